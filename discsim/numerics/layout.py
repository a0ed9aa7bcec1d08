"""Sizes of the cells of the grid and of drag cells. Numpy only.

The run and `discsim check` call the same functions, and those of a scheme's `Cells` (`drag/base.py`). Drag cells are
blocks of 2^n by 2^n leaves. In two dimensions leaves are whole cells of the grid (`kernels/drag/blocks.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray

LEVELS = 5  # a drag cell is at most 2^LEVELS leaves wide, as in kernels/drag/blocks.py
SOFT = 2.0  # largest side of cells that grow for lack of particles, over their target side
LOADED = 0.1  # dust-to-gas ratio above which shot noise in the loading matters


def grid_cells(scene: Scene, particles: int) -> tuple[float, tuple[int, ...]]:
    """Return the side of the square cells of `scene.space`, and their number along each axis.

    Without `space.cells` there are about as many cells as `particles`. Along an open side the number is rounded up, so
    that cells cover it.
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


def leaves(wanted: float, cell: float, shape: tuple[int, ...], periodic: bool, gas: int) -> tuple[float, list[int]]:
    """Return the side of leaves at least `wanted` wide on a grid of `shape` cells of side `cell`, and their numbers.

    In one dimension, a `shape` of one number, leaves need not be whole cells. There are at most four per gas particle,
    as finer ones would be empty.
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
    """Return the sides (n,) of the smallest blocks of leaves that are at least `wanted` (n,) wide."""
    level = np.ceil(np.log2(np.maximum(wanted * (1.0 - 1e-9) / leaf, 1.0)))
    return leaf * 2.0 ** np.minimum(level, LEVELS)
