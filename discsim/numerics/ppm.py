"""Gas and dust as two fluids on a fixed 1D grid, with the piecewise-parabolic method (`kernels/fluid1d/ppm.py`).

    U_t + F(U)_x = S,   U = (rho_g, rho_g v, E, rho_d, rho_d u)
                        F = (rho_g v, rho_g v^2 + P, (E + P) v, rho_d u, rho_d u^2)

A step has three stages, each from the state U^n at its start (Wicker & Skamarock 2002):

    U^(k) = U^n + a_k dt L(U^(k-1)),   a_k = 1/3, 1/2, 1,   U^(0) = U^n,   U^(n+1) = U^(3)

The scheme is of third order in time for linear equations and of second order otherwise, and stable with unlimited
parabolas up to a Courant number of 1.2. Cells are the particles of the state, with mass rho dx at fixed positions.
Isothermal gas has no E.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.kernels.fluid1d import ppm
from discsim.numerics import world
from discsim.parts import EOS

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

Array = np.ndarray
STAGES = (1 / 3, 1 / 2, 1.0)


class Tube:
    """Fixed 1D grid of a scene; each cell is one gas particle and one dust particle of `state`.

    Raises ValueError if particle k is not at the centre of cell k.
    """

    def __init__(self, scene: Scene, state: State):
        assert state.gas is not None and state.dust is not None and scene.gas is not None
        length, count = scene.space.size[0], state.gas.count
        self.dx = length / count
        centres = (np.arange(count) + 0.5) * self.dx - (0.5 * length if scene.centred else 0.0)
        for name, p in state.species.items():
            if p.count != count or np.abs(p.pos[:, 0] - centres).max() > 1e-9 * length:
                raise ValueError(f"[{name}]: particles are not at the centres of {count} even cells, in order")
        self.periodic = scene.space.boundary == "periodic"
        beyond = np.arange(-ppm.GHOSTS, count + ppm.GHOSTS)
        # Open ends: ghost cells copy the last cells.
        self.inside = beyond % count if self.periodic else np.clip(beyond, 0, count - 1)
        eos: Any = scene.gas.eos
        self.adiabatic = EOS[eos.kind].holds_heat
        self.gamma = eos.gamma if self.adiabatic else 0.0
        self.isothermal_speed = 0.0 if self.adiabatic else eos.sound_speed
        self.everyone: Any = world.CombinedParticles()

    def read(self, state: State) -> Array:
        """Return the conserved variables U (5, n) of all cells, including those of other processes."""
        gas, dust = state.gas, state.dust
        density, dust_density = gas.mass / self.dx, dust.mass / self.dx
        v, u = gas.vel[:, 0], dust.vel[:, 0]
        energy = density * (gas.u + 0.5 * v * v) if self.adiabatic else np.zeros_like(v)
        cells = np.array([density, density * v, energy, dust_density, dust_density * u])
        self.everyone = world.processes.allgather(gas)  # each process computes all cells, which are few
        return np.ascontiguousarray(self.everyone.with_ghosts(cells.T).T)

    def write(self, state: State, cells: Array) -> None:
        """Set masses, velocities and energies of the local particles from U of all cells, `cells` (5, n)."""
        gas, dust = state.gas, state.dust
        density, v, pressure, dust_density, u = self.primitive(cells[:, self.everyone.local_rows])
        gas.mass[:], gas.vel[:, 0] = density * self.dx, v
        dust.mass[:], dust.vel[:, 0] = dust_density * self.dx, u
        if self.adiabatic:
            gas.u[:] = pressure / (self.gamma - 1.0) / density

    def primitive(self, cells: Array) -> Array:
        """Return the primitive variables (5, n) of cells with conserved variables U, `cells` (5, n).

        Primitive variables are gas density, velocity and pressure, and dust density and velocity. The dust velocity is
        0 in cells without dust.
        """
        density, momentum, energy, dust_density, dust_momentum = cells
        v = momentum / density
        u = np.divide(dust_momentum, dust_density, out=np.zeros_like(v), where=dust_density > 0.0)
        if self.adiabatic:
            pressure = (self.gamma - 1.0) * (energy - 0.5 * density * v * v)
        else:
            pressure = self.isothermal_speed**2 * density
        return np.array([density, v, pressure, dust_density, u])

    def thermal_speed(self, cells: Array) -> Array:
        """Return sqrt(P / rho_g) (n,) of cells with conserved variables U, `cells` (5, n)."""
        density, _, pressure, _, _ = self.primitive(cells)
        with np.errstate(invalid="ignore"):  # a negative energy makes the time-step limit NaN, which is reported
            return np.sqrt(pressure / density)

    def add_fluxes(self, start: Array, now: Array, dt: float) -> Array:
        """Return start + dt L(now), for conserved variables `start` and `now` (5, n).

        L is the rate of change by fluxes and pressure, without the drag.
        """
        gas, rightward, leftward = ppm.through_faces(self.primitive(now)[:, self.inside], self.gamma)
        ratio = dt / self.dx
        dust = start[ppm.DUST_MASS], start[ppm.DUST_MOMENTUM]
        ppm.keep_positive(*dust, rightward, leftward, ratio, self.periodic)
        flux = np.concatenate([gas, rightward + leftward])
        return start - ratio * np.diff(flux)
