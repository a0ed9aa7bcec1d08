"""Pairs of a dust and a gas particle: their list, their weights, and the impulses that they exchange.

Dust particle j and gas particle a are a pair if j lies within the support of a. The weight W(r_ja, h_a) of the pair
acts in both directions. The list is sorted by dust particle; `by_gas` has the indices of the pairs sorted by gas
particle. The impulse of a pair is computed once. Each particle then sums its impulses in a fixed order. Momentum is
therefore exact, and results are bitwise the same on any number of threads.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import jit, jit_no_alloc
from discsim.kernels.common.candidates import max_candidates, pack_positions
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import nonlinear_drag_factor, stopping_time
from discsim.kernels.drag.relax import response
from discsim.kernels.sph.smoothing import NORM, SUPPORT, shape

CLIP = 1e-3  # eta^2 / h^2 of Monaghan & Kocharyan, which keeps r r / (r^2 + eta^2) finite at r = 0


@jit
def list_pairs(first, last, lists, dust_cells, cells, pos, radius, start, gas, offset):
    """Write to `gas` (pairs,) and `offset` (pairs, d) the pairs of each dust particle in the cells `first` to `last`.

    gas: index of the gas particle. offset: x_dust - x_gas. The pairs of dust particle j begin at start[j]. If `gas` is
    empty, only the number of pairs of j is written, to start[j + 1]. lists, dust_cells, cells: candidate neighbours,
    and cells of dust and of gas, from the neighbour search. pos: positions of the dust. radius: support radius of each
    gas particle.
    """
    dim = pos.shape[1]
    counting = len(gas) == 0
    begin, slots = lists.begin, lists.indices
    room = max_candidates(begin)
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
    """Return the factor by which q^2 times a kernel must be multiplied to be a kernel: one over the mean of q^2."""
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
    """Return the compiled loop that computes the weights W(r, h_a) of pairs.

    hump: whether W is the double hump q^2 W (Laibe & Price 2012, sec. 2.6) instead of the kernel itself.
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
def sum_to_dust(first, last, start, gas, weight, value, out):
    """Write to `out` (dust, m) the sums of `weight` times `value` (gas, m) over the pairs of each dust particle.

    start, gas, weight: as in `Pairs` of `drag/published/pairs.py`.
    """
    for j in range(first, last):
        for i in range(out.shape[1]):
            total = 0.0
            for k in range(start[j], start[j + 1]):
                total += weight[k] * value[gas[k], i]
            out[j, i] = total


class PairSpecies(NamedTuple):
    """Arrays of the gas, or of one dust population: masses and densities (n,), velocities (n, d)."""

    mass: np.ndarray
    density: np.ndarray
    vel: np.ndarray


class PairList(NamedTuple):
    """Pairs of the dust particles of one population; the pairs of dust particle j are start[j] to start[j + 1] - 1.

    gas (pairs,): index of the gas particle. part (pairs,): V_a W, the share of the pair in the drag on its dust
    particle. time (pairs,): stopping time.
    """

    start: np.ndarray
    gas: np.ndarray
    part: np.ndarray
    time: np.ndarray


@jit_no_alloc
def weigh_pairs(first, last, pairs, weight, gas, sound, dust, pos, law, grain, nonlinear, star, softening, whole, rate):
    """Write `pairs.part` and `pairs.time` of each pair, and the drag rate of each dust particle, `rate` (n,).

    weight (pairs,): W. gas, dust: `PairSpecies`. sound: thermal speed of the gas. pos: positions of the dust. law,
    grain: form and parameters of the drag law. nonlinear: whether the stopping time depends on the slip; the present
    slip of the pair is then used. star, softening: mass and softening length of the star. whole: whether the parts of a
    dust particle are normalised to a sum of one.
    """
    for j in range(first, last):
        omega = 0.0
        if star > 0.0:
            omega = orbital_frequency(pos[j, 0] * pos[j, 0] + pos[j, 1] * pos[j, 1], star, softening)
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
                pairs.time[k] /= nonlinear_drag_factor(law, grain, rho, sound[a], omega, math.sqrt(slip2))
            total += pairs.part[k]
        rate[j] = 0.0
        for k in range(pairs.start[j], pairs.start[j + 1]):
            if whole and total > 0.0:
                pairs.part[k] /= total
            rate[j] += pairs.part[k] / pairs.time[k]


@jit
def add_gas_rates(first, last, by_gas, begin, dust, part, time, dmass, mass, out):
    """Add to `out` (gas,) the rate at which its pairs change the velocity of each gas particle.

    The rate is sum_j (m_j / m_a) part / time.

    The pairs of gas particle a have the indices by_gas[begin[a] : begin[a + 1]]. dust, part, time (pairs,): as in
    `PairList`. dmass, mass: masses of dust and gas.
    """
    for a in range(first, last):
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            out[a] += dmass[dust[k]] / mass[a] * part[k] / time[k]


