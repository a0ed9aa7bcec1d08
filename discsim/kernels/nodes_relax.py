"""What a node changes: the slip relaxed, eqs. (2) and (2b) of `kernels/nodes.py`, sharpened for the width of its
clouds, and the rotation of eq. (4)."""

import numpy as np
from numba import njit

from discsim.formulas.laws import EPSTEIN
from discsim.kernels.frame import kepler
from discsim.kernels.laws import stopping_time
from discsim.kernels.nodes import LEAST_INERTIA, SQUARE
from discsim.kernels.nodes_fit import slope_near
from discsim.kernels.nonlinear import relax_by_speed
from discsim.kernels.relax import relax_means


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
