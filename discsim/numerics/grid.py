"""Uniform grid: cloud-in-cell deposit of particles on its nodes, and gather of fields with the same weights.

Cloud in cell: Hockney & Eastwood (1988), ch. 5. With equal weights in deposit and gather and a centred difference
between them, no particle exerts a force on itself, and momentum is conserved.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.kernels.common import grid as kernels
from discsim.kernels.gravity.gradient import gradient
from discsim.numerics.batches import LEAST
from discsim.numerics.layout import grid_cells
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for, parallel_for_ranges

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
Node = tuple[int, int]
ORIGIN: Node = (0, 0)
BORDER = 2  # number of nodes beyond an open edge that a centred gradient at the last node needs


class Extent(NamedTuple):
    """Range of the grid nodes that particles touch.

    Each particle touches two adjacent nodes along an axis, and only the first of them counts here. low, high: smallest
    and largest index of a first node along x. least, most (bands,): smallest and largest index of a first node along y,
    in each band of kernels.BAND rows. Without particles the smallest index exceeds the largest one. off: number of
    particles off the grid.
    """

    least: Array
    most: Array
    low: int
    high: int
    off: int


@dataclass(frozen=True)
class Grid:
    """Grid of nx x ny square cells. origin: its lower corner. cell: side of a cell. shape: (nx, ny); in 1D ny = 1.

    Nodes are the centres of cells; fields (nx, ny) have their values at nodes. Positions are (n, dimensions). A
    particle is off an open grid if one of the nodes that it touches is missing. If a method has an argument `first`,
    its fields may cover only a part of the grid, which begins at the node `first` and includes all nodes that the
    particles touch.
    """

    origin: tuple[float, float]
    cell: float
    shape: tuple[int, int]
    periodic: bool

    @classmethod
    def from_scene(cls, scene: Scene, particles: int) -> Grid:
        """Return the grid of `scene.space`.

        If the scene has no `space.cells`, the grid has about as many cells as `particles`. Raises ValueError for a
        periodic box whose sides are not whole numbers of square cells.
        """
        cell, shape = grid_cells(scene, particles)
        periodic = scene.space.boundary == "periodic"
        for side, count in zip(scene.space.size, shape, strict=True):
            if periodic and not np.isclose(count * cell, side, rtol=1e-9, atol=0):
                raise ValueError(
                    f"space.size: {max(shape)} square cells along the longest side leave {side / cell:g} along "
                    "another side; a periodic box needs a whole number of cells on each side: change space.cells"
                )
        x, y, *_ = (*(-count * cell / 2 if scene.centred else 0.0 for count in shape), 0.0)
        nx, ny, *_ = (*shape, 1)  # in 1D ny = 1
        return cls((x, y), cell, (max(nx, 1), max(ny, 1)), periodic)

    def nodes(self, axis: int) -> Array:
        """Return the coordinates (nx,) or (ny,) of the nodes along an axis, 0 or 1."""
        return self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.cell

    def deposit(
        self,
        pos: Array,
        mass: Array,
        out: Array | None = None,
        first: Node = ORIGIN,
        pieces: tuple[Array, Array] | None = None,
    ) -> Array:
        """Deposit particles on the grid, and return their surface density (nx, ny); in 1D mass per length.

        pos (n, dimensions), mass (n,): the particles. out (nx, ny): array to which the density is added and which is
        returned; None: a new one. pieces: order of summation, as two arrays with the first rows and the ends of ranges
        of particles; None: the order of the particles. The sum over nodes times the area of a cell is the mass of the
        particles on the grid, to rounding.
        """
        if pieces is None:
            pieces = np.zeros(1, np.int64)[: len(pos)], np.array([len(pos)])[: len(pos)]
        out = np.zeros(self.shape) if out is None else out
        shift = ((self.shape[0] - 1) // kernels.STRIPS).bit_length()  # STRIPS times 2^shift rows hold nx
        inverse = 1.0 / self.cell
        key = np.empty(len(pos), np.uint8)
        parallel_for(
            kernels.strip_keys, len(pos), pos, self.origin, inverse, self.shape, self.periodic, shift, key, light=True
        )
        runs, strips = kernels.strip_runs(key, *pieces)
        order, start = counting_sort(strips, kernels.STRIPS + 1)
        beyond, part = np.zeros((kernels.STRIPS, out.shape[1])), (*self.shape, *first)
        parallel_for(
            kernels.deposit_strips, kernels.STRIPS, pos, mass, inverse ** pos.shape[1], runs, order, start, self.origin,
            inverse, self.periodic, part, shift, out, beyond, least=1,
        )  # fmt: skip
        kernels.join_strips(shift, part, beyond, out)
        return out

    def gather(self, field: Array, pos: Array, first: Node = ORIGIN) -> Array:
        """Return a field interpolated to positions `pos` with the weights of `deposit`; 0 off the grid.

        The result is (n,) for a field (nx, ny), and (n, dimensions) for a vector field (nx, ny, 2).
        """
        scalar = field.ndim == 2
        out = np.empty((len(pos), 1 if scalar else pos.shape[1]))
        source = field[:, :, None] if scalar else field
        part = (*self.shape, *first)
        parallel_for(kernels.gather, len(pos), source, pos, self.origin, 1.0 / self.cell, self.periodic, part, out)
        return out[:, 0] if scalar else out

    def pull(
        self, gradient: Array, several: Iterable[tuple[Array, Array]], first: Node = ORIGIN
    ) -> list[tuple[float, int]]:
        """Interpolate `gradient` (nx, ny, 2) to particles, and subtract it from their accelerations.

        several: for each species its positions and its accelerations (n, dimensions), which change in place, except
        those of particles off the grid. Return for each species the largest length of the subtracted vectors, and the
        number of particles off the grid.
        """
        where = self.origin, 1.0 / self.cell, self.periodic, (*self.shape, *first)
        ranges, found = [], []
        for pos, acc in several:
            chunks = -(-len(pos) // kernels.CHUNK)
            of_chunks = np.empty(chunks), np.empty(chunks, np.int64)
            ranges.append((chunks, gradient, pos, *where, acc, *of_chunks))
            found.append(of_chunks)
        parallel_for_ranges(kernels.subtract_interpolated, ranges, least=1)
        return [(float(np.sqrt(largest.max(initial=0.0))), int(missing.sum())) for largest, missing in found]

    def sort_keys(self, pos: Array) -> tuple[Array, int]:
        """Return sort keys (n,) of particles by their cell, and one more than the largest key.

        Particles that are near each other in the sorted order are mostly near each other in space.
        """
        key = np.empty(len(pos), np.uint32)
        parallel_for(kernels.sort_keys, len(pos), pos, self.origin, 1.0 / self.cell, self.shape, self.periodic, key)
        return key, int(key.max(initial=0)) + 1

    def outside(self, pos: Array) -> Array:
        """Return the indices of particles off the grid, which are not deposited and must not gather."""
        outside = np.empty(len(pos), bool)
        inverse = 1.0 / self.cell
        parallel_for(kernels.mark_outside, len(pos), pos, self.origin, inverse, self.shape, self.periodic, outside)
        return np.flatnonzero(outside)

    def extent(self, pos: Array, bounds: Array) -> Extent:
        """Return the range of nodes that particles touch; bounds: boxes (batches, 4) about `pos`, from `bounds_of`."""
        given = pos, bounds, self.origin, 1.0 / self.cell, self.shape, self.periodic
        found = parallel_for(kernels.node_ranges, len(bounds), *given, least=LEAST)
        least, most, low, high, off = zip(*found, strict=True)
        return Extent(np.min(least, axis=0), np.max(most, axis=0), min(low), max(high), sum(off))

    def gradient(self, field: Array, out: Array | None = None, columns: tuple[Array, Array] | None = None) -> Array:
        """Return the fourth-order gradient (nx, ny, 2) of a field.

        field: (nx, ny), or larger by a border of BORDER nodes on every side. Without a border, differences at open
        edges are one-sided. With a border all differences are centred, and no particle exerts a force on itself. out:
        array for the result, which may cover a part of the grid; None: a new one. columns: first column and end (nx,)
        to compute in each row; None: whole rows. Raises ValueError for an open grid with fewer than five cells along a
        side.
        """
        if not self.periodic and min(self.shape) < 5:
            raise ValueError(f"an open grid with gravity needs at least 5 cells along each side, not {self.shape}")
        out = np.empty((*self.shape, 2)) if out is None else out
        bordered = field.shape != out.shape[:2]
        begin, end = columns or np.array([[0], [out.shape[1]]]).repeat(len(out), axis=1)
        parallel_for(gradient, len(out), field, self.cell, self.periodic or bordered, begin, end, out, least=16)
        return out

    @staticmethod
    def without_border(field: Array, shape: tuple[int, int]) -> Array:
        """Return the inner part of the given `shape` of a field that may have a border on every side."""
        x, y = (field.shape[axis] - shape[axis] >> 1 for axis in range(2))
        return np.ascontiguousarray(field[x : x + shape[0], y : y + shape[1]])
