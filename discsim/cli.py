"""The command line: what to run is checked here, before anything slow is imported or anything is written."""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from discsim import RARELY
from discsim.run.directory import DirectoryError, directory_fault, held

if TYPE_CHECKING:
    from discsim.scene import Scene

WRONG_INPUT = 2

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="2D circumstellar discs: SPH gas, particle-in-cell dust, FFT gravity, implicit drag-in-cell.",
)

SceneArgument = Annotated[Path, typer.Argument(help="Scene file (TOML).", metavar="SCENE.toml", readable=False)]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Change one value of the scene.")
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
def check(scene: SceneArgument, settings: SetOption = None, without: WithoutOption = None) -> None:
    """Validate a scene: the effects that will run, derived numbers, warnings."""
    loaded = _load(scene, settings or (), without or ())
    from discsim.preview.check import report

    typer.echo(report(loaded))


@app.command()
def cost(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="TABLE.KEY=A,B,...", help="Values of a key; of several at once: A.X,B.Y=1,2 or A.X,B.Y=1:5,2:6."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Directory of table and figure.")],
    repeat: Annotated[int, typer.Option(min=1, help="Runs of each, whose median is taken.")] = 1,
    parallel: Annotated[int, typer.Option(min=1, help="Runs at a time; more than one makes them slower.")] = 1,
    settings: SetOption = None,
    without: WithoutOption = None,
) -> None:
    """What accuracy costs in time: a table and a figure of errors against CPU seconds."""
    loaded = _load(scene, settings or (), without or ())
    from discsim.scene import SceneError

    try:
        from discsim.study.cost import Study
        from discsim.study.points import StudyError, Varied

        study = Study(scene, [Varied.from_text(text) for text in vary], repeat, output, settings or (), without or ())
        fault = directory_fault(output, resume=False)
        if fault:
            _refuse(fault)
        with held(output):
            study.make(loaded.title or str(scene), parallel)
    except (SceneError, StudyError, DirectoryError) as error:
        _refuse(str(error))


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


def _refuse(message: str) -> NoReturn:
    print(message, file=sys.stderr)
    raise SystemExit(WRONG_INPUT)


def main() -> None:
    """Entry point of the command `discsim`."""
    gc.set_threshold(*RARELY)
    app(prog_name="discsim")
