"""Implicit drag between nodes of a lattice: gathered, relaxed and scattered with one set of weights.

Nodes J are the centres of cells, w the weights of the triangular-shaped cloud (Hockney & Eastwood 1988, ch. 5) in
units of the cell. Of each species s a node holds

    M_s = sum m w,   X_s = sum m w x / M_s,   V_s = sum m w y / M_s,   A_s = sum m w b / M_s              (1)

with y velocities (relative to Kepler's about a star) and b sources. The slip is that at the gas's centroid,

    V_s + G (X_g - X_s) - V_g,                                                                           (2)

G the slope pooled within species over the nine cells about the node; that of the sources is at the node itself,

    A_s - B_s X_s - (A_g - B_g X_g),                                                                     (2b)

B_s the slope of a species' own sources there: where t_stop << dt the drag takes back nearly all that they do in a
step, and sources linear in space leave no error then. The slip relaxes exactly with the sources inside, which changes
the velocities by D_s, sum_s M_s D_s = 0, and a particle's by

    sum_J w_J D_s,J,                                                                                     (3)

so that momentum is exact. In two dimensions what the offset of the two centroids makes of angular momentum,

    sum_s M_s X_s x D_s,                                                                                 (4)

is taken from the gas about the node as a rotation about its centroid, scattered with the same weights. What is left
of a particle beside the line of its own species in its cell decays at the species' own rate.

The particles of a cell are columns, `nodes_columns`. Five parts: `nodes_gather` makes (1), of many classes of grains
`nodes_grains`, `nodes_fit` G and B, `nodes_relax` (2) and (3), `nodes_sharpen` gives back what the clouds smoothed away
and makes (4), `nodes_scatter` changes the particles.
In one dimension the second components are there, and are 0.
"""

from typing import NamedTuple

import numpy as np

from discsim.kernels.rows import LANES

# A particle as the nodes see it: ONE, its place (2) from the middle of its cell in sides, what the law of the drag
# needs of the gas, velocity (2) and source (2), two rows of LANES. Of the particle itself its mass is kept in place of
# ONE, and once the nodes have it, the norm of its weights in place of RHO.
ONE, X, Y, RHO, VX, VY, BX, BY, FIELDS = range(9)
MASS, NORM = ONE, RHO
# A cell's own moments of these: weighed with m, m x and m y.
WHOLE, BY_X, BY_Y = range(3)
# What a node brings to the particles of a species, a row: change of velocity (2), where there is a rotation with that
# of the centre that it is about; rotation; rate.
DX, DY, SPIN, RATE = range(LANES)
# A slope: d/dx of both components, then d/dy.
XX, XY, YX, YY = range(4)
LEAST_INERTIA = 0.01  # over mass times side^2: the least for gas about a node to be turned, and for a slope of sources


class Cells(NamedTuple):
    """The cell of each block: its `corner` (n, 2), `side` (n,) and the node at its centre, `home` (n,). Each species
    in it has a slot, `slot` (n, species): the gas that of the block's number, absent dust -1. What it gives to the
    nodes about is `given` (slots, 9, FIELDS), its own moments `own` (slots, 3, FIELDS). `period` (2,): of space, inf
    where it is open.
    """

    corner: np.ndarray
    side: np.ndarray
    home: np.ndarray
    slot: np.ndarray
    given: np.ndarray
    own: np.ndarray
    total: np.ndarray
    share: np.ndarray
    period: np.ndarray


class Nodes(NamedTuple):
    """The nodes in reach of cells: the nodes and the cells about each, `about` and `near` (n, 9), -1 where there is
    none, and its place `centre` (n, 2). `sums` (n, species, FIELDS): eq. (1) times M, places from the node; `square`
    (n,): sum m w x^2 of the gas, without entries if nothing is to turn.
    """

    about: np.ndarray
    near: np.ndarray
    centre: np.ndarray
    sums: np.ndarray
    square: np.ndarray


class Slopes(NamedTuple):
    """Slopes about nodes, in sides: of the velocities pooled within species (n, 4), of each species' sources
    (n, species, 4), and whether it has one there (n, species).
    """

    pooled: np.ndarray
    source: np.ndarray
    known: np.ndarray


class Change(NamedTuple):
    """What the drag changes at nodes: velocities by the slip and by sources (n, species, 2), at which `rate`
    (n, species), and the reduced `mass` (n, species) that it is done with.
    """

    slip: np.ndarray
    drive: np.ndarray
    rate: np.ndarray
    mass: np.ndarray


class Sharp(NamedTuple):
    """The same as particles take it: `value` (n, species, LANES), what a node brings to each species, places from it,
    and `slope` (n, 4) of the velocities. `heat` (n,), and `turn` (n, 2, LANES), what the rotation does and what it does
    no work on (`nodes_heat`): without entries if heat goes nowhere.
    """

    value: np.ndarray
    slope: np.ndarray
    heat: np.ndarray
    turn: np.ndarray
