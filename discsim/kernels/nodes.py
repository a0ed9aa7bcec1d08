"""Implicit drag between nodes of a lattice: gathered, relaxed and scattered with one set of weights.

Nodes J are the centres of cells, w the weights of the triangular-shaped cloud (Hockney & Eastwood 1988, ch. 5) in
units of the cell. Of each species s a node holds

    M_s = sum m w,   X_s = sum m w x / M_s,   V_s = sum m w y / M_s,   A_s = sum m w b / M_s              (1)

with y velocities (relative to Kepler's about a star) and b sources. The slip is that at the gas's centroid,

    V_s + G (X_g - X_s) - V_g,                                                                           (2)

G the slope pooled within species over the nine cells about the node; that of the sources is at the node itself,

    A_s - B_s X_s - (A_g - B_g X_g),                                                                     (2b)

B_s the slope of a species' own sources there (`fit_slopes`): where t_stop << dt the drag takes back nearly all that
they do in a step, and sources linear in space leave no error then. The slip relaxes exactly with the sources inside,
which changes the velocities by D_s, sum_s M_s D_s = 0, and a particle's by

    sum_J w_J D_s,J,                                                                                     (3)

so that momentum is exact. In two dimensions what the offset of the two centroids makes of angular momentum,

    sum_s M_s X_s x D_s,                                                                                 (4)

is taken from the gas about the node as a rotation about its centroid, scattered with the same weights. What is left
of a particle beside the line of its own species in its cell decays at the species' own rate (`rest`).
"""

import numpy as np
from numba import njit

from discsim.formulas.laws import EPSTEIN
from discsim.kernels.drag import solve_slope
from discsim.kernels.frame import kepler, sense_at
from discsim.kernels.laws import stopping_time
from discsim.kernels.nonlinear import relax_by_speed
from discsim.kernels.relax import relax_means, response

# A packed particle: mass, place from the middle of its cell in sides (2), velocity (2), source (2), and what the law
# of the drag needs of the gas; unused axes are 0. A species at a node: sums of w m times 1, each of these, and x^2.
FIELDS = 8
SQUARE = 8
LEAST_INERTIA = 0.01  # over mass times side^2: the least for gas about a node to be turned, and for a slope of sources
ROUNDING = 1e-9  # the same of particles at one place, but for rounding
# Of a species in a cell: m, m x (2), m xx, m xy, m yy, then m v (2), m x v (2), m y v (2), and the same of the sources.
VELOCITIES, SOURCES, MOMENTS = 6, 12, 18
# Columns as they are given to functions: each literal would compile anew.
C0, C1, C2, C3, C4, C5 = (np.int64(column) for column in range(6))


