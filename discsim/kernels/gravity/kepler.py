"""Kepler orbits about a star at the origin: the drift of gas and dust whose kicks do not contain the star's gravity.

Eqs. (1) to (3) of `exact/kepler.py`, with the root s of (1) by Newton's method from a third-order guess,

    dt = r0 s + eta G2 + zeta G3,      dt/ds = r = r0 + eta G1 + zeta G2,      zeta = M - beta r0             (1)

and G_n = s^n c_n(z), z = beta s^2, from their series. Where the iteration does not converge, as near the pericentre of
an eccentric orbit, the step is split into shorter ones, which compose exactly on an orbit.
"""

import math

import numpy as np

from discsim.jit.decorators import inline_jit, jit
from discsim.jit.index import index

ONE, TWO = index(1), index(2)
BATCH = 512  # particles that are moved together
ITERATIONS, MORE_ITERATIONS = 2, 5  # Newton iterations for all particles, and in each sub-step of those that need more
TOLERANCE = 1e-8  # relative size of the last Newton step; the error is its square
LARGEST_Z = 1.0  # largest |z| for the series
SUBSTEPS = 400  # largest number of sub-steps that are tried


@inline_jit
def stumpff(z):
    """Return Stumpff's functions c_2(z) and c_3(z), accurate to rounding for |z| <= LARGEST_Z."""
    c2, c3 = 1.0 / 6402373705728000.0, 1.0 / 121645100408832000.0  # 1 / 18!, 1 / 19!
    c2, c3 = 1.0 / 20922789888000.0 - z * c2, 1.0 / 355687428096000.0 - z * c3
    c2, c3 = 1.0 / 87178291200.0 - z * c2, 1.0 / 1307674368000.0 - z * c3
    c2, c3 = 1.0 / 479001600.0 - z * c2, 1.0 / 6227020800.0 - z * c3
    c2, c3 = 1.0 / 3628800.0 - z * c2, 1.0 / 39916800.0 - z * c3
    c2, c3 = 1.0 / 40320.0 - z * c2, 1.0 / 362880.0 - z * c3
    c2, c3 = 1.0 / 720.0 - z * c2, 1.0 / 5040.0 - z * c3
    c2, c3 = 1.0 / 24.0 - z * c2, 1.0 / 120.0 - z * c3
    return 0.5 - z * c2, 1.0 / 6.0 - z * c3


@inline_jit
def g_functions(beta, s):
    """Return G_1, G_2 and G_3 at s."""
    c2, c3 = stumpff(beta * s * s)
    g3 = s * s * s * c3
    return s - beta * g3, s * s * c2, g3


@inline_jit
def kepler_step(x, y, vx, vy, mass, dt, rounds):
    """Return position and velocity after dt, and whether Newton's method has converged within `rounds` iterations.

    mass: G M of the star.
    """
    r0 = math.sqrt(x * x + y * y)
    inverse = 1.0 / r0
    eta, beta = x * vx + y * vy, 2.0 * mass * inverse - (vx * vx + vy * vy)
    zeta = mass - beta * r0
    a, first, second = dt * inverse, 0.5 * eta * inverse, zeta * inverse * (1.0 / 6.0)
    s = a * (1.0 - a * (first - a * (2.0 * first * first - second)))
    change = s
    for _ in range(rounds):
        g1, g2, g3 = g_functions(beta, s)
        change = (r0 * s + eta * g2 + zeta * g3 - dt) / (r0 + eta * g1 + zeta * g2)
        s -= change
    g1, g2, g3 = g_functions(beta, s)
    r = r0 + eta * g1 + zeta * g2
    turned, pulled = -mass * g2, -mass * g1 * inverse / r
    f, g, df = turned * inverse, dt - mass * g3, pulled
    dg = turned / r
    found = (abs(change) <= TOLERANCE * abs(s)) & (abs(beta) * s * s <= LARGEST_Z)
    return x + (f * x + g * vx), y + (f * y + g * vy), vx + (df * x + dg * vx), vy + (df * y + dg * vy), found


@jit
def move_in_substeps(x, y, vx, vy, mass, dt):
    """Return position and velocity after dt, computed in sub-steps; whole orbits are subtracted from dt before.

    A particle that falls into the star continues in a straight line.
    """
    beta = 2.0 * mass / math.sqrt(x * x + y * y) - (vx * vx + vy * vy)
    if 0.0 < beta < np.inf:
        turn = 2.0 * math.pi * mass / (beta * math.sqrt(beta))
        dt -= turn * math.floor(dt / turn + 0.5)
    left, part = dt, 0.5 * dt
    for _ in range(SUBSTEPS):
        part = part if abs(part) < abs(left) else left
        nx, ny, nvx, nvy, found = kepler_step(x, y, vx, vy, mass, part, MORE_ITERATIONS)
        if not found:
            part *= 0.5
            continue
        x, y, vx, vy = nx, ny, nvx, nvy
        if part == left:
            return x, y, vx, vy
        left -= part
        part *= 2.0
    return x + left * vx, y + left * vy, vx, vy


@jit
def drift(first, last, pos, vel, masses, species, dt):
    """Change `pos` and `vel` (n, 2) of particles by their motion over dt, on Kepler orbits about a mass at the origin.

    masses (populations,): G M that acts on each population. species (n,): population of each particle; if it is empty,
    the first mass acts on all.
    """
    new, found = np.empty((4, BATCH)), np.empty(BATCH, np.bool_)
    places, velocities = pos.reshape(-1), vel.reshape(-1)  # flat arrays and unsigned indices: vectorised
    one_mass = len(species) == 0
    for block in range(first, last, BATCH):
        number, start = index(min(BATCH, last - block)), index(block)
        for k in range(number):
            i = TWO * (start + k)
            mass = masses[0] if one_mass else masses[species[start + k]]
            new[0, k], new[1, k], new[2, k], new[3, k], found[k] = kepler_step(
                places[i], places[i + ONE], velocities[i], velocities[i + ONE], mass, dt, ITERATIONS
            )
        for k in range(number):
            i = TWO * (start + k)
            if found[k]:
                places[i], places[i + ONE] = new[0, k], new[1, k]
                velocities[i], velocities[i + ONE] = new[2, k], new[3, k]
            else:
                mass = masses[0] if one_mass else masses[species[start + k]]
                moved = move_in_substeps(places[i], places[i + ONE], velocities[i], velocities[i + ONE], mass, dt)
                places[i], places[i + ONE], velocities[i], velocities[i + ONE] = moved
