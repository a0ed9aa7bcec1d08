"""Implicit drag between nodes of a lattice: gathered, relaxed and scattered with one set of weights.

Nodes J are the centres of cells, w the weights of the triangular-shaped cloud (TSC; Hockney & Eastwood 1988, ch. 5)
in units of the cell. For each species s a node holds

    M_s = sum m w,   X_s = sum m w x / M_s,   V_s = sum m w y / M_s,   A_s = sum m w b / M_s              (1)

with y velocities (relative to Kepler's about a star) and b sources, the accelerations of this species alone. The slip
is that at the gas's centroid,

    V_s + G (X_g - X_s) - V_g,                                                                           (2)

G the velocity slope pooled within species over the nine cells about the node. The slip of the sources is that at the
node itself,

    A_s - B_s X_s - (A_g - B_g X_g),                                                                     (2b)

B_s the slope of a species' own sources there. Where t_stop << dt the drag undoes nearly all that the sources do in a
step, and with (2b) sources linear in space then leave no error. The slip relaxes exactly, sources included. This
changes the velocities by D_s, with sum_s M_s D_s = 0, and the velocity of a particle by

    sum_J w_J D_s,J,                                                                                     (3)

so that momentum is exact. In two dimensions the offset between the centroids changes the angular momentum by

    sum_s M_s X_s x D_s.                                                                                 (4)

A rotation of the gas at the node about its centroid, scattered with the same weights, cancels (4). The deviation of a
particle's velocity from the linear fit of its own species in its cell decays at the species' own rate.

The particles of a cell are packed in columns (`nodes_columns`). `nodes_gather` computes (1), `nodes_grains` (1) for
many classes of grains, `nodes_fit` G and B, and `nodes_relax` (2) and (3). `nodes_sharpen` restores what the clouds
smoothed away and computes the rotation that cancels (4). `nodes_scatter` changes the particles. In one dimension the
second components exist and are 0.
"""

from typing import NamedTuple

import numpy as np

from discsim.kernels.common.simd import LANES

# Fields of a particle that nodes sum, two vectors of LANES: 1, position (2) from the centre of its cell in sides, the
# density that the drag law takes, velocity (2) and source (2). In the columns of the particles MASS replaces ONE and,
# after the gather, the norm of the weights replaces RHO.
ONE, X, Y, RHO, VX, VY, BX, BY, FIELDS = range(9)
MASS, NORM = ONE, RHO
# A cell's own moments of these fields: with the weights m, m x and m y.
WHOLE, BY_X, BY_Y = range(3)
# Values that a node scatters to the particles of a species, one vector: change of velocity at the node (2), which
# includes that by the rotation; rate of rotation; rate of drag.
DX, DY, SPIN, RATE = range(LANES)
# Components of a slope: d/dx of both velocity components, then d/dy.
XX, XY, YX, YY = range(4)
LEAST_INERTIA = 0.01  # over mass times side^2: minimum for the rotation of gas and for slopes of sources


class Cells(NamedTuple):
    """Drag cells, one for each block, and their sums.

    `corner` (n, 2); `side` (n,); `home` (n,): the node at the centre. `slot` (n, species): row of each species of a
    cell in the sums; that of the gas is the block's index, that of absent dust -1. `given` (slots, 9, FIELDS):
    contributions to the nine nodes about the cell. `own` (slots, 3, FIELDS): own moments. `total` (n, 3, FIELDS):
    moments of all the dust, and `share` (grains,): mass over the sum of weights, both of grains taken one by one
    (`nodes_grains`), else without entries. `period` (2,): of space, inf where it is open.
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
    """Nodes in reach of cells, and their sums.

    `about` (n, 9): the nodes about each node; `near` (n, 9): the cells about it; both -1 where there is none.
    `centre` (n, 2): position. `sums` (n, species, FIELDS): eq. (1) times M, positions from the node. `square` (n,):
    sum m w x^2 of the gas, without entries if there is no rotation.
    """

    about: np.ndarray
    near: np.ndarray
    centre: np.ndarray
    sums: np.ndarray
    square: np.ndarray


class Slopes(NamedTuple):
    """Slopes at nodes, per side of a cell.

    `pooled` (n, 4): of velocities, pooled within species. `source` (n, species, 4): of each species' sources, and
    `known` (n, species): whether the slope of the sources exists.
    """

    pooled: np.ndarray
    source: np.ndarray
    known: np.ndarray


class Change(NamedTuple):
    """Changes by the drag at nodes.

    `slip` and `drive` (n, species, 2): velocity changes by the slip and by sources. `rate` (n, species): rate of the
    drag. `mass` (n, species): reduced mass of gas and species.
    """

    slip: np.ndarray
    drive: np.ndarray
    rate: np.ndarray
    mass: np.ndarray


class Sharp(NamedTuple):
    """Changes at nodes after sharpening, as particles take them.

    `value` (n, species, LANES): values that a node scatters to each species, positions from the node. `slope` (n, 4):
    of velocities. `heat` (n,): energy lost. `turn` (n, 2, LANES): the rotation, and the motion on which it does no
    work (`nodes_heat`). The last two have no entries if the heat is not used.
    """

    value: np.ndarray
    slope: np.ndarray
    heat: np.ndarray
    turn: np.ndarray
