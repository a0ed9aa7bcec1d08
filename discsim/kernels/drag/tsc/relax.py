"""Relaxation of the slip at nodes: velocity changes D_s from the slips of eqs. (2) and (2b) of `nodes.py`."""

from typing import NamedTuple

import numpy as np

from discsim.formulas.laws import CONSTANT, EPSTEIN
from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.drag.coupled import SCRATCH_COLUMNS
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.nonlinear import relax_nonlinear
from discsim.kernels.drag.relax import relax_means, relax_separately, response
from discsim.kernels.drag.tsc.nodes import BX, ONE, RHO, VX, WHOLE, XX, YX, X, Y
from discsim.kernels.drag.tsc.weights import slope_weight


@inline_jit
def source_slope(n, s, stencil, slopes, c):
    """Return the slopes along x and along y of component c of the sources of species s at node n.

    At a node where no slope could be fitted, the result is the mean over the nine nodes about it.
    """
    if slopes.known[n, s]:
        return slopes.source[n, s, XX + c], slopes.source[n, s, YX + c]
    count, along, across = 0, 0.0, 0.0
    for k in range(9):
        other = stencil[n, k]
        if other >= 0 and slopes.known[other, s]:
            count += 1
            along += slopes.source[other, s, XX + c]
            across += slopes.source[other, s, YX + c]
    return (along / count, across / count) if count > 0 else (0.0, 0.0)


@inline_jit
def node_velocities(n, nodes, slopes, sourced, y, b):
    """Write to `y` (species, 2) the velocities of all species at the centroid of the gas, and to `b` their sources.

    The sources are those at the node itself, not at the centroid.
    """
    sums = nodes.sums
    for s in range(sums.shape[1]):
        m = sums[n, s, ONE]
        if m <= 0.0:
            continue
        off_x = sums[n, 0, X] / sums[n, 0, ONE] - sums[n, s, X] / m
        off_y = sums[n, 0, Y] / sums[n, 0, ONE] - sums[n, s, Y] / m
        for c in range(2):
            y[s, c] = sums[n, s, VX + c] / m  # eq. (2)
            y[s, c] += slopes.pooled[n, XX + c] * off_x + slopes.pooled[n, YX + c] * off_y
            b[s, c] = 0.0
            if sourced[s]:
                along, across = source_slope(n, s, nodes.stencil, slopes, c)
                b[s, c] = (sums[n, s, BX + c] - along * sums[n, s, X] - across * sums[n, s, Y]) / m  # eq. (2b)


@inline_jit
def node_stopping_times(n, nodes, sound, law, frame, mass, time):
    """Write the masses and the stopping times at zero slip of all species at node n to `mass` and `time` (species,).

    Returns (density, Omega, has_dust): gas density, orbital frequency, and whether there is any dust. sound (nodes,):
    thermal speed of the gas, or None.
    """
    gas, omega, c_s, has_dust = nodes.sums[n, 0, ONE], 0.0, 1.0, False
    if frame.star > 0.0:
        x, y = nodes.centre[n, 0], nodes.centre[n, 1]
        omega = orbital_frequency(x * x + y * y, frame.star, frame.softening)
    density = nodes.sums[n, 0, RHO] / gas  # Epstein's law without a star: density times sound speed
    if sound is not None:  # noqa: SIM102
        if law.code != EPSTEIN:
            c_s = sound[n]
    mass[0], time[0] = gas, np.inf
    for s in range(1, nodes.sums.shape[1]):
        m, own = nodes.sums[n, s, ONE], nodes.sums[n, s, RHO]
        mass[s], time[s] = m, np.inf
        if m > 0.0:
            has_dust = True
            ratio = own / m / density if own > 0.0 else m / gas
            time[s] = stopping_time(law.code, law.grains[s - 1], ratio, density, c_s, omega)
            if law.code != CONSTANT and own > 0.0:  # grains have individual sizes
                time[s] *= own / m
    return density, omega, has_dust


@inline_jit
def relax_one_population(n, mass, time, y, b, law, change):
    """Relax the gas and the one population at node n, and write the velocity changes to `change`."""
    rate = 1.0 / time[1]
    of_gas, of_dust = 0.0, 1.0
    if law.two_way:
        rate *= 1.0 + mass[1] / mass[0]
        of_gas, of_dust = mass[1] / (mass[0] + mass[1]), mass[0] / (mass[0] + mass[1])
    f, g = response(rate, law.dt, law.exponential)
    for c in range(2):
        slip, drive = f * (y[1, c] - y[0, c]), g * (b[1, c] - b[0, c])
        change.slip[n, 0, c], change.slip[n, 1, c] = -of_gas * slip, of_dust * slip
        change.drive[n, 0, c], change.drive[n, 1, c] = -of_gas * drive, of_dust * drive