@jit
def explicit_impulses(first, last, start, gas, offset, part, time, h, mass, vel, gvel, dt, impulse):
    """Write to `impulse` (pairs, d) the impulse of each pair on its dust particle over dt, as in the scheme mk.

    The impulse is along the line between the particles, `offset` (pairs, d). h, gvel: smoothing lengths and velocities
    of the gas. mass, vel: masses and velocities of the dust.
    """
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
def limited_slope(a, b):
    """Return the monotonised central slope of the slopes a and b, which is 0 if their signs differ (van Leer 1977)."""
    if a * b <= 0.0:
        return 0.0
    return math.copysign(min(0.5 * abs(a + b), 2.0 * min(abs(a), abs(b))), a)


@jit_no_alloc
def relaxation_impulses(
    first, last, pairs, offset, gas, gas_own, gas_slope, dust, own, slope, two_way, dt, exponential, pull, impulse
):
    """Write to `impulse` (pairs, d) the impulse of each pair on its dust particle over dt, as in the scheme lab14.

    The slip of each pair relaxes independently of other pairs. Writes to `pull` (pairs,) the number c of eq. (1) of
    `drag/published/lab14.py`: the impulse is c times the slip along the line between the particles. gas, dust:
    `PairSpecies`. gas_own, own (n, d): sources, accelerations of gas and of dust alone; `own` may be empty. gas_slope,
    slope (n, d, d): velocity slopes d v_c / d x_a at [a, c], by which the slip is extrapolated to a common point as in
    the scheme reconstructed. If they are empty, the slip is that between the two positions.
    """
    dim = offset.shape[1]
    for j in range(first, last):
        for k in range(pairs.start[j], pairs.start[j + 1]):
            a = pairs.gas[k]
            # The share of the dust in the change of the slip: all of it if drag does not act on the gas.
            mine = gas.density[a] / (gas.density[a] + dust.density[j]) if two_way else 1.0
            f, g = response(1.0 / (mine * pairs.time[k]), dt, exponential)
            factor = dust.mass[j] * pairs.part[k] * mine
            r2, y, b = 0.0, 0.0, 0.0
            for i in range(dim):
                r2 += offset[k, i] * offset[k, i]
                y += (dust.vel[j, i] - gas.vel[a, i]) * offset[k, i]
                b += ((own[j, i] if len(own) > 0 else 0.0) - gas_own[a, i]) * offset[k, i]
            pull[k] = -factor * f * (1.0 if r2 == 0.0 else dim)
            if r2 == 0.0:  # no line between the particles: mean over all directions
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
                y -= limited_slope(s, gs)
            for i in range(dim):
                impulse[k, i] = factor * dim * (f * y + g * b) / r2 * offset[k, i]


@jit
def removed_fractions(first, last, begin, order, offset, pull, mass, share):
    """Write to `share` (n,) the largest fraction of its slip that the pairs of a particle remove.

    The slip is taken to be the same in all pairs.

    The fraction depends on the direction of the slip; the largest is an eigenvalue. The pairs of particle i are
    order[begin[i] : begin[i + 1]], or begin[i] to begin[i + 1] - 1 if `order` is empty. pull (pairs,): c of eq. (1) of
    `drag/published/lab14.py`. mass (n,): masses of the particles.
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
def largest_pair_sums(first, last, begin, order, mine, one, other, both):
    """Write to `both` (n,), for each particle, its own fraction plus the largest fraction of its partners.

    one (n,), other: results of `removed_fractions` for the particles and for their partners. mine (pairs,): index of
    the partner. begin, order: as in `removed_fractions`.
    """
    for i in range(first, last):
        both[i] = 0.0
        for m in range(begin[i], begin[i + 1]):
            k = order[m] if len(order) > 0 else m
            both[i] = max(both[i], one[i] + other[mine[k]])


@jit
def limit_impulses(first, last, start, gas, both, gas_both, impulse):
    """Scale `impulse` (pairs, d) down, in place, so that impulses create no kinetic energy, as in the scheme lab14.

    both, gas_both: results of `largest_pair_sums` for dust and for gas.
    """
    for j in range(first, last):
        for k in range(start[j], start[j + 1]):
            scale = 2.0 / max(2.0, both[j], gas_both[gas[k]])
            for i in range(impulse.shape[1]):
                impulse[k, i] *= scale


@jit
def apply_impulses(first, last, begin, order, impulse, sign, mass, vel):
    """Change the velocity of each particle, in `vel` (n, d), by the impulses of its pairs times `sign`.

    impulse (pairs, d). sign: 1 for dust, -1 for gas. begin, order: as in `removed_fractions`. mass (n,): masses of the
    particles.
    """
    for i in range(first, last):
        for c in range(vel.shape[1]):
            total = 0.0
            for m in range(begin[i], begin[i + 1]):
                total += impulse[order[m] if len(order) > 0 else m, c]
            vel[i, c] += sign * total / mass[i]


@jit
def add_pair_heat(first, last, by_gas, begin, dust, impulse, mass, mean, gmean, heat):
    """Add to `heat` (gas,) the heat per mass that each gas particle gains from its pairs.

    The heat of a pair is -impulse . slip, with the velocities `mean` of the dust and `gmean` of the gas halfway
    through the kick. Together, the heat of all pairs is the whole loss of kinetic energy apart from the work of the
    accelerations.
    """
    for a in range(first, last):
        for m in range(begin[a], begin[a + 1]):
            k = by_gas[m]
            for i in range(impulse.shape[1]):
                heat[a] -= impulse[k, i] * (mean[dust[k], i] - gmean[a, i]) / mass[a]
