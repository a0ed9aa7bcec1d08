"""What accuracy costs: a scene run with every combination of some values, and the error of each against its CPU time.

CPU seconds are those of the steps, of all threads; making the initial condition and compiling kernels is apart.
Repeats go round the combinations, so that a busy hour of the machine is shared by all of them.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from discsim import __version__
from discsim.costs import clock
from discsim.progress import LINE_EVERY
from discsim.scene import Scene, SceneError, load_scene

GOALS = (0.1, 0.01, 0.001)  # errors whose cheapest setting is told
FARTHEST = 1e8
RUNS = "runs.jsonl"
WIDTH = 110  # letters that the tables take, also where there is no terminal
Settings = dict[str, str]  # key of the scene: its value, as text


class StudyError(Exception):
    """A study that cannot be made, or gone on with."""


@dataclass(frozen=True)
class Varied:
    """Keys that vary together: with one value for all of them, or one for each, as in "100:0.06"."""

    keys: tuple[str, ...]
    values: tuple[str, ...]

    @classmethod
    def from_text(cls, text: str) -> Varied:
        """From "table.key=a,b", "table.key,table.key=a,b" or "table.key,table.key=a:c,b:d". Raises StudyError."""
        names, equals, written = text.partition("=")
        keys, values = _split(names), _split(written)
        if not equals or not all(keys) or not all(values) or not values:
            wanted = "expected table.key=a,b,c, like drag.scheme=mk,tsc"
            raise StudyError(f"--vary {text}: not a key with its values; {wanted}")
        for value in values:
            if values.count(value) > 1:
                raise StudyError(f"--vary {text}: {value} is there twice; expected different values")
            if value.count(":") not in (0, len(keys) - 1):
                raise StudyError(f"--vary {text}: {value} has not one value for each key; expected {len(keys)} or one")
        return cls(tuple(keys), tuple(values))

    @property
    def name(self) -> str:
        return ",".join(self.keys)

    def settings(self, value: str) -> Settings:
        parts = value.split(":") if ":" in value else [value] * len(self.keys)
        return {key: part.strip() for key, part in zip(self.keys, parts, strict=True)}

    @property
    def numbers(self) -> tuple[float, ...] | None:
        """The values (the first key's) as numbers, without their unit; None where one of them is none."""
        found = [_number(value.partition(":")[0]) for value in self.values]
        return tuple(number for number in found if number is not None) if None not in found else None


def _split(text: str) -> list[str]:
    """The parts between commas that are not inside quotes or brackets."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if letter in "\"'":
            quote = "" if quote == letter else quote or letter
        depth += (letter in "[{") - (letter in "]}") if not quote else 0
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _number(text: str) -> float | None:
    words = text.strip("\"'").split()
    try:
        value = float(words[0].replace("_", "")) if words else np.nan
    except ValueError:
        return None
    return value if np.isfinite(value) else None


@dataclass
class Point:
    """One combination, with what its runs found."""

    settings: Settings
    runs: list[dict[str, Any]] = field(default_factory=list)
    errors: dict[str, float] = field(default_factory=dict)

    @property
    def done(self) -> bool:
        return bool(self.runs) and "stopped" not in self.runs[0]

    @property
    def cpu(self) -> float:
        return median(run["cpu"] for run in self.runs)

    @property
    def error(self) -> float | None:
        """The worse species' error; none of the reference, and of what did not come to its end."""
        return max(self.errors.values()) if self.errors else None


class Study:
    """The runs of a study and the directory that they are kept in. Raises StudyError, SceneError."""

    def __init__(
        self, scene: Path, varied: Sequence[Varied], repeat: int, directory: Path,
        settings: Sequence[str] = (), without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        names = [key for each in varied for key in each.keys]
        for name in names:
            if names.count(name) > 1:
                raise StudyError(f"--vary {name}: named twice; expected every key once")
        self.path, self.varied, self.repeat, self.directory = scene, tuple(varied), repeat, directory
        self.settings, self.without = tuple(settings), tuple(without)
        self.points = [
            Point({key: part for settings in together for key, part in settings.items()})
            for together in itertools.product(*([each.settings(value) for value in each.values] for each in varied))
        ]
        from discsim.errors import measure_of

        self.measures = [measure_of(self._scene(point.settings)) for point in self.points]
        self.reference: Point | None = None

    def _scene(self, settings: Settings) -> Scene:
        try:
            return load_scene(self.path, self._overrides(settings), self.without)
        except SceneError as fault:
            where = f" (with {label_of(settings)})" if settings else ""
            raise SceneError([problem + where for problem in fault.problems]) from None

    def _overrides(self, settings: Settings) -> list[str]:
        return [*self.settings, *(f"{key}={value}" for key, value in settings.items())]

    @property
    def exact(self) -> str | None:
        """What the errors are, where every combination has an exact solution."""
        return self.measures[0].words if all(self.measures) and self.measures[0] else None

    # Running

    def run(self, say: Callable[[str], None], parallel: int = 1) -> None:
        """Make the runs that are not there yet; each is kept as soon as it ends."""
        self._open()
        todo = [
            (point, number)
            for number in range(self.repeat)
            for point in self.points
            if len(point.runs) <= number and not (point.runs and not point.done)
        ]
        total, begun = len(self.points) * self.repeat, time.monotonic()
        for count, (point, run) in enumerate(self._made(todo, say, parallel), 1):
            point.runs.append(run)
            with (self.directory / RUNS).open("a", encoding="utf-8") as file:
                file.write(json.dumps({"settings": point.settings, **run}) + "\n")
            left = (time.monotonic() - begun) / count * (len(todo) - count)
            what = run.get("stopped") or f"{run['cpu']:.3g} s of CPU, {run['steps']} steps"
            say(f"{total - len(todo) + count}/{total}  {label_of(point.settings)}: {what}  {clock(left)} left")
        self._judge()

    def _made(
        self, todo: list[tuple[Point, int]], say: Callable[[str], None], parallel: int
    ) -> Iterator[tuple[Point, dict[str, Any]]]:
        jobs = [(self.path, self._overrides(point.settings), self.without) for point, _ in todo]
        if parallel == 1:
            for (point, number), job in zip(todo, jobs, strict=True):
                if number and not point.done:
                    continue  # what stopped once would stop again
                yield point, one_run(*job, say)
            return
        with ProcessPoolExecutor(parallel) as pool:
            futures = [pool.submit(one_run, *job) for job in jobs]
            for (point, _), future in zip(todo, futures, strict=True):
                yield point, future.result()

    def _open(self) -> None:
        """Make the directory, or take up the runs in it. Raises StudyError where it holds those of another study."""
        base = load_scene(self.path, self.settings, self.without)
        head = {"scene": tomllib.loads(base.text), "varied": [each.name for each in self.varied]}
        path = self.directory / RUNS
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a crash leaves a line without its end
        if not whole:
            self.directory.mkdir(parents=True, exist_ok=True)
            whole = json.dumps(head) + "\n"
        lines = [json.loads(line) for line in whole.splitlines()]
        if lines[0] != head:
            raise StudyError(f"{self.directory}: holds a study of another scene, or of other keys; expected another -o")
        if whole != text:
            path.write_text(whole, encoding="utf-8")
        for run in lines[1:]:
            settings = run.pop("settings")
            for point in self.points:
                if point.settings == settings and len(point.runs) < self.repeat:
                    point.runs.append(run)

    def _judge(self) -> None:
        """Errors against the exact solution, or against the run with the most particle updates."""
        done = [point for point in self.points if point.done]
        if self.exact:
            for point in done:
                point.errors = point.runs[0]["errors"]
            return
        from discsim.errors import profile_errors

        self.reference = max(done, key=lambda point: point.runs[0]["updates"], default=None)
        for point in done:
            if self.reference is not None and point is not self.reference:
                point.errors = profile_errors(point.runs[0]["profiles"], self.reference.runs[0]["profiles"])

    def make(self, title: str, parallel: int) -> None:
        """Run, write cost.csv and cost.png, and print what was found; all lines go to cost.log too."""
        console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        console.width = max(console.width, WIDTH)
        lines: list[str] = []

        def say(text: str) -> None:
            console.print(text)
            lines.append(text)
            if log.parent.exists():
                with log.open("a", encoding="utf-8") as file:
                    file.write("".join(f"{line}\n" for line in lines))
                lines.clear()

        log = self.directory / "cost.log"
        say(f"discsim {__version__}")
        say(f"{title}: {len(self.points)} combinations, {self.repeat} of each, into {self.directory}")
        self.run(say, parallel)
        self.write()
        from discsim.costfigure import cost_figure  # slow to import, and needed only here

        cost_figure(self, self.directory / "cost.png")
        with console.capture() as text:
            show(self, console)
        say(text.get().rstrip())
        say(f"table {self.directory / 'cost.csv'}\nfigure {self.directory / 'cost.png'}")

    # Findings

    @property
    def axis(self) -> Varied | None:
        """What varies along a line: the numbers with the most values."""
        numeric = [each for each in self.varied if each.numbers and len(each.values) > 1]
        return max(numeric, key=lambda each: len(each.values), default=None)

    def lines(self) -> dict[str, list[Point]]:
        """Points with an error by what they share, each line in the order of its axis."""
        along = set(self.axis.keys) if self.axis else set()
        out: dict[str, list[Point]] = {}
        for point in self.points:
            if point.error:
                shared = {key: value for key, value in point.settings.items() if key not in along}
                out.setdefault(label_of(shared) or "all", []).append(point)
        return out

    def front(self) -> list[Point]:
        """Points than which no other is both cheaper and no worse."""
        found: list[Point] = []
        for point in sorted((p for p in self.points if p.error), key=lambda p: p.cpu):
            if not found or point.error < found[-1].error:
                found.append(point)
        return found

    def write(self) -> None:
        """cost.csv, which appears whole."""
        front = {id(point) for point in self.front()}
        keys = [key for each in self.varied for key in each.keys]
        species = sorted({kind for point in self.points for kind in point.errors})
        kept = ("mass", "momentum", "angular_momentum", "energy")
        temporary = self.directory / ".cost.csv.part"
        with temporary.open("w", newline="") as file:
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
        os.replace(temporary, self.directory / "cost.csv")


def one_run(
    path: Path, overrides: Sequence[str], without: Sequence[str], say: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Run a scene and measure it: CPU seconds, steps, particle updates, errors, profiles, drifts; or why it stopped."""
    from discsim.errors import drifts, measure_of, profiles, totals
    from discsim.simulation import PhysicsError, Simulation

    scene = load_scene(path, overrides, without)
    try:
        first = Simulation(scene)
        for _ in range(2):  # compiles
            first.step()
        sim = Simulation(scene)
        before = totals(sim)
        updates, due = [0], [time.monotonic() + LINE_EVERY]

        def count() -> bool:
            updates[0] += sum(p.count for p in sim.state.species.values())
            if say is not None and time.monotonic() > due[0]:
                due[0] = time.monotonic() + LINE_EVERY
                say(f"    step {sim.state.step}, {sim.time / scene.run.until:.0%} of the time")
            return False

        cpu = time.process_time()
        sim.evolve(scene.run.until, count)
        sim.run(scene.run.until)  # closes the last kick
        cpu = time.process_time() - cpu
    except PhysicsError as fault:
        return {"stopped": f"stopped by the physics: {fault}"}
    measure = measure_of(scene)
    return {
        "cpu": cpu,
        "steps": sim.state.step,
        "updates": updates[0],
        "drifts": drifts(before, totals(sim)),
        **({"errors": measure.errors(sim)} if measure else {"profiles": profiles(sim)}),
    }


def label_of(settings: Settings) -> str:
    """Settings in words."""
    return ", ".join(f"{name} = {value}" for name, value in zip(leaves(settings), settings.values(), strict=True))


def leaves(keys: Iterable[str]) -> list[str]:
    """The last part of each key where no other has it, else the key."""
    ends = [key.rpartition(".")[2] for key in keys]
    return [end if ends.count(end) == 1 else key for key, end in zip(keys, ends, strict=True)]


def fitted_power(x: Sequence[float], y: Sequence[float]) -> float | None:
    """p of y ~ x^p by least squares of the logarithms; None of fewer than two different x."""
    if len(set(x)) < 2 or min(*x, *y) <= 0.0:
        return None
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def price(points: Sequence[Point], goal: float, of: Callable[[Point], float]) -> tuple[float, bool] | None:
    """What a line pays for an error of `goal`, and whether it was fitted beyond its points; None where it never pays.

    Between points, and beyond them by the last two, along straight lines of the logarithms; never is also what would
    take FARTHEST times the dearest run.
    """
    known = sorted((point.error or np.inf, of(point)) for point in points)
    known = [(error, paid) for k, (error, paid) in enumerate(known) if all(paid < other for _, other in known[:k])]
    if len(known) < 2:
        return (known[0][1], False) if known and known[0][0] <= goal else None
    errors, paid = np.log([k[0] for k in known]), np.log([k[1] for k in known])
    if goal >= known[-1][0]:
        return known[-1][1], False  # the cheapest run is good enough
    if goal >= known[0][0]:
        return float(np.exp(np.interp(np.log(goal), errors, paid))), False
    more = (np.log(goal) - errors[0]) * (paid[1] - paid[0]) / (errors[1] - errors[0])
    return (float(np.exp(paid[0] + more)), True) if more < np.log(FARTHEST) else None


def show(study: Study, console: Console) -> None:
    """Print the runs, the price of some errors, and the orders of the lines."""
    if study.exact:
        console.print(f"error: {study.exact}")
    elif study.reference is not None:
        console.print(f"error: mass elsewhere than in the run with {label_of(study.reference.settings)} (no exact one)")
    front = {id(point) for point in study.front()}
    keys = [key for each in study.varied for key in each.keys]
    runs = Table("", *leaves(keys), "error", "CPU s", "steps", "updates", "momentum", "energy", box=SIMPLE)
    for point in study.points:
        values = [point.settings[key] for key in keys]
        if not point.done:
            runs.add_row("", *values, point.runs[0]["stopped"] if point.runs else "not run")
            continue
        first = point.runs[0]
        momentum, energy = first["drifts"]["momentum"], first["drifts"]["energy"]
        runs.add_row(
            "*" if id(point) in front else "", *values,
            f"{point.error:.2g}" if point.error is not None else "reference", f"{point.cpu:.3g}", str(first["steps"]),
            f"{first['updates']:.2g}", *("" if drift is None else f"{drift:.0e}" for drift in (momentum, energy)),
        )  # fmt: skip
    console.print(runs)
    console.print("* no other is both cheaper and no worse")
    for goal in GOALS:
        good = [point for point in study.points if point.error and point.error <= goal]
        if good:
            cheapest = min(good, key=lambda point: point.cpu)
            console.print(f"{goal:.3g}: {label_of(cheapest.settings)}, {cheapest.cpu:.3g} s of CPU")
        else:
            console.print(f"{goal:.3g}: reached by none")
    if study.axis is None:
        return
    console.print(
        f"\nerror ~ {', '.join(leaves(study.axis.keys))}^p; CPU seconds, and particle updates, to an error of"
    )
    orders = Table("line", "p", "half the error", box=SIMPLE)
    for goal in GOALS:
        orders.add_column(f"{goal:.3g}", justify="right")
        orders.add_column("updates", justify="right")
    for name, points in study.lines().items():
        orders.add_row(name, *_order_row(study.axis, points))
    console.print(orders)
    console.print("~ fitted beyond the runs made")


def _order_row(axis: Varied, points: Sequence[Point]) -> Iterator[str]:
    values = [_number(point.settings[axis.keys[0]]) or np.nan for point in points]
    errors = [point.error or np.nan for point in points]
    order = fitted_power(values, errors)
    yield "" if order is None else f"{order:.2f}"
    dearer = fitted_power(errors, [point.cpu for point in points])
    yield "" if dearer is None or dearer >= 0.0 else f"costs {0.5**dearer:.2g} times"
    for goal in GOALS:
        for of in (lambda point: point.cpu, lambda point: float(point.runs[0]["updates"])):
            paid = price(points, goal, of)
            yield "" if paid is None else f"{'~' if paid[1] else ''}{paid[0]:.2g}"
