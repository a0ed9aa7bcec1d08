"""Random walk of dust particles (grains) in turbulent gas; in equilibrium Sigma_d / Sigma_g is uniform.

    S(x) = sum_a m_a W(|x - x_a|, h_a),   c^2(x) = sum_a m_a W c_a^2 / S                                  (1)
    dx   = (grad D + D grad ln S) dt + sqrt(2 D dt) xi,   D = D_g / (1 + St^2)                            (2)

so that d Sigma_d/dt = div [D S grad(Sigma_d / S)] in Ito's sense, with the actual gas density S, including its particle
noise. Gradients of S and c^2 are those of the sums (1), or of a given disc. The gradient of St = t Omega, with the
stopping time t, follows from them by the drag law.

About a star a grain keeps its radial and azimuthal velocity relative to the circular orbit at its position. Otherwise
each displacement would put it onto an eccentric orbit. The gas near the middle of the displacement loses the angular
momentum that the grain gains, so that gas and dust diffuse through each other (`effects/dust_diffusion.py`).
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from discsim.jit.decorators import inline_jit, jit, jit_sums_alloc
from discsim.jit.index import index
from discsim.kernels.common.philox import counter_words, normal_pair
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.dust.background import gas_at
from discsim.kernels.dust.packs import (
    FIRST_FREE,
    STEEP,
    W,
    X,
    Y,
    add_values,
    max_members,
    members_and_centre,
    pack_column,
    pack_kernels,
    pack_own_weights,
    pack_padded_positions,
    pack_weights,
    weighted_sum,
)
from discsim.kernels.sph.packs import CHUNK, STRIDE, clear, relative
from discsim.kernels.sph.smoothing import NORM

# Columns of `field`, the gas at the positions of grains: S, the length that limits a displacement, c^2; then d columns
# of grad ln S and d columns of grad ln c^2.
DENSITY, LENGTH, SPEED2, SLOPES = range(4)
# Rows of packs: h, mass and c^2 of gas particles; for grains, the angular momentum that they gained, over S.
LONG, MASS, C2 = range(FIRST_FREE, FIRST_FREE + 3)
PER_DENSITY = FIRST_FREE
LOG_STEP = 1e-3  # step in ln r for the slopes of a given disc; larger than the spacing of its table
LENGTH_OVER_HEIGHT = 1.0 / 3.0  # LENGTH over H in a given disc; about the h of SPH in a disc of gas particles
RELATIVE_STEP = 1e-4  # relative step of the arguments of a stopping time, for its slopes


class Turbulence(NamedTuple):
    """Turbulence that diffuses the grains, and the drag law."""

    table: np.ndarray  # (nodes, 2): alpha and d alpha / d ln r; if it is empty, D_g is `constant`
    first: float  # ln r of the first node of `table`
    nodes: float  # number of nodes per unit of ln r
    constant: float
    inert: bool  # whether inertia reduces D to D_g / (1 + St^2); otherwise D = D_g
    star: float  # G M
    softening: float
    frequency: float  # Omega if there is no star
    law: int  # form of the drag law
    grains: np.ndarray  # (populations, 5): its constants, as in `formulas/laws.py`


class CircularOrbits(NamedTuple):
    """Circular orbits about the star, relative to which grains keep their velocities."""

    star: float  # G M; 0: there are no orbits
    softening: float
    lag: float  # time by which velocities are behind the positions
    centre: np.ndarray  # (4,): position and velocity of the centre
    polar: bool  # whether grains drift in polar coordinates: only radial velocities are then behind


@njit(inline="always")
def pack_gas(begin, end, indices, order, h, mass, speed2, pack):
    """Write h, mass and c^2 of the gas particles `begin` to `end` to `pack`."""
    first = index(begin)
    for k in range(index(end - begin)):
        a = order[indices[first + k]]
        pack[LONG * STRIDE + k], pack[MASS * STRIDE + k], pack[C2 * STRIDE + k] = h[a], mass[a], speed2[a]


@njit(inline="always")
def add_gas(x, y, n, pack, sums):
    """Add to `sums` (7,) the terms of n packed gas particles in S, S h, S c^2, grad S and grad (S c^2) at (x, y)."""
    s = length = speed = sx = sy = vx = vy = 0.0
    for k in range(n):
        dx, dy = x - pack[X * STRIDE + k], y - pack[Y * STRIDE + k]
        m, c2 = pack[MASS * STRIDE + k], pack[C2 * STRIDE + k]
        w, steep = m * pack[W * STRIDE + k], m * pack[STEEP * STRIDE + k]
        s += w
        length += w * pack[LONG * STRIDE + k]
        speed += w * c2
        sx += steep * dx
        sy += steep * dy
        vx += steep * dx * c2
        vy += steep * dy * c2
    add_values((s, length, speed, sx, sy, vx, vy), 0, sums)


@njit(inline="always")
def write_gas(dim, j, sums, field):
    """Write row j of `field`, the gas at grain j, from the sums of `add_gas`. S = 0 outside the gas."""
    s, length, speed = sums[0], sums[1], sums[2]
    field[j, DENSITY] = s
    if s > 0.0:
        field[j, LENGTH], field[j, SPEED2] = length / s, speed / s
        for axis in range(dim):
            slope = sums[3 + axis] / s
            field[j, SLOPES + axis] = slope
            field[j, SLOPES + dim + axis] = sums[5 + axis] / speed - slope if speed > 0.0 else 0.0


@functools.cache
def gas_driver(kernel: int, dim: int):
    """Return the kernel that computes the sums (1) and writes the gas at each grain to `field` (n, 3 + 2 d).

    lists: candidate lists of gas particles, for the filled cells `first` to `last` of `grains`. cells: cells of the
    gas. pos (n, d): positions of the grains. h, mass, speed2 (gas,): h, mass and c^2 of the gas particles.
    """

    @jit_sums_alloc
    def gas_about(first, last, lists, grains, cells, pos, h, mass, speed2, field):
        begin, indices, order = lists.begin, lists.indices, grains.order
        pack = np.zeros((C2 + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, grains), 7))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, grains)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, cells, pack)
                pack_kernels(kernel, dim, listed, end, indices, cells.order, h, pack)
                pack_gas(listed, end, indices, cells.order, h, mass, speed2, pack)
                for p in range(members):
                    x, y = relative(dim, pos, order[own + p], ox, oy, 1.0)
                    pack_weights(kernel, dim, x, y, n, pack)
                    add_gas(x, y, n, pack, sums[p])
            for p in range(members):
                write_gas(dim, order[own + p], sums[p], field)

    return gas_about


@functools.cache
def recoil_driver(kernel: int):
    """Return the kernel that subtracts from the gas the angular momentum that grains gained, by the weights in (1).

    The kernel changes the velocities `gvel` (gas, 2), and processes the filled cells `first` to `last` of the gas,
    `cells`. lists: candidate lists of grains. gpos, h (gas,): positions and h of the gas. per_density (n,): angular
    momentum that each grain gained, over S at the grain; 0 where there is no gas. centre: as in `CircularOrbits`.
    """
    sigma = NORM[1][kernel]

    @jit_sums_alloc
    def recoil(first, last, lists, cells, grains, gpos, h, per_density, centre, gvel):
        begin, indices, order = lists.begin, lists.indices, cells.order
        pack = np.zeros((PER_DENSITY + 1) * STRIDE)
        sums = np.zeros((max_members(first, last, cells), 1))
        for c in range(first, last):
            own, members, ox, oy = members_and_centre(c, cells)
            clear(sums, members)
            for listed in range(begin[c - first], begin[c - first + 1], CHUNK):
                end = min(listed + CHUNK, begin[c - first + 1])
                n = pack_padded_positions(c - first, listed, end, lists, ox, oy, grains, pack)
                pack_column(listed, end, indices, grains.order, per_density, PER_DENSITY, pack)
                for p in range(members):
                    i = order[own + p]
                    x, y = relative(2, gpos, i, ox, oy, 1.0)
                    pack_own_weights(kernel, x, y, 1.0 / h[i], n, pack)
                    sums[p, 0] += weighted_sum(n, PER_DENSITY, pack)
            for p in range(members):
                # The change of velocity is tangential. The mass of the gas particle has cancelled.
                i = order[own + p]
                x, y = gpos[i, 0] - centre[0], gpos[i, 1] - centre[1]
                per = sigma * sums[p, 0] / (h[i] * h[i] * max(x * x + y * y, 1e-300))
                gvel[i, 0] += per * y
                gvel[i, 1] -= per * x

    return recoil


@jit
def write_gas_of_disc(first, last, pos, disc, field):
    """Write the gas of a given disc about the origin at the positions `pos` (n, 2) to `field` (n, 7)."""
    for i in range(first, last):
        r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
        density, sound2 = gas_at(r2, disc)[:2]
        out, out_sound2 = gas_at(r2 * math.exp(2.0 * LOG_STEP), disc)[:2]
        within, within_sound2 = gas_at(r2 * math.exp(-2.0 * LOG_STEP), disc)[:2]
        slope, steep = math.log(out / within), math.log(out_sound2 / within_sound2)
        field[i, DENSITY], field[i, SPEED2] = density, sound2
        field[i, LENGTH] = LENGTH_OVER_HEIGHT * math.sqrt(sound2) / orbital_frequency(r2, disc.star, disc.softening)
        for k in range(2):
            per = pos[i, k] / (r2 * 2.0 * LOG_STEP)
            field[i, SLOPES + k], field[i, SLOPES + 2 + k] = slope * per, steep * per


@inline_jit
def slopes_of_time(law, grain, density, sound, star, own):
    """Return d ln t / d ln x of the stopping time t, for x the gas density, the sound speed and Omega.

    grain: row of constants of the drag law. star: Omega, 0 without a star. own: the value of t.
    """
    up = 1.0 + RELATIVE_STEP
    per = 1.0 / math.log(up)
    by_density = math.log(stopping_time(law, grain, 1.0, density * up, sound, star) / own)
    by_sound = math.log(stopping_time(law, grain, 1.0, density, sound * up, star) / own)
    by_omega = math.log(stopping_time(law, grain, 1.0, density, sound, star * up) / own) if star > 0.0 else 0.0
    return per * by_density, per * by_sound, per * by_omega


@jit
def write_diffusivities(first, last, pos, centre, species, field, times, norm, fresh, stirring, diffusivity, drift):
    """Write D of each grain to `diffusivity` (n,), and grad D + D grad ln S to `drift` (n, d).

    D and the drift are 0 where there is no gas or no drag. field: the gas at the grains. stirring: a `Turbulence`.
    species (n,): population of each grain.

    If `fresh`, the stopping times are `times` (n,), and `norm` (n,) is set to their ratios to the values of the drag
    law for the gas in `field`. Otherwise the stopping times are the values of the law times `norm`. Returns the largest
    D over the squared LENGTH of `field`.
    """
    dim, most, steepest = pos.shape[1], len(stirring.table) - 1, 0.0
    for i in range(first, last):
        diffusivity[i] = 0.0
        for k in range(dim):
            drift[i, k] = 0.0
        density, speed2 = field[i, DENSITY], field[i, SPEED2]
        if density == 0.0:
            continue
        x, y = pos[i, 0] - centre[0], (pos[i, 1] - centre[1] if dim == 2 else 0.0)
        r2 = x * x + y * y
        # (turned x, turned y) is the gradient of ln Omega, and (rise x, rise y) the part of grad D_g due to grad alpha.
        omega, turned, rise = stirring.frequency, 0.0, 0.0
        if stirring.star > 0.0:
            if r2 + stirring.softening == 0.0:
                continue
            omega = orbital_frequency(r2, stirring.star, stirring.softening)
            turned = -1.5 / (r2 + stirring.softening * stirring.softening)
        d_gas = stirring.constant
        if most >= 0:
            at = min(max((0.5 * math.log(max(r2, 1e-300)) - stirring.first) * stirring.nodes, 0.0), float(most))
            node = min(int(at), most - 1)
            part = at - node
            alpha = (1.0 - part) * stirring.table[node, 0] + part * stirring.table[node + 1, 0]
            rise = (1.0 - part) * stirring.table[node, 1] + part * stirring.table[node + 1, 1]
            if r2 > 0.0:
                rise *= speed2 / omega / r2  # the slope of D_g itself, as alpha may be 0
            d_gas = alpha * speed2 / omega
        less, by_density, by_speed, by_omega = 1.0, 0.0, 0.0, 0.0
        if stirring.inert:
            star = omega if stirring.star > 0.0 else 0.0
            grain, sound = stirring.grains[species[i]], math.sqrt(speed2)
            own = stopping_time(stirring.law, grain, 1.0, density, sound, star)
            if fresh:
                norm[i] = times[i] / own
            stokes2 = (norm[i] * own * omega) ** 2
            less = 1.0 / (1.0 + stokes2)
            if less > 0.0:
                steep = -2.0 * stokes2 * less  # d ln D / d ln St
                by_density, by_speed, by_omega = slopes_of_time(stirring.law, grain, density, sound, star, own)
                by_density, by_speed, by_omega = steep * by_density, 0.5 * steep * by_speed, steep * (1.0 + by_omega)
        d = d_gas * less
        # A constant D_g depends on c^2 and Omega only through St.
        if most >= 0:
            by_speed += 1.0
            by_omega -= 1.0
        diffusivity[i] = d
        steepest = max(steepest, d / (field[i, LENGTH] * field[i, LENGTH]))
        for k in range(dim):
            along = x if k == 0 else y
            slope = (1.0 + by_density) * field[i, SLOPES + k] + by_speed * field[i, SLOPES + dim + k]
            drift[i, k] = d * (slope + by_omega * turned * along) + less * (rise * along if r2 > 0.0 else 0.0)
    return steepest


@jit
def random_walk(first, last, pos, vel, ids, diffusivity, drift, field, key, step, dt, circles, gained):
    """Displace grains by eq. (2) over dt: change `pos` (n, d) and, about a star, `vel` (n, 2).

    diffusivity, drift, field: results of `write_diffusivities`, and the gas at the grains. The random numbers are those
    of `key`, the `ids` (n,) of the grains and the `step`. circles: `CircularOrbits`. gained (n,): output, the angular
    momentum per mass that each grain gains; not written if it is empty.

    The displacement by the drift, which diverges at the edge of the gas, is limited to half the LENGTH of `field`.
    """
    dim = pos.shape[1]
    for i in range(first, last):
        if diffusivity[i] == 0.0:
            if len(gained) > 0:
                gained[i] = 0.0
            continue
        xi, eta = normal_pair(key, counter_words(ids[i], step))
        wide = math.sqrt(2.0 * diffusivity[i] * dt)
        u, v = dt * drift[i, 0], (dt * drift[i, 1] if dim == 2 else 0.0)
        far, most = math.sqrt(u * u + v * v), 0.5 * field[i, LENGTH]
        if far > most:
            u *= most / far
            v *= most / far
        u += wide * xi
        v += wide * eta
        if circles.star > 0.0:
            shift_velocity(i, pos, vel, u, v, circles, gained)
        pos[i, 0] += u
        if dim == 2:
            pos[i, 1] += v


@inline_jit
def shift_velocity(i, pos, vel, u, v, circles, gained):
    """Change vel[i] for a displacement (u, v) of grain i, so that its velocity relative to a circular orbit is kept.

    gained: as in `random_walk`.
    """
    cx, cy = circles.centre[0], circles.centre[1]
    x, y = pos[i, 0] - cx, pos[i, 1] - cy
    vx, vy = vel[i, 0] - circles.centre[2], vel[i, 1] - circles.centre[3]
    before = x * vy - y * vx
    sense = 1.0 if before >= 0.0 else -1.0
    r = max(math.sqrt(x * x + y * y), 1e-300)
    u_r, u_phi = lagging_orbit(r, sense, circles)
    radial, azimuthal = (x * vx + y * vy) / r - u_r, before / r - u_phi
    x += u
    y += v
    r = max(math.sqrt(x * x + y * y), 1e-300)
    u_r, u_phi = lagging_orbit(r, sense, circles)
    radial += u_r
    azimuthal += u_phi
    vx, vy = (x * radial - y * azimuthal) / r, (y * radial + x * azimuthal) / r
    vel[i, 0], vel[i, 1] = vx + circles.centre[2], vy + circles.centre[3]
    if len(gained) > 0:
        gained[i] = r * azimuthal - before


@inline_jit
def lagging_orbit(r, sense, circles):
    """Return the radial and azimuthal velocity on a circular orbit of radius r, `lag` before the time of the position.

    This is the circular velocity turned back by asin(Omega lag) or, if the drift is in polar coordinates, without the
    radial kick of `lag`. sense: 1 if the orbit is anticlockwise, else -1.
    """
    omega = orbital_frequency(r * r, circles.star, circles.softening)
    if circles.polar:
        return omega * omega * r * circles.lag, sense * omega * r
    sine = min(1.0, omega * circles.lag)
    return omega * r * sine, sense * omega * r * math.sqrt(1.0 - sine * sine)
