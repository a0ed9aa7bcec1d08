"""The uniform grid of a run: cloud-in-cell deposit, and gather with the same weights.

Cloud in cell: Hockney & Eastwood (1988), ch. 5. Equal weights both ways and a centred difference between
them leave no particle a force on itself, and conserve momentum.
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
from discsim.numerics.threads import share, share_all

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
Node = tuple[int, int]
ORIGIN: Node = (0, 0)
BORDER = 2  # nodes beyond an open edge that a centred gradient at the last one wants


class Extent(NamedTuple):
    """Of the first nodes about particles on a grid the least and the largest along y (bands,), in each kernels.BAND of
    rows, those along x, and how many particles are off it. Without any on it the least is the larger.
    """

    least: Array
    most: Array
    low: int
    high: int
    off: int


@dataclass(frozen=True)
class Grid:
    """Square cells of side `cell` from the corner `origin`; fields are (nx, ny) at their centres; 1D: ny = 1.

    Positions are (n, dimensions). A particle is off an open grid where one of the nodes about it is missing. Methods
    with `first` take a field of part of the grid, from that node on, which has all nodes about the particles.
    """

    origin: tuple[float, float]
    cell: float
    shape: tuple[int, int]
    periodic: bool

    @classmethod
    def from_scene(cls, scene: Scene, particles: int) -> Grid:
        """The grid of `scene.space`; without `cells` about as many as `particles`.

        Raises ValueError for a periodic box whose sides are not whole numbers of square cells.
        """
        cell, shape = grid_cells(scene, particles)
        counts = [*shape]
        periodic = scene.space.boundary == "periodic"
        for side, count in zip(scene.space.size, counts, strict=True):
            if periodic and not np.isclose(count * cell, side, rtol=1e-9, atol=0):
                raise ValueError(
                    f"space.size: {max(counts)} square cells along the longest side leave {side / cell:g} along "
                    "another; a periodic box needs whole cells on each side"
                )
        origin = [-count * cell / 2 if scene.centred else 0.0 for count in counts]
        if len(counts) == 1:
            counts.append(1)
            origin.append(0.0)
        return cls((origin[0], origin[1]), cell, (max(counts[0], 1), max(counts[1], 1)), periodic)

    def nodes(self, axis: int) -> Array:
        """Coordinates of the cell centres along an axis."""
        return self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.cell

    def deposit(
        self,
        pos: Array,
        mass: Array,
        out: Array | None = None,
        first: Node = ORIGIN,
        pieces: tuple[Array, Array] | None = None,
    ) -> Array:
        """Surface density (nx, ny) of the particles on the grid, added to `out` if given; 1D: by length.

        The sum over the nodes, times the cell's area, is the mass of those particles, to rounding. It goes through rows
        of arrays by `pieces`, first rows and ends (pieces,) of each; None: as they are.
        """
        if pieces is None:
            pieces = np.zeros(1, np.int64)[: len(pos)], np.array([len(pos)])[: len(pos)]
        out = np.zeros(self.shape) if out is None else out
        shift = ((self.shape[0] - 1) // kernels.STRIPS).bit_length()  # STRIPS times 2^shift rows hold nx
        inverse = 1.0 / self.cell
        key = np.empty(len(pos), np.uint8)
        share(kernels.strip_of, len(pos), pos, self.origin, inverse, self.shape, self.periodic, shift, key, light=True)
        runs, strips = kernels.runs_of(key, *pieces)
        order, start = counting_sort(strips, kernels.STRIPS + 1)
        beyond, part = np.zeros((kernels.STRIPS, out.shape[1])), (*self.shape, *first)
        share(
            kernels.deposit_strips, kernels.STRIPS, pos, mass, inverse ** pos.shape[1], runs, order, start, self.origin,
            inverse, self.periodic, part, shift, out, beyond, least=1,
        )  # fmt: skip
        kernels.join_strips(shift, part, beyond, out)
        return out

    def gather(self, field: Array, pos: Array, first: Node = ORIGIN) -> Array:
        """A field at the particles with the deposit's weights, 0 off the grid.

        Field (nx, ny) gives (n,); a vector field (nx, ny, 2) gives (n, dimensions).
        """
        scalar = field.ndim == 2
        out = np.empty((len(pos), 1 if scalar else pos.shape[1]))
        source = field[:, :, None] if scalar else field
        part = (*self.shape, *first)
        share(kernels.gather, len(pos), source, pos, self.origin, 1.0 / self.cell, self.periodic, part, out)
        return out[:, 0] if scalar else out

    def pull(
        self, gradient: Array, several: Iterable[tuple[Array, Array]], first: Node = ORIGIN
    ) -> list[tuple[float, int]]:
        """Take `gradient` (nx, ny, 2) at the particles of some species off their acceleration, but for those off the
        grid; `several` are the places and accelerations (n, dimensions) of each.

        Returns of each the largest length of what is taken off, and how many particles are off the grid.
        """
        where = self.origin, 1.0 / self.cell, self.periodic, (*self.shape, *first)
        ranges, found = [], []
        for pos, acc in several:
            chunks = -(-len(pos) // kernels.CHUNK)
            of_chunks = np.empty(chunks), np.empty(chunks, np.int64)
            ranges.append((chunks, gradient, pos, *where, acc, *of_chunks))
            found.append(of_chunks)
        share_all(kernels.pull, ranges, least=1)
        return [(float(np.sqrt(largest.max(initial=0.0))), int(missing.sum())) for largest, missing in found]

    def places(self, pos: Array) -> tuple[Array, int]:
        """Place of the cell of each particle (n,), to sort by for memory locality, and how many places there are."""
        key = np.empty(len(pos), np.uint32)
        share(kernels.places_of, len(pos), pos, self.origin, 1.0 / self.cell, self.shape, self.periodic, key)
        return key, int(key.max(initial=0)) + 1

    def outside(self, pos: Array) -> Array:
        """Indices of the particles off the grid: never deposited, and not to be gathered for."""
        outside = np.empty(len(pos), bool)
        inverse = 1.0 / self.cell
        share(kernels.is_outside, len(pos), pos, self.origin, inverse, self.shape, self.periodic, outside)
        return np.flatnonzero(outside)

    def extent(self, pos: Array, bounds: Array) -> Extent:
        """Where the first nodes about particles on the grid are; bounds: as of `numerics/batches.py`."""
        given = pos, bounds, self.origin, 1.0 / self.cell, self.shape, self.periodic
        least, most, low, high, off = zip(*share(kernels.extents, len(bounds), *given, least=LEAST), strict=True)
        return Extent(np.min(least, axis=0), np.max(most, axis=0), min(low), max(high), sum(off))

    def gradient(self, field: Array, out: Array | None = None, columns: tuple[Array, Array] | None = None) -> Array:
        """Gradient (nx, ny, 2) at the nodes of `field` (nx, ny), of fourth order, centred but at open edges.

        There too if `field` has a border of BORDER nodes more on every side: then no particle pulls itself. In `out`
        if given, which may be of part of the grid; of each row from and up to `columns` (nx,), or whole.

        Raises ValueError for an open grid of fewer than five cells a side.
        """
        if not self.periodic and min(self.shape) < 5:
            raise ValueError(f"an open grid with gravity needs at least 5 cells a side, not {self.shape}")
        out = np.empty((*self.shape, 2)) if out is None else out
        bordered = field.shape != out.shape[:2]
        begin, end = columns or np.array([[0], [out.shape[1]]]).repeat(len(out), axis=1)
        share(gradient, len(out), field, self.cell, self.periodic or bordered, begin, end, out, least=16)
        return out

    @staticmethod
    def within(field: Array, shape: tuple[int, int]) -> Array:
        """The middle of `shape` of a field, which may have a border along an axis."""
        x, y = (field.shape[axis] - shape[axis] >> 1 for axis in range(2))
        return np.ascontiguousarray(field[x : x + shape[0], y : y + shape[1]])
