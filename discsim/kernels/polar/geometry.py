"""Geometry of polar cells, and arrays of their fields.

A field is an array (rings + 4, angles): two rows of ghost cells lie beyond each edge. With several processes the rings
are those of one process, its own, and next rings of others (`ranks/polar.py`). Arrays of particles have own rings only.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_subroutine

GHOSTS = 2  # ghost rings beyond each edge
DENSITY, RADIAL, SPIN, PRESSURE, ENERGY = range(5)  # rows of the fields that move; SPIN: angular momentum per mass
MAX_RATIO = 4.0  # largest ratio of a positive quantity in a ghost ring to that in the next ring


class Geometry(NamedTuple):
    """Polar cells, in rings from the inside to the outside.

    sides (rings + 1,): radii between rings. radius (rings,): radius of the centroid of the cells. volume (rings,):
    difference of r^2 / 2, the area of a cell per angle. angle: width of a cell in azimuth. weights (rings + 4, 12):
    `parabola.side_coefficients`. cos, sin (angles,): of the azimuths of the centres. closed: whether no gas passes the
    edges. first: first own ring.
    """

    sides: np.ndarray
    radius: np.ndarray
    volume: np.ndarray
    angle: float
    weights: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    closed: bool
    first: int


@inline_jit
def continued(edge, inside):
    """Return the value of a positive quantity beyond an edge, from its last two values: a geometric series."""
    ratio = edge / inside if inside > 0.0 else 1.0
    return edge * min(max(ratio, 1.0 / MAX_RATIO), MAX_RATIO)


@jit_subroutine
def fill_positive(field):
    """Fill the ghost rings of a positive field in place, as geometric series of the outermost rings."""
    last = len(field) - 1
    for j in range(field.shape[1]):
        field[1, j] = continued(field[2, j], field[3, j])
        field[0, j] = continued(field[1, j], field[2, j])
        field[last - 1, j] = continued(field[last - 2, j], field[last - 3, j])
        field[last, j] = continued(field[last - 1, j], field[last - 2, j])


@jit_subroutine
def fill_linear(field):
    """Fill the ghost rings of a field in place by linear extrapolation."""
    last = len(field) - 1
    for j in range(field.shape[1]):
        field[1, j] = 2.0 * field[2, j] - field[3, j]
        field[0, j] = 2.0 * field[1, j] - field[2, j]
        field[last - 1, j] = 2.0 * field[last - 2, j] - field[last - 3, j]
        field[last, j] = 2.0 * field[last - 1, j] - field[last - 2, j]


@jit_subroutine
def fill_radial(field, closed):
    """Fill the ghost rings of a radial velocity in place: reflected at closed edges, uniform beyond open ones."""
    last = len(field) - 1
    for j in range(field.shape[1]):
        if closed:
            field[1, j], field[0, j] = -field[2, j], -field[3, j]
            field[last - 1, j], field[last, j] = -field[last - 2, j], -field[last - 3, j]
        else:
            field[1, j] = field[0, j] = field[2, j]
            field[last - 1, j] = field[last, j] = field[last - 2, j]


@jit
def fill_ghosts(fields, closed):
    """Fill the ghost rings of all fields (k, rings + 4, angles) that move."""
    fill_positive(fields[DENSITY])
    fill_radial(fields[RADIAL], closed)
    fill_linear(fields[SPIN])
    fill_positive(fields[PRESSURE])
    if len(fields) > ENERGY:
        fill_positive(fields[ENERGY])


@jit
def fill_force_ghosts(pressure, radial, closed):
    """Fill the ghost rings of the pressure and the radial velocity (rings + 4, angles)."""
    fill_positive(pressure)
    fill_radial(radial, closed)


@jit_subroutine
def pad_row(row, shift, padded):
    """Copy a ring `row` (n,) to `padded` (n + 6,), with three cells of the other end of the ring beyond each end.

    shift: value that is subtracted.
    """
    n = len(row)
    for j in range(n):
        padded[j + 3] = row[j] - shift
    for j in range(3):
        padded[j] = padded[n + j]
        padded[n + 3 + j] = padded[3 + j]
