"""Fluxes of gas and pressureless dust through the faces of a fixed 1D grid, from parabolas in the cells.

Colella & Woodward 1984 (CW84): with limited slopes d_i (1.7-1.8) the value at a face is

    a_(i+1/2) = (a_i + a_(i+1)) / 2 - (d_(i+1) - d_i) / 6                                              (1.6)

on both sides. In shocks of the gas the value is moved towards the mean of the cell (4.1, appendix A.2). The parabola is
then made monotone (1.10). The flux is HLLC's for gas with an energy and HLL's for barotropic gas (Toro 2009, ch. 10),
both with Einfeldt's wave speeds. The flux of dust is the sum of the fluxes from both sides of a face (Huang & Bai 2022,
arXiv:2206.01023):

    F = r_L max(u_L, 0) (1, u_L) + r_R min(u_R, 0) (1, u_R)                                            (2)

Rows of a state: gas density, velocity, pressure; dust density, velocity. Rows of conserved quantities: gas mass,
momentum, energy; dust mass, momentum, each per length.
"""

import math

import numpy as np

from discsim.jit.decorators import jit, jit_subroutine

GHOSTS = 4  # number of ghost cells beyond each end, on which the fluxes through the outer faces depend
DENSITY, VELOCITY, PRESSURE, DUST_DENSITY, DUST_VELOCITY = range(5)
MASS, MOMENTUM, ENERGY, DUST_MASS, DUST_MOMENTUM = range(5)

MOST = 0.75  # largest fraction of a cell's dust that may leave in a step by the fluxes of its parabola
STEEP, SHOCKED, SLOPE, LEAST_JUMP = 0.75, 10.0, 2.0, 0.33  # omega_1 and omega_2 of A.2, factor in (1.8), epsilon of A.2


@jit_subroutine
def limited_slope(left, centre, right):
    """Return the limited slope of the cell with the mean `centre` between cells `left` and `right`, (1.7) and (1.8)."""
    down, up = centre - left, right - centre
    if down * up <= 0.0:
        return 0.0
    middle = 0.5 * (down + up)
    return math.copysign(min(abs(middle), SLOPE * abs(down), SLOPE * abs(up)), middle)


@jit_subroutine
def limited_edges(left, centre, right):
    """Return the values at the two ends of a cell's parabola, limited so that it has no extremum inside (1.10).

    left, right: values at the ends before the limit. centre: mean of the cell.
    """
    if (right - centre) * (centre - left) <= 0.0:
        return centre, centre
    jump, bulge = right - left, 6.0 * (centre - 0.5 * (left + right))
    if jump * bulge > jump * jump:
        return 3.0 * centre - 2.0 * right, right
    if -jump * jump > jump * bulge:
        return left, 3.0 * centre - 2.0 * left
    return left, right


@jit_subroutine
def parabolas(mean, flatness, left, right):
    """Write the values at the ends of the cells' parabolas to `left` and `right` (n,) (1.6, 4.1, 1.10, A.2).

    The first two and the last two cells are left out. mean (n,): means of the cells. flatness (n,): result of
    `flattening`.
    """
    n = len(mean)
    slope = np.zeros(n)
    for i in range(1, n - 1):
        slope[i] = limited_slope(mean[i - 1], mean[i], mean[i + 1])
    for i in range(2, n - 2):
        low = 0.5 * (mean[i - 1] + mean[i]) - (slope[i] - slope[i - 1]) / 6.0
        high = 0.5 * (mean[i] + mean[i + 1]) - (slope[i + 1] - slope[i]) / 6.0
        low += flatness[i] * (mean[i] - low)
        high += flatness[i] * (mean[i] - high)
        left[i], right[i] = limited_edges(low, mean[i], high)


@jit_subroutine
def flattening(velocity, pressure):
    """Return the weight (n,) of the mean in each cell's parabola: 1 in a shock one or two cells wide (A.2), else 0."""
    n = len(pressure)
    own, out = np.zeros(n), np.zeros(n)
    for i in range(2, n - 2):
        jump, wide = pressure[i + 1] - pressure[i - 1], pressure[i + 2] - pressure[i - 2]
        least = min(pressure[i + 1], pressure[i - 1])
        if abs(jump) > LEAST_JUMP * least and velocity[i - 1] > velocity[i + 1]:
            share = jump / wide if wide != 0.0 else 1.0
            own[i] = min(1.0, max(0.0, SHOCKED * (share - STEEP)))
    for i in range(1, n - 1):
        ahead = i - 1 if pressure[i + 1] > pressure[i - 1] else i + 1
        out[i] = max(own[i], own[ahead])
    return out


