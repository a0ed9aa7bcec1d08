"""A scene in motion: what `Simulation` gives to who uses discsim from Python, and to `run/runner.py`.

A step is put together by `run/integrators.py` from the operators of `run/operators.py`. Where a caller looks at the
state (`synchronised`), the closing kick is made and undone again: looking never changes a bit of what follows.
"""

from __future__ import annotations

import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import numpy as np

from discsim.effects.base import Effect
from discsim.initial import own
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import EntryError
from discsim.numerics.state import Dust, Gas, State
from discsim.numerics.threads import use_threads
from discsim.output.checkpoint import (
    CheckpointError,
    OtherVersionWarning,
    Scalar,
    Values,
    other_version,
    read_checkpoint,
    write_checkpoint,
)
from discsim.parts import INTEGRATORS, found_at
from discsim.preview.memory import too_much
from discsim.run import guards
from discsim.run.costs import Costs
from discsim.run.forces import PhysicsError, acceleration_of
from discsim.run.operators import Operators
from discsim.run.restored import GROWING, LIMITS, restored
from discsim.run.start import Begun, begin
from discsim.run.timestep import next_step
from discsim.run.watch import Watch
from discsim.scene import Scene, SceneError, load_scene
from discsim.scene.differences import refuse_another
from discsim.scene.summary import Rows, Summarised
from discsim.scene.units import Units

__all__ = ["PhysicsError", "Simulation"]


