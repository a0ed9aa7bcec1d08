"""The command line: what to run is checked here, before anything slow is imported or anything is written."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from discsim import RARELY
from discsim.parts import PartError
from discsim.run.directory import DirectoryError, directory_fault, held
from discsim.shipped import ShippedError, copy_setup, scene_file
from discsim.shipped import setups as shipped_setups

if TYPE_CHECKING:
    from discsim.scene import Scene

NOT_WRITTEN, WRONG_INPUT, NOT_REACHED, INTERRUPTED = 1, 2, 4, 130

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="2D circumstellar discs: SPH gas, particle-in-cell dust, FFT gravity, implicit drag-in-cell.",
)


def _refuse(message: str, status: int = WRONG_INPUT) -> NoReturn:
    print(message, file=sys.stderr)
    raise SystemExit(status)


def _scene_file(given: Path) -> Path:
    try:
        return scene_file(given)
    except ShippedError as error:
        _refuse(str(error))


SceneArgument = Annotated[
    Path,
    typer.Argument(
        help="Scene file (TOML), or the name of a setup.", metavar="SCENE.toml", readable=False, callback=_scene_file
    ),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Change one value of the scene.")
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TABLE.KEY=A,B,...", help="Values of a key; of several at once: A.X,B.Y=1,2 or A.X,B.Y=1:5,2:6."
    ),
]
ReferenceOption = Annotated[
    list[str] | None,
    typer.Option(metavar="TABLE.KEY=VALUE", help="Of the finer run, without an exact solution [2 x particles]."),
]
WindowOption = Annotated[
    str | None, typer.Option(metavar="R", help='Part to show: "50 au", "10 au,50 au" in radius, "X,Y,R" on a map.')
]
DistanceOption = Annotated[
    str | None, typer.Option(metavar="D", help='For angles in arcsec and fluxes, like "140 pc".')
]
WavelengthOption = Annotated[str | None, typer.Option(metavar="L", help="Of emission and optical_depth [1.3 mm].")]
OpacityOption = Annotated[
    str | None, typer.Option(metavar="K", help='Per gram of dust, like "2 cm2/g" [10 cm2/g (nu / THz)].')
]
WithoutOption = Annotated[list[str] | None, typer.Option(metavar="TABLE", help="Remove an effect from the scene.")]


def _version(wanted: bool) -> None:
    if wanted:
        from discsim import __version__

        typer.echo(f"discsim {__version__}")
        raise typer.Exit


@app.callback()
def _discsim(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    scene: SceneArgument,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Output directory [runs/<name of the scene>]."),
    ] = None,
    settings: SetOption = None,
    without: WithoutOption = None,
    until: Annotated[str | None, typer.Option(metavar="T", help='End time, as in run.until: "100 yr".')] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; results do not depend on it.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint in DIR.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Run a scene."""
    overrides = list(settings or ())
    if until is not None:
        overrides.append(f"run.until={until}")
    if threads is not None:
        overrides.append(f"run.threads={threads}")
    loaded = _load(scene, overrides, without or ())
    directory = output or Path("runs") / scene.stem
    fault = directory_fault(directory, resume)
    if fault:
        _refuse(fault)
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(loaded, directory, resume=resume, quiet=quiet))