@jit_subroutine
def gas_flux(left, right, gamma, flux):
    """Write the flux of mass, momentum and energy between the states `left` and `right` of the gas to `flux` (3,).

    The flux is HLLC's, or with gamma = 0 HLL's flux of mass and momentum. The gas is then isothermal, and P / rho in
    the states is c_s^2.
    """
    heat = gamma if gamma > 0.0 else 1.0
    rl, vl, pl = left[DENSITY], left[VELOCITY], left[PRESSURE]
    rr, vr, pr = right[DENSITY], right[VELOCITY], right[PRESSURE]
    wl, wr = math.sqrt(rl), math.sqrt(rr)
    v = (wl * vl + wr * vr) / (wl + wr)
    squared = heat * (wl * pl / rl + wr * pr / rr) / (wl + wr)
    squared += 0.5 * wl * wr / (wl + wr) ** 2 * (vr - vl) ** 2
    c = math.sqrt(squared)
    low, high = min(vl - math.sqrt(heat * pl / rl), v - c), max(vr + math.sqrt(heat * pr / rr), v + c)
    el = pl / (gamma - 1.0) + 0.5 * rl * vl * vl if gamma > 0.0 else 0.0
    er = pr / (gamma - 1.0) + 0.5 * rr * vr * vr if gamma > 0.0 else 0.0
    if low >= 0.0:
        flux[MASS], flux[MOMENTUM], flux[ENERGY] = rl * vl, rl * vl * vl + pl, (el + pl) * vl
    elif high <= 0.0:
        flux[MASS], flux[MOMENTUM], flux[ENERGY] = rr * vr, rr * vr * vr + pr, (er + pr) * vr
    elif gamma > 0.0:
        ml, mr = rl * (low - vl), rr * (high - vr)
        star = (pr - pl + ml * vl - mr * vr) / (ml - mr)
        r, vel, p, e, m, speed = (rl, vl, pl, el, ml, low) if star >= 0.0 else (rr, vr, pr, er, mr, high)
        density = m / (speed - star)
        energy = density * (e / r + (star - vel) * (star + p / m))
        flux[MASS] = r * vel + speed * (density - r)
        flux[MOMENTUM] = r * vel * vel + p + speed * (density * star - r * vel)
        flux[ENERGY] = (e + p) * vel + speed * (energy - e)
    else:
        width = high - low
        flux[MASS] = (high * rl * vl - low * rr * vr + high * low * (rr - rl)) / width
        push = high * (rl * vl * vl + pl) - low * (rr * vr * vr + pr)
        flux[MOMENTUM] = (push + high * low * (rr * vr - rl * vl)) / width
        flux[ENERGY] = 0.0


@jit
def through_faces(state, gamma):
    """Return the fluxes through the n + 1 faces of n cells: one of the gas (3, n + 1), and two of the dust (2, n + 1).

    The two fluxes of dust are the flux to the right, and the flux to the left, which is negative. state (5, n + 2
    GHOSTS): state of the cells and of ghost cells at both ends. gamma: adiabatic index, 0 for isothermal gas.
    """
    width = state.shape[1]
    faces = width - 2 * GHOSTS + 1
    flatness = flattening(state[VELOCITY], state[PRESSURE])
    left, right = np.zeros_like(state), np.zeros_like(state)
    for row in range(len(state)):
        parabolas(state[row], flatness, left[row], right[row])
    gas, rightward, leftward = np.zeros((3, faces)), np.zeros((2, faces)), np.zeros((2, faces))
    for k in range(faces):
        west, east = k + GHOSTS - 1, k + GHOSTS
        gas_flux(right[:, west], left[:, east], gamma, gas[:, k])
        from_west, from_east = right[DUST_VELOCITY, west], left[DUST_VELOCITY, east]
        rightward[0, k] = right[DUST_DENSITY, west] * max(from_west, 0.0)  # eq. (2)
        rightward[1, k] = rightward[0, k] * from_west
        leftward[0, k] = left[DUST_DENSITY, east] * min(from_east, 0.0)
        leftward[1, k] = leftward[0, k] * from_east
    return gas, rightward, leftward


@jit
def keep_positive(density, momentum, rightward, leftward, ratio, periodic):
    """Limit the fluxes of dust out of each cell, in place, to the dust that the cell contains.

    Where the fluxes of the parabolas would remove more than MOST of a cell's dust, these fluxes are replaced by the
    fluxes of a uniform cell with the cell's velocity. density, momentum (n,): of the dust at the start of the step.
    rightward, leftward (2, n + 1): fluxes to the right and to the left. ratio: dt / dx.
    """
    n, fastest = len(density), (1.0 - 1e-12) / ratio  # slightly less than all, with a margin for rounding
    for i in range(n):
        if ratio * (rightward[0, i + 1] - leftward[0, i]) <= MOST * density[i]:
            continue
        u = momentum[i] / density[i] if density[i] > 0.0 else 0.0
        u = min(max(u, -fastest), fastest)
        rightward[0, i + 1], rightward[1, i + 1] = density[i] * max(u, 0.0), density[i] * max(u, 0.0) * u
        leftward[0, i], leftward[1, i] = density[i] * min(u, 0.0), density[i] * min(u, 0.0) * u
    if periodic:
        for k in range(2):
            rightward[k, 0], leftward[k, n] = rightward[k, n], leftward[k, 0]
