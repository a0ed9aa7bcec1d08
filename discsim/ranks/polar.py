"""Gas in polar cells on several ranks: each rank owns whole rings, as cells do not move and gas turns around a ring.

A rank owns consecutive rings, and the tiles of space (`division.py`) whose centres are at the radii of these rings. The
dust and the grid nodes in these tiles are therefore near the gas of the rank. Tiles are narrow, so that few grains at
the borders have gas of other ranks around them.

Work arrays of the kernels have the own rings and HALO ghost rings on both sides, or up to the edge of the grid. Ghost
rings are fetched before the forces, before viscosity and before the radial sweep. Kernels then compute the own rings
with the same numbers as on one rank. Sums over cells at grains, and over grains in cells, have ghosts of their own
(`PolarGrains` in `numerics/polar.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas.polar import ring_sides
from discsim.kernels.polar.geometry import GHOSTS
from discsim.numerics.polar import PolarCells, rings_of
from discsim.physics.polar import polar_shape
from discsim.ranks.division import TILES_PER_SIDE, Division

if TYPE_CHECKING:
    from discsim.numerics.state import Particles
    from discsim.ranks.comm import Comm
    from discsim.scene import Scene

Array = np.ndarray
# The flux through a side depends on the parabolas of two rings on both sides, and a parabola on two more rings.
HALO = 2 + GHOSTS
CELL_COST = {"gas": 1.0, "dust": 1.0}  # relative cost of a cell and of a grain per step, with drag (2026-11)
FINER = 4  # number of tiles along a side, over that of other runs


class RingDivision(Division):
    """`Division` of a scene with gas in polar cells: tiles in the order of radius, and whole rings of cells.

    ring_edges (ranks + 1,): first ring of each rank, and the number of rings. changed: function without arguments,
    called when other rings have arrived on this rank.
    """

    tiles_per_side = FINER * TILES_PER_SIDE
    particle_cost = CELL_COST

    def __init__(self, scene: Scene, comm: Comm) -> None:
        super().__init__(scene, comm)
        shape = polar_shape(scene)
        self.angles, sides = shape.angles, ring_sides(shape.rings, shape.inner, shape.outer)
        self._ring_radius = 0.5 * (sides[1:] + sides[:-1])
        along = self.low[0] + (np.arange(self.along) + 0.5) / self.tiles_per_length
        radius = np.hypot(*np.meshgrid(along, along)).ravel()
        self.curve = np.argsort(radius, kind="stable")
        self._curve_radius = radius[self.curve]
        self.ring_edges = self._find_ring_edges()
        self.changed: Callable[[], None] = lambda: None
        self._ring_owners_changed = False

    def divide_gas(self, effect: Any) -> None:
        effect.cells = DividedCells(effect.cells, self)

    def _find_ring_edges(self) -> Array:
        """Return `ring_edges`: a ring belongs to the rank that owns the tiles at its radius."""
        first_tile = np.searchsorted(self.owner[self.curve], np.arange(1, self.comm.size))
        first_ring = np.searchsorted(self._ring_radius, np.append(self._curve_radius, np.inf)[first_tile])
        return np.concatenate([[0], first_ring, [len(self._ring_radius)]])

    def owner_of(self, name: str, particles: Particles, rows: Array | slice = slice(None)) -> Array:
        if name != "gas":
            return super().owner_of(name, particles, rows)
        # The order of the cells is ring by ring.
        ring = particles.global_index[rows] // np.uint64(self.angles)
        return np.searchsorted(self.ring_edges, ring.astype(np.int64), side="right") - 1

    def leaving_rows(self, name: str, particles: Particles, bounds: Array) -> Array:
        if name != "gas":
            return super().leaving_rows(name, particles, bounds)
        if not self._ring_owners_changed:
            return np.empty(0, np.int64)
        return np.flatnonzero(self.owner_of(name, particles) != self.comm.rank)

    def rebalance(self, species: dict[str, Particles]) -> bool:
        changed = super().rebalance(species)
        if changed:
            edges, self.ring_edges = self.ring_edges, self._find_ring_edges()
            self._ring_owners_changed = not np.array_equal(edges, self.ring_edges)
        return changed

    def migrate(self, species: dict[str, Particles]) -> None:
        super().migrate(species)
        if self._ring_owners_changed:
            gas = species["gas"]
            gas.take(np.argsort(gas.global_index))
            gas.unsorted_rows = gas.unsorted_rows[:0]
            self._ring_owners_changed = False
            self.changed()


class DividedCells(PolarCells):
    """`PolarCells` of one rank of several: its own rings, and ghost rings on both sides.

    whole: the cells of a serial run.
    """

    def __init__(self, whole: PolarCells, division: RingDivision) -> None:
        self.angles, self.azimuth = whole.angles, whole.azimuth
        self.division, self.comm, self._all_rings = division, division.comm, whole.geometry
        self._find_rings()
        division.changed = self._find_rings

    def _find_rings(self) -> None:
        """Set own rings and ghost rings as the division has them."""
        rank, edges, g = self.comm.rank, self.division.ring_edges, self._all_rings
        begin, end = edges[:-1], edges[1:]
        held = begin < end
        # First ring, and end, of the own rings and the ghost rings of each rank.
        low = np.where(held, np.maximum(begin - HALO, 0), begin)
        high = np.where(held, np.minimum(end + HALO, len(g.radius)), end)
        first, last = int(low[rank]), int(high[rank])
        self.set_rings(rings_of(g, first, last, int(begin[rank]) - first), int(end[rank] - begin[rank]))
        self._with_ghosts = np.empty((2, self.rings, self.angles))  # memory of `with_empty_ghosts`
        elsewhere = np.arange(self.comm.size) != rank
        # Rings that this rank sends to each rank, and ghost rings that it receives from each rank: first ring and end.
        self._sent = _common_rings(low, high, begin[rank], end[rank], elsewhere) - first
        self._received = _common_rings(begin, end, first, last, elsewhere) - first

    def with_empty_ghosts(self, array: Array, number: int) -> Array:
        out = self._with_ghosts[number]
        out[self.own] = array.reshape(self.shape)
        return out

    def update_ghosts(self, arrays: list[Array]) -> None:
        widths = np.array([array[:1].size for array in arrays])
        send_counts, receive_counts = (np.diff(spans)[:, 0] * widths.sum() for spans in (self._sent, self._received))
        sent = [array[begin:end].ravel() for begin, end in self._sent for array in arrays]
        message = self.comm.alltoallv(np.concatenate(sent), send_counts, receive_counts)
        at = 0
        for begin, end in self._received:
            for array in arrays:
                some = array[begin:end]
                some[:] = message[at : at + some.size].reshape(some.shape)
                at += some.size


def _common_rings(low: Array, high: Array, begin: int, end: int, chosen: Array) -> Array:
    """Return the rings that are both in the ranges low to high, (ranks,) each, and in the range begin to end.

    The result (ranks, 2) has first rings and ends. chosen (ranks,): mask of the ranks; others have no rings.
    """
    first, last = np.maximum(low, begin), np.minimum(high, end)
    last = np.where(chosen, np.maximum(first, last), first)
    return np.stack([first, last], axis=1)
