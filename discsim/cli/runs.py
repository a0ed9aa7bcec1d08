"""The commands that run scenes: `run`, `branch` and `sweep`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from discsim.cli.base import (
    QuietOption,
    SceneArgument,
    SetOption,
    UntilOption,
    VaryOption,
    WithoutOption,
    app,
    exit_on_fault,
    fail,
    load,
    show,
)
from discsim.launch import size_and_rank
from discsim.parts import install_command
from discsim.printable import printable
from discsim.run.directory import locked_directory, require_usable_directory

if TYPE_CHECKING:
    from discsim.scene import Scene


@app.command()
def run(
    scene: SceneArgument,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Output directory [runs/<name of the scene>]."),
    ] = None,
    settings: SetOption = None,
    without: WithoutOption = None,
    until: UntilOption = None,
    threads: Annotated[int | None, typer.Option(min=1, help="Number of threads; results do not depend on it.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the checkpoint in DIR.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Run a scene."""
    loaded = load(scene, _collect_overrides(settings, until=until, threads=threads), without or ())
    directory = output or Path("runs") / scene.stem
    if size_and_rank()[0] > 1:
        raise SystemExit(_run_on_mpi(loaded, directory, resume, quiet))
    require_usable_directory(directory, resume)
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(loaded, directory, resume=resume, quiet=quiet))


def _collect_overrides(settings: Sequence[str] | None, **run_keys: object) -> list[str]:
    """Return the values of --set, and those of options like --until that set a key of [run], for `load_scene`."""
    from discsim.scene.overrides import Option

    given = {key: value for key, value in run_keys.items() if value is not None}
    return [*(settings or ()), *(Option(f"--{key}", f"run.{key}", value) for key, value in given.items())]


def _run_on_mpi(scene: Scene, directory: Path, resume: bool, quiet: bool) -> int:
    """Run the scene on MPI ranks, and return the exit status of the process."""
    try:
        import mpi4py  # noqa: F401
    except ImportError:
        fail(f"started as several MPI ranks, but mpi4py is not installed; run: {install_command('mpi')}")
    from discsim.ranks.run import run_on_ranks

    return run_on_ranks(scene, directory, resume, quiet)


@app.command()
def branch(
    directory: Annotated[Path, typer.Argument(help="Directory of a run.", metavar="DIR")],
    at: Annotated[int | None, typer.Option(min=0, metavar="NUMBER", help="Number of the snapshot [the last].")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Directory of the new run [DIR-NUMBER].")
    ] = None,
    settings: SetOption = None,
    without: WithoutOption = None,
    until: UntilOption = None,
    preview: Annotated[
        bool, typer.Option("--check", help="Print the changes and the output of `check`, and stop.")
    ] = False,
    quiet: QuietOption = False,
) -> None:
    """Start a new run from a snapshot, with other physics. The time goes on."""
    from discsim.run.branch import branch as branch_of

    made = branch_of(directory, at, _collect_overrides(settings, until=until), without or ())
    into = output or directory.parent / f"{directory.resolve().name}-{made.snapshot.stem}"
    if not preview:
        require_usable_directory(into, resume=False)
    if preview or not quiet:
        show(made.text)
    if preview:
        from discsim.preview.check import report

        show(f"\n{report(made.scene)}")
        return
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(made.scene, into, quiet=quiet))


@app.command()
def sweep(
    scene: SceneArgument,
    vary: VaryOption = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Result to tabulate, like accreted_dust, dust-r50; may be repeated."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Directory of the runs [runs/<name>-sweep].")
    ] = None,
    parallel: Annotated[int, typer.Option(min=1, help="Number of simultaneous runs; they share the cores.")] = 1,
    settings: SetOption = None,
    without: WithoutOption = None,
) -> None:
    """Run a scene with every combination of some values. A table and a figure compare the results."""
    loaded = load(scene, settings or (), without or ())
    if not vary:
        fail("nothing to vary; add --vary with values of a key, like --vary dust.ratio=0.01,0.1")
    from rich.console import Console

    from discsim.study.points import Varied
    from discsim.study.sweep import RunError, Sweep

    directory = output or Path("runs") / f"{scene.stem}-sweep"
    require_usable_directory(directory, resume=False)
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    again = f"interrupted; repeat the command to continue with the runs in {directory}"
    try:
        with exit_on_fault("read or written", directory, again):
            varied = [Varied.from_text(text) for text in vary]
            made = Sweep(scene, varied, directory, measure or (), settings or (), without or ())
            with locked_directory(directory):
                made.make(loaded.title or printable(scene), parallel, console)
    except RunError as failed:
        raise SystemExit(failed.status) from None
