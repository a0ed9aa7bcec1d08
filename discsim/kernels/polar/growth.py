"""Growth of dust in polar cells: the sums of `kernels/dust/growth.py` with the weights of `sampling.py`.

In eqs. (1) to (5) there, W_ij is w / A: the weight of cell i at grain j over the area of the cell. A cell takes the
place of a gas particle at its centroid, so that masses, momenta and angular momenta are exchanged in the same way.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.kernels.dust.growth import COLUMNS, GIVE, TAKE, VEL
from discsim.kernels.dust.growth_sums import FAR, FLOW, MEANS, MOMENTS_OF_GAS, MOMENTS_OF_SMALL, write_surroundings
from discsim.kernels.polar.sampling import near_column, near_ring, slopes, weight_in_ring, weights


class CarrierCells(NamedTuple):
    """Cells of gas, which carry small dust: arrays (rings, angles), and (rings, angles, 2) for the velocity."""

    vel: np.ndarray
    gas: np.ndarray  # mass of the gas without its small dust
    small: np.ndarray  # mass of the small dust
    pressure: np.ndarray


@inline_jit
def add_cell_moments(first, w, dx, dy, sums):
    """Add the moments 1, x, y, xx, xy and yy of the weight `w` at the offset (dx, dy) to `sums` from `first` on."""
    sums[first] += w
    sums[first + 1] += w * dx
    sums[first + 2] += w * dy
    sums[first + 3] += w * dx * dx
    sums[first + 4] += w * dx * dy
    sums[first + 5] += w * dy * dy


@jit
def gather(first, last, pos, places, carriers, grown, geometry, field):
    """Write the surroundings of grains to `field` (n, COLUMNS).

    grown (rings, angles): surface density G_i of eq. (2).
    """
    rings, angles = grown.shape
    sums = np.zeros(FAR + 1)
    for g in range(first, last):
        for k in range(COLUMNS):
            field[g, k] = 0.0
        if places.ring[g] < 0:
            continue
        sums[:] = 0.0
        x, y, s = pos[g, 0], pos[g, 1], places.offset[g, 0]
        across, along, slope = weights(s), weights(places.offset[g, 1]), slopes(s)
        for a in range(3):
            i = near_ring(places.ring[g], a, rings)
            per_area = 1.0 / (geometry.volume[i] * geometry.angle)
            for b in range(3):
                j = near_column(places.column[g], b, angles)
                dx, dy = geometry.radius[i] * geometry.cos[j] - x, geometry.radius[i] * geometry.sin[j] - y
                w, steep = across[a] * along[b], slope[a] * along[b] / places.width
                small = w * per_area * carriers.small[i, j]
                add_cell_moments(MOMENTS_OF_SMALL, small, dx, dy, sums)
                add_cell_moments(MOMENTS_OF_GAS, w * per_area * carriers.gas[i, j], dx, dy, sums)
                for axis in range(2):
                    flow = small * carriers.vel[i, j, axis]
                    sums[FLOW + 3 * axis] += flow
                    sums[FLOW + 3 * axis + 1] += flow * dx
                    sums[FLOW + 3 * axis + 2] += flow * dy
                sums[MEANS] += w
                sums[MEANS + 1] += w * grown[i, j]
                sums[MEANS + 2] += w * carriers.pressure[i, j]
                sums[MEANS + 3] += steep * carriers.pressure[i, j]
                sums[FAR] = max(sums[FAR], math.sqrt(dx * dx + dy * dy))
        write_surroundings(g, math.sqrt(x * x + y * y), sums, field)


@jit
def exchange_to_cells(first, last, pos, vel, places, grains, field, wanted, carriers, geometry, share, spread, taken):
    """Compute the mass and momentum that the cells of the rings `first` to `last` give and receive.

    grains: `SortedGrains`. field: result of `gather`. wanted (n,): mass that each grain gains. Written for each cell:
    `share`, the fraction of its small dust that is taken; `spread`, this fraction over the fraction that grains demand;
    and `taken` (rings, angles, 3), the mass that it receives, and the momentum that it receives minus the momentum
    that is taken.
    """
    rings, angles = share.shape
    sums = np.empty((angles, 6))  # demanded fraction and momentum, then received mass and momentum, per mass of a cell
    for i in range(first, last):
        sums[:] = 0.0
        per_area = 1.0 / (geometry.volume[i] * geometry.angle)
        begin, end = grains.start[max(i - 1, 0) * angles], grains.start[min(i + 2, rings) * angles]
        for k in range(begin, end):
            g = grains.order[k]
            takes = wanted[g] > 0.0
            kind, first_sum = (TAKE, 0) if takes else (GIVE, 3)
            vx, vy = (field[g, VEL], field[g, VEL + 1]) if takes else (vel[g, 0], vel[g, 1])
            factor = weight_in_ring(places, g, i, rings) * per_area * field[g, kind] * abs(wanted[g])
            along = weights(places.offset[g, 1])
            for b in range(3):
                j = near_column(places.column[g], b, angles)
                dx = geometry.radius[i] * geometry.cos[j] - pos[g, 0]
                dy = geometry.radius[i] * geometry.sin[j] - pos[g, 1]
                w = factor * along[b] * (1.0 + field[g, kind + 1] * dx + field[g, kind + 2] * dy)
                sums[j, first_sum] += w
                sums[j, first_sum + 1] += w * vx
                sums[j, first_sum + 2] += w * vy
        for j in range(angles):
            demanded, gas = sums[j, 0], carriers.gas[i, j]
            spread[i, j] = 1.0 / max(1.0, demanded)
            share[i, j] = min(1.0, demanded)
            gone = carriers.small[i, j] * spread[i, j]
            taken[i, j, 0] = gas * sums[j, 3]
            taken[i, j, 1] = gas * sums[j, 4] - gone * sums[j, 1]
            taken[i, j, 2] = gas * sums[j, 5] - gone * sums[j, 2]


@jit
def exchange_to_grains(first, last, pos, places, field, wanted, carriers, spread, geometry, mass, vel):
    """Change `mass` (n,) of grains by `wanted` (n,) or by what their cells have, and `vel` (n, 2) by its momentum.

    spread (rings, angles): result of `exchange_to_cells`.
    """
    rings, angles = spread.shape
    for g in range(first, last):
        if wanted[g] <= 0.0:
            mass[g] += wanted[g]
            continue
        across, along, offered = weights(places.offset[g, 0]), weights(places.offset[g, 1]), 0.0
        for a in range(3):
            i = near_ring(places.ring[g], a, rings)
            per_area = 1.0 / (geometry.volume[i] * geometry.angle)
            for b in range(3):
                j = near_column(places.column[g], b, angles)
                dx = geometry.radius[i] * geometry.cos[j] - pos[g, 0]
                dy = geometry.radius[i] * geometry.sin[j] - pos[g, 1]
                bent = 1.0 + field[g, TAKE + 1] * dx + field[g, TAKE + 2] * dy
                offered += across[a] * along[b] * per_area * bent * carriers.small[i, j] * spread[i, j]
        gain = field[g, TAKE] * wanted[g] * offered
        mass[g] += gain
        for axis in range(2):
            vel[g, axis] += gain / mass[g] * (field[g, VEL + axis] - vel[g, axis])
