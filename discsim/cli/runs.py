"""The commands that run scenes: `run`, `branch` and `sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from discsim.cli.base import (
    INTERRUPTED,
    NOT_WRITTEN,
    SceneArgument,
    SetOption,
    VaryOption,
    WithoutOption,
    app,
    fail,
    load,
    show,
)
from discsim.launch import size_and_rank
from discsim.parts import install_command
from discsim.printable import printable
from discsim.run.directory import DirectoryError, directory_fault, held
from discsim.userfiles import system_message

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
    until: Annotated[str | None, typer.Option(metavar="T", help='End time, as in run.until: "100 yr".')] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="Number of threads; results do not depend on it.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the checkpoint in DIR.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Do not show progress.")] = False,
) -> None:
    """Run a scene."""
    from discsim.scene.overrides import Option

    overrides: list[str] = list(settings or ())
    if until is not None:
        overrides.append(Option("--until", "run.until", until))
    if threads is not None:
        overrides.append(Option("--threads", "run.threads", threads))
    loaded = load(scene, overrides, without or ())
    directory = output or Path("runs") / scene.stem
    if size_and_rank()[0] > 1:
        raise SystemExit(_run_on_mpi(loaded, directory, resume, quiet))
    fault = directory_fault(directory, resume)
    if fault:
        fail(fault)
    from discsim.run.runner import run_scene

    raise SystemExit(run_scene(loaded, directory, resume=resume, quiet=quiet))


def _run_on_mpi(scene: Scene, directory: Path, resume: bool, quiet: bool) -> int:
    """Run the scene on MPI ranks, and return the exit status of the process."""
    try:
        import mpi4py  # noqa: F401
    except ImportError:
        fail(f"started as several MPI ranks, but mpi4py is not installed; expected {install_command('mpi')}")
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
    until: Annotated[str | None, typer.Option(metavar="T", help='End time, as in run.until: "100 yr".')] = None,
    preview: Annotated[
        bool, typer.Option("--check", help="Print the changes and the output of `check`, and stop.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Do not show progress.")] = False,
) -> None:
    """Start a new run from a snapshot, with other physics. The time goes on."""
    from discsim.run.branch import BranchError
    from discsim.run.branch import branch as branch_of
    from discsim.scene import SceneError
    from discsim.scene.overrides import Option

    try:
        ends = [] if until is None else [Option("--until", "run.until", until)]
        made = branch_of(directory, at, [*(settings or ()), *ends], without or ())
    except (BranchError, SceneError) as error:
        fail(str(error))
    into = output or directory.parent / f"{directory.resolve().name}-{made.snapshot.stem}"
    fault = None if preview else directory_fault(into, resume=False)
    if fault:
        fail(fault)
    if preview or not quiet:
        show(made.words)
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
        fail("nothing to vary; expected --vary with values of a key, like --vary dust.ratio=0.01,0.1")
    from rich.console import Console

    from discsim.output.snapshot import SnapshotError
    from discsim.scene import SceneError
    from discsim.study.points import StudyError, Varied
    from discsim.study.sweep import RunError, Sweep

    directory = output or Path("runs") / f"{scene.stem}-sweep"
    fault = directory_fault(directory, resume=False)
    if fault:
        fail(fault)
    console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
    try:
        varied = [Varied.from_text(text) for text in vary]
        made = Sweep(scene, varied, directory, measure or (), settings or (), without or ())
        with held(directory):
            made.make(loaded.title or printable(scene), parallel, console)
    except (SceneError, StudyError, DirectoryError, SnapshotError) as wrong:
        fail(str(wrong))
    except RunError as failed:
        raise SystemExit(failed.status) from None
    except OSError as error:
        fail(system_message(error, "read or written", directory), NOT_WRITTEN)
    except KeyboardInterrupt:
        fail(f"interrupted; repeat the command to continue with the runs in {directory}", INTERRUPTED)
