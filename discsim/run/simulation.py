"""The step loop.

    kick(dt/2)  drift(dt)  events  forces  kick(dt/2)

A kick turns accelerations into velocities; where a scene has drag, the kick is the exact relaxation of gas and
dust with the accelerations inside. The closing kick of a step and the opening kick of the next have the same
sources, and the relaxation composes exactly, so the loop does both at once: between steps `state.lag` says how
much of a kick the velocities still await. Where somebody looks (`synchronised`), the closing kick is made on
copies, and undone, so that looking never changes a bit of what follows. `euler` is the papers' first-order
scheme.
"""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from discsim.effects import load_effects
from discsim.initial import make_particles, make_state, own, start_of
from discsim.numerics.state import Dust, Gas, Ledger, State
from discsim.numerics.threads import copied, fill, share, use_threads
from discsim.output.checkpoint import CheckpointError, Scalar, read_checkpoint, write_checkpoint
from discsim.preview.memory import too_much
from discsim.run.costs import Costs
from discsim.scene import Scene, SceneError, load_scene
from discsim.scene.differences import refuse_another
from discsim.scene.units import Units


class PhysicsError(Exception):
    """The run cannot go on: something is not finite, or the step has collapsed."""


class Simulation:
    """A scene in motion.

    scene: path of a TOML file, dict, or validated Scene. particles: own particles by species, in place of [initial]:
    dict(pos (n, d), vel (n, d), mass (n,)[, u, species]), Quantities or in code units. Raises SceneError.
    """

    def __init__(self, scene: Scene | str | Path | dict, particles: dict[str, dict[str, Any]] | None = None):
        if not isinstance(scene, Scene):
            scene = load_scene(scene, own_particles=particles is not None)
        given = None if particles is None else own.read(scene, particles)
        if given is not None:
            scene = own.counted(scene, given)
        self.scene = scene
        if faults := list(too_much(scene)):
            raise SceneError(faults)
        use_threads(scene.run.threads)
        try:
            self.state = make_state(scene, _made(scene) if given is None else given)
            of_drag = scene.drag is not None and scene.background is None and not scene.on_cells
            if scene.self_gravity is not None or of_drag:
                from discsim.numerics.grid import Grid

                # As fine as the gas, where there is any: one-way dust must not change it.
                first = next(iter(self.state.species.values()))
                self.state.grid = Grid.from_scene(scene, first.count)
            self.effects = load_effects(scene, self.state)
            settle = None if particles is not None else start_of(scene).settle
            if settle is not None:
                with np.errstate(**OVERFLOWS):
                    settle(self.state, self.effects)
        except ValueError as error:
            raise SceneError([str(error)]) from error
        except (FloatingPointError, ZeroDivisionError, OverflowError) as error:
            raise SceneError([f"the start's numbers are too extreme: {error}; expected others"]) from error
        self.costs = Costs(self.effects)
        self.limit, self.limited_by = math.inf, ""
        self.dust_limit, self.dust_limited_by = math.inf, ""  # of one-way dust, which limits no step
        self._fresh = self._in_midst = False

    @property
    def time(self) -> float:
        return self.state.time

    @property
    def units(self) -> Units:
        return self.scene.units

    @property
    def gas(self) -> Gas | None:
        return self.state.gas

    @property
    def dust(self) -> Dust | None:
        return self.state.dust

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
            self._close()
        return dt

    def run(self, until: float | None = None) -> None:
        """Step to time `until` (code units; default that of the scene) and land on it.

        Ctrl-C ends it after a step; to run on gives the same bits as never to have stopped. Velocities then await the
        closing kick of that step: `synchronised` shows them with it.
        """
        self.evolve(self.scene.run.until if until is None else until)
        with self._whole():
            self._close()

    def evolve(self, until: float, after_step: Callable[[], bool] | None = None) -> bool:
        """Step to `until`, leaving the closing kick open; ends early (False) where `after_step` returns True."""
        self._prepare()
        while self.state.time < until:
            dt = self._next_step(until)
            self._check_dust_step(dt)
            with self._whole():
                self._advance(dt, until)
            if after_step is not None and after_step():
                return False
        return True

    @contextmanager
    def synchronised(self) -> Iterator[State]:
        """The state with its closing kick made, for looking at; what follows does not notice."""
        state = self.state
        self._prepare()
        if state.lag == 0.0:
            yield state
            return
        saved = [(p, {k: v.copy() for k, v in p.arrays().items() if k in MOVED}) for p in state.species.values()]
        lag = state.lag
        kept_costs = self.costs
        self.costs = Costs(self.effects)
        try:
            self._close()
            yield state
        finally:
            self.costs = kept_costs
            state.lag = lag
            for particles, arrays in saved:
                for name, array in arrays.items():
                    setattr(particles, name, array)

    def acceleration(self, effect: str) -> tuple[np.ndarray | None, np.ndarray | None]:
        """What one effect gives now to (gas, dust), each (n, dimensions) or None where there is no such species."""
        if effect not in self.effects:
            raise KeyError(f"no effect {effect!r} in this scene; it has {', '.join(self.effects)}")
        use_threads(self.scene.run.threads)
        state = self.state
        gas, dust = state.gas, state.dust
        try:
            # On copies: the gas's effect settles h as well.
            state.gas, state.dust = gas and gas.copy(), dust and dust.copy()
            for p in state.species.values():
                p.acc[:] = 0.0
            self.effects[effect].accelerate(state)
            found = {name: p.acc for name, p in state.species.items()}
        finally:
            state.gas, state.dust = gas, dust
        return found.get("gas"), found.get("dust")

    def save(self, path: str | Path, notes: Mapping[str, Scalar] | None = None) -> None:
        """Write a checkpoint from which `restore` goes on, bit for bit, with `notes` in it. Raises OSError."""
        self._prepare()
        state = self.state
        groups = {name: p.arrays() for name, p in state.species.items()}
        groups["own_acc"] = state.own_acc
        groups["ledger"] = {name: np.atleast_1d(value) for name, value in asdict(state.ledger).items()}
        groups["scene"] = {"text": np.frombuffer(self.scene.text.encode(), np.uint8)}
        groups["costs"] = {"calls": np.array([*self.costs.calls.values()])}
        groups["costs"]["seconds"] = np.array([*self.costs.seconds.values()])
        values: dict[str, Scalar] = {"time": state.time, "step": state.step, "lag": state.lag}
        values |= {"limit": self.limit, "limited_by": self.limited_by}
        values |= {"dust_limit": self.dust_limit, "dust_limited_by": self.dust_limited_by}
        write_checkpoint(path, groups, {**values, **(notes or {})})

    def restore(self, path: str | Path) -> dict[str, Scalar]:
        """Go on from a checkpoint of this scene; returns its single values. Raises CheckpointError, SceneError.

        The scene may differ from that of the checkpoint as with --resume. What raises leaves all as it was.
        """
        groups, values = read_checkpoint(path)
        refuse_another(path, groups["scene"]["text"].tobytes(), self.scene)
        state, costs = self.state, self.costs.copy()
        for name, particles in state.species.items():
            held, own = groups[name], particles.arrays()
            lengths = {len(array) for array in held.values()}
            if held.keys() != own.keys() or len(lengths) > 1 or any(held[k].shape[1:] != own[k].shape[1:] for k in own):
                raise CheckpointError(f"{path}: does not hold the {name} of this scene")
        ledger = Ledger(**{f.name: _entry(groups["ledger"][f.name]) for f in fields(Ledger)})
        for table, numbers in ((costs.calls, "calls"), (costs.seconds, "seconds")):
            table.update(zip(self.effects, groups["costs"][numbers].tolist(), strict=True))
        time, step, lag = float(values["time"]), int(values["step"]), float(values["lag"])
        limit, limited_by = float(values["limit"]), str(values["limited_by"])
        dust_limit, dust_limited_by = float(values["dust_limit"]), str(values["dust_limited_by"])
        own_acc = dict(groups["own_acc"])
        for name, particles in state.species.items():
            for array_name, array in groups[name].items():
                setattr(particles, array_name, array)
        state.own_acc, state.ledger, self.costs = own_acc, ledger, costs
        state.time, state.step, state.lag = time, step, lag
        self.limit, self.limited_by = limit, limited_by
        self.dust_limit, self.dust_limited_by = dust_limit, dust_limited_by
        self._fresh, self._in_midst = True, False  # forces are among the arrays
        return values

    # The step

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """What must not be left half-made: the first Ctrl-C waits for its end, unless somebody handles it otherwise.

        A second one ends it at once, as an exception does. The state is then of no time, and nothing goes on from it.
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
        if self._in_midst:
            raise RuntimeError("a step was left half-made; expected a new Simulation, or restore() of a checkpoint")
        if not self._fresh or not self._coupled:
            self._check_inputs()
        if not self._fresh:
            with self._whole():
                self._forces()
                self._fresh = True

    def _advance(self, dt: float, until: float = math.inf) -> None:
        """From an open closing kick to the next: kick, drift, events, forces."""
        state = self.state
        if self.scene.run.integrator == "euler":
            # v with the forces at the old places, x with the old velocity: both first order.
            other = {name: p.vel.copy() for name, p in state.species.items()}
            self._kick(dt)
            for name, p in state.species.items():
                p.vel, other[name] = other[name], p.vel
            self._move(dt)
            for name, p in state.species.items():
                p.vel = other[name]
        else:
            self._kick(state.lag + 0.5 * dt)
            self._move(dt)
        left = until - state.time
        state.time = until if abs(dt - left) <= 1e-9 * dt else state.time + dt
        state.step += 1
        state.lag = 0.5 * dt if self.scene.run.integrator == "kdk" else 0.0
        for name, effect in self.effects.items():
            with self.costs(name):
                effect.event(state)
        self._forces()

    def _close(self) -> None:
        if self.state.lag > 0.0:
            self._kick(self.state.lag)
            self.state.lag = 0.0

    def _kick(self, dt: float) -> None:
        if self._coupled:
            self._check_inputs()
        if "drag" in self.effects:
            try:
                with self.costs("drag"):
                    self.effects["drag"].kick(self.state, dt)
            except FloatingPointError as fault:
                raise PhysicsError(str(fault)) from fault
        else:
            for name, effect in self.effects.items():
                with self.costs(name):
                    effect.kick(self.state, dt)
        for name, p in self.state.species.items():
            self._check_finite(name, p.vel, "in its vel after a kick")
        if self.state.gas is not None and self.state.gas.u is not None:
            self._check_finite("gas", self.state.gas.u, "in its u after a kick")

    def _move(self, dt: float) -> None:
        for name, effect in self.effects.items():
            with self.costs(name):
                effect.move(self.state, dt)

    def _forces(self) -> None:
        """Accelerations of all effects at the present positions, and the step that they allow."""
        state = self.state
        for p in state.species.values():
            fill(p.acc, lambda piece: 0.0)
        own = {name: effect.acts_on for name, effect in self.effects.items() if not effect.shared}
        for name in own:
            self._accelerate(name)
        if "drag" in self.effects:
            alone = {name for acts_on in own.values() for name in acts_on}
            with self.costs("drag"):
                state.own_acc = {
                    name: copied(p.acc) if name in alone else p.acc[:0] for name, p in state.species.items()
                }
        for name in self.effects:
            if name not in own:
                self._accelerate(name)
        limits = {name: effect.limit(state) for name, effect in self.effects.items()}
        self.limit, self.limited_by = _least(limits)
        self.dust_limit, self.dust_limited_by = math.inf, ""
        if state.unnoticed:
            of_dust = {name: effect.limit_of(state, "dust") for name, effect in self.effects.items()}
            self.dust_limit, self.dust_limited_by = _least(of_dust)
        for name, p in state.species.items():
            self._check_finite(name, p.acc, "in its acceleration")
        self._check_limits(limits)

    def _accelerate(self, name: str) -> None:
        try:
            with self.costs(name):
                self.effects[name].accelerate(self.state)
        except FloatingPointError as fault:
            raise PhysicsError(str(fault)) from fault
        for p in self.state.species.values():
            if p.immobile is not None:
                p.acc[p.immobile] = 0.0

    def _next_step(self, until: float) -> float:
        """The step from here: the limit's share, or the fixed one, cut so as to land on `until`."""
        run, left = self.scene.run, until - self.state.time
        if (
            run.timestep is not None
            and min(run.timestep, left) > MOST * self.limit
            and not self._over_before_it_grows(left)
        ):
            raise PhysicsError(
                f"run.timestep is {run.timestep / self.limit:.3g} times the step that {self.limited_by} allows: "
                f"above {MOST:g} times sound and orbits grow without end; expected at most {self.limit:.3g} code units"
            )
        dt = run.timestep if run.timestep is not None else run.courant * self.limit
        if not math.isfinite(dt):
            if left == math.inf and self.state.time >= run.until:
                return math.inf
            dt = run.until - self.state.time if left == math.inf else left
        if abs(dt - left) <= 1e-9 * dt:
            return dt  # not cut: a landing must not change a fixed step by a rounding
        if dt > left:
            return left
        if run.timestep is None and 2.0 * dt > left:
            return 0.5 * left  # two even steps rather than a long and a tiny one
        if self.state.time + dt == self.state.time:
            raise PhysicsError(f"the step has collapsed to {dt:g}, set by {self.limited_by}")
        return dt

    def _over_before_it_grows(self, left: float) -> bool:
        """Whether rounding errors stay small in the few steps of uniform gas, whose drag is exact at any length."""
        run = self.scene.run
        if self.scene.initial is None or not start_of(self.scene).uniform or run.timestep is None:
            return False
        steps = math.ceil((run.until if left == math.inf else self.state.time + left) / run.timestep - 1e-9)
        # A step of x times the limit multiplies them by x^2 at most.
        return steps <= 1 or 2 * steps * math.log10(run.timestep / self.limit) < GROWN

    def _check_dust_step(self, dt: float) -> None:
        """That one-way dust, which may not shorten the step, keeps its orbits in one of dt."""
        if dt <= LOST * self.dust_limit:
            return
        dust, name = self.state.dust, self.dust_limited_by
        assert dust is not None
        pull = self.acceleration(name)[1]
        assert pull is not None
        i = self.effects[name].tightest(dust, pull)
        raise PhysicsError(
            f"a step of {dt:.3g} is {dt / self.dust_limit:.3g} times the limit that {name} sets for dust particle "
            f"{dust.ids[i]} at r = {np.linalg.norm(dust.pos[i]):.3g}: one-way dust does not shorten the step of "
            f"the gas, and above {LOST:g} its orbit is lost; expected {self.effects[name].softer}, or a smaller "
            f"run.{'courant' if self.scene.run.timestep is None else 'timestep'}"
        )

    def _check_limits(self, limits: dict[str, float]) -> None:
        for name, limit in limits.items():
            if math.isnan(limit) or limit <= 0.0:
                raise PhysicsError(f"the step that {name} allows is {limit}{self._without_heat()}")

    def _without_heat(self) -> str:
        """The coldest gas, where it has lost more heat within a step than it had."""
        gas = self.state.gas
        if gas is None or gas.u is None or not gas.pressure.min() < 0.0:
            return ""
        coldest = gas.ids[gas.pressure.argmin()]
        return f"; gas particle {coldest} has lost more heat in a step than it had: try a smaller run.courant"

    @property
    def _coupled(self) -> bool:
        """Whether particles feel each other, so that what is wrong with one spreads."""
        return self.state.gas is not None or self.state.grid is not None

    def _check_inputs(self) -> None:
        """That what somebody may have changed is finite, before a kick or a search for neighbours spreads it."""
        for name, p in self.state.species.items():
            arrays = {key: values for key in INPUTS if (values := getattr(p, key, None)) is not None}
            if not math.isfinite(sum(share(partial(_sum, *arrays.values()), p.count))):
                for key, values in arrays.items():
                    self._check_finite(name, values, f"in its {key} before the step", made_here=False)

    def _check_finite(self, name: str, values: np.ndarray, where: str, made_here: bool = True) -> None:
        """That all `values` (n, ...) are finite; `made_here` says that it was an effect that made them."""
        # A sum is finite unless an entry is not (or they overflow, which is as bad), and costs a tenth.
        if math.isfinite(sum(share(partial(_sum, values), len(values)))):
            return
        particles = self.state.species[name]
        rows = values.reshape(len(values), -1)
        right = np.isfinite(rows).all(axis=1)
        i = int(np.argmax(np.abs(rows).max(axis=1)) if right.all() else np.argmin(right))
        if made_here and not np.isfinite(particles.pos[i]).all():
            where, rows, made_here = "in its pos", particles.pos, False
        value = ", ".join(f"{entry:g}" for entry in rows[i])
        what = f"{name} particle {particles.ids[i]} is not finite {where} ({value}; step {self.state.step})"
        raise PhysicsError(what + (self._culprit(name, i) if made_here else ""))

    def _culprit(self, species: str, i: int) -> str:
        for name in self.effects:
            try:
                with np.errstate(all="ignore"):
                    found = dict(zip(("gas", "dust"), self.acceleration(name), strict=True))[species]
            except FloatingPointError as fault:
                return f"; {fault}"
            if found is not None and not np.isfinite(found[i]).all():
                return f"; the first effect to give it an acceleration that is not finite is {name}"
        return ""


