"""Checks that stop a run if its numbers are wrong or will soon be; each raises a PhysicsError that names the cause."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from functools import reduce
from itertools import chain
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect
from discsim.numerics import world
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import EntryError, check_arrays, check_like, check_ranges
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for_ranges
from discsim.parts import Lazy
from discsim.physics.orbits import star_acts_in_drift
from discsim.run.forces import Effects, Limits, PhysicsError, acceleration_of, limiting_grain

finite = Lazy("discsim.kernels.common.finite")

STEP_INPUTS = ("pos", "vel", "across", "mass", "u", "h")  # arrays that a step reads

# Detection of unstable gas: smallest size of the sample if there is more gas, and number of steps between checks.
MIN_SAMPLE, CHECK_EVERY = 512, 16
# Gas is unstable if more than half of the sample is beyond each of these two limits.
REVERSAL_COSINE = -0.2  # cosine of the angle between two successive changes of acceleration
MAX_KICK = 0.25  # difference between the velocity changes of two steps, in sound speeds


class Sample(NamedTuple):
    """Sample of n gas particles in one step: ids (n,), which ascend, sound speeds (n,) and accelerations (n, d)."""

    time: float
    ids: np.ndarray
    sound_speed: np.ndarray
    acc: np.ndarray


class ReversalGuard:
    """Detector of unstable gas, whose accelerations change sign in every step.

    In an unstable leapfrog, sound waves between neighbours change sign with each step and grow. In a stable run this
    happens to few particles at most, as steps resolve the motion. Sampled particles have accelerations a1, a2, a3 in
    three consecutive steps, without the pull of the central mass; d1 = a2 - a1 and d2 = a3 - a2. cos(d1, d2) is near 1
    on smooth paths, -1 for one growing mode, and -1/2 for noise that is independent in each step. |d2| dt is the
    difference between the velocity changes of two steps.
    """

    def __init__(self) -> None:
        self.samples: list[Sample] = []  # samples of the last steps

    def forget(self) -> None:
        """Drop all samples. Call this if the next step does not follow the sampled steps."""
        self.samples.clear()

    def check(self, state: State, effects: Effects) -> None:
        """Sample the gas in three of every CHECK_EVERY steps, and check the third sample.

        Raises PhysicsError, on every process, if more than half of the sample has a cosine below REVERSAL_COSINE and
        more than half of the sample has a velocity difference above MAX_KICK.
        """
        gas, turn = state.gas, state.step % CHECK_EVERY
        if gas is None or gas.global_count == 0 or not 1 <= turn <= 3:
            self.forget()
            return
        self.samples.append(_sample_gas(state))
        if len(self.samples) < 3:
            return
        # Particles that stayed on this process through three steps; rows change as they are sorted.
        ids = reduce(np.intersect1d, [sample.ids for sample in self.samples])
        rows = [np.searchsorted(sample.ids, ids) for sample in self.samples]
        a1, a2, a3 = (sample.acc[own] for sample, own in zip(self.samples, rows, strict=True))
        first, second = a2 - a1, a3 - a2
        size = np.sqrt((first**2).sum(axis=1) * (second**2).sum(axis=1))
        cosine = (first * second).sum(axis=1) / np.maximum(size, 1e-300)
        kicks = np.sqrt((second**2).sum(axis=1)) * (self.samples[2].time - self.samples[1].time)
        beyond = kicks > MAX_KICK * self.samples[2].sound_speed[rows[2]]
        counts = np.array([len(ids), np.count_nonzero(cosine < REVERSAL_COSINE), np.count_nonzero(beyond)])
        number, reversals, large_kicks = world.processes.sum(counts)
        if 2 * reversals > number and 2 * large_kicks > number:
            key = "courant" if state.scene.run.timestep is None else "timestep"
            raise PhysicsError(
                f"the gas is numerically unstable: accelerations reverse in every step, and each kick exceeds "
                f"{MAX_KICK:g} times the sound speed; lower run.{key}"
            )


def _sample_gas(state: State) -> Sample:
    """Return a sample of the gas: the particles whose ids are multiples of a power of two.

    The pull of the central mass is subtracted from the accelerations.
    """
    gas = state.gas
    every = 1 << max(gas.global_count // MIN_SAMPLE, 1).bit_length() - 1
    rows = np.flatnonzero((gas.ids & (every - 1)) == 0)
    rows = rows[np.argsort(gas.ids[rows])]
    acc, (mass, softening) = gas.acc[rows], state.central
    if mass > 0.0 and not star_acts_in_drift(state.scene):
        away = state.from_centre(gas.pos[rows])
        acc += mass * away / np.maximum((away**2).sum(axis=1)[:, None] + softening**2, 1e-200) ** 1.5
    return Sample(state.time, gas.ids[rows], gas.sound_speed[rows], acc)


def check_entries(state: State, effects: Effects) -> None:
    """Check the arrays of the state, which a caller may have set, before a kernel reads them.

    Raises EntryError for a wrong type, shape or range, and PhysicsError as `check_inputs`.
    """
    dimensions = state.scene.space.dimensions
    for name, p in state.species.items():
        held = p.arrays()
        if lost := [f.name for f in fields(p) if f.default is MISSING and f.name not in held]:
            raise EntryError(f"{name}.{lost[0]} is None; expected an array")
        count = check_arrays(name, held, dimensions)
        forces = state.acc_unshared.get(name)
        if forces is not None and len(forces) not in (0, count):
            words = f"{state.scene.model.element_of(name)}s"
            raise EntryError(
                f"{name} has {count} {words}, but had {len(forces)} {words} before; keep the number of {words}"
            )
    if state.bodies is not None:
        same = Bodies.at_rest(np.zeros(state.body_count))
        check_like("bodies", state.bodies.arrays(), same.arrays())
        check_ranges("bodies", state.bodies.arrays(), time=state.time)
    check_inputs(state, effects)
    for name, p in state.species.items():
        check_ranges(name, p.arrays(), populations=len(state.scene.dust or ()))


def check_inputs(state: State, effects: Effects) -> None:
    """Raise PhysicsError if an array that a step reads is not finite."""
    species = state.species.items()
    arrays = [
        (name, values, f"in its {key} before the step")
        for name, p in species for key in STEP_INPUTS if (values := getattr(p, key, None)) is not None
    ]  # fmt: skip
    _check_arrays(state, effects, arrays, made_here=False)


def check_after_kick(state: State, effects: Effects) -> None:
    """Raise PhysicsError if a velocity or an energy is not finite after a kick."""
    arrays = [
        (name, values, f"in its {key} after a kick")
        for name, p in state.species.items() for key in ("vel", "across") if (values := getattr(p, key)) is not None
    ]  # fmt: skip
    if state.gas is not None and state.gas.u is not None:
        arrays.append(("gas", state.gas.u, "in its u after a kick"))
    _check_arrays(state, effects, arrays)
    _check_bodies(state)


def check_forces(state: State, effects: Effects, limits: dict[str, float]) -> None:
    """Raise PhysicsError if an acceleration is not finite, or a time-step limit is NaN or not positive.

    limits: time-step limits by name of the effect.
    """
    _check_arrays(state, effects, [(name, p.acc, "in its acceleration") for name, p in state.species.items()])
    _check_bodies(state)
    for name, limit in limits.items():
        if math.isnan(limit) or limit <= 0.0:
            raise PhysicsError(
                f"the time-step limit of {name} is {limit}; expected a positive number{_negative_energy_remark(state)}"
            )


def check_new_effect(state: State, name: str, effect: Effect) -> None:
    """Raise PhysicsError if an acceleration by an effect that is not in the run yet is not finite."""
    arrays = [(species, acc, "in its acceleration") for species, acc in acceleration_of(effect, state).items()]
    _check_arrays(state, {name: effect}, arrays)


def check_dust_step(state: State, effects: Effects, limits: Limits, dt: float) -> None:
    """Raise PhysicsError if a step of dt is too long for the orbits of one-way dust, which does not shorten steps."""
    if dt <= limits.dust:
        return
    dust, name, which, remedy = state.dust, limits.dust_by, "a dust particle", ""
    assert dust is not None
    if not world.processes.is_parallel:
        i, remedy = limiting_grain(effects[name], state)
        remedy = remedy and f"{remedy}, or "
        which = f"dust particle {dust.ids[i]} at r = {np.linalg.norm(dust.pos[i]):.3g}"
    raise PhysicsError(
        f"the time step {dt:.3g} is {dt / limits.dust:.3g} times the limit of {name} for the orbit of {which}: "
        f"one-way dust does not shorten the time step; choose {remedy}a smaller "
        f"run.{'courant' if state.scene.run.timestep is None else 'timestep'}"
    )


def _check_bodies(state: State) -> None:
    """Raise PhysicsError if a position, velocity or acceleration of the star or a companion is not finite."""
    bodies = state.bodies
    if bodies is None:
        return
    for name in ("pos", "vel", "acc"):
        values = getattr(bodies, name)
        if not all(map(math.isfinite, values.ravel().tolist())):  # numpy takes five times as long for so few
            i = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise PhysicsError(
                f"{bodies.name(i)} is not finite in its {name} (step {state.step}); perhaps two bodies collide"
            )


def _negative_energy_remark(state: State) -> str:
    """Return a remark about a gas particle with a negative energy, for a message; "" if there is none."""
    gas = state.gas
    if gas is None or gas.u is None or not gas.pressure.min() < 0.0:
        return ""
    coldest = f"gas {state.scene.model.element_of('gas')} {gas.ids[gas.pressure.argmin()]}"
    return f"; {coldest} has a negative energy after one step; lower run.courant"


def _check_arrays(
    state: State, effects: Effects, arrays: list[tuple[str, np.ndarray, str]], made_here: bool = True
) -> None:
    """Raise PhysicsError unless all `arrays` are finite.

    arrays: tuples (species, values (n, ...), description of the array for the message). made_here: whether effects have
    just computed the values; the message then names the first effect at fault.
    """
    if _are_finite([values for _, values, _ in arrays]):
        return
    name, values, where = next(each for each in arrays if not _are_finite([each[1]]))
    particles = state.species[name]
    rows = values.reshape(len(values), -1)
    right = np.isfinite(rows).all(axis=1)
    i = int(np.argmax(np.abs(rows).max(axis=1)) if right.all() else np.argmin(right))
    if made_here and not np.isfinite(particles.pos[i]).all():
        where, rows, made_here = "in its pos", particles.pos, False
    value = ", ".join(f"{entry:g}" for entry in rows[i])
    element = state.scene.model.element_of(name)
    what = f"{name} {element} {particles.ids[i]} is not finite {where} ({value}; step {state.step})"
    raise PhysicsError(what + (_remark_on_first_effect(state, effects, name, i) if made_here else ""))


def _remark_on_first_effect(state: State, effects: Effects, species: str, i: int) -> str:
    """Return a remark that names the first effect whose acceleration of a particle is not finite; "" if there is none.

    species, i: species and row of the particle.
    """
    if world.processes.is_parallel:
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
    """Return whether all entries of all `arrays` are finite.

    The arrays are tested in one parallel loop, as most are too short for a loop of their own.
    """
    rows = [(len(array), array.reshape(len(array), -1)) for array in arrays if array.size > 0]
    return all(chain(*parallel_for_ranges(finite.are_finite, rows, light=True)))