class Simulation(Summarised):
    """A scene in motion.

    scene: path of a TOML file, dict, or validated Scene. particles: own particles by species, in place of [initial]:
    dict(pos (n, d), vel (n, d), mass (n,)[, u, species, size]), Quantities or in code units. to_restore: its state will
    be that of a checkpoint (`restore`), so that the start need not settle before t = 0. begun: its start, where that is
    made. Raises SceneError.
    """

    def __init__(
        self,
        scene: Scene | str | Path | dict[str, Any],
        particles: dict[str, dict[str, Any]] | None = None,
        *,
        to_restore: bool = False,
        begun: Begun | None = None,
    ):
        if not isinstance(scene, Scene):
            scene = load_scene(scene, own_particles=particles is not None)
        given = None if particles is None else own.read(scene, particles)
        if given is not None:
            scene = own.counted(scene, given)
        self.scene = scene
        if faults := list(too_much(scene)):
            raise SceneError(faults)
        use_threads(scene.run.threads)
        self.state, effects, self.relaxed = begun or begin(scene, given, to_restore)
        self.operators = Operators(self.state, effects)
        self._integrate = found_at(INTEGRATORS[scene.run.integrator])
        self._fresh = self._in_midst = False
        self._open: State | None = None  # the state before its closing kick, while a callback reads it

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        raise TypeError(
            "a Simulation cannot be pickled or copied; expected save(path), and restore(path) of another one"
        )

    @property
    def time(self) -> float:
        return self.state.time

    @property
    def effects(self) -> dict[str, Effect]:
        """The effects that run, by the names of their tables."""
        return self.operators.effects

    @property
    def limit(self) -> float:
        """The longest step that effects allow, before the Courant factor."""
        return self.operators.limits.step

    @property
    def limited_by(self) -> str:
        """The effect that allows no longer one."""
        return self.operators.limits.by

    @property
    def costs(self) -> Costs:
        return self.operators.costs

    @costs.setter
    def costs(self, costs: Costs) -> None:
        self.operators.costs = costs

    @property
    def units(self) -> Units:
        return self.scene.units

    @property
    def gas(self) -> Gas | None:
        return self.state.gas

    @property
    def dust(self) -> Dust | None:
        return self.state.dust

    @property
    def bodies(self) -> Bodies | None:
        """Star and companions; None where there is a star alone, at the origin and of one mass, or none."""
        return self.state.bodies

    def step(self, most: float = math.inf) -> float:
        """One whole step, of `most` at most, velocities and positions at the same time after it; returns its length.

        Ctrl-C waits for its end. Raises ValueError where nothing limits it.
        """
        if not most > 0.0:
            raise ValueError(f"most = {most} is no length of a step; expected a positive time in code units")
        self._prepare()
        dt = min(self._next_step(math.inf), most)
        if dt == math.inf:
            raise ValueError("nothing limits a step past run.until; expected its length, step(most=...), in code units")
        self._check_dust_step(dt)
        with self._whole():
            self._advance(dt)
            self.operators.close()
        return dt

    def run(
        self,
        until: Any = None,
        *,
        progress: bool = False,
        every: Any = None,
        callback: Callable[[Simulation], object] | None = None,
    ) -> None:
        """Step to time `until` (code units or a Quantity; default that of the scene) and land on it.

        progress: tell of it as the command does. callback(sim): called after each step, which changes nothing of the
        run; with `every`, a time, instead where that is at multiples of it, and at the end. It sees velocities at the
        time of places, in read-only views as of `synchronised`. The run ends early where it returns True.

        Ctrl-C ends it after a step; to run on gives the same bits as never to have stopped. Velocities then await the
        closing kick of that step: `synchronised` shows them with it. Raises ValueError.
        """
        end = self.scene.run.until if until is None else self._in_code(until)
        watch = Watch(self, end, progress, None if every is None else self._in_code(every), callback)
        with watch:
            for time in watch.times:
                try:
                    if not self.evolve(time, watch.after_step, only_looks=True):  # a callback in `synchronised`
                        break
                except KeyboardInterrupt:
                    if not self._in_midst:
                        watch.after_step()  # of the step that the interrupt has waited for
                    raise
        with self._whole():
            self.operators.close()

    def _in_code(self, time: Any) -> float:
        return float(self.units.in_code(time, "time") if hasattr(time, "unit") else time)

    def summary(self) -> tuple[str, Rows]:
        now = self.units.show_time(self.time)
        return self.scene.title or "A simulation", [("time", now), ("step", self.state.step), *self.scene.facts]

    def evolve(self, until: float, after_step: Callable[[], bool] | None = None, only_looks: bool = False) -> bool:
        """Step to `until`, leaving the closing kick open; ends early (False) where `after_step` returns True.

        only_looks: `after_step` changes nothing, so that what it was shown need not be checked before the next step.
        """
        self._prepare()
        while self.state.time < until:
            dt = self._next_step(until)
            self._check_dust_step(dt)
            with self._whole():
                self._advance(dt, until)
            if after_step is None:
                continue
            if after_step():
                return False
            if not only_looks:
                self.operators.take_back()
        return True

    @contextmanager
    def synchronised(self) -> Iterator[State]:
        """The state with its closing kick made, in read-only views, for looking at; what follows is unaffected.

        Meanwhile `sim.gas`, `sim.dust` and `sim.state` are these views. An attribute that is set on them is lost at
        the end. `step`, `run`, `evolve` and `restore` raise RuntimeError; `save` writes the state as the run has it.
        """
        if self._open is not None:
            yield self.state
            return
        with self.closed() as state:
            self.state = state.read_only()
            try:
                yield self.state
            finally:
                self.state = state

    @contextmanager
    def closed(self) -> Iterator[State]:
        """The state itself with its closing kick made, for outputs, which only read it. What follows is unaffected."""
        self._prepare()
        state = self._open = self.state
        try:
            if state.lag == 0.0:
                yield state
                return
            saved = {
                name: {k: v.copy() for k, v in p.arrays().items() if k in MOVED} for name, p in state.species.items()
            }
            kept: dict[str, Any] = {name: replace(p, **saved[name]) for name, p in state.species.items()}
            bodies = None if state.bodies is None else state.bodies.copy()
            self._open = replace(state, bodies=bodies, **kept)
            costs, self.costs = self.costs, Costs(self.effects)
            try:
                self.operators.close()
            finally:
                self.costs = costs
            yield state
        finally:
            if self._open is not state:
                self.operators.shown = True
                state.lag, state.bodies = self._open.lag, self._open.bodies
                for name, arrays in saved.items():
                    for key, array in arrays.items():
                        setattr(state.species[name], key, array)
            self._open = None

    def acceleration(self, effect: str) -> tuple[np.ndarray | None, np.ndarray | None]:
        """What one effect gives now to (gas, dust), each (n, dimensions) or None where there is no such species."""
        if effect not in self.effects:
            raise KeyError(f"no effect {effect!r} in this scene; it has {', '.join(self.effects)}")
        use_threads(self.scene.run.threads)
        if self._open is None:
            guards.check_entries(self.state, self.effects)
        found = acceleration_of(self.effects[effect], self.state)
        return found.get("gas"), found.get("dust")

    def save(
        self, path: str | Path, notes: Mapping[str, Scalar] | None = None, before: str | Path | None = None
    ) -> None:
        """Write a checkpoint from which `restore` goes on, bit for bit, with `notes` in it. Raises OSError.

        Raises PhysicsError where the state is not finite: it would take the place of one that can go on.
        before: where the one that was at `path` stays; else it is replaced.
        """
        groups, values = self.contents()
        write_checkpoint(path, groups, {**values, **(notes or {})}, None if before is None else Path(before))

    def contents(self) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, Scalar]]:
        """Arrays by group and single values of a checkpoint of now. Raises PhysicsError as `save`."""
        if self._open is None and not self._fresh:
            self._prepare()
        self._refuse_half_made()
        state = self._open or self.state
        guards.check_entries(state, self.effects)
        groups = {name: p.arrays() for name, p in state.species.items()}
        groups["own_acc"] = state.own_acc
        groups["ledger"] = {name: np.atleast_1d(value) for name, value in asdict(state.ledger).items()}
        if state.bodies is not None:
            groups["bodies"] = state.bodies.arrays()
        groups["scene"] = {"text": np.frombuffer(self.scene.text.encode(), np.uint8)}
        groups["costs"] = {"calls": np.array([*self.costs.calls.values()])}
        groups["costs"]["seconds"] = np.array([*self.costs.seconds.values()])
        values: dict[str, Scalar] = {"time": state.time, "step": state.step, "lag": state.lag}
        values |= dict(zip(chain(*LIMITS, [GROWING]), self.operators.limits, strict=True))
        if state.pace is not None:
            values |= {f"pace_{name}": value for name, value in state.pace._asdict().items()}
        return groups, values

    def restore(self, path: str | Path, share: tuple[int, int] = (0, 1)) -> Values:
        """Go on from a checkpoint of this scene; returns its single values. Raises CheckpointError, SceneError.

        The scene may differ from that of the checkpoint as with --resume. What raises leaves all as it was. share: of
        the particles only some, as `read_checkpoint`, for who has the others elsewhere. A checkpoint of another version
        of discsim is taken with an OtherVersionWarning.
        """
        self._refuse_within()
        groups, values = read_checkpoint(path, share)
        refuse_another(path, groups["scene"]["text"].tobytes(), self.scene)
        try:
            found = restored(self.state, self.effects, groups, values)
        except EntryError as fault:
            raise CheckpointError(f"{path}: a damaged checkpoint, or of another version of discsim: {fault}") from None
        if remark := other_version(values):  # before anything is set: a filter may make an exception of it
            warnings.warn(remark, OtherVersionWarning, stacklevel=2)
        for name, arrays in found.particles.items():
            for array_name, array in arrays.items():
                setattr(self.state.species[name], array_name, array)
        for name, value in found.of_state.items():
            setattr(self.state, name, value)
        self.costs, self.operators.limits = found.costs, found.limits
        for effect in self.effects.values():
            effect.discard()
            effect.forget()
        self.operators.reversals.forget()
        self._fresh, self._in_midst = True, False  # forces are among the arrays
        return values

    # The step

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """What must not be left half-made: the first Ctrl-C waits for its end, unless somebody handles it otherwise.

        A second one ends it as an exception does, once other threads have ended what they are in. The state is then of
        no time, and nothing goes on from it.
        """
        use_threads(self.scene.run.threads)
        noted: list[int] = []

        def note(number: int, frame: FrameType | None) -> None:
            noted.append(number)
            if len(noted) > 1:
                raise KeyboardInterrupt("in the midst of a step")

        main = threading.current_thread() is threading.main_thread()
        ours = main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if ours:
            signal.signal(signal.SIGINT, note)
        try:
            self._in_midst = True
            yield
            self._in_midst = False
        finally:
            if ours:
                signal.signal(signal.SIGINT, signal.default_int_handler)
        if noted:
            raise KeyboardInterrupt

    def _prepare(self) -> None:
        use_threads(self.scene.run.threads)
        self._refuse_within()
        self._refuse_half_made()
        self.operators.take_back()
        if not self._fresh:
            with self._whole():
                self.operators.forces()
                self._fresh = True

    def _refuse_within(self) -> None:
        if self._open is not None:
            wrong = "the state is being looked at, in a callback or synchronised()"
            raise RuntimeError(f"{wrong}; expected this call after it, or of another Simulation")

    def _refuse_half_made(self) -> None:
        if self._in_midst:
            raise RuntimeError("a step was left half-made; expected a new Simulation, or restore() of a checkpoint")

    def _next_step(self, until: float) -> float:
        return next_step(self.state, self.operators.limits, until)

    def _check_dust_step(self, dt: float) -> None:
        guards.check_dust_step(self.state, self.effects, self.operators.limits, dt)

    def _advance(self, dt: float, until: float = math.inf) -> None:
        """From an open closing kick to the next."""
        self._integrate(self.operators, dt, until)


MOVED = ("vel", "u", "kick_acc", "kick_rate", "radiated")  # what a kick changes