def _least(limits: dict[str, float]) -> tuple[float, str]:
    """The shortest step, and the effect that sets it."""
    name = min(limits, key=limits.__getitem__)
    return limits[name], name


def _entry(array: np.ndarray) -> Any:
    """An entry of the ledger as it was saved: a number, or several."""
    return array if len(array) > 1 else float(array[0])


# A leapfrog of a frequency of 1 over the limit grows above 2; limits are estimates. In a box rounding errors do.
MOST = 2.5
GROWN = 8.0  # powers of ten that rounding, of 1e-16, may grow by before it is seen
# In steps of 1/Omega a circular orbit keeps its energy to 12%, of half of it to 1%; in longer ones grains that come
# near the star are thrown out.
LOST = 1.0
MOVED = ("vel", "u", "kick_acc", "kick_rate")  # what a kick changes
OVERFLOWS: Any = {"over": "raise", "divide": "raise", "invalid": "raise"}  # of a start
INPUTS = ("pos", "vel", "mass", "u", "h")  # of a step


def _made(scene: Scene) -> dict[str, dict[str, Any]]:
    with np.errstate(**OVERFLOWS):
        return make_particles(scene)


def _sum(*arrays: Any) -> float:
    """The sum of all entries of arrays (n, ...) between two numbers of particles, the last two arguments."""
    *values, first, last = arrays
    with np.errstate(all="ignore"):
        return float(sum(np.add.reduce(array[first:last], axis=None) for array in values))
