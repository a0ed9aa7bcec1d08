"""Implicit drag at the nodes of a lattice: particles are gathered to nodes and scattered back with the same weights.

Nodes J are the centres of cells. w is the weight of a particle on a node: triangular-shaped cloud (TSC; Hockney &
Eastwood 1988, ch. 5), in units of the cell. For each species s (g: gas) a node has

    M_s = sum m w,   X_s = sum m w x / M_s,   V_s = sum m w y / M_s,   A_s = sum m w b / M_s              (1)

with the velocity y (about a star, relative to Kepler's) and the source b of each particle. A source is an acceleration
that acts on one species only. The slip is computed at the centroid of the gas,

    V_s + G (X_g - X_s) - V_g,                                                                           (2)

with the velocity slope G in the nine cells about the node, fitted to all species, each about its own mean. The
difference of the sources is computed at the node itself,

    A_s - B_s X_s - (A_g - B_g X_g),                                                                     (2b)

with the slope B_s of the sources of species s there. Where t_stop << dt, drag undoes nearly all the effect of the
sources in a step; with (2b), sources that are linear in space then leave no error. The slip relaxes exactly, with the
sources included. The velocities at the node thereby change by D_s, with sum_s M_s D_s = 0, and the velocity of a
particle by

    sum_J w_J D_s,J,                                                                                     (3)

so that momentum is exact. In two dimensions the offset between the centroids changes the angular momentum by

    sum_s M_s X_s x D_s.                                                                                 (4)

Smoothing by gather and scatter, of variance side^2 / 2 together, moves momentum from node to node where the ratio of
dust to gas varies, because gas and dust near a node then lose and gain different amounts. From a node to a neighbour
at distance side it moves, to second order,

    sum_s (M_s' - M_s) (D_s + D_s') / 8,                                                                  (5)

with the values at the neighbour marked by '. It is returned to the gas. A rotation of the gas at the node about its
centroid, scattered with the same weights, compensates (4) and half of the torque of (5). The residual velocity of a
particle about the linear fit of its own species in its cell decays at the drag rate of this species.

The modules of this folder: `columns.py` packs the particles of a cell in columns. `gather.py` computes (1), or
`grains.py` for many classes of grains. `fit.py` computes G and B, and `relax.py` (2) and D_s. `antidiffusion.py`
corrects D_s for the smoothing by the weights, and computes the rotation for (4). `scatter.py` changes the particles. In
one dimension the second components of vectors exist and are 0.
"""

from typing import NamedTuple

import numpy as np

from discsim.kernels.common.simd import LANES

# Fields of a particle that nodes sum, two vectors of LANES: the number 1; position (2) from the centre of its cell, in
# sides of the cell; density for the drag law; velocity (2); source (2). In the columns of particles, the mass replaces
# the number 1 and, after the gather, the norm of the weights replaces the density.
ONE, X, Y, RHO, VX, VY, BX, BY, FIELDS = range(9)
MASS, NORM = ONE, RHO
# The moments of a cell are sums of these fields over its particles, with the weights m, m x and m y.
WHOLE, BY_X, BY_Y = range(3)
# Values that a node scatters to the particles of a species, one vector: velocity change at the node (2), which includes
# the change by the rotation; angular velocity of the rotation; drag rate.
DX, DY, SPIN, RATE = range(LANES)
# Components of a slope: d/dx of both velocity components, then d/dy.
XX, XY, YX, YY = range(4)
LEAST_INERTIA = 0.01  # smallest inertia over mass times side^2, for the rotation of gas and for slopes of sources


class CellSums(NamedTuple):
    """Drag cells, one for each block, with sums over their particles.

    corner (n, 2), side (n,): lower corner and side of each cell. centre_node (n,): index of the node at the centre
    of the cell. species_row (n, species): row of each species of a cell in the tables of sums. The row of the gas is
    the index of the cell; the row of absent dust is -1. contributions (rows, 9, FIELDS): weighted sums of the
    particles to the nine nodes about the cell. moments (rows, 3, FIELDS): moments of the particles. dust_moments (n,
    3, FIELDS): moments of all dust in the cell. scaled_mass (grains,): mass of each grain, divided by the sum of its
    weights on nodes with gas. `dust_moments` and `scaled_mass` are empty unless nodes sum single grains
    (`grains.py`). period (2,): period of space along x and y, inf where space is open.
    """

    corner: np.ndarray
    side: np.ndarray
    centre_node: np.ndarray
    species_row: np.ndarray
    contributions: np.ndarray
    moments: np.ndarray
    dust_moments: np.ndarray
    scaled_mass: np.ndarray
    period: np.ndarray


class NodeSums(NamedTuple):
    """Nodes that the particles of cells contribute to, with their sums.

    stencil (n, 9): indices of the nine nodes about each node, with the node itself in the middle. node_cells (n, 9):
    indices of the nine cells about each node. An index is -1 where no node or cell exists. centre (n, 2): position
    of each node. sums (n, species, FIELDS): the sums of eq. (1) before the division by M_s; positions are relative
    to the node. square (n,): sum m w x^2 over the gas; empty if no rotation is computed.
    """

    stencil: np.ndarray
    node_cells: np.ndarray
    centre: np.ndarray
    sums: np.ndarray
    square: np.ndarray


class Slopes(NamedTuple):
    """Slopes at nodes, per side of a cell.

    pooled (n, 4): slopes of the velocity, fitted to all species together. source (n, species, 4): slopes of the sources
    of each species. known (n, species): whether the slope of the sources could be fitted.
    """

    pooled: np.ndarray
    source: np.ndarray
    known: np.ndarray


class DragChanges(NamedTuple):
    """Changes by the drag at nodes, before the correction for smoothing.

    slip, drive (n, species, 2): velocity changes due to the slip, and due to sources. rate (n, species): drag rate.
    mass (n, species): reduced mass of the gas and a dust species.
    """

    slip: np.ndarray
    drive: np.ndarray
    rate: np.ndarray
    mass: np.ndarray


class NodeImpulses(NamedTuple):
    """Changes at nodes that are scattered to particles, after the correction for smoothing.

    value (n, species, LANES): values DX to RATE of each species. slope (n, 4): slopes of the velocity. heat (n,):
    energy lost. rotation (n, 2, LANES): rotation of the gas at the node, and the motion on which it does no work
    (`heat.py`). heat and rotation are empty without heating; rotation is also empty if no rotation is computed.
    """

    value: np.ndarray
    slope: np.ndarray
    heat: np.ndarray
    rotation: np.ndarray
