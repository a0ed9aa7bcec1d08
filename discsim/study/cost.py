"""Cost study: runs of a scene with all combinations of given values, to compare their errors and CPU times.

All combinations are run once before any is repeated, so that high load on the computer affects them equally.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from discsim.output.files import appended, replace_atomically
from discsim.printable import printable
from discsim.scene.units import clock
from discsim.study.findings import show
from discsim.study.points import Point, StudyError, Varied, axis_of, combinations, label_of, lines_of
from discsim.study.runs import RUNS, Runs, Say
from discsim.version import __version__

WIDTH = 110  # width of the tables in characters, also without a terminal


class Study:
    """A cost study: combinations of values, their runs, and their directory. Raises StudyError, SceneError.

    `repeat` is the number of runs of each combination, `reference` the combination with which others are compared.
    """

    def __init__(
        self, scene: Path, varied: Sequence[Varied], repeat: int, directory: Path,
        settings: Sequence[str] = (), without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.varied, self.repeat, self.directory = tuple(varied), repeat, directory
        self.runs = Runs(scene, directory, settings, without)
        self.points = combinations(self.varied)
        from discsim.study.errors import measure_of

        self.measures = [measure_of(self.runs.scene(point.settings)) for point in self.points]
        self.reference: Point | None = None

    @property
    def exact(self) -> str | None:
        """Description of the error as text, if all combinations have an exact solution; else None."""
        return self.measures[0].words if all(self.measures) and self.measures[0] else None

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
            self.runs.keep(point.settings, run)
            left = (time.monotonic() - begun) / count * (len(todo) - count)
            what = run.get("stopped") or f"{run['cpu']:.3g} s of CPU, {run['steps']} steps"
            say(f"{total - len(todo) + count}/{total}  {label_of(point.settings)}: {what}  {clock(left)} left")
        self._set_errors()

    def _make_runs(
        self, todo: list[tuple[Point, int]], say: Say, parallel: int
    ) -> Iterator[tuple[Point, dict[str, Any]]]:
        """Make the runs, given as (point, repetition), and yield each point with its result."""
        if parallel > 1:
            points = [point for point, _ in todo]
            yield from zip(points, self.runs.made([p.settings for p in points], say, parallel), strict=True)
            return
        for point, number in todo:
            if number and not point.done:
                continue  # a run that stopped would stop again
            yield point, next(self.runs.made([point.settings], say))

    def _read_recorded_runs(self) -> None:
        """Read the recorded runs. Raises StudyError if they belong to another study."""
        for settings, run in self.runs.open({"varied": [each.name for each in self.varied]}):
            for point in self.points:
                if point.settings == settings and len(point.runs) < self.repeat:
                    point.runs.append(run)

    def _set_errors(self) -> None:
        """Set the errors of all points, against the exact solution or the run with the most particle updates."""
        done = [point for point in self.points if point.done]
        if self.exact:
            for point in done:
                point.errors = point.runs[0]["errors"]
            return
        from discsim.study.errors import profile_errors

        self.reference = max(done, key=lambda point: point.runs[0]["updates"], default=None)
        for point in done:
            if self.reference is not None and point is not self.reference:
                point.errors = profile_errors(point.runs[0]["profiles"], self.reference.runs[0]["profiles"])

    def make(self, title: str, parallel: int) -> bool:
        """Make the runs, write cost.csv and cost.png, and print the results, also to cost.log. Return True."""
        console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        console.width = max(console.width, WIDTH)
        lines: list[str] = []

        def say(text: str) -> None:
            console.print(text)
            lines.append(text)
            if log.parent.exists():
                with appended(log) as file:
                    file.write("".join(f"{line}\n" for line in lines).encode())
                lines.clear()

        log = self.directory / "cost.log"
        say(f"discsim {__version__}")
        say(f"{title}: {len(self.points)} combinations, {self.repeat} runs of each, into {printable(self.directory)}")
        self.run(say, parallel)
        self.write()
        if not any(point.done for point in self.points):
            stopped = self.points[0].runs[0]["stopped"]
            raise StudyError(f"no run completed; the run with {label_of(self.points[0].settings)} was {stopped}")
        from discsim.study.costfigure import cost_figure  # imported here, as it is slow

        with replace_atomically(self.directory / "cost.png", ".png") as temporary:
            cost_figure(self, temporary)
        with console.capture() as text:
            show(self, console)
        say(text.get().rstrip())
        say(f"table {printable(self.directory / 'cost.csv')}")
        say(f"figure {printable(self.directory / 'cost.png')}")
        say(f"runs {printable(self.directory / RUNS)}")
        say(f"log {printable(self.directory / log.name)}")
        return True

    # Findings

    @property
    def axis(self) -> Varied | None:
        """The varied keys that are the axis of tables and figures; see `axis_of`."""
        return axis_of(self.varied)

    def lines(self) -> dict[str, list[Point]]:
        """Return lists of points with an error that differ only in the keys of `axis`; see `lines_of`."""
        return lines_of((point for point in self.points if point.error), self.axis)

    def front(self) -> list[Point]:
        """Return the Pareto front, the cheapest first: no other point is both cheaper and at least as accurate."""
        found: list[Point] = []
        for point in sorted((p for p in self.points if p.error), key=lambda p: p.cpu):
            if not found or point.error < found[-1].error:
                found.append(point)
        return found

    def write(self) -> None:
        """Write cost.csv; the file appears when it is complete."""
        front = {id(point) for point in self.front()}
        keys = [key for each in self.varied for key in each.keys]
        species = sorted({kind for point in self.points for kind in point.errors})
        kept = ("mass", "momentum", "angular_momentum", "energy")
        with replace_atomically(self.directory / "cost.csv") as temporary, temporary.open("w", newline="") as file:
            rows = csv.writer(file)
            head = ["runs", "cpu_seconds", "cpu_least", "cpu_most", "steps", "updates", "error"]
            rows.writerow([*keys, *head, *(f"error_{kind}" for kind in species), *kept, "front", "status"])
            for point in self.points:
                row: list[Any] = [point.settings[key] for key in keys]
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
