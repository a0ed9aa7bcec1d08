"""Drag between gas and dust: dv/dt = a_g + eps (u - v) / t_stop, du/dt = a_d + (v - u) / t_stop, solved in cells.

Where a scene has drag, drag is the kick: the relaxation is solved with the accelerations inside, so the slip is
right at any step. Cells are blocks of grid cells (`kernels/blocks.py`), schemes are in `discsim/drag`, laws in
`kernels/drag.py`. It limits no step.
"""

from importlib import import_module

import numpy as np

from discsim.drag import SCHEMES
from discsim.effects import base
from discsim.effects.gas import kick_gas
from discsim.kernels.blocks import LEVELS, leaf_counts, leaf_keys, merge
from discsim.kernels.drag import LAWS, relax_blocks, stopping_times
from discsim.kernels.grid import counting_sort
from discsim.kernels.move import add_scaled
from discsim.state import State
from discsim.threads import share
from discsim.units import epstein_stopping_time

NONE = np.empty(0)

# Steps of the cells' origin, in fractions of the largest block: n a 2^k mod 1 is well spread for k = 0..5 (for
# n <= 60, n |n a 2^k - nearest whole number| >= .17; found by search).
SHIFT_STEP = np.array([0.70493075, 0.64794019])


class Effect(base.Effect):
    name = "drag"

    def __init__(self, scene, state):
        self.scene, self.drag = scene, scene.drag
        self.two_way = self.drag.direction == "two-way"
        self.dim = scene.space.dimensions
        self.scheme = import_module(SCHEMES[self.drag.scheme])
        self.exponential = self.drag.integration == "exponential"
        self.values = np.array([self._law_value(population) for population in scene.dust])
        loaded = sum(population.ratio for population in scene.dust) > 0.1
        # Fewer than these and a cell grows: shot noise in the loading matters at dust-to-gas ratios near one.
        self.least = (4, 4) if self.dim == 1 else (8, 30 if loaded and self.two_way else 8)
        # A number of wanted sides up to which cells grow for want of particles, or of a species.
        self.soft, self.hard = (2.0, 8.0) if self.dim == 1 else (2.0, 4.0)
        self.uncoupled = 0.0  # share of the dust mass in enlarged cells or without gas, at the last kick
        self.stopping_times = NONE

    def _law_value(self, population) -> float:
        if self.drag.law == "epstein":
            # t_stop c_s rho_g, all of it that is the grain's.
            grain = population.grain_size, population.grain_density
            return epstein_stopping_time(*grain, 1.0, 1.0, self.drag.convention)
        return {"constant": self.drag.K, "stopping-time": self.drag.t_stop}.get(self.drag.law, self.drag.stokes)

    def stopping_time(self, population: int, density, sound, omega, ratio) -> np.ndarray:
        """Stopping time of a population in gas of given density, sound speed and Omega (n,)."""
        return stopping_times(LAWS[self.drag.law], self.values[population], ratio, density, sound, omega)

    def lattice(self, state: State) -> tuple[np.ndarray, float, int, int]:
        """Origin, side of a leaf and number of leaves; leaves are whole grid cells in two dimensions."""
        grid, gas = state.grid, state.gas
        wanted = self.drag.cell_length
        if wanted is None:
            # A cell of this size holds the least number of gas particles; finer leaves would be merged again.
            fewest = self.least[0] ** (1.0 / self.dim) / self.scene.gas.eta
            wanted = float(gas.h.min()) * (max(self.drag.cell, fewest) if self.dim == 2 else self.drag.cell)
        periodic = grid.periodic
        extent = np.array(grid.shape) * grid.cell
        if self.dim == 2:
            whole = max(1, int(np.ceil(wanted / grid.cell - 1e-9)))
            while periodic and whole < max(grid.shape) and any(n % whole for n in grid.shape):
                whole += 1
            leaf = whole * grid.cell
            nx, ny = (-(-n // whole) for n in grid.shape)
        elif periodic:
            nx, ny = max(1, int(extent[0] / wanted + 1e-9)), 1
            leaf = extent[0] / nx
        else:
            leaf = max(wanted, extent[0] / (4.0 * gas.count))
            nx, ny = int(np.ceil(extent[0] / leaf)), 1
        if not periodic:  # room for the shift
            nx, ny = nx + 2**LEVELS, (ny + 2**LEVELS if self.dim == 2 else 1)
        return np.array(grid.origin), leaf, nx, ny

    def blocks(self, state: State):
        """Sort gas and dust into blocks: (gas order, start, dust order, start, corners)."""
        gas, dust, drag = state.gas, state.dust, self.drag
        origin, leaf, nx, ny = self.lattice(state)
        shift = np.zeros(2)
        if self.scheme.SHIFTED:
            shift[: self.dim] = ((state.step * SHIFT_STEP) % 1.0 * 2**LEVELS)[: self.dim]
        periodic = state.grid.periodic
        gas_key, dust_key = np.empty(gas.count, np.int64), np.empty(dust.count, np.int64)
        for particles, key in ((gas, gas_key), (dust, dust_key)):
            share(leaf_keys, len(key), particles.pos, origin, shift, 1.0 / leaf, nx, ny, periodic, key)
        n_gas, h_sum = leaf_counts(gas_key, gas.h, nx * ny)
        n_dust, _ = leaf_counts(dust_key, NONE, nx * ny)
        # A length's whole cells are the wanted side; a number of h is met by doubling leaves.
        length = leaf if drag.cell_length else 0.0
        number, count, first, enlarged = merge(
            n_gas, n_dust, h_sum, nx, ny, leaf, drag.cell or 0.0, length, *self.least,
            self.soft, self.hard, self.two_way,
        )  # fmt: skip
        # What lies outside the lattice meets nobody: a block of its own for each species.
        gas_order, gas_start = counting_sort(np.append(number, count)[gas_key], count + 2)
        population = len(self.values)
        dust_block = np.append(number, count + 1)[dust_key]
        dust_order, dust_start = counting_sort(dust_block * population + dust.species, (count + 2) * population)
        corners = np.zeros((count + 2, 2))
        corners[:count] = origin + (first - shift) * leaf
        alone = np.diff(gas_start)[dust_block] == 0
        alone |= np.append(enlarged, [True, True])[dust_block]
        mass = dust.mass if dust.immobile is None else np.where(dust.immobile, 0.0, dust.mass)
        self.uncoupled = float(mass[alone].sum() / mass.sum())
        return gas_order, gas_start, dust_order, dust_start, corners

    def kick(self, state: State, dt: float) -> None:
        gas, dust, two_way = state.gas, state.dust, self.two_way
        before = gas.vel.copy()
        heat = np.zeros(gas.count if self.drag.heating else 0)
        if gas.count > 0 and dust.count > 0:
            # One-way: the gas is kicked below as it is without dust, to the last bit.
            self._relax(state, dt, gas.vel if two_way else before, heat)
        else:
            share(add_scaled, gas.count, gas.vel if two_way else before, gas.acc, dt)
            share(add_scaled, dust.count, dust.vel, dust.acc, dt)
        if not two_way:
            kick_gas(gas, dt)
            return
        if gas.kick_acc is not None:
            gas.kick_acc[:] = (gas.vel - before) / dt
        if gas.u is not None:
            gas.kick_rate[:] = gas.heating_rate
            gas.kick_rate[: len(heat)] += heat / dt
            gas.u += dt * gas.kick_rate
        if gas.immobile is not None:
            gas.vel[gas.immobile] = before[gas.immobile]

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Stopping times of the dust where it is now (n,), inf where it has no gas; changes no velocity."""
        gas, dust = state.gas, state.dust
        if gas.count == 0 or dust.count == 0:
            return np.full(dust.count, np.inf)
        vel, dust.vel = dust.vel, dust.vel.copy()
        self._relax(state, 0.0, gas.vel.copy(), np.zeros(gas.count if self.drag.heating else 0))
        dust.vel = vel
        return self.stopping_times

    def _relax(self, state: State, dt: float, gas_vel: np.ndarray, heat: np.ndarray) -> None:
        gas, dust, star = state.gas, state.dust, state.scene.star
        gas_order, gas_start, dust_order, dust_start, corners = self.blocks(state)
        if len(self.stopping_times) != dust.count:
            self.stopping_times = np.empty(dust.count)
        size = np.ones(2)
        size[: self.dim] = state.scene.space.size
        resting = dust.vel[dust.immobile] if dust.immobile is not None else None
        share(
            relax_blocks, len(corners), gas.pos, gas_vel, gas.acc, state.own_acc["gas"], gas.mass, gas.density,
            gas.sound_speed,
            gas_order, gas_start, dust.pos, dust.vel, dust.acc, state.own_acc["dust"], dust.mass,
            dust_order, dust_start, self.stopping_times, self.scheme.LINEAR, self.two_way,
            LAWS[self.drag.law], self.values, dt, self.exponential,
            star.mass if star else 0.0, star.softening if star else 0.0, corners, size,
            state.grid.periodic, heat, least=64,
        )  # fmt: skip
        if resting is not None:
            dust.vel[dust.immobile] = resting
