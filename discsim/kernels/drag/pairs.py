"""Pairs of a dust and a gas particle: their list, their weights, and the sums of their exchange.

Dust j and gas a are a pair where j lies in the support of a, with the weight W(r_ja, h_a) in both directions. The
list is sorted by dust particle, and `by_gas` orders it by gas particle. The exchange of a pair is computed once, and
each of the two sums gathers it in a fixed order: momentum is exact, and results are bitwise the same on any number of
threads.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import jit, jit_no_alloc
from discsim.kernels.common.candidates import most_of, pack_positions
from discsim.kernels.drag.frame import kepler
from discsim.kernels.drag.laws import hastening, stopping_time
from discsim.kernels.drag.relax import response
from discsim.kernels.sph.smoothing import NORM, SUPPORT, shape

CLIP = 1e-3  # eta^2 / h^2 of Monaghan & Kocharyan, which keeps r r / (r^2 + eta^2) finite


@jit
def list_pairs(first, last, lists, dust_cells, cells, pos, radius, start, gas, offset):
    """List the gas whose support holds each dust particle of the cells, and the offset x_dust - x_gas (pairs, d).

    Where `gas` has no entries only the number of pairs is written, to start[j + 1].
    """
    dim = pos.shape[1]
    counting = len(gas) == 0
    begin, slots = lists.begin, lists.slots
    room = most_of(begin)
    cx, cy = np.zeros(room), np.zeros(room)
    for c in range(first, last):
        cell, listed, end = dust_cells.filled[c], begin[c - first], begin[c - first + 1]
        ox, oy = dust_cells.bounds[cell, 0], dust_cells.bounds[cell, 1]
        pack_positions(c - first, listed, end, lists, ox, oy, 1.0, cells, cx, cy)
        for m in range(dust_cells.start[cell], dust_cells.start[cell + 1]):
            j = dust_cells.order[m]
            found = 0
            for k in range(end - listed):
                a = cells.order[slots[listed + k]]
                dx = pos[j, 0] - ox - cx[k]
                dy = pos[j, 1] - oy - cy[k] if dim == 2 else 0.0
                if dx * dx + dy * dy < radius[a] * radius[a]:
                    if not counting:
                        at = start[j] + found
                        gas[at] = a
                        offset[at, 0] = dx
                        if dim == 2:
                            offset[at, 1] = dy
                    found += 1
            if counting:
                start[j + 1] = found


def hump_norm(kernel: int, dim: int) -> float:
    """Return the factor that makes q^2 times a kernel a kernel: 1 over the mean of q^2."""
    node, weight = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for piece in range(9):  # the splines are polynomials between thirds
        for x, w in zip(node, weight, strict=True):
            q = (piece + 0.5 + 0.5 * x) / 3.0
            volume = 2.0 if dim == 1 else 2.0 * math.pi * q
            total += w / 6.0 * volume * q * q * shape(kernel, dim, q)[0]
    return 1.0 / (NORM[dim - 1][kernel] * total)


@functools.cache
def weight_driver(kernel: int, dim: int, hump: bool):
    """Compile the loop that computes the weights W(r, h_a) of pairs.

    With `hump` they are those of the double hump q^2 W (Laibe & Price 2012, sec. 2.6).
    """
    sigma = NORM[dim - 1][kernel] * (hump_norm(kernel, dim) if hump else 1.0)
    support = SUPPORT[kernel]

    # No fastmath: chunk ends decide which pairs a vector loop computes, and its rounding may differ.
    @jit
    def weigh(first, last, gas, offset, h, weight):
        for k in range(first, last):
            inv_h = 1.0 / h[gas[k]]
            r2 = offset[k, 0] * offset[k, 0]
            if dim == 2:
                r2 += offset[k, 1] * offset[k, 1]
            q = min(math.sqrt(r2) * inv_h, support)
            w, _ = shape(kernel, dim, q)
            if hump:
                w *= q * q
            weight[k] = sigma * inv_h**dim * w

    return weigh


@jit
def gather(first, last, start, gas, weight, value, out):
    """Write the sum of W value_a over the pairs of dust j to out_j."""
    for j in range(first, last):
        total = 0.0
        for k in range(start[j], start[j + 1]):
            total += weight[k] * value[gas[k]]
        out[j] = total


class Side(NamedTuple):
    """Gas or dust of pairs: masses and densities (n,), velocities (n, d)."""

    mass: np.ndarray
    density: np.ndarray
    vel: np.ndarray


class Couples(NamedTuple):
    """Pairs, those of each dust particle from its `start` on.

    Per pair (pairs,): the gas particle, the part V_a W of the dust particle's drag, and the stopping time.
    """

    start: np.ndarray
    gas: np.ndarray
    part: np.ndarray
    time: np.ndarray


@jit_no_alloc
def couple(first, last, pairs, weight, gas, sound, dust, pos, law, grain, nonlinear, star, softening, whole, rate):
    """Write part and time of the pairs, from their `weight` W, and the rate of each dust particle.

    With `whole` the parts of a particle sum to one. A stopping time that depends on the slip is that at the pair's
    present slip.
    """
    for j in range(first, last):
        omega = 0.0
        if star > 0.0:
            omega = kepler(pos[j, 0] * pos[j, 0] + pos[j, 1] * pos[j, 1], star, softening)
        total = 0.0
        for k in range(pairs.start[j], pairs.start[j + 1]):
            a = pairs.gas[k]
            rho = gas.density[a]
            pairs.part[k] = weight[k] * gas.mass[a] / rho
            pairs.time[k] = stopping_time(law, grain, dust.density[j] / rho, rho, sound[a], omega)
            if nonlinear:
                slip2 = 0.0
                for i in range(pos.shape[1]):
                    slip2 += (dust.vel[j, i] - gas.vel[a, i]) ** 2
                pairs.time[k] /= hastening(law, grain, rho, sound[a], omega, math.sqrt(slip2))
            total += pairs.part[k]
        rate[j] = 0.0
        for k in range(pairs.start[j], pairs.start[j + 1]):
            if whole and total > 0.0:
                pairs.part[k] /= total
            rate[j] += pairs.part[k] / pairs.time[k]


@jit
def gas_rates(first, last, by_gas, begin, dust, part, time, dmass, mass, out):
    """Add the rate at which pairs change the velocity of a gas particle, sum_j (m_j / m_a) part / time, to `out`."""
    for a in range(first, last):
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            out[a] += dmass[dust[k]] / mass[a] * part[k] / time[k]


@jit
def push_explicitly(first, last, start, gas, offset, part, time, h, mass, vel, gvel, dt, impulse):
    """Write the impulse of each pair on its dust particle over dt, along the line of sight (`drag/published/mk.py`)."""
    dim = offset.shape[1]
    for j in range(first, last):
        for k in range(start[j], start[j + 1]):
            a = gas[k]
            r2, along = 0.0, 0.0
            for i in range(dim):
                r2 += offset[k, i] * offset[k, i]
                along += (vel[j, i] - gvel[a, i]) * offset[k, i]
            factor = -mass[j] * dim * part[k] * dt / time[k] * along / (r2 + CLIP * h[a] * h[a])
            for i in range(dim):
                impulse[k, i] = factor * offset[k, i]


@njit(inline="always")
def limited(a, b):
    """Return the monotonised central slope of two slopes (van Leer 1977)."""
    if a * b <= 0.0:
        return 0.0
    return math.copysign(min(0.5 * abs(a + b), 2.0 * min(abs(a), abs(b))), a)


@jit_no_alloc
def push_by_relaxing(
    first, last, pairs, offset, gas, gas_own, gas_slope, dust, own, slope, two_way, dt, exponential, pull, impulse
):
    """Write the impulse of each pair on its dust particle over dt; the pair's slip relaxes by itself
    (`drag/published/lab14.py`).

    Writes `pull`, the c of eq. (1) there: the impulse that a slip of one along the line of sight loses. `slope` and
    `gas_slope` (n, d, d), d v_c / d x_a at [a, c], extrapolate the slip to a common point, as in
    `drag/published/reconstructed.py`; without entries the slip is that between the two positions. `own` has no entries
    if dust has no sources.
    """
    dim = offset.shape[1]
    for j in range(first, last):
        for k in range(pairs.start[j], pairs.start[j + 1]):
            a = pairs.gas[k]
            # The dust's part of the change of the slip: all of it where the gas does not move.
            mine = gas.density[a] / (gas.density[a] + dust.density[j]) if two_way else 1.0
            f, g = response(1.0 / (mine * pairs.time[k]), dt, exponential)
            factor = dust.mass[j] * pairs.part[k] * mine
            r2, y, b = 0.0, 0.0, 0.0
            for i in range(dim):
                r2 += offset[k, i] * offset[k, i]
                y += (dust.vel[j, i] - gas.vel[a, i]) * offset[k, i]
                b += ((own[j, i] if len(own) > 0 else 0.0) - gas_own[a, i]) * offset[k, i]
            pull[k] = -factor * f * (1.0 if r2 == 0.0 else dim)
            if r2 == 0.0:  # no line of sight: the mean over all directions
                for i in range(dim):
                    source = (own[j, i] if len(own) > 0 else 0.0) - gas_own[a, i]
                    impulse[k, i] = factor * (f * (dust.vel[j, i] - gas.vel[a, i]) + g * source)
                continue
            if len(slope) > 0:
                s, gs = 0.0, 0.0
                for i in range(dim):
                    for l in range(dim):
                        s += offset[k, i] * offset[k, l] * slope[j, i, l]
                        gs += offset[k, i] * offset[k, l] * gas_slope[a, i, l]
                y -= limited(s, gs)
            for i in range(dim):
                impulse[k, i] = factor * dim * (f * y + g * b) / r2 * offset[k, i]


@jit
def shares(first, last, begin, order, offset, pull, mass, share):
    """Write the largest share of its slip that a particle's pairs remove, if all pairs have the same slip.

    This is the share for a slip in the direction in which the pairs remove most. The pairs of particle i are
    order[begin[i] : begin[i + 1]], or begin[i] to begin[i + 1] where `order` is empty.
    """
    for i in range(first, last):
        xx, xy, yy = 0.0, 0.0, 0.0
        for m in range(begin[i], begin[i + 1]):
            k = order[m] if len(order) > 0 else m
            x, y = offset[k, 0], offset[k, 1] if offset.shape[1] == 2 else 0.0
            r2 = x * x + y * y
            if r2 == 0.0:
                xx += pull[k]
                yy += pull[k]
            else:
                xx += pull[k] * x * x / r2
                xy += pull[k] * x * y / r2
                yy += pull[k] * y * y / r2
        share[i] = (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)) / mass[i]


@jit
def most_shares(first, last, begin, order, mine, one, other, both):
    """Write to `both` the largest sum of a particle's share, `one` (n,), and its partner's, `other`, over its pairs.

    `mine` (pairs,) has the index of the partner in each pair.
    """
    for i in range(first, last):
        both[i] = 0.0
        for m in range(begin[i], begin[i + 1]):
            k = order[m] if len(order) > 0 else m
            both[i] = max(both[i], one[i] + other[mine[k]])


@jit
def limit_impulses(first, last, start, gas, both, gas_both, impulse):
    """Scale impulses down to where they cannot create kinetic energy (`drag/published/lab14.py`)."""
    for j in range(first, last):
        for k in range(start[j], start[j + 1]):
            scale = 2.0 / max(2.0, both[j], gas_both[gas[k]])
            for i in range(impulse.shape[1]):
                impulse[k, i] *= scale


@jit
def pull_dust(first, last, start, impulse, mass, vel):
    """Add the impulses of its pairs to the velocity of each dust particle."""
    for j in range(first, last):
        for i in range(vel.shape[1]):
            total = 0.0
            for k in range(start[j], start[j + 1]):
                total += impulse[k, i]
            vel[j, i] += total / mass[j]


@jit
def pull_gas(first, last, by_gas, begin, impulse, mass, vel):
    """Subtract the impulses of its pairs from the velocity of each gas particle."""
    for a in range(first, last):
        for i in range(vel.shape[1]):
            total = 0.0
            for m in range(begin[a], begin[a + 1]):
                total += impulse[by_gas[m], i]
            vel[a, i] -= total / mass[a]


@jit
def add_pair_heat(first, last, by_gas, begin, dust, impulse, mass, mean, gmean, heat):
    """Add the heat per mass that pairs leave in a gas particle to `heat`.

    It is -impulse . slip, at velocities halfway through the kick: the whole loss of kinetic energy apart from the
    work of the accelerations.
    """
    for a in range(first, last):
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            for i in range(impulse.shape[1]):
                heat[a] -= impulse[k, i] * (mean[dust[k], i] - gmean[a, i]) / mass[a]