class Scratch(NamedTuple):
    """Scratch arrays for all species at one node.

    mass, time (species,): masses and stopping times. y, b (species, 2): velocities and sources. zeros (species, 2).
    relaxation: scratch of `relax_coupled`.
    """

    mass: np.ndarray
    time: np.ndarray
    y: np.ndarray
    b: np.ndarray
    zeros: np.ndarray
    relaxation: np.ndarray


@inline_jit
def relax_node(n, nodes, slopes, sourced, sound, law, frame, several, change, scratch):
    """Relax the slip at node n, and write its row of `change`; arguments as in `relax`."""
    species, gas = nodes.sums.shape[1], nodes.sums[n, 0, ONE]
    mass, time, y, b, slip, drive = scratch.mass, scratch.time, scratch.y, scratch.b, change.slip[n], change.drive[n]
    density, omega, has_dust = node_stopping_times(n, nodes, sound, law, frame, mass, time)
    if not has_dust:
        return
    node_velocities(n, nodes, slopes, sourced, y, b)
    if sound is None and species == 2:
        relax_one_population(n, mass, time, y, b, law, change)
    elif sound is not None:
        relax_nonlinear(
            mass, time, law.code, law.grains, density, sound[n], omega, y, b, law.two_way, law.dt, law.exponential,
            several, scratch.relaxation, slip,
        )  # fmt: skip
        relax_means(
            mass, time, scratch.zeros, b, law.two_way, law.dt, law.exponential, several, scratch.relaxation, drive
        )
        for s in range(species):
            for c in range(2):
                slip[s, c] -= drive[s, c]
    elif several is not None:
        relax_separately(mass, time, y, b, law.two_way, law.dt, law.exponential, scratch.relaxation, slip, drive)
    for s in range(1, species):
        if mass[s] > 0.0:
            change.rate[n, s], change.mass[n, s] = 1.0 / time[s], mass[s]
            if law.two_way:
                change.rate[n, 0] += mass[s] / gas / time[s]
                change.mass[n, s] *= gas / (gas + mass[s])


@jit
def relax(node_from, node_to, nodes, slopes, sourced, sound, law, frame, several, change):
    """Relax the slip at each node, and write the velocity changes, the drag rates and the reduced masses to `change`.

    sourced (species,): whether a species has sources. sound (nodes,): thermal speed of the gas; None unless stopping
    times depend on the slip. several: None if there is one population. numba leaves out the branches for arguments that
    are None, which saves half a minute of compilation.
    """
    species = nodes.sums.shape[1]
    scratch = Scratch(
        np.empty(species), np.empty(species), np.empty((species, 2)), np.empty((species, 2)), np.zeros((species, 2)),
        np.empty((species, SCRATCH_COLUMNS)),
    )  # fmt: skip
    for n in range(node_from, node_to):
        clear(n, change)
        if has_gas(n, nodes):
            relax_node(n, nodes, slopes, sourced, sound, law, frame, several, change, scratch)


@inline_jit
def has_gas(n, nodes):
    """Return whether node n has gas."""
    return nodes.sums[n, 0, ONE] > 0.0


@inline_jit
def clear(n, change):
    """Set all changes at node n to 0."""
    for s in range(change.rate.shape[1]):
        change.rate[n, s], change.mass[n, s] = 0.0, 0.0
        for c in range(2):
            change.slip[n, s, c], change.drive[n, s, c] = 0.0, 0.0


@jit_no_alloc
def mean_over_gas(node_from, node_to, nodes, moments, of_block, out):
    """Write to `out` (nodes,) the mass-weighted mean of a property of the gas in the nine cells about each node.

    Nearer cells have larger weights. moments: of `CellSums`. of_block (blocks,): mean of the property in each block.
    Nodes without gas get 1.
    """
    for n in range(node_from, node_to):
        total, mass = 0.0, 0.0
        for k in range(9):
            block = nodes.node_cells[n, k]
            if block >= 0 and moments[block, WHOLE, ONE] > 0.0:
                w = slope_weight(k) * moments[block, WHOLE, ONE]
                total += w * of_block[block]
                mass += w
        out[n] = total / mass if mass > 0.0 else 1.0
