"""Code that all commands share: the typer app, error messages, common options, and loading of the scene.

A command raises UserError for a fault that the user can correct; `_Commands` prints the message.
"""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from discsim.launch import LaunchError, size_and_rank
from discsim.printable import UserError, printable_lines
from discsim.shipped import scene_file
from discsim.userfiles import system_message

if TYPE_CHECKING:
    from discsim.scene import Scene

NOT_WRITTEN, WRONG_INPUT, INTERRUPTED = 1, 2, 130


class _Commands(TyperGroup):
    """The group of all commands. A UserError or OSError in a command becomes a message and an exit status."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except UserError as error:
            fail(str(error))
        except OSError as fault:
            if fault.errno == errno.EPIPE:  # typer ends the process without a message
                raise
            fail(system_message(fault, "read or written", "a file"), NOT_WRITTEN)


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="2D circumstellar discs: SPH gas, particle-in-cell dust, FFT gravity, implicit drag-in-cell.",
)


def fail(message: str, status: int = WRONG_INPUT) -> NoReturn:
    """Print an error message on standard error, and exit with `status`.

    All MPI ranks find the same error, and only the first rank prints it.
    """
    try:
        is_first_rank = size_and_rank()[1] == 0
    except LaunchError:
        is_first_rank = True
    if is_first_rank:
        print(printable_lines(message), file=sys.stderr)
    raise SystemExit(status)


def show(text: object) -> None:
    """Print a text on standard output. Raises BrokenPipeError if standard output is a closed pipe."""
    try:
        typer.echo(printable_lines(text))
    except BrokenPipeError:
        raise
    except OSError as fault:
        fail(system_message(fault, "written", "standard output"), NOT_WRITTEN)


@contextmanager
def exit_on_fault(verb: str, path: Path | str, interrupted: str = "interrupted; no file was written") -> Iterator[None]:
    """Exit with a message if the block raises OSError or KeyboardInterrupt.

    verb, path: arguments of `system_message`. interrupted: message for KeyboardInterrupt.
    """
    try:
        yield
    except OSError as fault:
        fail(system_message(fault, verb, path), NOT_WRITTEN)
    except KeyboardInterrupt:
        fail(interrupted, INTERRUPTED)


SceneArgument = Annotated[
    Path,
    typer.Argument(
        help="Scene file (TOML), or the name of a setup.", metavar="SCENE.toml", readable=False, callback=scene_file
    ),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Change one value of the scene.")
]
WithoutOption = Annotated[
    list[str] | None, typer.Option(metavar="TABLE", help="Table of an effect to remove from the scene.")
]
UntilOption = Annotated[
    str | None, typer.Option(metavar="T", help='End time in place of run.until, like "100 yr" or "40 orbits".')
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Show only warnings and errors, on standard error.")]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TABLE.KEY=A,B,...",
        help="Values of one key, or of several keys that change together: A.X,B.Y=1,2 or A.X,B.Y=1:5,2:6.",
    ),
]


def _print_version(is_requested: bool) -> None:
    """Print the version and exit, if the option --version is given."""
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
    """Return the validated scene of the file `path`. Raises SceneError.

    overrides, without: values of the options --set and --without.
    """
    from discsim.scene import load_scene  # a slow import

    return load_scene(path, overrides, without)