@app.command()
def branch(
    directory: Annotated[Path, typer.Argument(help="Directory of a run.", metavar="DIR")],
    at: Annotated[int | None, typer.Option(min=0, metavar="NUMBER", help="Of the snapshot [the last].")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Directory of the new run [DIR-NUMBER].")
    ] = None,
    settings: SetOption = None,
    without: WithoutOption = None,
    until: Annotated[str | None, typer.Option(metavar="T", help='End time, as in run.until: "100 yr".')] = None,
    preview: Annotated[bool, typer.Option("--check", help="Say what changes, as `check` does, and stop.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """A new run from a snapshot of a run, with other physics: the time goes on."""
    from discsim.run.branch import BranchError
    from discsim.run.branch import branch as branch_of
    from discsim.scene import SceneError

    try:
        made = branch_of(directory, at, [*(settings or ()), *([f"run.until={until}"] if until else [])], without or ())
    except (BranchError, SceneError) as error:
        _refuse(str(error))
    into = output or directory.parent / f"{directory.resolve().name}-{made.snapshot.stem}"
    fault = None if preview else directory_fault(into, resume=False)
    if fault:
        _refuse(fault)
    if preview or not quiet:
        typer.echo(made.words)
    if preview:
        from discsim.preview.check import report

        typer.echo(f"\n{report(made.scene)}")
        return
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(made.scene, into, quiet=quiet))


@app.command()
def check(scene: SceneArgument, settings: SetOption = None, without: WithoutOption = None) -> None:
    """Validate a scene: the effects that will run, derived numbers, warnings."""
    loaded = _load(scene, settings or (), without or ())
    from discsim.preview.check import report

    typer.echo(report(loaded))


@app.command()
def cost(
    scene: SceneArgument,
    error: Annotated[
        str | None,
        typer.Option(metavar="E", help='Find the cheapest setting with this error: "1%", or "scene" for its own.'),
    ] = None,
    vary: VaryOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Directory of table and figure [runs/<name>-cost]."),
    ] = None,
    budget: Annotated[str, typer.Option(metavar="T", help="Wall-clock time that a search may take.")] = "1 h",
    measure: Annotated[
        str | None, typer.Option(metavar="NAME", help="What the error is of, like exact, dust-profile, gas-modes.")
    ] = None,
    reference: ReferenceOption = None,
    keep: Annotated[
        list[str] | None, typer.Option(metavar="TABLE.KEY", help="A key that a search leaves alone.")
    ] = None,
    repeat: Annotated[int | None, typer.Option(min=1, help="Runs of each [1]; of a search's finalists [3].")] = None,
    parallel: Annotated[int, typer.Option(min=1, help="Runs at a time; more than one makes them slower.")] = 1,
    settings: SetOption = None,
    without: WithoutOption = None,
) -> None:
    """What accuracy costs in time: a table of runs with --vary, the cheapest setting with --error."""
    loaded = _load(scene, settings or (), without or ())
    from discsim.scene import SceneError

    changed = settings or (), without or ()
    directory = output or Path("runs") / f"{scene.stem}-{'cost' if error is None else 'cheapest'}"
    title = loaded.title or str(scene)
    try:
        from discsim.study.points import StudyError, Varied

        varied = [Varied.from_text(text) for text in vary or ()]
        make: Callable[[], bool]
        if error is None:
            _refuse_without_error(vary, {"--measure": measure, "--reference": reference, "--keep": keep})
            from discsim.study.cost import Study

            make = partial(Study(scene, varied, repeat or 1, directory, *changed).make, title, parallel)
        else:
            from discsim.study.cheapest import Cheapest, wanted

            search = wanted(error, budget, measure, reference or (), varied, keep or (), repeat or 3, parallel)
            make = partial(Cheapest(scene, directory, search, *changed).make, title)
        fault = directory_fault(directory, resume=False)
        if fault:
            _refuse(fault)
        with held(directory):
            reached = make()
    except (SceneError, StudyError, DirectoryError) as wrong:
        _refuse(str(wrong))
    except KeyboardInterrupt:
        _refuse(f"interrupted; the same command goes on with the runs in {directory}", INTERRUPTED)
    if not reached:
        raise SystemExit(NOT_REACHED)


@app.command()
def sweep(
    scene: SceneArgument,
    vary: VaryOption = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="What is told of each run, like accreted_dust, dust-r50; several times."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Directory of the runs [runs/<name>-sweep].")
    ] = None,
    parallel: Annotated[int, typer.Option(min=1, help="Runs at a time; they share the cores.")] = 1,
    settings: SetOption = None,
    without: WithoutOption = None,
) -> None:
    """Runs with every combination of some values, a directory each, and a table and a figure of what they came to."""
    loaded = _load(scene, settings or (), without or ())
    if not vary:
        _refuse("nothing to vary; expected --vary with values of a key, like --vary dust.ratio=0.01,0.1")
    from rich.console import Console

    from discsim.output.snapshot import SnapshotError
    from discsim.scene import SceneError
    from discsim.study.points import StudyError, Varied
    from discsim.study.sweep import RunFailed, Sweep

    directory = output or Path("runs") / f"{scene.stem}-sweep"
    fault = directory_fault(directory, resume=False)
    if fault:
        _refuse(fault)
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    try:
        varied = [Varied.from_text(text) for text in vary]
        made = Sweep(scene, varied, directory, measure or (), settings or (), without or ())
        with held(directory):
            made.make(loaded.title or str(scene), parallel, console)
    except (SceneError, StudyError, DirectoryError, SnapshotError) as wrong:
        _refuse(str(wrong))
    except RunFailed as failed:
        raise SystemExit(failed.status) from None
    except OSError as error:
        _refuse(f"{error.filename or directory}: {error.strerror}", NOT_WRITTEN)
    except KeyboardInterrupt:
        _refuse(f"interrupted; the same command goes on with the runs in {directory}", INTERRUPTED)


def _refuse_without_error(vary: list[str] | None, given: Mapping[str, object]) -> None:
    if not vary:
        _refuse("nothing to find; expected --error 1%, the cheapest setting for it, or --vary with values of a key")
    for name, value in given.items():
        if value:
            _refuse(f"{name}: goes with --error; expected that, or no {name}")


@app.command()
def report(
    directory: Annotated[Path, typer.Argument(help="Directory of a run.", metavar="DIR")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="The page [DIR/report.html].")
    ] = None,
) -> None:
    """A page of a run, for a browser or for paper: pictures, conservation, cost, effects with equations, scene."""
    from discsim.output.snapshot import SnapshotError
    from discsim.report.page import ReportError, write_report
    from discsim.scene import SceneError
    from discsim.study.points import StudyError

    path = output or directory / "report.html"
    try:
        write_report(directory, path)
    except (ReportError, SceneError, SnapshotError, StudyError) as wrong:
        _refuse(str(wrong))
    except OSError as error:
        _refuse(f"{error.filename or path}: {error.strerror}", NOT_WRITTEN)
    typer.echo(f"{path}: a page of the run in {directory}")


@app.command()
def plot(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="DIR|FILE...", help="Directories of runs, or snapshots.")
    ] = None,
    field: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Fields, like toomre_q or dust.v_r [surface_density].")
    ] = None,
    fields: Annotated[bool, typer.Option("--fields", help="List the fields: units and equations.")] = False,
    profile: Annotated[bool, typer.Option("--profile", help="Against radius, in place of maps.")] = False,
    polar: Annotated[bool, typer.Option("--polar", help="In angle and radius.")] = False,
    time: Annotated[bool, typer.Option("--time", help="In radius and time, of all snapshots.")] = False,
    against: Annotated[
        str | None, typer.Option(metavar="NAME", help="Particles over this field, like radius, and --field.")
    ] = None,
    at: Annotated[
        list[str] | None, typer.Option(metavar="T", help='The snapshot nearest to "700 yr" [the last].')
    ] = None,
    compare: Annotated[Path | None, typer.Option(metavar="DIR|FILE", help="What it has over the first.")] = None,
    window: WindowOption = None,
    limits: Annotated[str | None, typer.Option("--range", metavar="LOW,HIGH", help="Of colours or axis.")] = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="png, pdf or svg [DIR/plots/...png].")
    ] = None,
) -> None:
    """Draw a run or snapshots: maps, profiles, fields in time."""
    if fields:
        from discsim.output.fields.names import table

        typer.echo(table())
        return
    kinds = {"--profile": profile, "--polar": polar, "--time": time, "--against": against is not None}
    given = [name for name, there in kinds.items() if there]
    if not sources or len(given) > 1:
        _refuse(
            "no run to draw; expected DIR or FILE" if not sources else f"{' and '.join(given)}: expected one of them"
        )
    from discsim.plot.request import Request, look_of, save, usual_path

    kind = "phase" if against else given[0].removeprefix("--") if given else None

    def make() -> Path:
        request = Request(
            [*sources, *([compare] if compare else [])],
            field.split(",") if field else (),
            kind,
            at or (),
            against,
            compare is not None,
            look_of(window, limits, distance, wavelength, opacity),
        )
        where = output or usual_path(request)
        save(request.figure, where)
        return where

    typer.echo(_drawn(make))


@app.command()
def movie(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a run.")],
    field: Annotated[str | None, typer.Option(metavar="NAME,...", help="Fields [surface_density].")] = None,
    polar: Annotated[bool, typer.Option("--polar", help="In angle and radius.")] = False,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Snapshots a second.")] = 10.0,
    window: WindowOption = None,
    limits: Annotated[str | None, typer.Option("--range", metavar="LOW,HIGH", help="Of colours.")] = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="mp4 or gif [DIR/plots/...].")
    ] = None,
) -> None:
    """Make a film of a run, a frame a snapshot."""
    from discsim.plot.film import Film, usual_path
    from discsim.plot.request import look_of

    def make() -> Path:
        look = look_of(window, limits, distance, wavelength, opacity)
        film = Film(source, field.split(",") if field else (), "polar" if polar else "map", rate, look)
        where = output or usual_path(film)
        film.save(where, _count if sys.stderr.isatty() else None)
        return where

    typer.echo(_drawn(make))


def _count(done: int, of: int) -> None:
    print(f"\rframe {done} of {of}", end="\n" if done == of else "", file=sys.stderr, flush=True)


def _drawn(make: Callable[[], Path]) -> Path:
    """What draws a figure or film, with its faults as messages."""
    from discsim.output.fields.base import FieldError
    from discsim.output.snapshot import SnapshotError
    from discsim.plot.sources import PlotError

    try:
        return make()
    except (FieldError, PlotError, SnapshotError) as wrong:
        _refuse(str(wrong))
    except OSError as error:
        _refuse(f"{error.filename or 'the figure'}: cannot be written: {error.strerror}", NOT_WRITTEN)
    except KeyboardInterrupt:
        _refuse("interrupted; nothing was written", INTERRUPTED)


@app.command()
def setups() -> None:
    """List the setups that come with discsim: name, title, what it is and how long it takes."""
    for each in shipped_setups().values():
        takes = each.notes.get("How long", "").partition(",")[0].rstrip(".")
        typer.echo(f"{each.name:<18} {each.title}{f' ({takes})' if takes else ''}\n{'':<18} {each.about}".rstrip())


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of a setup, as `discsim setups` lists them.")],
    file: Annotated[
        Path | None, typer.Argument(help="New scene file [NAME.toml].", metavar="[FILE.toml]", readable=False)
    ] = None,
) -> None:
    """Copy a setup that comes with discsim, as the start of a scene of one's own."""
    path = file or Path(f"{name}.toml")
    try:
        copy_setup(name, path)
    except ShippedError as error:
        _refuse(str(error))
    except OSError as error:
        _refuse(f"{path}: cannot be written: {error.strerror}", NOT_WRITTEN)
    typer.echo(f"{path}: a copy of the setup {name}; run it with: discsim run {path}")


@app.command()
def effects() -> None:
    """List every effect: its equation, its keys with units and defaults."""
    from discsim.preview.reference import effects_text

    typer.echo(effects_text())


def _load(path: Path, overrides: Sequence[str], without: Sequence[str]) -> Scene:
    from discsim.scene import SceneError, load_scene

    try:
        return load_scene(path, overrides, without)
    except SceneError as error:
        _refuse(str(error))


def main() -> None:
    """Entry point of the command `discsim`."""
    gc.set_threshold(*RARELY)
    try:
        app(prog_name="discsim")
    except PartError as error:
        _refuse(str(error))
