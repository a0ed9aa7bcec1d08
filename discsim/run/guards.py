"""Guards that stop a run before its numbers lose their meaning; each raises a PhysicsError that names the cause."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from functools import reduce
from itertools import chain
from typing import NamedTuple

import numpy as np

from discsim.numerics import world
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import EntryError, check_arrays, check_like, check_ranges
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for_ranges
from discsim.parts import Lazy
from discsim.physics.orbits import in_drift
from discsim.run.forces import Effects, Limits, PhysicsError, acceleration_of, limit_of_dust

finite = Lazy("discsim.kernels.common.finite")

INPUTS = ("pos", "vel", "mass", "u", "h")  # arrays that a step reads

# Detection of gas that long steps tear apart: least number of sampled particles, interval in steps, and values that
# half of the sample must not exceed.
SAMPLE, EVERY = 512, 16
REVERSED = -0.2  # cosine between two changes of acceleration, one after the other
KICKED = 0.25  # change of a kick, in sound speeds


class Sample(NamedTuple):
    """Sample of particles at a time: ids in ascending order and sound speeds, (n,) each, and accelerations (n, d)."""

    time: float
    ids: np.ndarray
    sound_speed: np.ndarray
    acc: np.ndarray


class Reversals:
    """Detector of gas whose acceleration swings back and forth from one step to the next.

    In an unstable leapfrog sound between neighbours changes its sign with each step, and grows. No physics does this
    to most of the gas, as a step resolves its motion. Sampled particles have accelerations a1, a2, a3 in three steps,
    without the pull of the central mass; d1 = a2 - a1 and d2 = a3 - a2. cos(d1, d2) is near 1 on smooth paths, -1
    where one mode grows, and -1/2 where each step has noise of its own. |d2| dt is the change of velocity by a step.
    """

    def __init__(self) -> None:
        self.seen: list[Sample] = []  # samples of the last steps

    def forget(self) -> None:
        """Drop all samples, before steps that do not continue them."""
        self.seen.clear()

    def check(self, state: State, effects: Effects) -> None:
        """Raise PhysicsError on every process if the acceleration of half of the sampled gas swings back and forth."""
        gas, turn = state.gas, state.step % EVERY
        if gas is None or gas.everywhere == 0 or not 1 <= turn <= 3:
            self.forget()
            return
        self.seen.append(_sample(state))
        if len(self.seen) < 3:
            return
        # Particles that stayed on this process through three steps; rows change as they are sorted.
        ids = reduce(np.intersect1d, [sample.ids for sample in self.seen])
        rows = [np.searchsorted(sample.ids, ids) for sample in self.seen]
        a1, a2, a3 = (sample.acc[own] for sample, own in zip(self.seen, rows, strict=True))
        first, second = a2 - a1, a3 - a2
        size = np.sqrt((first**2).sum(axis=1) * (second**2).sum(axis=1))
        cosine = (first * second).sum(axis=1) / np.maximum(size, 1e-300)
        kicks = np.sqrt((second**2).sum(axis=1)) * (self.seen[2].time - self.seen[1].time)
        beyond = kicks > KICKED * self.seen[2].sound_speed[rows[2]]
        counts = np.array([len(ids), np.count_nonzero(cosine < REVERSED), np.count_nonzero(beyond)])
        number, reversals, beyonds = world.processes.sum(counts)
        if 2 * reversals > number and 2 * beyonds > number:
            key = "courant" if state.scene.run.timestep is None else "timestep"
            raise PhysicsError(
                f"the gas is numerically unstable: accelerations reverse in every step, and each kick exceeds "
                f"{KICKED:g} times the sound speed; expected a smaller run.{key}"
            )


def _sample(state: State) -> Sample:
    """Return a sample of the gas, with ids that are multiples of a power of two, without the pull of the central
    mass.
    """
    gas = state.gas
    every = 1 << max(gas.everywhere // SAMPLE, 1).bit_length() - 1
    rows = np.flatnonzero((gas.ids & (every - 1)) == 0)
    rows = rows[np.argsort(gas.ids[rows])]
    acc, (mass, softening) = gas.acc[rows], state.central
    if mass > 0.0 and not in_drift(state.scene):
        away = state.from_centre(gas.pos[rows])
        acc += mass * away / np.maximum((away**2).sum(axis=1)[:, None] + softening**2, 1e-200) ** 1.5
    return Sample(state.time, gas.ids[rows], gas.sound_speed[rows], acc)


def coupled(state: State) -> bool:
    """Return whether particles interact, so that a fault of one spreads."""
    return state.gas is not None or state.grid is not None


def check_entries(state: State, effects: Effects) -> None:
    """Check arrays that a caller may have set, before a kernel reads them. Raises ValueError, and as `check_inputs`."""
    dimensions = state.scene.space.dimensions
    for name, p in state.species.items():
        held = p.arrays()
        if lost := [f.name for f in fields(p) if f.default is MISSING and f.name not in held]:
            raise EntryError(f"{name}.{lost[0]} is None; expected an array")
        count = check_arrays(name, held, dimensions)
        forces = state.acc_unshared.get(name)
        if forces is not None and len(forces) not in (0, count):
            raise EntryError(f"{name} has {count} particles, but had {len(forces)} before; expected the same number")
    if state.bodies is not None:
        same = Bodies.at_rest(np.zeros(state.body_count))
        check_like("bodies", state.bodies.arrays(), same.arrays())
        check_ranges("bodies", state.bodies.arrays(), time=state.time)
    check_inputs(state, effects)
    for name, p in state.species.items():
        check_ranges(name, p.arrays(), populations=len(state.scene.dust or ()))


def check_inputs(state: State, effects: Effects) -> None:
    """Raise PhysicsError if an input of a step is not finite, before a kick or a neighbour search spreads the fault."""
    species = state.species.items()
    arrays = [
        (name, values, f"in its {key} before the step")
        for name, p in species for key in INPUTS if (values := getattr(p, key, None)) is not None
    ]  # fmt: skip
    _check_all(state, effects, arrays, made_here=False)


def check_kicked(state: State, effects: Effects) -> None:
    """Raise PhysicsError if a velocity or an energy is not finite after a kick."""
    arrays = [(name, p.vel, "in its vel after a kick") for name, p in state.species.items()]
    if state.gas is not None and state.gas.u is not None:
        arrays.append(("gas", state.gas.u, "in its u after a kick"))
    _check_all(state, effects, arrays)
    _check_bodies(state)


def check_forces(state: State, effects: Effects, limits: dict[str, float]) -> None:
    """Raise PhysicsError if an acceleration is not finite, or an effect allows no step."""
    _check_all(state, effects, [(name, p.acc, "in its acceleration") for name, p in state.species.items()])
    _check_bodies(state)
    for name, limit in limits.items():
        if math.isnan(limit) or limit <= 0.0:
            raise PhysicsError(f"the time-step limit of {name} is {limit}{_without_heat(state)}")


def check_dust_step(state: State, effects: Effects, limits: Limits, dt: float) -> None:
    """Raise PhysicsError if one-way dust, which may not shorten the step, cannot keep its orbits in a step of dt."""
    if dt <= limits.dust:
        return
    dust, name, which, remedy = state.dust, limits.dust_by, "a dust particle", ""
    assert dust is not None
    if not world.processes.many:
        i, remedy = limit_of_dust(effects[name], state)
        remedy = remedy and f"{remedy}, or "
        which = f"dust particle {dust.ids[i]} at r = {np.linalg.norm(dust.pos[i]):.3g}"
    raise PhysicsError(
        f"the time step {dt:.3g} is {dt / limits.dust:.3g} times the limit of {name} for the orbit of {which}: "
        f"one-way dust does not shorten the time step; expected {remedy}a smaller "
        f"run.{'courant' if state.scene.run.timestep is None else 'timestep'}"
    )


def _check_bodies(state: State) -> None:
    """Raise PhysicsError if a position, velocity or acceleration of star or companions is not finite."""
    bodies = state.bodies
    if bodies is None:
        return
    for name in ("pos", "vel", "acc"):
        values = getattr(bodies, name)
        if not all(map(math.isfinite, values.ravel().tolist())):  # numpy takes five times as long for so few
            i = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise PhysicsError(
                f"{bodies.name(i)} is not finite in its {name} (step {state.step}); possibly two bodies collide"
            )


def _without_heat(state: State) -> str:
    """Return a remark on the coldest gas if it has lost more heat in a step than it had, else an empty text."""
    gas = state.gas
    if gas is None or gas.u is None or not gas.pressure.min() < 0.0:
        return ""
    coldest = gas.ids[gas.pressure.argmin()]
    return f"; gas particle {coldest} has a negative energy after one step: try a smaller run.courant"


def _check_all(
    state: State, effects: Effects, arrays: list[tuple[str, np.ndarray, str]], made_here: bool = True
) -> None:
    """Apply `_check_finite` to several arrays; entries of `arrays` are species, values and where these are."""
    if not _are_finite([values for _, values, _ in arrays]):
        for name, values, where in arrays:
            _check_finite(state, effects, name, values, where, made_here)


def _check_finite(
    state: State, effects: Effects, name: str, values: np.ndarray, where: str, made_here: bool = True
) -> None:
    """Raise PhysicsError unless all `values` (n, ...) of species `name` are finite.

    made_here: whether an effect has made the values.
    """
    if _are_finite([values]):
        return
    particles = state.species[name]
    rows = values.reshape(len(values), -1)
    right = np.isfinite(rows).all(axis=1)
    i = int(np.argmax(np.abs(rows).max(axis=1)) if right.all() else np.argmin(right))
    if made_here and not np.isfinite(particles.pos[i]).all():
        where, rows, made_here = "in its pos", particles.pos, False
    value = ", ".join(f"{entry:g}" for entry in rows[i])
    what = f"{name} particle {particles.ids[i]} is not finite {where} ({value}; step {state.step})"
    raise PhysicsError(what + (_culprit(state, effects, name, i) if made_here else ""))


def _culprit(state: State, effects: Effects, species: str, i: int) -> str:
    """Return a remark on the first effect whose acceleration of particle `i` of a species is not finite."""
    if world.processes.many:
        return ""  # effects make collective calls, and other processes have not found a fault
    for name, effect in effects.items():
        try:
            with np.errstate(all="ignore"):
                found = acceleration_of(effect, state)[species]
        except FloatingPointError as fault:
            return f"; {fault}"
        if not np.isfinite(found[i]).all():
            return f"; the first effect with an acceleration that is not finite is {name}"
    return ""


def _are_finite(arrays: list[np.ndarray]) -> bool:
    """Return whether all entries of arrays (n, ...) are finite.

    All arrays share one loop, as few are long enough for threads to be faster with a loop for each.
    """
    rows = [(len(array), array.reshape(len(array), -1)) for array in arrays if array.size > 0]
    return all(chain(*parallel_for_ranges(finite.are_finite, rows, light=True)))
