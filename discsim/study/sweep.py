"""A sweep: runs of a scene with all combinations of given values, each in its own directory.

When the command is repeated, unfinished runs resume from their checkpoints. Results are read from the directories.
"""

from __future__ import annotations

import csv
import multiprocessing
import os
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from discsim.output.files import replace_atomically
from discsim.printable import printable
from discsim.run.directory import ended_before_checkpoint, read_scene_file
from discsim.scene import load_scene
from discsim.scene.differences import refuse_changed_scene
from discsim.study.outcomes import read_results, select_outcomes
from discsim.study.points import Point, StudyError, Varied, axis_of, combinations, keys_of, label_of, short_names
from discsim.study.runs import Runs, Say
from discsim.study.workers import end_with_parent, failure_text, results
from discsim.version import __version__

DONE, REFUSED, PHYSICS, FAILED, INTERRUPTED = 0, 2, 3, 70, 128  # exit statuses of a run; interrupted: 128 + the signal
FAILURE_TEXT = {
    REFUSED: "could not start", PHYSICS: "stopped by a numerical failure", FAILED: "ended by an error of discsim",
}  # fmt: skip
TIME_TOLERANCE = 1e-9  # relative tolerance of the end time


class RunError(Exception):
    """A run failed, and has printed the reason; `status` is its exit status."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class Sweep:
    """A sweep: combinations of values of the keys `varied`, and their runs. Raises StudyError, SceneError.

    directory: contains the directories of the runs. measures: names of the results to compare. settings, without:
    changes of the scene for all runs.
    """

    def __init__(
        self, scene: Path, varied: Sequence[Varied], directory: Path, measures: Sequence[str] = (),
        settings: Sequence[str] = (), without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.varied, self.directory = tuple(varied), directory
        self.runs = Runs(scene, directory, settings, without)
        self.keys, self.axis = keys_of(self.varied), axis_of(self.varied)
        self.points = combinations(self.varied)
        self.scenes = [self.runs.scene(point.settings) for point in self.points]
        self.measures = select_outcomes(self.scenes[0], measures)
        names = [each.name for each in self.measures]
        self.wanted = [select_outcomes(each, names) for each in self.scenes]  # scenes may have different units
        self.folders = [directory / folder_name(point) for point in self.points]
        for folder in self.folders:
            if self.folders.count(folder) > 1:
                wrong = f"{folder}: two combinations of values have this directory name"
                raise StudyError(f"{wrong}; choose values that differ in letters or digits")

    def make(self, title: str, parallel: int, console: Console) -> None:
        """Make the runs that are not finished, `parallel` at a time, and write the table and the figure of all runs.

        A run that cannot start, or that fails, is reported and has no values in the table. Raises SceneError if a
        directory has a run of another scene, DirectoryError if its scene cannot be read, and RunError if all runs
        fail. Raises KeyboardInterrupt after an interrupt, when the active runs have written their checkpoints.
        """
        self._refuse_other_scenes()
        say: Say = console.print
        say(f"discsim {__version__}\n{title}: {len(self.points)} combinations, into {printable(self.directory)}")
        given_up = []
        for number, status in enumerate(self._statuses(parallel, say)):
            if status > INTERRUPTED:
                raise KeyboardInterrupt
            if status != DONE and status not in FAILURE_TEXT:
                raise RunError(status)
            given_up += [status] if status in (REFUSED, FAILED) else []
            point = self.points[number]
            point.runs = [self._result(number, status)]
            say(f"{number + 1}/{len(self.points)}  {label_of(point.settings)}: {self._result_text(point)}")
            self.write()
        if len(given_up) == len(self.points):
            raise RunError(given_up[0])
        from discsim.study.sweepfigure import sweep_figure  # imported here, as it is slow

        with replace_atomically(self.directory / "sweep.png", ".png") as temporary:
            sweep_figure(self, temporary)
        console.print(self.table())
        say(f"table {printable(self.directory / 'sweep.csv')}")
        say(f"figure {printable(self.directory / 'sweep.png')}")

    def _refuse_other_scenes(self) -> None:
        """Raise SceneError if a directory has a run of another scene, DirectoryError if its scene cannot be read.

        Nothing is written before this check.
        """
        for folder, scene in zip(self.folders, self.scenes, strict=True):
            path = folder / "scene.toml"
            if path.exists():
                refuse_changed_scene(path, read_scene_file(folder), scene)

    def _statuses(self, parallel: int, say: Say) -> Iterator[int]:
        """Make the runs, `parallel` at a time, and yield their exit statuses in order.

        With `parallel` = 1 a run starts when its status is requested.
        """
        threads = f"run.threads={max(1, len(os.sched_getaffinity(0)) // parallel)}"
        jobs = []
        for point, folder, scene in zip(self.points, self.folders, self.scenes, strict=True):
            shared = [threads] if parallel > 1 and scene.run.threads is None else []
            jobs.append((self.runs.path, [*self.runs.overrides(point.settings), *shared], self.runs.without, folder))
        if parallel == 1:
            for number, job in enumerate(jobs, 1):
                say(f"{number}/{len(jobs)}  {printable(job[-1])}: its progress is in run.log")
                yield run_or_resume(*job)
            return
        with ProcessPoolExecutor(parallel, initializer=_set_up_worker) as pool:
            before = signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                yield from results((pool.submit(run_or_resume, *job) for job in jobs), say)
            except BaseException:
                for process in multiprocessing.active_children():
                    os.kill(process.pid, signal.SIGINT)
                pool.shutdown(cancel_futures=True)
                raise
            finally:
                signal.signal(signal.SIGTERM, before)

    def _result(self, number: int, status: int) -> dict[str, Any]:
        """Return the results of run `number` by name; for an unfinished run {"stopped": reason}."""
        if status in FAILURE_TEXT:
            return {"stopped": FAILURE_TEXT[status]}
        scene = self.scenes[number]
        found = read_results(self.folders[number], scene, self.wanted[number])
        if found.time < (1.0 - TIME_TOLERANCE) * scene.run.until:
            return {"stopped": f"stopped at t = {scene.show_time(found.time)}"}
        return found.values

    def _result_text(self, point: Point) -> str:
        """Return the results of a combination as text, or the reason why it has none."""
        if not point.done:
            return str(point.runs[0]["stopped"])
        return ", ".join(f"{each.name} {point.runs[0][each.name]:.4g} {each.unit}".rstrip() for each in self.measures)

    # Findings

    def table(self) -> Table:
        """Return the table of settings and results for the terminal."""
        out = Table(*short_names(self.keys), *(each.head for each in self.measures), box=SIMPLE)
        for point in self.points:
            numbers = [f"{point.runs[0][each.name]:.4g}" for each in self.measures] if point.done else []
            out.add_row(*map(printable, point.settings.values()), *(numbers or [self._result_text(point)]))
        return out

    def write(self) -> None:
        """Write the table sweep.csv; the file appears when it is complete."""
        with replace_atomically(self.directory / "sweep.csv") as temporary, temporary.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow([*self.keys, *(each.head for each in self.measures), "status", "directory"])
            for point, folder in zip(self.points, self.folders, strict=True):
                values = [point.runs[0][each.name] if point.done else None for each in self.measures]
                status = "not run" if not point.runs else "done" if point.done else point.runs[0]["stopped"]
                rows.writerow([*point.settings.values(), *values, status, folder.name])


def folder_name(point: Point) -> str:
    """Return the directory name of a combination: its settings, without special characters."""
    return re.sub(r"[^\w.,=+-]+", "", label_of(point.settings))


def run_or_resume(path: Path, overrides: Sequence[str], without: Sequence[str], directory: Path) -> int:
    """Make the run in a directory, or resume it, and return its exit status.

    An exception is printed as one line on standard error.
    """
    from discsim.run.runner import run_scene

    begun = (directory / "checkpoint.h5").exists() or ended_before_checkpoint(directory)
    try:
        return run_scene(load_scene(path, overrides, without), directory, resume=begun, quiet=True)
    except Exception as fault:  # the sweep continues after any failure of a run
        print(printable(f"{directory}: {failure_text(fault)}"), file=sys.stderr)
        return FAILED


def _set_up_worker() -> None:
    """Set up a worker process so that Ctrl-C in the terminal interrupts only its parent process.

    The parent then sends one interrupt to every worker.
    """
    end_with_parent()
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
