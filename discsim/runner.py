"""A run from a validated scene to the files of its directory: outputs, checkpoints, interrupts, messages."""

from __future__ import annotations

import os
import signal
import time
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from pydantic import BaseModel

from discsim import __version__
from discsim.check import warnings
from discsim.checkpoint import CheckpointError, read_checkpoint
from discsim.eos import pressure_and_sound_speed
from discsim.history import History, history_row
from discsim.progress import Progress, clock
from discsim.scene import Scene, SceneError, load_scene
from discsim.simulation import PhysicsError, Simulation
from discsim.snapshot import write_snapshot
from discsim.state import Gas, State
from discsim.tables import Run as RunTable

Array = np.ndarray

DONE, NOT_WRITTEN, WRONG_INPUT, PHYSICS = 0, 1, 2, 3  # exit statuses; interrupted: 128 + the signal
SMALL = 20_000  # particles: below it history has a row for every step
ROW_EVERY = 16  # steps between rows of a larger run
FREE_TO_CHANGE = {f"run.{key}" for key in ("until", "snapshots", "every", "threads", "checkpoint_every", "walltime")}
FREE_TO_CHANGE.add("title")  # what a run that goes on may do otherwise


def run_scene(scene: Scene, directory: Path, resume: bool = False, quiet: bool = False) -> int:
    """Run `scene` with its files in `directory`, or go on with the run there; returns the exit status.

    0 done (or stopped by run.walltime); 1 a file cannot be written; 2 not to be resumed; 3 stopped by the physics;
    128 + signal interrupted. What is wrong is one message on stderr.
    """
    run = _Run(scene, Path(directory), Progress(scene, quiet))
    with run.interrupts:
        try:
            return run.go(resume)
        except (SceneError, CheckpointError) as fault:
            run.progress.fail(str(fault))
            return WRONG_INPUT
        except PhysicsError as fault:
            run.progress.fail(f"stopped by the physics {run.where()}: {fault}\n{run.way_back()}")
            return PHYSICS
        except MemoryError as fault:
            run.progress.fail(f"out of memory {run.where()}: {fault or 'no room'}\n{run.way_back()}")
            return PHYSICS
        except OSError as fault:
            run.progress.fail(f"{directory}: cannot be written: {fault.strerror or fault}. {run.way_back()}")
            return NOT_WRITTEN
        except KeyboardInterrupt:
            run.progress.fail(f"left at once. {run.way_back()}")
            return 128 + run.interrupts.number
        finally:
            run.close()


def output_times(run: RunTable) -> list[float]:
    """Times of the snapshots after the initial one, the last of them the end.

    Multiples are taken of the decimal numbers, so that runs of different lengths meet at the same floats.
    """
    until = Fraction(repr(run.until))
    if run.every is None:
        return [float(until * k / run.snapshots) for k in range(1, run.snapshots + 1)]
    every = Fraction(repr(run.every))
    whole = max(1, round(until / every))
    if abs(whole * every - until) <= until * Fraction(1, 10**9):
        return [float(every * k) for k in range(1, whole + 1)]
    return [*(float(every * k) for k in range(1, int(until / every) + 1)), run.until]


def differences(before: Any, now: Any, name: str = "") -> Iterator[str]:
    """The keys in which two scenes differ, by name; a table that only one of them has is one key."""
    if type(before) is type(now):
        parts = _parts(before)
        if parts is not None:
            others = _parts(now) or {}
            for key in parts | others:
                path = f"{name}.{key}" if name else key
                yield from differences(parts.get(key), others.get(key), path)
            return
    if before != now:
        yield name


def _parts(value: Any) -> dict[str, Any] | None:
    """The named parts of a scene or table, of units, or of a list of tables."""
    if isinstance(value, Scene):
        return {name: getattr(value, name) for name in Scene.model_fields if name not in ("text", "path")}
    if isinstance(value, BaseModel):
        return {name: getattr(value, name) for name in type(value).model_fields}
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
        return {str(number): entry for number, entry in enumerate(value)} if len(value) > 1 else _parts(value[0])
    return None


class Interrupts:
    """Ctrl-C and SIGTERM: the first is noted, for the end of the step; the second raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._note)

    def __exit__(self, *fault: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number


class _Run:
    def __init__(self, scene: Scene, directory: Path, progress: Progress) -> None:
        self.scene, self.directory, self.progress = scene, directory, progress
        self.interrupts = Interrupts()
        self.checkpoint = directory / "checkpoint.h5"
        self.begun = self.saved = time.monotonic()
        self.saved_time: float | None = None
        self.next_snapshot = 0
        self.sim: Simulation | None = None
        self.history: History | None = None
        populations = [*([scene.gas] if scene.gas else []), *(scene.dust or ())]
        self.rows_every = 1 if sum(p.particles for p in populations) < SMALL else ROW_EVERY

    def go(self, resume: bool) -> int:
        until = self._time_to_resume() if resume else -1.0
        times = [t for t in output_times(self.scene.run) if t > until * (1.0 + 1e-9)]
        if not times:
            self.progress.say(f"{self.directory}: finished already, {self._at(until)}")
            return DONE
        self._announce()
        self.sim = Simulation(self.scene)
        self._open(resume)
        self._watch()
        if not resume:
            self._output()
            self._save()
        for t in times:
            if self._stopping():
                break
            self.sim.evolve(t, self._after_step)
            if self.sim.time >= t:
                self._output()
        self._save()
        return self._stopped() if self.sim.time < times[-1] else self._finish()
