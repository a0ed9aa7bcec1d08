"""A sweep: a scene run with every combination of some values, each in a directory of its own, and what they came to.

A run that was stopped goes on from its checkpoint when the sweep is made again; results are read from the directories.
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

from discsim import __version__
from discsim.output.files import written
from discsim.printable import printable
from discsim.run.directory import only_begun, scene_there
from discsim.scene import load_scene
from discsim.scene.differences import refuse_another
from discsim.study.outcomes import chosen, found_in
from discsim.study.points import Point, StudyError, Varied, axis_of, combinations, label_of, leaves
from discsim.study.runs import Runs, Say
from discsim.study.workers import end_with_parent, in_words, results

DONE, REFUSED, PHYSICS, FAILED, INTERRUPTED = 0, 2, 3, 70, 128  # exit statuses of a run; interrupted: 128 + the signal
GIVEN_UP = {
    REFUSED: "could not start", PHYSICS: "stopped by the physics", FAILED: "ended by an error of discsim",
}  # fmt: skip
REACHED = 1e-9  # share of the end by which a run may miss it


class RunFailed(Exception):
    """A run that could not be made: its exit status; it has said why."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class Sweep:
    """The runs of a sweep and the directory that they are in. Raises StudyError, SceneError."""

    def __init__(
        self, scene: Path, varied: Sequence[Varied], directory: Path, measures: Sequence[str] = (),
        settings: Sequence[str] = (), without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.varied, self.directory = tuple(varied), directory
        self.runs = Runs(scene, directory, settings, without)
        self.points = combinations(self.varied)
        self.scenes = [self.runs.scene(point.settings) for point in self.points]
        self.measures = chosen(self.scenes[0], measures)
        names = [each.name for each in self.measures]
        self.wanted = [chosen(each, names) for each in self.scenes]  # units of scenes may differ
        self.folders = [directory / folder_name(point) for point in self.points]
        for folder in self.folders:
            if self.folders.count(folder) > 1:
                raise StudyError(f"{folder}: of two combinations; expected values that differ in letters or numbers")

    @property
    def keys(self) -> list[str]:
        return [key for each in self.varied for key in each.keys]

    def make(self, title: str, parallel: int, console: Console) -> None:
        """Make the runs that are not at their end, and the table and the figure of all.

        A run that its start refuses, or that fails, is told and left out. Raises SceneError where runs of other scenes
        are there, DirectoryError where one cannot be read, RunFailed where no run could be made, and KeyboardInterrupt
        once the runs that were going on have written their checkpoints.
        """
        self._refuse_others()
        say: Say = console.print
        say(f"discsim {__version__}\n{title}: {len(self.points)} combinations, into {printable(self.directory)}")
        given_up = []
        for number, status in enumerate(self._statuses(parallel, say)):
            if status > INTERRUPTED:
                raise KeyboardInterrupt
            if status != DONE and status not in GIVEN_UP:
                raise RunFailed(status)
            given_up += [status] if status in (REFUSED, FAILED) else []
            point = self.points[number]
            point.runs = [self._result(number, status)]
            say(f"{number + 1}/{len(self.points)}  {label_of(point.settings)}: {self._words(point)}")
            self.write()
        if len(given_up) == len(self.points):
            raise RunFailed(given_up[0])
        from discsim.study.sweepfigure import sweep_figure  # slow to import, and needed only here

        with written(self.directory / "sweep.png", ".png") as temporary:
            sweep_figure(self, temporary)
        console.print(self.table())
        say(f"table {printable(self.directory / 'sweep.csv')}")
        say(f"figure {printable(self.directory / 'sweep.png')}")

    def _refuse_others(self) -> None:
        """Raise SceneError where a directory holds a run of another scene, DirectoryError where its scene cannot be
        read: nothing is written then.
        """
        for folder, scene in zip(self.folders, self.scenes, strict=True):
            path = folder / "scene.toml"
            if path.exists():
                refuse_another(path, scene_there(folder), scene)

    def _statuses(self, parallel: int, say: Say) -> Iterator[int]:
        """Exit statuses of the runs in their order, made as they are asked for, or so many at a time."""
        threads = f"run.threads={max(1, len(os.sched_getaffinity(0)) // parallel)}"
        jobs = []
        for point, folder, scene in zip(self.points, self.folders, self.scenes, strict=True):
            shared = [threads] if parallel > 1 and scene.run.threads is None else []
            jobs.append((self.runs.path, [*self.runs.overrides(point.settings), *shared], self.runs.without, folder))
        if parallel == 1:
            for number, job in enumerate(jobs, 1):
                say(f"{number}/{len(jobs)}  {printable(job[-1])}: its progress is in run.log")
                yield one_run(*job)
            return
        with ProcessPoolExecutor(parallel, initializer=_leave_interrupts) as pool:
            before = signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                yield from results((pool.submit(one_run, *job) for job in jobs), say)
            except BaseException:
                for process in multiprocessing.active_children():
                    os.kill(process.pid, signal.SIGINT)
                pool.shutdown(cancel_futures=True)
                raise
            finally:
                signal.signal(signal.SIGTERM, before)

    def _result(self, number: int, status: int) -> dict[str, Any]:
        if status in GIVEN_UP:
            return {"stopped": GIVEN_UP[status]}
        scene = self.scenes[number]
        found = found_in(self.folders[number], scene, self.wanted[number])
        if found.time < (1.0 - REACHED) * scene.run.until:
            return {"stopped": f"stopped at t = {scene.units.show_time(found.time)}"}
        return found.values

    def _words(self, point: Point) -> str:
        if not point.done:
            return str(point.runs[0]["stopped"])
        return ", ".join(f"{each.name} {point.runs[0][each.name]:.4g} {each.unit}".rstrip() for each in self.measures)

    # Findings

    @property
    def axis(self) -> Varied | None:
        return axis_of(self.varied)

    def table(self) -> Table:
        out = Table(*leaves(self.keys), *(each.head for each in self.measures), box=SIMPLE)
        for point in self.points:
            numbers = [f"{point.runs[0][each.name]:.4g}" for each in self.measures] if point.done else []
            out.add_row(*map(printable, point.settings.values()), *(numbers or [self._words(point)]))
        return out

    def write(self) -> None:
        """sweep.csv, which appears whole."""
        with written(self.directory / "sweep.csv") as temporary, temporary.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow([*self.keys, *(each.head for each in self.measures), "status", "directory"])
            for point, folder in zip(self.points, self.folders, strict=True):
                values = [point.runs[0][each.name] if point.done else None for each in self.measures]
                status = "not run" if not point.runs else "done" if point.done else point.runs[0]["stopped"]
                rows.writerow([*point.settings.values(), *values, status, folder.name])


def folder_name(point: Point) -> str:
    """The settings of a combination as a name that shells and file systems take."""
    return re.sub(r"[^\w.,=+-]+", "", label_of(point.settings))


def one_run(path: Path, overrides: Sequence[str], without: Sequence[str], directory: Path) -> int:
    """Make a run, or go on with the one there; its exit status. What is wrong is one message on stderr."""
    from discsim.run.runner import run_scene

    begun = (directory / "checkpoint.h5").exists() or only_begun(directory)
    try:
        return run_scene(load_scene(path, overrides, without), directory, resume=begun, quiet=True)
    except Exception as fault:  # a run that fails in any way is given up, and the sweep goes on with the others
        print(printable(f"{directory}: {in_words(fault)}"), file=sys.stderr)
        return FAILED


def _leave_interrupts() -> None:
    """For processes whose parent tells them, once, that somebody interrupts; Ctrl-C on a terminal tells all."""
    end_with_parent()
    os.setsid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
