"""Drag between the gas of polar cells and the grains near them: an exact relaxation in each cell.

A grain has the mass m and is divided into nine parts, one for each of the nearest cells, with the weights w of a
triangular-shaped cloud in ln r and phi. Grains are then clouds, and the dust-to-gas ratio of a cell is smooth in time.
A part k in a cell is compared with the gas at the grain. A cell has the mass M_g, its centroid the radius R, and the
gas there the velocity V. The slip of a part is, in polar components,

    s_k = (u_r - v_r(x_k), (r_k / R) (u_phi - v_phi(x_k)))                                            (1)

where v_r r^2 and v_phi r^(1/2) are linear functions of position, with the differences between the cells on both sides
as slopes. Both functions are uniform if all gas is on Keplerian orbits: r^2 because a drift adds the centrifugal
acceleration to v_r. With full slopes, to second order in the side of a cell, a velocity field that gas and dust share
is not damped. Only accelerations of one species change slips; those of gas are continued to the grain in the same way,
and B_k is the difference. With the means S_j and B_j over the parts of a population, their mass M_j and e_j = M_j / M_g

    dS_j/dt = B_j - S_j / t_j - sum_i e_i S_i / t_i,    ds_k/dt - dS_j/dt = B_k - B_j - (s_k - S_j) / t_j    (2)

is solved exactly over dt. The gas receives what the parts lose of radial momentum and of angular momentum: with the
factor r_k / R, the change of M_g V in polar components is minus the sum of w m (du_r, (r_k / R) du_phi). The velocity
of a grain is the mean over its parts.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.formulas.laws import CONSTANT
from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index
from discsim.kernels.drag.coupled import SCRATCH_COLUMNS
from discsim.kernels.drag.frame import orbital_frequency
from discsim.kernels.drag.laws import stopping_time
from discsim.kernels.drag.nonlinear import relax_nonlinear
from discsim.kernels.drag.relax import relax_means, response
from discsim.kernels.polar.sampling import near_column, near_ring, weights

PARTS, NEAREST = 9, 4  # number of parts of a grain, and the part in the cell that contains the grain
# Columns of the table of grains: unit vector along r, r, r^-2, r^(-1/2), and polar components of velocity and source.
EX, EY, R, INVERSE_SQUARE, INVERSE_ROOT, VELOCITY, SOURCE, COLUMNS = 0, 1, 2, 3, 4, 5, 7, 9
VALUE, ALONG_R, ALONG_PHI = range(3)  # rows of a field: at the centroid, per r, and per sin(phi - phi of the centroid)


class Parts(NamedTuple):
    """Parts of the grains, n grains in all.

    share (n, PARTS): fraction of the mass of a grain. grain (n, COLUMNS): table of the grains. change (n, PARTS, 2):
    change of the velocity by drag times the share, radial and azimuthal. time (n,): stopping time of a grain in its
    own cell.
    """

    share: np.ndarray
    grain: np.ndarray
    change: np.ndarray
    time: np.ndarray


class CellScratch(NamedTuple):
    """Scratch arrays for the parts in a cell, and for the gas (row 0) and the n populations there.

    slip (parts, 4): slips and differences of sources B_k. fields (2, 3, 2): velocity and source of the gas as linear
    functions. mass, time, factor (n + 1,): masses, stopping times, and means of `Dust.per_grain`. y, b, change (n + 1,
    2): mean slips, mean B and changes by drag. response (n + 1, 2): f and g of `response`. coupled: scratch of
    `relax_coupled`.
    """

    slip: np.ndarray
    fields: np.ndarray
    mass: np.ndarray
    time: np.ndarray
    factor: np.ndarray
    y: np.ndarray
    b: np.ndarray
    change: np.ndarray
    response: np.ndarray
    coupled: np.ndarray


@jit_no_alloc
def divide_grains(first, last, pos, geometry, cell, share):
    """Write the cells of the parts of each grain to `cell` (n, PARTS), and their shares of its mass to `share`.

    Grains beyond the edges are in the cell whose index is the number of cells.
    """
    sides, angles = geometry.sides, len(geometry.cos)
    rings = len(sides) - 1
    start = math.log(sides[0])
    per_ring = rings / (math.log(sides[rings]) - start)
    for k in range(first, last):
        x, y = pos[k, 0], pos[k, 1]
        r = math.sqrt(x * x + y * y)
        if not sides[0] <= r < sides[rings]:
            for m in range(PARTS):
                cell[k, m], share[k, m] = rings * angles, 0.0
            continue
        out, around = (math.log(r) - start) * per_ring, math.atan2(y, x) / geometry.angle
        i, j = math.floor(out), math.floor(around)
        across, along = weights(out - i - 0.5), weights(around - j - 0.5)
        for a in range(3):
            row = near_ring(i, a, rings)
            for b in range(3):
                cell[k, 3 * a + b] = row * angles + near_column(j, b, angles)
                share[k, 3 * a + b] = across[a] * along[b]


@jit_no_alloc
def fill_table(first, last, pos, vel, source, grain):
    """Write the table `grain` (n, COLUMNS) of the grains; source (n, 2): may have no rows."""
    for k in range(first, last):
        x, y = pos[k, 0], pos[k, 1]
        r = math.sqrt(x * x + y * y)
        over = 1.0 / r if r > 0.0 else 0.0
        x, y = x * over, y * over
        grain[k, EX], grain[k, EY], grain[k, R] = x, y, r
        grain[k, INVERSE_SQUARE], grain[k, INVERSE_ROOT] = over * over, math.sqrt(over)
        grain[k, VELOCITY] = x * vel[k, 0] + y * vel[k, 1]
        grain[k, VELOCITY + 1] = x * vel[k, 1] - y * vel[k, 0]
        grain[k, SOURCE], grain[k, SOURCE + 1] = 0.0, 0.0
        if len(source) > 0:
            grain[k, SOURCE] = x * source[k, 0] + y * source[k, 1]
            grain[k, SOURCE + 1] = x * source[k, 1] - y * source[k, 0]


@inline_jit
def scaled(vector, i, j, geometry):
    """Return the polar components of `vector` (n, 2) in the cell (i, j), times r^2 and times r^(1/2)."""
    r, c, s, at = geometry.radius[i], geometry.cos[j], geometry.sin[j], i * len(geometry.cos) + j
    x, y = vector[at, 0], vector[at, 1]
    return (c * x + s * y) * r * r, (c * y - s * x) * math.sqrt(r)


@inline_jit
def fit_field(vector, i, j, geometry, field):
    """Write the linear functions of eq. (1) in the cell (i, j) for `vector` (n, 2) to `field` (3, 2)."""
    rings, angles = len(geometry.radius), len(geometry.cos)
    low, high = max(i - 1, 0), min(i + 1, rings - 1)
    left, right = (j - 1 if j > 0 else angles - 1), (j + 1 if j < angles - 1 else 0)
    across = 1.0 / (geometry.radius[high] - geometry.radius[low])
    along = 0.5 / math.sin(geometry.angle)
    field[VALUE, 0], field[VALUE, 1] = scaled(vector, i, j, geometry)
    a, b = scaled(vector, low, j, geometry)
    c, d = scaled(vector, high, j, geometry)
    field[ALONG_R, 0], field[ALONG_R, 1] = across * (c - a), across * (d - b)
    a, b = scaled(vector, i, left, geometry)
    c, d = scaled(vector, i, right, geometry)
    field[ALONG_PHI, 0], field[ALONG_PHI, 1] = along * (c - a), along * (d - b)


@inline_jit
def value_at(field, component, dr, dphi):
    """Return a component of the linear function `field` (3, 2) at the distances dr and dphi from the centroid."""
    return field[VALUE, component] + dr * field[ALONG_R, component] + dphi * field[ALONG_PHI, component]


@inline_jit
def find_slips(i, j, first, last, gas, dust, geometry, parts, scratch):
    """Write the slips of eq. (1) and the differences B_k of the parts dust.order[first:last] to `scratch.slip`."""
    fields, slip, sources = scratch.fields, scratch.slip, len(gas.source) > 0
    fit_field(gas.vel, i, j, geometry, fields[0])
    if sources:
        fit_field(gas.source, i, j, geometry, fields[1])
    radius, c, s = geometry.radius[i], geometry.cos[j], geometry.sin[j]
    inverse = 1.0 / radius
    for m in range(first, last):
        k, at = dust.order[m] // PARTS, index(m - first)
        r, square, root = parts.grain[k, R], parts.grain[k, INVERSE_SQUARE], parts.grain[k, INVERSE_ROOT]
        dr, dphi, arm = r - radius, parts.grain[k, EY] * c - parts.grain[k, EX] * s, r * inverse
        slip[at, 0] = parts.grain[k, VELOCITY] - square * value_at(fields[0], 0, dr, dphi)
        slip[at, 1] = arm * (parts.grain[k, VELOCITY + 1] - root * value_at(fields[0], 1, dr, dphi))
        slip[at, 2], slip[at, 3] = parts.grain[k, SOURCE], arm * parts.grain[k, SOURCE + 1]
        if sources:
            slip[at, 2] -= square * value_at(fields[1], 0, dr, dphi)
            slip[at, 3] -= arm * root * value_at(fields[1], 1, dr, dphi)


@inline_jit
def find_means(first, last, dust, class_of, parts, scratch):
    """Write the mass, the mean slip, the mean B and the mean of `dust.density` of each population in a cell.

    `dust.density` has no rows if the grains of a population are equal.
    """
    slip, mass, factor, y, b = scratch.slip, scratch.mass, scratch.factor, scratch.y, scratch.b
    for s in range(1, len(mass)):
        mass[s], factor[s] = 0.0, 0.0
        for c in range(2):
            y[s, c], b[s, c] = 0.0, 0.0
    for m in range(first, last):
        part, at = dust.order[m], index(m - first)
        k = part // PARTS
        s, own = class_of[k] + 1, parts.share[k, part - k * PARTS] * dust.mass[k]
        mass[s] += own
        if len(dust.density) > 0:
            factor[s] += own * dust.density[k]
        for c in range(2):
            y[s, c] += own * slip[at, c]
            b[s, c] += own * slip[at, 2 + c]
    for s in range(1, len(mass)):
        if mass[s] > 0.0:
            factor[s] /= mass[s]
            for c in range(2):
                y[s, c] /= mass[s]
                b[s, c] /= mass[s]


@inline_jit
def find_times(cell, gas, law, omega, scratch):
    """Write the stopping time of each population in a cell, at zero slip, to `scratch.time`."""
    rho, sound, mass, factor = gas.density[cell], gas.sound[cell], scratch.mass, scratch.factor
    scratch.time[0] = np.inf
    for s in range(1, len(mass)):
        scratch.time[s] = np.inf
        if mass[s] > 0.0:
            sparse = law.code == CONSTANT and factor[s] > 0.0  # factor is then the density of the dust
            ratio = factor[s] / rho if sparse else mass[s] / mass[0]
            time = stopping_time(law.code, law.grains[s - 1], ratio, rho, sound, omega)
            if law.code != CONSTANT and factor[s] > 0.0:  # grains have individual sizes
                time *= factor[s]
            scratch.time[s] = time


@inline_jit
def change_parts(i, first, last, dust, class_of, geometry, law, parts, scratch):
    """Write the changes of the parts dust.order[first:last] by drag, eq. (2), to `parts`."""
    slip, y, b, change, radius = scratch.slip, scratch.y, scratch.b, scratch.change, geometry.radius[i]
    for s in range(1, len(scratch.mass)):
        scratch.response[s, 0], scratch.response[s, 1] = response(1.0 / scratch.time[s], law.dt, law.exponential)
    for m in range(first, last):
        part, at = dust.order[m], index(m - first)
        k = part // PARTS
        own, s = part - k * PARTS, class_of[k] + 1
        f, g, share = scratch.response[s, 0], scratch.response[s, 1], parts.share[k, own]
        radial = change[s, 0] + f * (slip[at, 0] - y[s, 0]) + g * (slip[at, 2] - b[s, 0])
        around = change[s, 1] + f * (slip[at, 1] - y[s, 1]) + g * (slip[at, 3] - b[s, 1])
        parts.change[k, own, 0] = share * radial
        parts.change[k, own, 1] = share * around * radius / parts.grain[k, R]
        if own == NEAREST:
            parts.time[k] = scratch.time[s]


@inline_jit
def most_parts(first, last, start):
    """Return the largest number of parts in one of the cells `first` to `last`."""
    most = 0
    for cell in range(first, last):
        most = max(most, start[cell + 1] - start[cell])
    return most


@inline_jit
def relax_cell(i, j, gas, dust, class_of, geometry, law, nonlinear, several, omega, parts, scratch, by_drag):
    """Relax the cell (i, j), as `relax_cells`; omega: Keplerian frequency there."""
    cell = i * len(geometry.cos) + j
    begin, end = dust.start[cell], dust.start[cell + 1]
    by_drag[cell, 0], by_drag[cell, 1] = 0.0, 0.0
    if begin == end:
        return
    mass, time, y, b, change = scratch.mass, scratch.time, scratch.y, scratch.b, scratch.change
    mass[0] = gas.mass[cell]
    find_slips(i, j, begin, end, gas, dust, geometry, parts, scratch)
    find_means(begin, end, dust, class_of, parts, scratch)
    find_times(cell, gas, law, omega, scratch)
    if nonlinear:
        relax_nonlinear(
            mass, time, law.code, law.grains, gas.density[cell], gas.sound[cell], omega, y, b, law.two_way, law.dt,
            law.exponential, several, scratch.coupled, change,
        )  # fmt: skip
    else:
        relax_means(mass, time, y, b, law.two_way, law.dt, law.exponential, several, scratch.coupled, change)
    change_parts(i, begin, end, dust, class_of, geometry, law, parts, scratch)
    c, s = geometry.cos[j], geometry.sin[j]
    by_drag[cell, 0] = c * change[0, 0] - s * change[0, 1]
    by_drag[cell, 1] = s * change[0, 0] + c * change[0, 1]


@jit
def relax_cells(first, last, gas, dust, class_of, geometry, law, nonlinear, several, frame, parts, by_drag):
    """Relax the cells in the rings `first` to `last`; write the changes of their gas by drag to `by_drag` (cells, 2).

    gas, dust: `Species`; the parts of grains in a cell are dust.order[dust.start[cell] : dust.start[cell + 1]].
    class_of (n,): population of each grain. frame: star of the Keplerian frequency in stopping times. by_drag is 0 in
    cells without dust, and with one-way drag. Changes of grains are written to `parts`.
    """
    n, angles = len(law.grains) + 1, len(geometry.cos)
    scratch = CellScratch(
        np.empty((most_parts(first * angles, last * angles, dust.start), 4)), np.empty((2, 3, 2)), np.zeros(n),
        np.empty(n), np.zeros(n), np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2)), np.empty((n, 2)),
        np.empty((n, SCRATCH_COLUMNS)),
    )  # fmt: skip
    for i in range(first, last):
        omega = 0.0
        if frame.star > 0.0:
            omega = orbital_frequency(geometry.radius[i] ** 2, frame.star, frame.softening)
        for j in range(angles):
            relax_cell(i, j, gas, dust, class_of, geometry, law, nonlinear, several, omega, parts, scratch, by_drag)


@jit_no_alloc
def kick_grains(first, last, vel, acc, outside, parts, dt):
    """Kick grains by accelerations over dt and by the changes of their parts; `vel` (n, 2) changes in place.

    outside (n,): whether a grain is beyond the edges of the grid. The velocities in the table of the grains are
    replaced by those half-way through the kick.
    """
    for k in range(first, last):
        radial, around = 0.0, 0.0
        if not outside[k]:
            for m in range(PARTS):
                radial += parts.change[k, m, 0]
                around += parts.change[k, m, 1]
        x, y = parts.grain[k, EX], parts.grain[k, EY]
        dx = dt * acc[k, 0] + x * radial - y * around
        dy = dt * acc[k, 1] + y * radial + x * around
        parts.grain[k, VELOCITY] += 0.5 * (x * dx + y * dy)
        parts.grain[k, VELOCITY + 1] += 0.5 * (x * dy - y * dx)
        vel[k, 0] += dx
        vel[k, 1] += dy


@jit_no_alloc
def find_heat(first, last, gas, dust, by_drag, parts, dt, heat):
    """Write the heat per mass of the gas in each cell, the kinetic energy that drag removes there, to `heat` (cells,).

    gas, dust: `Species` as in `relax_cells`, with the gas before the kick. parts: after `kick_grains`.
    """
    for cell in range(first, last):
        lost = 0.0
        for m in range(dust.start[cell], dust.start[cell + 1]):
            part = dust.order[m]
            k = part // PARTS
            for c in range(2):
                lost -= dust.mass[k] * parts.change[k, part - k * PARTS, c] * parts.grain[k, VELOCITY + c]
        for c in range(2):
            middle = gas.vel[cell, c] + 0.5 * (dt * gas.acc[cell, c] + by_drag[cell, c])
            lost -= gas.mass[cell] * by_drag[cell, c] * middle
        heat[cell] = lost / gas.mass[cell]


@jit_no_alloc
def kick_cells(first, last, vel, acc, by_drag, dt):
    """Add accelerations over dt and the changes by drag to the velocities of the gas `vel` (n, 2), in place."""
    for cell in range(first, last):
        for c in range(2):
            vel[cell, c] += dt * acc[cell, c] + by_drag[cell, c]
