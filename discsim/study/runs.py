"""Runs of a study, each recorded in runs.jsonl as soon as it ends, so that the study can resume.

CPU seconds are those of all threads during the steps, without initial conditions and compilation.
"""

from __future__ import annotations

import json
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from discsim.effects.base import SORT_EVERY
from discsim.output.files import open_to_append, replace_atomically
from discsim.run.progress import LINE_EVERY
from discsim.scene import Scene, SceneError, load_scene
from discsim.scene.overrides import Option
from discsim.study.points import Settings, StudyError, label_of
from discsim.study.workers import end_with_parent, failure_text, results
from discsim.userfiles import read_text

RUNS = "runs.jsonl"
MAX_WARM_UP = 2.0  # largest duration in seconds of the steps that compile kernels before a run; at least two are made
MIN_WIDTH = 110  # smallest width of tables in characters, also without a terminal
Say = Callable[[str], None]


class Limits(NamedTuple):
    """Limits of a run: the CPU seconds of its steps, and a deadline as a value of time.monotonic()."""

    cpu: float = float("inf")
    deadline: float = float("inf")


class DeadlineError(Exception):
    """The deadline has passed during a run, which is not recorded; `cpu` is its CPU seconds so far."""

    def __init__(self, cpu: float = 0.0) -> None:
        super().__init__(cpu)
        self.cpu = cpu


class LoggedConsole:
    """Printer of lines on the terminal, which also appends them to the file `log`.

    Lines are kept until the directory of this file exists.
    """

    def __init__(self, log: Path) -> None:
        self.console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        self.console.width = max(self.console.width, MIN_WIDTH)
        self.log = log
        self.unwritten: list[str] = []

    def __call__(self, text: str) -> None:
        self.console.print(text)
        self.unwritten.append(text)
        if self.log.parent.exists():
            with open_to_append(self.log) as file:
                file.write("".join(f"{line}\n" for line in self.unwritten).encode())
            self.unwritten.clear()

    def say_all(self, show: Callable[[Console], None]) -> None:
        """Print everything that `show(console)` prints."""
        with self.console.capture() as text:
            show(self.console)
        self(text.get().rstrip())


