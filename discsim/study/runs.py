"""Runs of a scene with settings changed, each kept in a file as soon as it ends, so that what was stopped goes on.

CPU seconds are those of the steps, of all threads; making the initial condition and compiling kernels is apart.
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
from discsim.output.files import appended, written
from discsim.run.progress import LINE_EVERY
from discsim.scene import Scene, SceneError, load_scene
from discsim.study.points import Settings, StudyError, label_of
from discsim.study.workers import end_with_parent, in_words, results
from discsim.userfiles import read_text

RUNS = "runs.jsonl"
WARM = 2.0  # seconds of steps that are made before any is measured, at most; two are always
Say = Callable[[str], None]


class Limits(NamedTuple):
    """CPU seconds that the steps of a run may take, and the time.monotonic() at which it has to stop."""

    cpu: float = float("inf")
    deadline: float = float("inf")


class Late(Exception):
    """The deadline came before the end of a run, of which nothing is kept. `cpu`: what it had taken."""

    def __init__(self, cpu: float = 0.0) -> None:
        super().__init__(cpu)
        self.cpu = cpu


class Runs:
    """A scene with what the command line changes in it, and the directory that its runs are kept in."""

    def __init__(self, path: Path, directory: Path, settings: Sequence[str] = (), without: Sequence[str] = ()) -> None:
        self.path, self.directory = path, directory
        self.settings, self.without = tuple(settings), tuple(without)

    def scene(self, settings: Settings) -> Scene:
        """The scene with these settings. Raises SceneError, whose problems say with which."""
        try:
            return load_scene(self.path, self.overrides(settings), self.without)
        except SceneError as fault:
            where = f" (with {label_of(settings)})" if settings else ""
            raise SceneError([problem + where for problem in fault.problems]) from None

    def overrides(self, settings: Settings) -> list[str]:
        return [*self.settings, *(f"{key}={value}" for key, value in settings.items())]

    def open(self, what: dict[str, Any]) -> list[tuple[Settings, dict[str, Any]]]:
        """Make the directory, or take up the runs in it. Raises StudyError where it holds those of another study."""
        base = load_scene(self.path, self.settings, self.without)
        head = {"scene": tomllib.loads(base.text), **what}
        path = self.directory / RUNS
        text = read_text(path, "replace") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a crash leaves a line without its end
        if not whole:
            self.directory.mkdir(parents=True, exist_ok=True)
            whole = json.dumps(head) + "\n"
        lines = whole.removesuffix("\n").split("\n")
        if _entry(path, 1, lines[0]) != head:
            raise StudyError(f"{self.directory}: holds a study of another scene, or of other keys; expected another -o")
        found = [_entry(path, number, line, "settings") for number, line in enumerate(lines[1:], 2)]
        if whole != text:
            with written(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")
        return [(run.pop("settings"), run) for run in found]

    def keep(self, settings: Settings, run: dict[str, Any]) -> None:
        with appended(self.directory / RUNS) as file:
            file.write((json.dumps({"settings": settings, **run}) + "\n").encode())

    def made(
        self, todo: Sequence[Settings], say: Say, parallel: int = 1, limits: Limits | None = None
    ) -> Iterator[dict[str, Any]]:
        """Make these runs, `parallel` at a time, and yield what each found. Raises Late at the deadline.

        With one at a time each begins when it is asked for, so that the caller may look first whether it is wanted.
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
    """A line of the runs of a study, which has a `table`. Raises StudyError where it is damaged."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        entry = None
    if not isinstance(entry, dict) or (table is not None and not isinstance(entry.get(table), dict)):
        raise StudyError(f"{path}:{number}: no run of a study; expected another -o, or that line to be removed")
    return entry


def one_run(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits | None = None, say: Say | None = None
) -> dict[str, Any]:
    """Run a scene and measure it: CPU seconds, steps, particle updates, errors, what is seen of it, drifts.

    Or why it stopped, whatever its start, its steps or its measures raise. Raises Late at the deadline.
    """
    from discsim.run.simulation import PhysicsError

    begun = [time.process_time()]  # of the run, then of its steps
    try:
        return _measured(path, overrides, without, limits or Limits(), say, begun)
    except Late:
        raise
    except PhysicsError as fault:
        stopped = f"stopped by the physics: {fault}"
    except SceneError as fault:
        stopped = f"refused by its start: {fault}"
    except Exception as fault:  # a trial that fails in any way is given up, and a study goes on with the others
        stopped = in_words(fault)
    return {"stopped": stopped, "cpu": time.process_time() - begun[-1]}


def _measured(
    path: Path, overrides: Sequence[str], without: Sequence[str], limits: Limits, say: Say | None, begun: list[float]
) -> dict[str, Any]:
    """The run of `one_run`; the CPU time at which its steps begin is added to `begun`."""
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
            raise Late(time.process_time() - begun[-1])
        if say is not None and time.monotonic() > due[0]:
            due[0] = time.monotonic() + LINE_EVERY
            say(f"    step {sim.state.step}, {sim.time / scene.run.until:.0%} of the time")
        return time.process_time() - begun[-1] > limits.cpu

    if not sim.evolve(scene.run.until, count, only_looks=True):
        words = f"given up after {limits.cpu:.3g} s of CPU at {sim.time / scene.run.until:.0%}"
        return {"stopped": words, "cpu": limits.cpu, "most": limits.cpu}
    sim.run(scene.run.until)  # closes the last kick
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
    """Steps of a run that is thrown away: two, and as far as the second sorting where that takes no time."""
    begun = time.monotonic()
    for step in range(SORT_EVERY + 1):
        if step >= 2 and (time.monotonic() - begun > WARM or first.time >= first.scene.run.until):
            return
        first.step()
