"""Relaxation of the gas before t = 0: each ring of particles moves to the radius at which its forces balance.

    dv_r/dt = <a_r> - g(r) + l^2 / r^3 - 2 Omega v_r,    dr/dt = v_r,    d(phi)/dt = l / r^2                     (1)

for `initial.relax` orbits at the reference radius. <a_r> is the mean over a ring of the SPH acceleration by pressure
and viscosity. g is the mean inward pull of star, companions and self-gravity (`initial/balance.py`). l = r v_phi is
constant, as at the start. The disc edges spread until they are in balance as well. Balance includes the errors of the
SPH forces.

All particles of a ring move together. Particles that moved independently in the shear would lose the low-noise order
of the start within a few orbits, with or without damping.

Temperatures at each radius stay as at the start. Dust does not move or act on the gas. Accretion, cooling and
conduction are left out. Afterwards the gas has the rotation of its ring, and the equilibrium radial and azimuthal flow
due to viscosity and drag.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from discsim.effects.base import Effect
from discsim.initial import balance, make_state
from discsim.numerics.operators import accelerate, longest_step
from discsim.numerics.state import State
from discsim.physics import profile
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import initial_energy
from discsim.run.forces import PhysicsError

Array = np.ndarray
DAMPING = 2.0  # damping rate in units of Omega; this is critical damping of epicycles
SAME_RADIUS = 1e-9  # largest relative difference of radii within a ring


class RelaxationReport(NamedTuple):
    """Report of a relaxation, as text by `str`.

    orbits: length of the relaxation, in orbits at the reference radius. steps, seconds: number of steps and CPU time.
    before, after: rms over particles of the residual radial acceleration, in units of c_s Omega, before and after the
    relaxation.
    """

    orbits: float
    steps: int
    seconds: float
    before: float
    after: float

    def __str__(self) -> str:
        took = f"{self.steps} steps, {self.seconds:.1f} s of CPU"
        change = f"from {self.before:.2g} to {self.after:.2g} c_s Omega (rms)"
        return f"gas relaxed for {self.orbits:g} orbits before t = 0 ({took}): residual acceleration {change}"


def relax(state: State, effects: dict[str, Effect]) -> RelaxationReport | None:
    """Relax the gas of an initial state, eq. (1), and return a report; None if the scene has no `initial.relax`.

    pos, vel, h and u of `state.gas` change in place. Dust, bodies and the time stay the same.
    """
    scene, gas = state.scene, state.gas
    orbits = getattr(scene.initial, "relax", 0.0)
    if orbits == 0.0 or gas is None:
        return None
    begun = time.process_time()
    disc = _Rings(state, effects)
    before = disc.residual_acceleration()
    until = 2.0 * math.pi * orbits / float(kepler_omega(scene, scene.initial.reference_radius))
    steps, elapsed = 0, 0.0
    while elapsed < until:
        dt = min(scene.run.courant * disc.longest_step(), until - elapsed)
        if elapsed + dt == elapsed:
            raise PhysicsError(f"in the relaxation before t = 0 the time step became too small, {dt:g}")
        disc.step(dt)
        steps, elapsed = steps + 1, elapsed + dt
    gas.pos[:], gas.vel[:], gas.h[:] = disc.gas_only.gas.pos, disc.velocities(), disc.gas_only.gas.h
    if gas.u is not None:
        gas.u[:] = disc.gas_only.gas.u
    return RelaxationReport(orbits, steps, time.process_time() - begun, before, disc.residual_acceleration())


class _Rings:
    """Rings of the gas in an initial state; the rings are sets of n particles at equal radii.

    gas_only: state with only the gas particles, which move with the rings. ring (n,): ring of each particle. count
    (rings,): number of particles. radius, radial, acc (rings,): radius, radial velocity and radial acceleration. angle
    (n,): azimuth of each particle at the start. rotated (rings,): angle by which a ring has rotated since. spin
    (rings,): specific angular momentum l of eq. (1).
    """

    def __init__(self, state: State, effects: dict[str, Effect]) -> None:
        gas = state.gas
        self.scene = balance.gas_only_scene(state.scene)
        arrays = {"pos": gas.pos, "vel": gas.vel, "mass": gas.mass, "u": gas.u, "small": gas.small}
        self.gas_only = make_state(self.scene, {"gas": {key: a for key, a in arrays.items() if a is not None}})
        self.gas_only.gas.h[:] = gas.h
        self.sph = type(effects["gas"])(self.scene, self.gas_only)
        self.balance = balance.Equilibrium(state, effects)
        radius = np.sqrt((gas.pos**2).sum(axis=1))
        self.angle = np.arctan2(gas.pos[:, 1], gas.pos[:, 0])
        self.ring = np.concatenate([[0], np.cumsum(np.abs(np.diff(radius)) > SAME_RADIUS * radius[1:])])
        self.count = np.bincount(self.ring)
        self.radius = self.mean(radius)
        self.radial, self.rotated = np.zeros_like(self.radius), np.zeros_like(self.radius)
        at = np.stack([self.radius, np.zeros_like(self.radius)], axis=1)
        self.spin = self.radius * self.balance.without_drag(at)[1]
        self.forces()

    def mean(self, values: Array) -> Array:
        """Return the mean of `values` (n,) over the particles of each ring (rings,)."""
        return np.asarray(np.bincount(self.ring, values) / self.count)

    def forces(self) -> None:
        """Move the particles with their rings, and set `acc`, the radial acceleration of eq. (1) without damping."""
        gas = self.gas_only.gas
        angle = self.angle + self.rotated[self.ring]
        outwards = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        gas.pos[:] = self.radius[self.ring][:, None] * outwards
        if gas.u is not None:
            gas.u[:] = initial_energy(self.scene, self.radius)[self.ring]
        across = np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
        gas.vel[:] = self.radial[self.ring][:, None] * outwards
        gas.vel += (self.spin / self.radius)[self.ring][:, None] * across
        gas.acc[:] = 0.0
        self.results = accelerate(self.sph, self.gas_only)
        pull = self.mean((gas.acc * outwards).sum(axis=1))
        self.acc = pull - self.balance.gravity(self.radius) + self.spin**2 / self.radius**3

    def longest_step(self) -> float:
        """Return the longest time step before the Courant factor."""
        return min(longest_step(self.sph, self.gas_only, self.results), 1.0 / float(self.omega.max()))

    @property
    def omega(self) -> Array:
        """Keplerian orbital frequencies (rings,)."""
        return kepler_omega(self.scene, self.radius)

    def step(self, dt: float) -> None:
        """Advance the rings by dt, eq. (1)."""
        self.radial += 0.5 * dt * self.acc
        self.radius += dt * self.radial
        if self.radius.min() <= 0.0:
            raise PhysicsError(
                "in the relaxation before t = 0 a ring of gas falls into the centre; choose smoother edges of the "
                "gas, or remove initial.relax"
            )
        self.rotated += dt * self.spin / self.radius**2
        self.forces()
        self.radial += 0.5 * dt * self.acc
        self.radial *= np.exp(-DAMPING * self.omega * dt)  # eq. (1)

    def residual_acceleration(self) -> float:
        """Return the rms over particles of the residual radial acceleration, in units of c_s Omega."""
        unit = self.mean(self.gas_only.gas.sound_speed) * self.omega
        return float(np.sqrt(np.average((self.acc / unit) ** 2, weights=self.count)))

    def velocities(self) -> Array:
        """Return velocities (n, 2) of the particles: the rotation of their rings, and the flow by viscosity and drag.

        The flow is that of the initial disc at the radius of the ring, or at the nearest edge outside the disc.
        """
        disc = profile.radial(self.balance.scene)
        inside = np.clip(self.radius, disc.inner, disc.outer)
        at = np.stack([inside, np.zeros_like(inside)], axis=1)
        radial, azimuthal = self.balance.velocities("gas", at, None)
        azimuthal = self.spin / self.radius + azimuthal - self.balance.without_drag(at)[1]
        out = self.gas_only.gas.pos / self.radius[self.ring][:, None]
        across = np.stack([-out[:, 1], out[:, 0]], axis=1)
        return radial[self.ring][:, None] * out + azimuthal[self.ring][:, None] * across
