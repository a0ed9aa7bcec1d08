"""Nodes of drag cells: where the blocks of each level lie on its own lattice, and what lies about them.

Blocks (`kernels/blocks.py`) of one level are cells of one regular lattice; a node is the centre of a cell. A lattice
has a border of nodes all round, and joins itself where space is periodic and whole cells fill the period.
"""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def place_blocks(level, leaf, nx, ny, periodic, levels):
    """Nodes of the blocks: (node of a block (blocks,), block of a node or -1, strides, whether levels wrap).

    Each level has a lattice of its own with a border of nodes all round; `first` is where it starts. `leaf`
    (blocks, 2) is a block's first leaf.
    """
    width, height = np.empty(levels, np.int64), np.empty(levels, np.int64)
    wrap = np.zeros((levels, 2), np.bool_)
    first = np.zeros(levels + 1, np.int64)
    for n in range(levels):
        width[n], height[n] = (nx - 1 >> n) + 1, (ny - 1 >> n) + 1
        # A level whose cells do not fill the period is open where it joins itself.
        wrap[n, 0], wrap[n, 1] = periodic and width[n] << n == nx, periodic and height[n] << n == ny
        first[n + 1] = first[n] + (width[n] + 2) * (height[n] + 2)
    at = np.full(first[levels], -1, np.int64)
    node = np.empty(len(level), np.int64)
    for block in range(len(level)):
        n = level[block]
        node[block] = first[n] + ((leaf[block, 0] >> n) + 1) * (height[n] + 2) + (leaf[block, 1] >> n) + 1
        at[node[block]] = block
    return node, at, first, width, height, wrap


@njit(inline="always")
def step_along(index, by, count, wraps):
    """Index (with the border's 1 added) of a neighbour along one axis."""
    index += by
    if wraps:
        if index < 1:
            index += count
        elif index > count:
            index -= count
    return index


@njit(nogil=True, cache=True, error_model="numpy")
def neighbours(node, level, first, width, height, wrap, flat, out):
    """Nodes (9,) about `node`, itself in the middle, -1 beyond the border; `flat` in one dimension."""
    rows = height[level] + 2
    ix, iy = (node - first[level]) // rows, (node - first[level]) % rows
    for i in range(-1, 2):
        for j in range(-1, 2):
            jx, jy = step_along(ix, i, width[level], wrap[level, 0]), step_along(iy, j, height[level], wrap[level, 1])
            inside = 0 <= jx < width[level] + 2 and 0 <= jy < rows and not (flat and j != 0)
            out[3 * (i + 1) + j + 1] = first[level] + jx * rows + jy if inside else -1


@njit(nogil=True, cache=True, error_model="numpy")
def list_nodes(node, level, first, width, height, wrap, flat, at):
    """The nodes in reach of the blocks, numbered: of each block its own, and of each node its number with borders,
    the nodes about it (n, 9) and the blocks about it (n, 9), -1 where there is none.
    """
    index = np.full(len(at), -1, np.int64)
    dense, levels = np.empty(len(at), np.int64), np.empty(len(at), np.int64)
    total = 0
    about = np.empty(9, np.int64)
    for block in range(len(node)):
        neighbours(node[block], level[block], first, width, height, wrap, flat, about)
        for k in range(9):
            if about[k] >= 0 and index[about[k]] < 0:
                index[about[k]] = total
                dense[total], levels[total] = about[k], level[block]
                total += 1
    nodes, blocks = np.empty((total, 9), np.int64), np.empty((total, 9), np.int64)
    for n in range(total):
        neighbours(dense[n], levels[n], first, width, height, wrap, flat, about)
        for k in range(9):
            nodes[n, k] = index[about[k]] if about[k] >= 0 else -1
            blocks[n, k] = at[about[k]] if about[k] >= 0 else -1
    home = np.empty(len(node), np.int64)
    for block in range(len(node)):
        home[block] = index[node[block]]
    return home, dense[:total], nodes, blocks


@njit(nogil=True, cache=True, error_model="numpy")
def node_centres(dense, first, height, origin, leaf):
    """Places (n, 2) of the nodes, whose numbers with borders are `dense`."""
    out = np.empty((len(dense), 2))
    level = 0
    for n in range(len(dense)):
        while dense[n] < first[level]:
            level -= 1
        while dense[n] >= first[level + 1]:
            level += 1
        rows, side = height[level] + 2, leaf * 2.0**level
        ix, iy = (dense[n] - first[level]) // rows, (dense[n] - first[level]) % rows
        out[n, 0], out[n, 1] = origin[0] + (ix - 0.5) * side, origin[1] + (iy - 0.5) * side
    return out
