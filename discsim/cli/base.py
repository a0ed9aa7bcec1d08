"""Code that all commands share: the typer app, error messages, common options, and loading of the scene."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from discsim import shipped
from discsim.launch import LaunchError, size_and_rank
from discsim.printable import printable_lines
from discsim.userfiles import system_message

if TYPE_CHECKING:
    from discsim.scene import Scene

NOT_WRITTEN, WRONG_INPUT, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="2D circumstellar discs: SPH gas, particle-in-cell dust, FFT gravity, implicit drag-in-cell.",
)


def fail(message: str, status: int = WRONG_INPUT) -> NoReturn:
    """Print an error message on standard error, and exit with `status`. Of several MPI ranks, only the first prints."""
    try:
        is_first_rank = size_and_rank()[1] == 0  # all MPI ranks find the same error, and only the first prints it
    except LaunchError:
        is_first_rank = True
    if is_first_rank:
        print(printable_lines(message), file=sys.stderr)
    raise SystemExit(status)


def show(text: object) -> None:
    """Print lines on standard output. Raises BrokenPipeError if the reader of the pipe is gone."""
    try:
        typer.echo(printable_lines(text))
    except BrokenPipeError:
        raise
    except OSError as fault:
        fail(system_message(fault, "written", "standard output"), NOT_WRITTEN)


def _scene_file(given: Path) -> Path:
    try:
        return shipped.scene_file(given)
    except shipped.ShippedError as error:
        fail(str(error))


SceneArgument = Annotated[
    Path,
    typer.Argument(
        help="Scene file (TOML), or the name of a setup.", metavar="SCENE.toml", readable=False, callback=_scene_file
    ),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Change one value of the scene.")
]
WithoutOption = Annotated[list[str] | None, typer.Option(metavar="TABLE", help="Remove an effect from the scene.")]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TABLE.KEY=A,B,...",
        help="Values of one key, or of several keys that change together: A.X,B.Y=1,2 or A.X,B.Y=1:5,2:6.",
    ),
]


def _print_version(is_requested: bool) -> None:
    if is_requested:
        from discsim.version import __version__

        show(f"discsim {__version__}")
        raise typer.Exit


@app.callback()
def _discsim(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def load(path: Path, overrides: Sequence[str], without: Sequence[str]) -> Scene:
    """Return the validated scene of a file; if it has faults, print them and exit.

    overrides, without: values of the options --set and --without.
    """
    from discsim.scene import SceneError, load_scene

    try:
        return load_scene(path, overrides, without)
    except SceneError as error:
        fail(str(error))
