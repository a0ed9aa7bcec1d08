"""Cost study: runs of a scene with all combinations of given values, to compare their errors and CPU times.

All combinations are run once before any combination is repeated, so that high load on the computer affects all of
them equally.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from discsim.output.files import replace_atomically
from discsim.printable import printable
from discsim.scene.units import clock
from discsim.study.errors import measure_of, profile_errors
from discsim.study.findings import print_results
from discsim.study.points import (
    Point,
    StudyError,
    Varied,
    axis_of,
    combinations,
    keys_of,
    label_of,
    pareto_front,
    points_by_line,
)
from discsim.study.runs import RUNS, LoggedConsole, Runs, Say
from discsim.version import __version__


class Study:
    """A cost study: combinations of values of the keys `varied`, and their runs. Raises StudyError, SceneError.

    repeat: number of runs of each combination. settings, without: changes of the scene for all runs. The attribute
    `reference` is the combination with which the others are compared, if there is no exact solution; `title` is the
    title of the scene, or the name of its file.
    """

    def __init__(
        self, scene: Path, varied: Sequence[Varied], repeat: int, directory: Path,
        settings: Sequence[str] = (), without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.varied, self.repeat, self.directory = tuple(varied), repeat, directory
        self.runs = Runs(scene, directory, settings, without)
        self.keys, self.axis = keys_of(self.varied), axis_of(self.varied)
        self.points = combinations(self.varied)
        scenes = [self.runs.scene(point.settings) for point in self.points]
        self.title = scenes[0].title or scene.stem
        measures = [measure_of(each) for each in scenes]
        # How the error against the exact solution is defined, as text; None if a combination has no exact solution.
        self.exact_error = measures[0].words if all(measures) and measures[0] else None
        self.reference: Point | None = None

    # Running

    def run(self, say: Say, parallel: int = 1) -> None:
        """Make the runs that are not recorded yet, and record each as soon as it ends."""
        self._read_recorded_runs()
        todo = [
            (point, number)
            for number in range(self.repeat)
            for point in self.points
            if len(point.runs) <= number and not (point.runs and not point.done)
        ]
        total, begun = len(self.points) * self.repeat, time.monotonic()
        for count, (point, run) in enumerate(self._make_runs(todo, say, parallel), 1):
            point.runs.append(run)
            self.runs.record(point.settings, run)
            left = (time.monotonic() - begun) / count * (len(todo) - count)
            what = run.get("stopped") or f"{run['cpu']:.3g} s of CPU, {run['steps']} steps"
            label = label_of(point.settings, whole=True)
            say(f"{total - len(todo) + count}/{total}  {label}: {what}  {clock(left)} left")
        self._set_errors()

    def _make_runs(
        self, todo: list[tuple[Point, int]], say: Say, parallel: int
    ) -> Iterator[tuple[Point, dict[str, Any]]]:
        """Make the runs in `todo`, given as (point, number of the repetition), and yield each point with its result."""
        if parallel > 1:
            points = [point for point, _ in todo]
            yield from zip(points, self.runs.make([p.settings for p in points], say, parallel), strict=True)
            return
        for point, number in todo:
            if number and not point.done:
                continue  # a run that stopped would stop again
            yield point, next(self.runs.make([point.settings], say))

    def _read_recorded_runs(self) -> None:
        """Read the recorded runs into the points. Raises StudyError if the record belongs to another study."""
        for settings, run in self.runs.open_record({"varied": [each.name for each in self.varied]}):
            for point in self.points:
                if point.settings == settings and len(point.runs) < self.repeat:
                    point.runs.append(run)

    def _set_errors(self) -> None:
        """Set the errors of all points, relative to the exact solution or to the run with the most particle updates."""
        done = [point for point in self.points if point.done]
        if self.exact_error:
            for point in done:
                point.errors = point.runs[0]["errors"]
            return
        self.reference = max(done, key=lambda point: point.runs[0]["updates"], default=None)
        for point in done:
            if self.reference is not None and point is not self.reference:
                point.errors = profile_errors(point.runs[0]["profiles"], self.reference.runs[0]["profiles"])

    def make(self, title: str, parallel: int) -> bool:
        """Make the runs, write cost.csv and cost.png, and print the results, also to cost.log. Return True."""
        say = LoggedConsole(self.directory / "cost.log")
        say(f"discsim {__version__}")
        say(f"{title}: {len(self.points)} combinations, {self.repeat} runs of each, into {printable(self.directory)}")
        self.run(say, parallel)
        self.write()
        if not any(point.done for point in self.points):
            stopped = self.points[0].runs[0]["stopped"]
            raise StudyError(
                f"no run completed; the run with {label_of(self.points[0].settings, whole=True)} was {stopped}"
            )
        from discsim.study.costfigure import cost_figure  # imported here, as it is slow

        with replace_atomically(self.directory / "cost.png", ".png") as temporary:
            cost_figure(self, temporary)
        say.say_all(partial(print_results, self))
        say(f"table {printable(self.directory / 'cost.csv')}")
        say(f"figure {printable(self.directory / 'cost.png')}")
        say(f"runs {printable(self.directory / RUNS)}")
        say(f"log {printable(say.log)}")
        return True

    # Findings

    def lines(self) -> dict[str, list[Point]]:
        """Return the points that have an error, grouped into lines of a figure; see `points_by_line`."""
        return points_by_line((point for point in self.points if point.error), self.axis)

    def front(self) -> list[Point]:
        """Return the Pareto front of the points that have an error, the cheapest first."""
        return pareto_front(point for point in self.points if point.error)

    def write(self) -> None:
        """Write cost.csv; the file appears when it is complete."""
        front = {id(point) for point in self.front()}
        species = sorted({kind for point in self.points for kind in point.errors})
        kept = ("mass", "momentum", "angular_momentum", "energy")
        with replace_atomically(self.directory / "cost.csv") as temporary, temporary.open("w", newline="") as file:
            rows = csv.writer(file)
            head = ["runs", "cpu_seconds", "cpu_least", "cpu_most", "steps", "updates", "error"]
            rows.writerow([*self.keys, *head, *(f"error_{kind}" for kind in species), *kept, "front", "status"])
            for point in self.points:
                row: list[Any] = [point.settings[key] for key in self.keys]
                if point.done:
                    cpu, first = [run["cpu"] for run in point.runs], point.runs[0]
                    row += [len(cpu), point.cpu, min(cpu), max(cpu), first["steps"], first["updates"]]
                    row += [point.error, *(point.errors.get(kind) for kind in species)]
                    row += [*(first["drifts"][name] for name in kept), int(id(point) in front)]
                    row.append("reference" if point is self.reference else "done")
                else:
                    row += [None] * (len(head) + len(species) + len(kept) + 1)
                    row.append(point.runs[0]["stopped"] if point.runs else "not run")
                rows.writerow(row)
