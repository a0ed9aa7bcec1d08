"""Sizes of grid cells and of drag cells. Needs only numpy.

Both a run and `discsim check` call these functions and the `Cells` of a drag scheme (`drag/base.py`). Drag cells are
blocks of 2^n by 2^n leaves, the smallest squares of their lattice. In two dimensions the side of a leaf is a multiple
of the side of a grid cell (`kernels/drag/blocks.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray

LEVELS = 5  # a drag cell is at most 2^LEVELS leaves wide, as in kernels/drag/blocks.py
MAX_CELL_GROWTH = 2.0  # cells with too few particles may become this factor wider than the target
NOISY_LOADING = 0.1  # dust-to-gas ratio above which shot noise in that ratio matters


def grid_cells(scene: Scene, particles: int) -> tuple[float, tuple[int, ...]]:
    """Return the side of the square grid cells of a scene, and their number along each axis.

    If the scene has no `space.cells`, there are about as many cells as `particles`. With open edges the number along
    each axis is rounded up, so that the cells cover the box.
    """
    size, cells = scene.space.size, scene.space.cells
    if not cells:
        # About one particle per cell gives grid and particles the same resolution. A power of two, for the FFT.
        along_a_side = max(particles, 1) ** (1.0 / scene.space.dimensions)
        cells = max(8, 2 ** round(np.log2(along_a_side)))
    cell = max(size) / cells
    if scene.space.boundary == "periodic":
        return cell, tuple(round(side / cell) for side in size)
    return cell, tuple(int(np.ceil(side / cell - 1e-9)) for side in size)


def leaf_side_and_counts(
    wanted: float, cell: float, shape: tuple[int, ...], periodic: bool, gas: int
) -> tuple[float, list[int]]:
    """Return the side of the leaves of drag cells, and the number of leaves along each axis.

    wanted: smallest allowed side. cell, shape: side of a grid cell, and number of grid cells along each axis. gas:
    number of gas particles. In two dimensions the side is a multiple of `cell`. In one dimension (`shape` has one
    number) any side is possible, but there are at most four leaves per gas particle, as smaller ones would be empty.
    """
    if len(shape) == 2:
        whole = max(1, int(np.ceil(wanted / cell - 1e-9)))
        while periodic and whole < max(shape) and any(n % whole for n in shape):
            whole += 1
        return whole * cell, [-(-n // whole) for n in shape]
    extent = shape[0] * cell
    side = max(wanted, extent / (4.0 * gas))
    if periodic:
        number = max(1, int(extent / side + 1e-9))
        return extent / number, [number]
    return side, [int(np.ceil(extent / side))]


def side_of_blocks(leaf: float, wanted: Array) -> Array:
    """Return the sides (n,) of the smallest blocks of leaves that are at least `wanted` (n,) wide.

    leaf: side of a leaf. Blocks are at most 2^LEVELS leaves wide, even if this is less than `wanted`.
    """
    level = np.ceil(np.log2(np.maximum(wanted * (1.0 - 1e-9) / leaf, 1.0)))
    return leaf * 2.0 ** np.minimum(level, LEVELS)
