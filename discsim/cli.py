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
from discsim.launch import size_and_rank
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
    if size_and_rank()[1] == 0:  # of several MPI ranks, which find the same, one tells
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
    if size_and_rank()[0] > 1:
        raise SystemExit(_on_ranks(loaded, directory, resume, quiet))
    fault = directory_fault(directory, resume)
    if fault:
        _refuse(fault)
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(loaded, directory, resume=resume, quiet=quiet))


def _on_ranks(scene: Scene, directory: Path, resume: bool, quiet: bool) -> int:
    try:
        import mpi4py  # noqa: F401
    except ImportError:
        _refuse("started as several MPI ranks, but mpi4py is not installed; expected pip install 'discsim[mpi]'")
    from discsim.ranks.run import run_on_ranks

    return run_on_ranks(scene, directory, resume, quiet)


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


def _refuse_without_error(vary: list[str] | None, given: Mapping[str, object]) -> None:
    if not vary:
        _refuse("nothing to find; expected --error 1%, the cheapest setting for it, or --vary with values of a key")
    for name, value in given.items():
        if value:
            _refuse(f"{name}: goes with --error; expected that, or no {name}")


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
