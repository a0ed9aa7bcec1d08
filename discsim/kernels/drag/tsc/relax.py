"""Relaxation at a node: the changes of eq. (3) of `kernels/drag/tsc/nodes.py` by the slips of eqs. (2) and (2b)."""

from typing import NamedTuple

import numpy as np

from discsim.formulas.laws import CONSTANT, EPSTEIN
from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.kernels.drag.coupled import ROOM
from discsim.kernels.drag.frame import kepler
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.nonlinear import relax_by_speed
from discsim.kernels.drag.relax import relax_apart, relax_means, response
from discsim.kernels.drag.tsc.nodes import BX, ONE, RHO, VX, WHOLE, XX, YX, X, Y


@inline_jit
def source_slope(n, s, about, slopes, c):
    """Return the slope along x and y of component c of a species' sources at a node.

    A node without a slope of its own has the mean over the nodes about it.
    """
    if slopes.known[n, s]:
        return slopes.source[n, s, XX + c], slopes.source[n, s, YX + c]
    count, along, across = 0, 0.0, 0.0
    for k in range(9):
        other = about[n, k]
        if other >= 0 and slopes.known[other, s]:
            count += 1
            along += slopes.source[other, s, XX + c]
            across += slopes.source[other, s, YX + c]
    return (along / count, across / count) if count > 0 else (0.0, 0.0)


@inline_jit
def velocities(n, nodes, slopes, sourced, y, b):
    """Write the velocities of all species (n, 2) at the gas's centroid, and their sources (n, 2) at the node."""
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
                along, across = source_slope(n, s, nodes.about, slopes, c)
                b[s, c] = (sums[n, s, BX + c] - along * sums[n, s, X] - across * sums[n, s, Y]) / m  # eq. (2b)


@inline_jit
def times_at(n, nodes, sound, law, frame, mass, time):
    """Write masses and stopping times at vanishing slip of all species at a node.

    Returns the gas's density, Omega, and whether there is dust.
    """
    gas, omega, c_s, met = nodes.sums[n, 0, ONE], 0.0, 1.0, False
    if frame.star > 0.0:
        x, y = nodes.centre[n, 0], nodes.centre[n, 1]
        omega = kepler(x * x + y * y, frame.star, frame.softening)
    density = nodes.sums[n, 0, RHO] / gas  # Epstein's law without a star: density times sound speed
    if sound is not None:  # noqa: SIM102
        if law.code != EPSTEIN:
            c_s = sound[n]
    mass[0], time[0] = gas, np.inf
    for s in range(1, nodes.sums.shape[1]):
        m, own = nodes.sums[n, s, ONE], nodes.sums[n, s, RHO]
        mass[s], time[s] = m, np.inf
        if m > 0.0:
            met = True
            ratio = own / m / density if own > 0.0 else m / gas
            time[s] = stopping_time(law.code, law.grains[s - 1], ratio, density, c_s, omega)
            if law.code != CONSTANT and own > 0.0:  # grains have individual sizes
                time[s] *= own / m
    return density, omega, met


@inline_jit
def relax_two(n, mass, time, y, b, law, change):
    """Relax the gas and the one population at a node to their mean, or for one-way drag the dust to the gas."""
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
    """Scratch arrays of all species at one node.

    These are masses, stopping times, velocities, sources, zeros, changes by slip and by source, and a workspace.
    """

    mass: np.ndarray
    time: np.ndarray
    y: np.ndarray
    b: np.ndarray
    none: np.ndarray
    slip: np.ndarray
    drive: np.ndarray
    room: np.ndarray


@inline_jit
def relax_node(n, nodes, slopes, sourced, sound, law, frame, several, change, own):
    """Write the changes of eq. (3) at node n."""
    species, gas = nodes.sums.shape[1], nodes.sums[n, 0, ONE]
    density, omega, met = times_at(n, nodes, sound, law, frame, own.mass, own.time)
    if not met:
        return
    velocities(n, nodes, slopes, sourced, own.y, own.b)
    if sound is None and species == 2:
        relax_two(n, own.mass, own.time, own.y, own.b, law, change)
    elif sound is not None:
        relax_by_speed(
            own.mass, own.time, law.code, law.grains, density, sound[n], omega, own.y, own.b, law.two_way, law.dt,
            law.exponential, several, own.room, own.slip,
        )  # fmt: skip
        relax_means(
            own.mass, own.time, own.none, own.b, law.two_way, law.dt, law.exponential, several, own.room, own.drive
        )
        for s in range(species):
            for c in range(2):
                change.slip[n, s, c], change.drive[n, s, c] = own.slip[s, c] - own.drive[s, c], own.drive[s, c]
    elif several is not None:
        relax_apart(
            own.mass, own.time, own.y, own.b, law.two_way, law.dt, law.exponential, own.room, own.slip, own.drive
        )
        for s in range(species):
            for c in range(2):
                change.slip[n, s, c], change.drive[n, s, c] = own.slip[s, c], own.drive[s, c]
    for s in range(1, species):
        if own.mass[s] > 0.0:
            change.rate[n, s], change.mass[n, s] = 1.0 / own.time[s], own.mass[s]
            if law.two_way:
                change.rate[n, 0] += own.mass[s] / gas / own.time[s]
                change.mass[n, s] *= gas / (gas + own.mass[s])


@jit
def relax(node_from, node_to, nodes, slopes, sourced, sound, law, frame, several, change):
    """Relax the slip at each node: write the changes of eq. (3), the rates and the reduced masses to `change`.

    `sound` (nodes,) is None unless the stopping time depends on the slip. `several` is None where there is one
    population. numba then leaves out the branches that need them, which saves half a minute of compilation.
    """
    species = nodes.sums.shape[1]
    own = Scratch(
        np.empty(species), np.empty(species), np.empty((species, 2)), np.empty((species, 2)), np.zeros((species, 2)),
        np.empty((species, 2)), np.empty((species, 2)), np.empty((species, ROOM)),
    )  # fmt: skip
    for n in range(node_from, node_to):
        clear(n, change)
        if has_gas(n, nodes):
            relax_node(n, nodes, slopes, sourced, sound, law, frame, several, change, own)


@inline_jit
def has_gas(n, nodes):
    return nodes.sums[n, 0, ONE] > 0.0


@inline_jit
def clear(n, change):
    for s in range(change.rate.shape[1]):
        change.rate[n, s], change.mass[n, s] = 0.0, 0.0
        for c in range(2):
            change.slip[n, s, c], change.drive[n, s, c] = 0.0, 0.0


@jit_no_alloc
def mean_sound(node_from, node_to, nodes, own, sound, out):
    """Write the sound speed at nodes, the mass-weighted mean of the gas (blocks,) in the nine cells about each node.

    Nearer cells have larger weights.
    """
    for n in range(node_from, node_to):
        total, mass = 0.0, 0.0
        for k in range(9):
            block = nodes.near[n, k]
            if block >= 0 and own[block, WHOLE, ONE] > 0.0:
                w = (0.5 if k // 3 == 1 else 0.25) * (0.5 if k % 3 == 1 else 0.25) * own[block, WHOLE, ONE]
                total += w * sound[block]
                mass += w
        out[n] = total / mass if mass > 0.0 else 1.0