class Runs:
    """A scene to run with different settings, and the directory with the record of the runs.

    path: scene file. settings, without: changes of the scene for all runs, from the command line.
    """

    def __init__(self, path: Path, directory: Path, settings: Sequence[str] = (), without: Sequence[str] = ()) -> None:
        self.path, self.directory = path, directory
        self.settings, self.without = tuple(settings), tuple(without)

    def scene(self, settings: Settings, option: str = "--vary") -> Scene:
        """Return the scene with these settings. Raises SceneError, whose messages contain `option` and the settings."""
        changes = [Option(option, key, value, with_key=True) for key, value in settings.items()]
        try:
            return load_scene(self.path, [*self.settings, *changes], self.without)
        except SceneError as fault:
            where = f" (with {label_of(settings)})" if settings else ""
            raise SceneError([problem + where for problem in fault.problems]) from None

    def overrides(self, settings: Settings) -> list[str]:
        """Return the changes of the scene for a run with these settings, in the form "key=value"."""
        return [*self.settings, *(f"{key}={value}" for key, value in settings.items())]

    def open_record(self, study: dict[str, Any]) -> list[tuple[Settings, dict[str, Any]]]:
        """Open the record, or create it, and return the settings and results of the runs in the record.

        study: entries that identify the study. Raises StudyError if the record belongs to another study or scene.
        """
        base = load_scene(self.path, self.settings, self.without)
        head = {"scene": tomllib.loads(base.text), **study}
        path = self.directory / RUNS
        text = read_text(path, "replace") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a crash may leave an incomplete line
        if not whole:
            self.directory.mkdir(parents=True, exist_ok=True)
            whole = json.dumps(head) + "\n"
        lines = whole.removesuffix("\n").split("\n")
        if _parse_line(path, 1, lines[0]) != head:
            wrong = "the directory contains a study of another scene, or of other keys"
            raise StudyError(f"{self.directory}: {wrong}; choose another directory with -o")
        found = [_parse_line(path, number, line, "settings") for number, line in enumerate(lines[1:], 2)]
        if whole != text:
            with replace_atomically(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")
        return [(run.pop("settings"), run) for run in found]

    def record(self, settings: Settings, run: dict[str, Any]) -> None:
        """Append the results `run` of a run with these settings to the record."""
        with open_to_append(self.directory / RUNS) as file:
            file.write((json.dumps({"settings": settings, **run}) + "\n").encode())

    def make(
        self, todo: Sequence[Settings], say: Say, parallel: int = 1, limits: Limits | None = None
    ) -> Iterator[dict[str, Any]]:
        """Make a run for each of the settings in `todo`, `parallel` at a time, and yield the results in this order.

        With `parallel` = 1 a run starts when its result is requested. Raises DeadlineError at the deadline.
        """
        jobs = [(self.path, self.overrides(settings), self.without, limits or Limits()) for settings in todo]
        if parallel == 1:
            yield from (one_run(*job, say) for job in jobs)
            return
        with ProcessPoolExecutor(parallel, initializer=end_with_parent) as pool:
            try:
                yield from results((pool.submit(one_run, *job) for job in jobs), say)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _parse_line(path: Path, number: int, line: str, table: str | None = None) -> dict[str, Any]:
    """Return line `number` of the record as a dict. Raises StudyError if it is no dict, or if its `table` is none."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        entry = None
    if not isinstance(entry, dict) or (table is not None and not isinstance(entry.get(table), dict)):
        raise StudyError(
            f"{path}:{number}: the line is not a run of a study; choose another directory with -o, or remove the line"
        )
    return entry


def one_run(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits | None = None, say: Say | None = None
) -> dict[str, Any]:
    """Run a scene, and return its results by name: CPU seconds, steps, particle updates, errors, profiles, drifts.

    If the run fails or reaches the limit of CPU time, the results are the reason, "stopped", and the CPU seconds.
    Raises DeadlineError at the deadline.
    """
    from discsim.run.simulation import PhysicsError

    begun = [time.process_time()]  # CPU time at the start of the run, then of its steps
    try:
        return _run_and_measure(path, overrides, without, limits or Limits(), say, begun)
    except DeadlineError:
        raise
    except PhysicsError as fault:
        stopped = f"stopped by a numerical failure: {fault}"
    except SceneError as fault:
        stopped = f"refused at the start: {fault}"
    except Exception as fault:  # a study continues after any failure of a run
        stopped = failure_text(fault)
    return {"stopped": stopped, "cpu": time.process_time() - begun[-1]}


def _run_and_measure(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits, say: Say | None, begun: list[float]
) -> dict[str, Any]:
    """Make the run of `one_run`, and return its results; append to `begun` the process's CPU time before the steps."""
    from discsim.run.simulation import Simulation
    from discsim.study.errors import drifts, measure_of, totals
    from discsim.study.measures import structure_of

    scene = load_scene(path, overrides, without)
    _compile_kernels(Simulation(scene))
    sim = Simulation(scene)
    before = totals(sim)
    updates, due = [0], [time.monotonic() + LINE_EVERY]
    begun.append(time.process_time())

    def count() -> bool:
        updates[0] += sum(p.count for p in sim.state.species.values())
        if time.monotonic() > limits.deadline:
            raise DeadlineError(time.process_time() - begun[-1])
        if say is not None and time.monotonic() > due[0]:
            due[0] = time.monotonic() + LINE_EVERY
            say(f"    step {sim.state.step}, {sim.time / scene.run.until:.0%} of run.until")
        return time.process_time() - begun[-1] > limits.cpu

    if not sim.evolve(scene.run.until, count, read_only=True):
        words = f"stopped after {limits.cpu:.3g} s of CPU at {sim.time / scene.run.until:.0%}"
        return {"stopped": words, "cpu": limits.cpu, "most": limits.cpu}
    sim.run(scene.run.until)  # makes the closing half kick
    cpu = time.process_time() - begun[-1]
    measure = measure_of(scene)
    errors = measure.errors(sim) if measure else {}
    if not np.isfinite([*errors.values()]).all():
        return {"stopped": "without a finite error at its end", "cpu": cpu}
    return {
        "cpu": cpu,
        "steps": sim.state.step,
        "updates": updates[0],
        "drifts": drifts(before, totals(sim)),
        **({"errors": errors} if measure else {}),
        **structure_of(sim),
    }


def _compile_kernels(first: Any) -> None:
    """Compile the kernels of a run by steps of `first`, a simulation of the same scene that is then discarded.

    At least two steps are made, and others up to the second sorting of particles within MAX_WARM_UP seconds.
    """
    begun = time.monotonic()
    for step in range(SORT_EVERY + 1):
        if step >= 2 and (time.monotonic() - begun > MAX_WARM_UP or first.time >= first.scene.run.until):
            return
        first.step()