@njit(nogil=True, cache=True, error_model="numpy")
def pack(
    block_from, block_to, order, start, stride, pos, vel, own, mass, density, sound, law,
    corners, sides, size, periodic, frame, out,
):  # fmt: skip
    """Copy the members of the blocks in their order into out (n, FIELDS)."""
    dim, star = pos.shape[1], frame.star
    for block in range(block_from, block_to):
        inverse = 1.0 / sides[block]
        for k in range(start[block * stride], start[(block + 1) * stride]):
            i = order[k]
            out[k, 0] = mass[i]
            for a in range(dim):
                d = pos[i, a] - corners[block, a]
                if periodic:
                    d -= size[a] * np.floor(d / size[a])
                out[k, 1 + a] = d * inverse - 0.5
                out[k, 3 + a] = vel[i, a]
                if len(own) > 0:
                    out[k, 5 + a] = own[i, a]
            if star > 0.0:
                r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
                omega = sense_at(r2, frame) * kepler(r2, star, frame.softening)
                out[k, 3] += omega * pos[i, 1]
                out[k, 4] -= omega * pos[i, 0]
            if len(density) > 0:
                out[k, 7] = density[i] * (sound[i] if law == EPSTEIN and star == 0.0 else 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def cloud(x, flat):
    """Weights on the nodes -1, 0 and 1 from its own of a particle at x in [-1/2, 1/2]; `flat`: all on its own."""
    low, high = 0.5 - x, 0.5 + x
    if flat:
        return 0.0, 1.0, 0.0
    return 0.5 * low * low, 0.75 - x * x, 0.5 * high * high


@njit(nogil=True, cache=True, error_model="numpy")
def deposit(
    block_from, block_to, home, about, start, species, first, flat, sources, packed, nodes, norm, cells, clouds,
):  # fmt: skip
    """What each block gives to the nodes about it, clouds (blocks, all species, 9, SQUARE + 1), and its own moments,
    cells (blocks, all species, MOMENTS).

    `norm`, where it has entries, receives one over a particle's weights on nodes that have gas; 0 where none has.
    """
    value, w = np.empty(SQUARE + 1), np.empty(9)
    for block in range(block_from, block_to):
        near = about[home[block]]
        whole = True
        for k in range(9):
            if len(norm) > 0 and (near[k] < 0 or nodes[near[k], 0, 0] <= 0.0):
                whole = whole and flat and k % 3 != 1
        for s in range(species):
            o, c = clouds[block, first + s], cells[block, first + s]
            for p in range(start[block * species + s], start[block * species + s + 1]):
                m, x, y, vx, vy = packed[p, 0], packed[p, 1], packed[p, 2], packed[p, 3], packed[p, 4]
                c[0] += m
                c[1] += m * x
                c[2] += m * y
                c[3] += m * x * x
                c[4] += m * x * y
                c[5] += m * y * y
                c[6] += m * vx
                c[7] += m * vy
                c[8] += m * x * vx
                c[9] += m * x * vy
                c[10] += m * y * vx
                c[11] += m * y * vy
                if sources:
                    bx, by = packed[p, 5], packed[p, 6]
                    c[12] += m * bx
                    c[13] += m * by
                    c[14] += m * x * bx
                    c[15] += m * x * by
                    c[16] += m * y * bx
                    c[17] += m * y * by
                u0, u1, u2 = cloud(x, False)
                t0, t1, t2 = cloud(y, flat)
                w[0], w[1], w[2] = u0 * t0, u0 * t1, u0 * t2
                w[3], w[4], w[5] = u1 * t0, u1 * t1, u1 * t2
                w[6], w[7], w[8] = u2 * t0, u2 * t1, u2 * t2
                scale = 1.0
                if len(norm) > 0:
                    if not whole:
                        total = 0.0
                        for k in range(9):
                            if near[k] >= 0 and nodes[near[k], 0, 0] > 0.0:
                                total += w[k]
                            else:
                                w[k] = 0.0
                        scale = 1.0 / total if total > 0.0 else 0.0
                    norm[p] = scale
                m *= scale
                value[0] = m
                for f in range(1, FIELDS):
                    value[f] = m * packed[p, f]
                value[SQUARE] = m * (x * x + y * y)
                for k in range(9):
                    for f in range(SQUARE + 1):
                        o[k, f] += w[k] * value[f]


@njit(nogil=True, cache=True, error_model="numpy")
def collect(node_from, node_to, blocks, first, last, clouds, out):
    """Eq. (1): sums over species `first` to `last` at each node, places from it: out (nodes, species, SQUARE + 1)."""
    for n in range(node_from, node_to):
        for k in range(9):
            block = blocks[n, k]
            if block < 0:
                continue
            i, j = k // 3 - 1, k % 3 - 1
            for s in range(first, last):
                o, given = out[n, s], clouds[block, s, 8 - k]
                for f in range(SQUARE + 1):
                    o[f] += given[f]
                o[SQUARE] += 2.0 * (i * given[1] + j * given[2]) + (i * i + j * j) * given[0]
                o[1] += i * given[0]
                o[2] += j * given[0]


@njit(nogil=True, cache=True, error_model="numpy")
def pooled_slope(n, blocks, cells, first, last, field, dim, inertia, moment, part, slope):
    """Slope (d, d) of the moments' `field` about node n, in sides, pooled within each of the species `first` to
    `last`; nearer cells count more.
    """
    mass = 0.0
    for a in range(2):
        for c2 in range(2):
            inertia[a, c2], moment[a, c2] = 0.0, 0.0
    for s in range(first, last):
        for f in range(VELOCITIES + 6):
            part[f] = 0.0
        for k in range(9):
            block = blocks[n, k]
            if block < 0 or cells[block, s, 0] == 0.0:
                continue
            i, j = k // 3 - 1, k % 3 - 1
            w = (0.5 if i == 0 else 0.25) * (0.5 if j == 0 else 0.25)
            c = cells[block, s]
            # About the node, which lies at (-i, -j) from the cell's middle.
            part[0] += w * c[0]
            part[1] += w * (c[1] + i * c[0])
            part[2] += w * (c[2] + j * c[0])
            part[3] += w * (c[3] + i * (2.0 * c[1] + i * c[0]))
            part[4] += w * (c[4] + i * c[2] + j * (c[1] + i * c[0]))
            part[5] += w * (c[5] + j * (2.0 * c[2] + j * c[0]))
            part[6] += w * c[field]
            part[7] += w * c[field + 1]
            part[8] += w * (c[field + 2] + i * c[field])
            part[9] += w * (c[field + 3] + i * c[field + 1])
            part[10] += w * (c[field + 4] + j * c[field])
            part[11] += w * (c[field + 5] + j * c[field + 1])
        mass += part[0]
        if part[0] > 0.0:
            for a in range(dim):
                for c2 in range(dim):
                    inertia[a, c2] += part[3 + a + c2] - part[1 + a] * part[1 + c2] / part[0]
                    moment[a, c2] += part[8 + 2 * a + c2] - part[1 + a] * part[6 + c2] / part[0]
    for a in range(dim):
        for c2 in range(dim):
            slope[a, c2] = 0.0
    spread = inertia[0, 0] + inertia[1, 1]
    if spread <= ROUNDING * mass:
        return False
    return solve_slope(inertia, moment, dim, slope) and spread > LEAST_INERTIA * mass


@njit(nogil=True, cache=True, error_model="numpy")
def fit_slopes(node_from, node_to, blocks, cells, nodes, pooled, slopes, source_slopes, known):
    """Slopes about the nodes: (nodes, d, d) of the velocities, pooled within the first `pooled` species; (nodes,
    species, d, d) of each species' sources, and whether it has one there.
    """
    species, dim = nodes.shape[1], slopes.shape[1]
    inertia, moment, part = np.zeros((2, 2)), np.zeros((2, 2)), np.empty(MOMENTS)
    none, velocities, sources = np.int64(0), np.int64(VELOCITIES), np.int64(SOURCES)  # each literal would compile anew
    for n in range(node_from, node_to):
        if nodes[n, 0, 0] > 0.0:
            pooled_slope(n, blocks, cells, none, pooled, velocities, dim, inertia, moment, part, slopes[n])
        for s in range(species):
            known[n, s] = pooled_slope(
                n, blocks, cells, s, s + 1, sources, dim, inertia, moment, part, source_slopes[n, s]
            )


@njit(nogil=True, cache=True, error_model="numpy")
def slope_near(n, s, about, slopes, known, out):
    """The slope (d, d) of a species' sources at a node: its own, or the mean of those about it."""
    dim = len(out)
    count = 0
    for a in range(dim):
        for c in range(dim):
            out[a, c] = slopes[n, s, a, c] if known[n, s] else 0.0
    if known[n, s]:
        return
    for k in range(9):
        if about[n, k] >= 0 and known[about[n, k], s]:
            count += 1
            for a in range(dim):
                for c in range(dim):
                    out[a, c] += slopes[about[n, k], s, a, c]
    if count > 0:
        for a in range(dim):
            for c in range(dim):
                out[a, c] /= count


@njit(nogil=True, cache=True, error_model="numpy")
def relax_nodes(
    node_from, node_to, about, nodes, centre, slopes, source_slopes, known, sound, law, grains, two_way, dt,
    exponential, several, star, softening, change, drive, rate,
):  # fmt: skip
    """Relax the slip at each node: changes (nodes, species, d) of eq. (3) by the slip, `change`, and by the sources,
    `drive`, and rates of decay (nodes, species). `sound` (nodes,) is None unless the stopping time depends on the slip:
    without it numba leaves out the branches that ask for it, half a minute of compilation.
    """
    species, dim = nodes.shape[1], change.shape[2]
    source_slope, none = np.empty((dim, dim)), np.zeros((species, dim))
    mass, times = np.empty(species), np.empty(species)
    y, b = np.empty((species, dim)), np.empty((species, dim))
    for n in range(node_from, node_to):
        gas = nodes[n, 0]
        if gas[0] <= 0.0:
            continue
        slope = slopes[n]
        omega = 0.0
        if star > 0.0:
            omega = kepler(centre[n, 0] * centre[n, 0] + centre[n, 1] * centre[n, 1], star, softening)
        density, c_s = gas[7] / gas[0], 1.0  # of Epstein's law without a star their product
        if sound is not None:  # noqa: SIM102
            if law != EPSTEIN:
                c_s = sound[n]
        alone = True
        for s in range(species):
            o = nodes[n, s]
            mass[s], times[s] = o[0], np.inf
            if o[0] <= 0.0:
                continue
            if s > 0:
                alone = False
                ratio = o[7] / o[0] / density if o[7] > 0.0 else o[0] / gas[0]
                times[s] = stopping_time(law, grains[s - 1], ratio, density, c_s, omega)
            slope_near(n, s, about, source_slopes, known, source_slope)
            for c in range(dim):
                y[s, c], b[s, c] = o[3 + c] / o[0], o[5 + c] / o[0]
                for a in range(dim):
                    y[s, c] += slope[a, c] * (gas[1 + a] / gas[0] - o[1 + a] / o[0])  # eq. (2)
                    b[s, c] -= source_slope[a, c] * o[1 + a] / o[0]  # eq. (2b)
        if alone:
            continue
        if sound is not None:
            relax_by_speed(
                mass, times, law, grains, density, sound[n], omega, y, b, two_way, dt, exponential, several, change[n]
            )  # fmt: skip
            relax_means(mass, times, none, b, two_way, dt, exponential, several, drive[n])
            for s in range(species):
                for c in range(dim):
                    change[n, s, c] -= drive[n, s, c]
        else:
            relax_means(mass, times, y, none, two_way, dt, exponential, several, change[n])
            relax_means(mass, times, none, b, two_way, dt, exponential, several, drive[n])
        for s in range(1, species):
            if mass[s] > 0.0:
                rate[n, s] = 1.0 / times[s]
                if two_way:
                    rate[n, 0] += mass[s] / gas[0] / times[s]


@njit(nogil=True, cache=True, error_model="numpy")
def mean_sound(node_from, node_to, blocks, cells, sound, out):
    """Sound speed at nodes, from the gas's means (blocks,) in the nine cells about them; nearer cells count more."""
    for n in range(node_from, node_to):
        total, mass = 0.0, 0.0
        for k in range(9):
            block = blocks[n, k]
            if block >= 0 and cells[block, 0, 0] > 0.0:
                w = (0.5 if k // 3 == 1 else 0.25) * (0.5 if k % 3 == 1 else 0.25) * cells[block, 0, 0]
                total += w * sound[block]
                mass += w
        out[n] = total / mass if mass > 0.0 else 1.0


@njit(nogil=True, cache=True, error_model="numpy")
def sharpen(node_from, node_to, about, nodes, two_way, change, out):
    """Changes (nodes, species, d) with what gathering and scattering smoothed away given back to second order.

    To the clouds' two variances of 1/4 a side, through the faces between nodes and in proportion to the lesser
    reduced mass there: a uniform change stays what it is, and momentum is exact.
    """
    species, dim = change.shape[1], change.shape[2]
    for n in range(node_from, node_to):
        for s in range(species):
            for c in range(dim):
                out[n, s, c] = change[n, s, c]
        for s in range(1, species):
            mass = reduced_mass(nodes[n, 0, 0], nodes[n, s, 0], two_way)
            if mass == 0.0:
                continue
            for k in range(1, 9, 2):  # across faces
                other = about[n, k]
                if other < 0:
                    continue
                face = min(mass, reduced_mass(nodes[other, 0, 0], nodes[other, s, 0], two_way))
                for c in range(dim):
                    d = change[n, s, c] - change[n, 0, c] - change[other, s, c] + change[other, 0, c]
                    d *= 0.25 * face
                    out[n, s, c] += d / nodes[n, s, 0]
                    if two_way:
                        out[n, 0, c] -= d / nodes[n, 0, 0]


@njit(nogil=True, cache=True, error_model="numpy")
def sharpen_drive(node_from, node_to, about, nodes, two_way, drive, out):
    """Add to out (nodes, species, d) the changes by sources, with what the clouds smoothed away given back as in
    `sharpen`, but along each axis by second differences: changes linear in space stay what they are.
    """
    species, dim = drive.shape[1], drive.shape[2]
    for n in range(node_from, node_to):
        gas = nodes[n, 0, 0]
        for s in range(species):
            for c in range(dim):
                out[n, s, c] += drive[n, s, c]
        for s in range(1, species):
            dust = nodes[n, s, 0]
            if reduced_mass(gas, dust, two_way) == 0.0:
                continue
            for axis in range(dim):
                step = 3 if axis == 0 else 1
                low, high = about[n, 4 - step], about[n, 4 + step]
                if low < 0 or high < 0 or min(nodes[low, 0, 0], nodes[high, 0, 0]) <= 0.0:
                    continue
                if min(nodes[low, s, 0], nodes[high, s, 0]) <= 0.0:
                    continue
                for c in range(dim):
                    d = 2.0 * (drive[n, s, c] - drive[n, 0, c])
                    d -= drive[low, s, c] - drive[low, 0, c] + drive[high, s, c] - drive[high, 0, c]
                    d *= 0.25 * reduced_mass(gas, dust, two_way)
                    out[n, s, c] += d / dust
                    if two_way:
                        out[n, 0, c] -= d / gas


@njit(nogil=True, cache=True, error_model="numpy")
def turn(node_from, node_to, nodes, change, spin):
    """Rate of rotation (nodes,) of the gas about its centroid that takes eq. (4) back."""
    for n in range(node_from, node_to):
        gas = nodes[n, 0]
        if gas[0] <= 0.0:
            continue
        inertia = gas[SQUARE] - (gas[1] * gas[1] + gas[2] * gas[2]) / gas[0]
        if inertia < LEAST_INERTIA * gas[0]:
            continue
        torque = 0.0
        for s in range(nodes.shape[1]):
            torque += nodes[n, s, 1] * change[n, s, 1] - nodes[n, s, 2] * change[n, s, 0]
        spin[n] = -torque / inertia


@njit(nogil=True, cache=True, error_model="numpy")
def sharpen_slopes(node_from, node_to, about, nodes, slopes, out):
    """Slopes (nodes, d, d) with what pooling over nine cells took from a curved field given back to second order.

    Of a sine the fit along the slope takes k^2 m_4 / (6 m_2), the mean across it k^2 m_2 / 2, with m_2 = 7/12 and
    m_4 = 61/80 the moments of the cells' weights 1/4, 1/2, 1/4.
    """
    dim = slopes.shape[1]
    for n in range(node_from, node_to):
        for a in range(dim):
            for c in range(dim):
                out[n, a, c] = slopes[n, a, c]
        for axis in range(dim):
            step = 3 if axis == 0 else 1
            low, high = about[n, 4 - step], about[n, 4 + step]
            if low < 0 or high < 0 or min(nodes[n, 0, 0], nodes[low, 0, 0], nodes[high, 0, 0]) <= 0.0:
                continue
            for a in range(dim):
                given = 61.0 / 280.0 if a == axis else 7.0 / 24.0
                for c in range(dim):
                    out[n, a, c] -= given * (slopes[low, a, c] - 2.0 * slopes[n, a, c] + slopes[high, a, c])


@njit(inline="always")
def reduced_mass(gas, dust, two_way):
    if gas <= 0.0 or dust <= 0.0:
        return 0.0
    return gas * dust / (gas + dust) if two_way else dust


@njit(nogil=True, cache=True, error_model="numpy")
def curvature(about, nodes, slopes, dim, out):
    """Second derivatives (3, d) of the velocity along xx, xy and yy, in sides, from the slopes at the next nodes."""
    for a in range(3):
        for c in range(dim):
            out[a, c] = 0.0
    for a in range(dim):
        step = 3 if a == 0 else 1
        low, high = about[4 - step], about[4 + step]
        if low < 0 or high < 0 or min(nodes[low, 0, 0], nodes[high, 0, 0]) <= 0.0:
            continue
        for e in range(dim):
            for c in range(dim):
                d = 0.5 * (slopes[high, e, c] - slopes[low, e, c])
                # The mixed derivative is the mean of both.
                out[a + e, c] += d if a == e else 0.5 * d


@njit(nogil=True, cache=True, error_model="numpy")
def node_heat(node_from, node_to, nodes, change, dt, heat):
    """Energy that eq. (3) takes at each node, to first order in the changes (the rest is the particles')."""
    for n in range(node_from, node_to):
        for s in range(change.shape[1]):
            for c in range(change.shape[2]):
                heat[n] -= change[n, s, c] * (nodes[n, s, 3 + c] + 0.5 * dt * nodes[n, s, 5 + c])


@njit(nogil=True, cache=True, error_model="numpy")
def pass_on(nodes, about, heat):
    """Heat of nodes without gas to those about them, in equal parts to each that has."""
    for n in range(len(heat)):
        if heat[n] == 0.0 or nodes[n, 0, 0] > 0.0:
            continue
        takers = 0
        for k in range(9):
            takers += 1 if about[n, k] >= 0 and nodes[about[n, k], 0, 0] > 0.0 else 0
        for k in range(9):
            if about[n, k] >= 0 and nodes[about[n, k], 0, 0] > 0.0:
                heat[about[n, k]] += heat[n] / takers


@njit(nogil=True, cache=True, error_model="numpy")
def spread_heat(block_from, block_to, home, about, order, start, flat, packed, nodes, node_heats, heat):
    """Heat per mass of each gas particle from that of the nodes."""
    table = np.zeros((9, 1))
    for block in range(block_from, block_to):
        near = about[home[block]]
        for k in range(9):
            n = near[k]
            table[k, 0] = node_heats[n] / nodes[n, 0, 0] if n >= 0 and nodes[n, 0, 0] > 0.0 else 0.0
        for p in range(start[block], start[block + 1]):
            u0, u1, u2 = cloud(packed[p, 1], False)
            t0, t1, t2 = cloud(packed[p, 2], flat)
            heat[order[p]] = blend(table, C0, u0, u1, u2, t0, t1, t2)


@njit(nogil=True, cache=True, error_model="numpy")
def own_line(first, last, packed, field, pooled, dim, inertia, moment, slope):
    """Mean place and mean of fields `field` and the next of some particles, and their slope.

    Any more than a line needs will do: with few of them little is left beside it, but nothing false. Those too few
    have the pooled slope and a rotation of their own: what is beside their line never has angular momentum.
    """
    m, sx, sy, sv, sw = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, last):
        m += packed[p, 0]
        sx += packed[p, 0] * packed[p, 1]
        sy += packed[p, 0] * packed[p, 2]
        sv += packed[p, 0] * packed[p, field]
        sw += packed[p, 0] * packed[p, field + 1]
    sx, sy, sv, sw = sx / m, sy / m, sv / m, sw / m
    xx, xy, yy, xv, xw, yv, yw = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(first, last):
        x, y, v, w = packed[p, 1] - sx, packed[p, 2] - sy, packed[p, field] - sv, packed[p, field + 1] - sw
        mx, my = packed[p, 0] * x, packed[p, 0] * y
        xx += mx * x
        xy += mx * y
        yy += my * y
        xv += mx * v
        xw += mx * w
        yv += my * v
        yw += my * w
    own = last - first > dim + 1
    if own:
        inertia[0, 0], inertia[0, 1], inertia[1, 0], inertia[1, 1] = xx, xy, xy, yy
        moment[0, 0], moment[0, 1], moment[1, 0], moment[1, 1] = xv, xw, yv, yw
        own = solve_slope(inertia, moment, dim, slope)
    if not own:
        for a in range(dim):
            for c in range(dim):
                slope[a, c] = pooled[a, c]
        if dim == 2 and xx + yy > 0.0:
            torque = xw - yv - pooled[0, 1] * xx - (pooled[1, 1] - pooled[0, 0]) * xy + pooled[1, 0] * yy
            slope[0, 1] += torque / (xx + yy)
            slope[1, 0] -= torque / (xx + yy)
    return sx, sy, sv, sw


@njit(nogil=True, cache=True, error_model="numpy")
def apply_nodes(
    block_from, block_to, home, about, order, start, first, species, packed, sources, norm,
    nodes, slopes, change, spin, rate, dt, exponential, vel, acc, time, heat,
):  # fmt: skip
    """The kick of the particles in each block: free motion, eq. (3), the rotation of `spin` where it has entries, and
    the decay of what is left beside the line.

    Writes stopping times of dust into `time` and adds the energy lost to that of a block's own node in `heat`, where
    they have entries; packed velocities are overwritten. `frame` is what these leave out of a velocity, Kepler's and
    half a kick of what gas and dust share: from one orbit to another the same momentum is not the same energy.
    """
    dim = vel.shape[1]
    flat = dim == 1
    inertia, moment, even = np.empty((2, 2)), np.empty((2, 2)), np.zeros((2, 2))
    slope, slope_source, bend = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((3, 2))
    table, turns = np.zeros((9, 3)), np.zeros((9, 6))
    base = start[block_from * species]
    frame = np.zeros((start[block_to * species] - base if len(heat) > 0 else 0, 2))
    for block in range(block_from, block_to):
        near = about[home[block]]
        if len(spin) > 0:
            for k in range(9):
                n = near[k]
                for f in range(6):
                    turns[k, f] = 0.0
                if n >= 0 and spin[n] != 0.0:
                    gas = nodes[n, 0]
                    x, y = gas[1] / gas[0] + k // 3 - 1, gas[2] / gas[0] + k % 3 - 1
                    vx, vy = (gas[3] + 0.5 * dt * gas[5]) / gas[0], (gas[4] + 0.5 * dt * gas[6]) / gas[0]
                    turns[k, 0], turns[k, 1], turns[k, 2] = spin[n], spin[n] * x, spin[n] * y
                    turns[k, 3], turns[k, 4], turns[k, 5] = spin[n] * vx, spin[n] * vy, spin[n] * (y * vx - x * vy)
        for s in range(species):
            lo, hi = start[block * species + s], start[block * species + s + 1]
            if hi == lo:
                continue
            for k in range(9):
                n = near[k]
                table[k, 0] = rate[n, first + s] if n >= 0 else 0.0
                for c in range(dim):
                    table[k, 1 + c] = change[n, first + s, c] if n >= 0 else 0.0
            met, lost = 0.0, 0.0
            for p in range(lo, hi):
                i = order[p]
                u0, u1, u2 = cloud(packed[p, 1], False)
                t0, t1, t2 = cloud(packed[p, 2], flat)
                scale = norm[p] if len(norm) > 0 else 1.0
                local = scale * blend(table, C0, u0, u1, u2, t0, t1, t2)
                d = scale * blend(table, C1, u0, u1, u2, t0, t1, t2)
                spin_x, spin_y = 0.0, 0.0
                if len(spin) > 0:
                    omega = blend(turns, C0, u0, u1, u2, t0, t1, t2)
                    spin_x = blend(turns, C2, u0, u1, u2, t0, t1, t2) - omega * packed[p, 2]
                    spin_y = omega * packed[p, 1] - blend(turns, C1, u0, u1, u2, t0, t1, t2)
                if len(heat) > 0:
                    for c in range(dim):
                        frame[p - base, c] = vel[i, c] - packed[p, 3 + c] + 0.5 * dt * (acc[i, c] - packed[p, 5 + c])
                    if len(spin) > 0:
                        # `node_heat` has the work of eq. (3) alone. A rotation does none on the mean velocity.
                        work = spin_x * (packed[p, 3] + 0.5 * dt * packed[p, 5])
                        work += spin_y * (packed[p, 4] + 0.5 * dt * packed[p, 6])
                        work += packed[p, 2] * blend(turns, C3, u0, u1, u2, t0, t1, t2)
                        work -= packed[p, 1] * blend(turns, C4, u0, u1, u2, t0, t1, t2)
                        work -= blend(turns, C5, u0, u1, u2, t0, t1, t2)
                        lost -= packed[p, 0] * work
                d += spin_x
                packed[p, 3] += d
                lost -= 0.5 * packed[p, 0] * d * d
                if len(heat) > 0:
                    lost -= packed[p, 0] * d * frame[p - base, 0]
                vel[i, 0] += dt * acc[i, 0] + d
                if not flat:
                    d = scale * blend(table, C2, u0, u1, u2, t0, t1, t2) + spin_y
                    packed[p, 4] += d
                    lost -= 0.5 * packed[p, 0] * d * d
                    if len(heat) > 0:
                        lost -= packed[p, 0] * d * frame[p - base, 1]
                    vel[i, 1] += dt * acc[i, 1] + d
                met += local / (hi - lo)
                if len(time) > 0:
                    time[i] = 1.0 / local if local > 0.0 else np.inf
            if met > 0.0:
                f, g = response(met, dt, exponential)
                curvature(near, nodes, slopes, dim, bend)
                for p in range(lo, hi):
                    bx, by = bent(bend, packed[p, 1], packed[p, 2])
                    packed[p, 3] -= bx
                    packed[p, 4] -= by
                sx, sy, sv, sw = own_line(lo, hi, packed, C3, slopes[home[block]], dim, inertia, moment, slope)
                tx, ty, tv, tw = 0.0, 0.0, 0.0, 0.0
                if sources:
                    tx, ty, tv, tw = own_line(lo, hi, packed, C5, even, dim, inertia, moment, slope_source)
                for p in range(lo, hi):
                    i = order[p]
                    x, y = packed[p, 1] - sx, packed[p, 2] - sy
                    rest = packed[p, 3] - sv - slope[0, 0] * x - slope[1, 0] * y
                    rest_y = packed[p, 4] - sw - slope[0, 1] * x - slope[1, 1] * y
                    more, more_y = f * rest, f * rest_y
                    if sources:
                        x, y = packed[p, 1] - tx, packed[p, 2] - ty
                        more += g * (packed[p, 5] - tv - slope_source[0, 0] * x - slope_source[1, 0] * y)
                        more_y += g * (packed[p, 6] - tw - slope_source[0, 1] * x - slope_source[1, 1] * y)
                    vel[i, 0] += more
                    if not flat:
                        vel[i, 1] += more_y
                    if len(heat) > 0:
                        # The changes have no mean: what is common to the cell does no work.
                        bx, by = bent(bend, packed[p, 1], packed[p, 2])
                        along = frame[p - base, 0] + 0.5 * (dt * packed[p, 5] + more)
                        lost -= packed[p, 0] * more * (packed[p, 3] - sv + bx + along)
                        if not flat:
                            along = frame[p - base, 1] + 0.5 * (dt * packed[p, 6] + more_y)
                            lost -= packed[p, 0] * more_y * (packed[p, 4] - sw + by + along)
            if len(heat) > 0:
                heat[home[block]] += lost


@njit(cache=True, error_model="numpy", forceinline=True)
def bent(bend, x, y):
    """The quadratic part of a velocity at (x, y) from its second derivatives."""
    xx, xy, yy = 0.5 * x * x, x * y, 0.5 * y * y
    return bend[0, 0] * xx + bend[1, 0] * xy + bend[2, 0] * yy, bend[0, 1] * xx + bend[1, 1] * xy + bend[2, 1] * yy


@njit(cache=True, error_model="numpy", forceinline=True)
def blend(table, c, u0, u1, u2, t0, t1, t2):
    """Sum of column c over the nine nodes with the products of the weights."""
    low = t0 * table[0, c] + t1 * table[1, c] + t2 * table[2, c]
    middle = t0 * table[3, c] + t1 * table[4, c] + t2 * table[5, c]
    high = t0 * table[6, c] + t1 * table[7, c] + t2 * table[8, c]
    return u0 * low + u1 * middle + u2 * high
