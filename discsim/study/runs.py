"""Runs of a scene with changed settings, recorded one by one so that a study can resume.

CPU seconds are those of the steps, of all threads, without initial conditions and compilation.
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

from discsim.effects.base import SORT_EVERY
from discsim.output.files import appended, replace_atomically
from discsim.run.progress import LINE_EVERY
from discsim.scene import Scene, SceneError, load_scene
from discsim.study.points import Settings, StudyError, label_of
from discsim.study.workers import end_with_parent, in_words, results
from discsim.userfiles import read_text

RUNS = "runs.jsonl"
WARM = 2.0  # largest number of seconds for unmeasured steps before a run; two steps are always made
Say = Callable[[str], None]


class Limits(NamedTuple):
    """Limits of a run: CPU seconds of its steps, and a deadline in time.monotonic()."""

    cpu: float = float("inf")
    deadline: float = float("inf")


class DeadlineError(Exception):
    """The deadline passed during a run, which is not recorded. `cpu` has the CPU seconds used."""

    def __init__(self, cpu: float = 0.0) -> None:
        super().__init__(cpu)
        self.cpu = cpu


class Runs:
    """A scene with its command-line changes, and the directory with its recorded runs."""

    def __init__(self, path: Path, directory: Path, settings: Sequence[str] = (), without: Sequence[str] = ()) -> None:
        self.path, self.directory = path, directory
        self.settings, self.without = tuple(settings), tuple(without)

    def scene(self, settings: Settings) -> Scene:
        """Return the scene with these settings. Raises SceneError, whose problems name the settings."""
        try:
            return load_scene(self.path, self.overrides(settings), self.without)
        except SceneError as fault:
            where = f" (with {label_of(settings)})" if settings else ""
            raise SceneError([problem + where for problem in fault.problems]) from None

    def overrides(self, settings: Settings) -> list[str]:
        """Return the command-line overrides with those of the settings appended."""
        return [*self.settings, *(f"{key}={value}" for key, value in settings.items())]

    def open(self, what: dict[str, Any]) -> list[tuple[Settings, dict[str, Any]]]:
        """Create the directory, or return the settings and results of the runs recorded in it.

        Raises StudyError if it holds runs of another study.
        """
        base = load_scene(self.path, self.settings, self.without)
        head = {"scene": tomllib.loads(base.text), **what}
        path = self.directory / RUNS
        text = read_text(path, "replace") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a crash may leave an incomplete line
        if not whole:
            self.directory.mkdir(parents=True, exist_ok=True)
            whole = json.dumps(head) + "\n"
        lines = whole.removesuffix("\n").split("\n")
        if _entry(path, 1, lines[0]) != head:
            raise StudyError(
                f"{self.directory}: contains a study of another scene, or of other keys; expected another -o"
            )
        found = [_entry(path, number, line, "settings") for number, line in enumerate(lines[1:], 2)]
        if whole != text:
            with replace_atomically(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")
        return [(run.pop("settings"), run) for run in found]

    def keep(self, settings: Settings, run: dict[str, Any]) -> None:
        """Append a run to the record."""
        with appended(self.directory / RUNS) as file:
            file.write((json.dumps({"settings": settings, **run}) + "\n").encode())

    def made(
        self, todo: Sequence[Settings], say: Say, parallel: int = 1, limits: Limits | None = None
    ) -> Iterator[dict[str, Any]]:
        """Make these runs, `parallel` at a time, and yield their results. Raises DeadlineError at the deadline.

        With `parallel` = 1 a run starts when its result is requested, so that the caller can skip it.
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


def _entry(path: Path, number: int, line: str, table: str | None = None) -> dict[str, Any]:
    """Return a line of the record, which must have a dict `table`. Raises StudyError if it is damaged."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        entry = None
    if not isinstance(entry, dict) or (table is not None and not isinstance(entry.get(table), dict)):
        raise StudyError(f"{path}:{number}: not a run of a study; expected another -o, or remove this line")
    return entry


def one_run(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits | None = None, say: Say | None = None
) -> dict[str, Any]:
    """Run a scene and measure it: CPU seconds, steps, particle updates, errors, profiles, drifts.

    After any exception of the start, steps or measures the result has the key "stopped" with the reason. Raises
    DeadlineError at the deadline.
    """
    from discsim.run.simulation import PhysicsError

    begun = [time.process_time()]  # CPU time at the start of the run, then of its steps
    try:
        return _measured(path, overrides, without, limits or Limits(), say, begun)
    except DeadlineError:
        raise
    except PhysicsError as fault:
        stopped = f"stopped by a numerical failure: {fault}"
    except SceneError as fault:
        stopped = f"refused at the start: {fault}"
    except Exception as fault:  # a study continues after any failure of a run
        stopped = in_words(fault)
    return {"stopped": stopped, "cpu": time.process_time() - begun[-1]}


def _measured(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits, say: Say | None, begun: list[float]
) -> dict[str, Any]:
    """Make the run of `one_run`; appends the CPU time at the start of its steps to `begun`."""
    from discsim.run.simulation import Simulation
    from discsim.study.errors import drifts, measure_of, totals
    from discsim.study.measures import seen

    scene = load_scene(path, overrides, without)
    _compile(Simulation(scene))
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

    if not sim.evolve(scene.run.until, count, only_looks=True):
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
        **seen(sim),
    }


def _compile(first: Any) -> None:
    """Make steps of a run that is discarded, to compile kernels.

    Two steps at least; more, up to the second sorting of particles, within WARM seconds.
    """
    begun = time.monotonic()
    for step in range(SORT_EVERY + 1):
        if step >= 2 and (time.monotonic() - begun > WARM or first.time >= first.scene.run.until):
            return
        first.step()
