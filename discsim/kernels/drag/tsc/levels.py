"""Nodes of drag cells: the lattice of nodes of each level of blocks, and the neighbours of each node.

Blocks (`kernels/drag/blocks.py`) of one level are cells of a regular lattice. A node is the centre of a cell. A
lattice has a border of one node on all sides. The lattice is periodic where space is periodic and whole cells fill
the period.
"""

from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import inline_jit, jit, jit_no_alloc
from discsim.jit.index import index


class Levels(NamedTuple):
    """Lattice of nodes of each level of blocks, with a border of one node on all sides.

    width, height (levels,): number of cells along x and y. wrap (levels, 2): whether the lattice is periodic along x
    and y. first (levels + 1,): index of the first node of each level.
    """

    width: np.ndarray
    height: np.ndarray
    wrap: np.ndarray
    first: np.ndarray


def lattice_levels(nx: int, ny: int, joined: np.ndarray, levels: int) -> Levels:
    """Return the node lattices of all levels above a lattice of nx by ny leaves.

    joined (2,): whether the leaves are periodic along x and y.
    """
    sides = 2 ** np.arange(levels)
    width, height = -(-nx // sides), -(-ny // sides)
    # A level whose cells do not fill the period is not periodic.
    wrap = np.column_stack([width * sides == nx, height * sides == ny]) & joined
    return Levels(width, height, wrap, np.append(0, np.cumsum((width + 2) * (height + 2))))


@inline_jit
def step_along(index, by, count, wraps):
    """Return the index of the node `by` nodes further along an axis with `count` cells.

    Cell i has the index i + 1, as the border comes first. wraps: whether the lattice is periodic along the axis.
    """
    index += by
    if wraps:
        if index < 1:
            index += count
        elif index > count:
            index -= count
    return index


@inline_jit
def neighbours(ix, iy, level, levels, flat, out):
    """Write the nine nodes about the node (ix, iy) of a level, with this node in the middle, to `out` (9, 3).

    The columns are the index of the node, -1 if it is beyond the border, and its position on the lattice. flat: whether
    space is one-dimensional.
    """
    width, rows, begin = levels.width[level], levels.height[level] + 2, levels.first[level]
    for i in range(3):
        jx = step_along(ix, i - 1, width, levels.wrap[level, 0])
        for j in range(3):
            jy = step_along(iy, j - 1, rows - 2, levels.wrap[level, 1])
            inside = 0 <= jx < width + 2 and 0 <= jy < rows and not (flat and j != 1)
            out[3 * i + j, 0] = begin + jx * rows + jy if inside else -1
            out[3 * i + j, 1], out[3 * i + j, 2] = jx, jy


@inline_jit
def is_inner(ix, iy, level, levels, flat):
    """Return whether the nine nodes about (ix, iy) have its own index plus fixed offsets, as at most nodes."""
    return 1 < ix < levels.width[level] and 1 < iy < levels.height[level] and not flat


@inline_jit
def number_nodes(level, leaf, levels, flat, at, number_of, place, near):
    """Number the nodes about blocks, in the order of the blocks; return the number of nodes.

    level (blocks,), leaf (blocks, 2): level and first leaf of each block. Writes, for each lattice node, its block to
    `at` and its number to `number_of`, which must be -1 on input; and for each numbered node, its level and position on
    the lattice to `place` (n, 3). near (9, 3): overwritten.
    """
    total = 0
    for block in range(len(level)):
        n = level[block]
        ix, iy, rows = (leaf[block, 0] >> n) + 1, (leaf[block, 1] >> n) + 1, levels.height[n] + 2
        middle = levels.first[n] + ix * rows + iy
        at[middle] = block
        if is_inner(ix, iy, n, levels, flat):
            for i in range(-1, 2):
                for j in range(-1, 2):
                    node = index(middle + i * rows + j)
                    if number_of[node] < 0:
                        number_of[node] = total
                        place[total, 0], place[total, 1], place[total, 2] = n, ix + i, iy + j
                        total += 1
            continue
        neighbours(ix, iy, n, levels, flat, near)
        for k in range(9):
            node = near[k, 0]
            if node >= 0 and number_of[node] < 0:
                number_of[node] = total
                place[total, 0], place[total, 1], place[total, 2] = n, near[k, 1], near[k, 2]
                total += 1
    return total


@inline_jit
def link_nodes(total, levels, flat, at, number_of, place, near, stencil, blocks):
    """Write the nine nodes about each of the `total` nodes to `stencil` (n, 9), and the nine blocks to `blocks` (n, 9).

    at, number_of, place: results of `number_nodes`. near (9, 3): overwritten. An entry is -1 where there is no node
    or block.
    """
    for n in range(total):
        level, ix, iy = np.int64(place[n, 0]), np.int64(place[n, 1]), np.int64(place[n, 2])
        if is_inner(ix, iy, level, levels, flat):
            rows = levels.height[level] + 2
            below = levels.first[level] + (ix - 1) * rows + iy - 1
            for i in range(3):
                for j in range(3):
                    node = index(below + i * rows + j)
                    stencil[n, 3 * i + j], blocks[n, 3 * i + j] = number_of[node], at[node]
            continue
        neighbours(ix, iy, level, levels, flat, near)
        for k in range(9):
            node = near[k, 0]
            stencil[n, k] = number_of[node] if node >= 0 else -1
            blocks[n, k] = at[node] if node >= 0 else -1


@jit
def list_nodes(level, leaf, levels, flat):
    """Return (centre_node, place, stencil, blocks) of the nodes about blocks.

    centre_node (blocks,): index of the node at the centre of each block. place (n, 3): level, and position on the
    lattice, of each node. stencil, blocks (n, 9): indices of the nodes and of the blocks about each node, -1 where
    no node or block exists. level (blocks,), leaf (blocks, 2): level and first leaf of each block. flat: whether
    space is one-dimensional.
    """
    most, near = levels.first[-1], np.empty((9, 3), np.int64)
    at, number_of = np.full(most, -1, np.int32), np.full(most, -1, np.int32)
    place = np.empty((min(most, 9 * len(level)), 3), np.int32)
    total = number_nodes(level, leaf, levels, flat, at, number_of, place, near)
    stencil, blocks = np.empty((total, 9), np.int32), np.empty((total, 9), np.int32)
    link_nodes(total, levels, flat, at, number_of, place, near, stencil, blocks)
    centre_node = np.empty(len(level), np.int32)
    for n in range(total):
        if blocks[n, 4] >= 0:
            centre_node[blocks[n, 4]] = n
    return centre_node, place[:total], stencil, blocks


@jit_no_alloc
def node_centres(first, last, place, origin, leaf, begin, out):
    """Write the positions of nodes to `out` (n, 2).

    place (n, 3): level of each node, and its position on the lattice, which begins at the leaf `begin` (2,). origin
    (2,): position of the lattice of leaves. leaf: side of a leaf.
    """
    for n in range(first, last):
        side = leaf * 2.0 ** place[n, 0]
        ix, iy = place[n, 1] + (begin[0] >> place[n, 0]), place[n, 2] + (begin[1] >> place[n, 0])
        out[n, 0], out[n, 1] = origin[0] + (ix - 0.5) * side, origin[1] + (iy - 0.5) * side
