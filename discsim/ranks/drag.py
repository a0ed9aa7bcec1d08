"""Drag on several ranks: a kick of local gas and dust together with the ghosts that they depend on.

The results are the same as on one rank. In schemes with cells, ghosts are the particles in the blocks (drag cells)
of local particles, and in other blocks near the nodes of these blocks. The blocks depend on the particles of all
ranks: on their numbers and h in each leaf, on the mean h, and on the frame. These quantities are computed
collectively first. Each rank then makes the blocks of its local particles. In schemes with pairs, ghosts are all
particles of other ranks, and each rank computes the whole kick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.drag.base import EMPTY, CellRule, Dust, Gas, KickResult
from discsim.drag.cells import Layout, Merged
from discsim.drag.engine import Engine, Prepared, Seen, azimuthal, set_azimuthal
from discsim.kernels.drag.blocks import LEVELS, MOST
from discsim.kernels.drag.frame import Frame
from discsim.kernels.drag.tsc import levels
from discsim.kernels.mpi.halo import (
    batches_near,
    block_number_ranges,
    blocks_in,
    mark_blocks,
    mark_blocks_of_leaves,
    mark_top_blocks,
    renumber,
)
from discsim.numerics import alloc, world
from discsim.numerics.batches import LEAST
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.world import NeededCells
from discsim.ranks.exchange import FetchedGhosts, concatenate, exchange_requests, route_to_requesters
from discsim.ranks.leaves import DividedLeaves, dilate

if TYPE_CHECKING:
    from discsim.drag.cells import Lattice
    from discsim.ranks.division import Division
    from discsim.scene import Scene

Array = np.ndarray
# Further rings of nodes if drag heats gas: a node gets heat from particles of its cell and from near nodes without gas.
HEATING_RINGS = 2


class DividedDrag(Engine):
    """Drag `Engine` of one rank of several; heating: whether drag heats the gas."""

    def __init__(self, scene: Scene, star: tuple[float, float], division: Division) -> None:
        super().__init__(scene, star)
        self.division, self.comm, self.heating = division, division.comm, scene.drag.heating
        self.leaves = DividedLeaves(self.comm)

    def _relax(self, state: State, dt: float, gas_vel: Array, heat: Array, prepared: Prepared | None) -> KickResult:
        gas, dust = self._positions(state, gas_vel)
        if self.scheme.layout is None:
            both = self._gather_all(state)
            local = self._complete(state, gas, dust)
            reads: tuple[str, ...] = gas._fields + dust._fields
            frame = self._frame(state)
            azimuth = self._azimuth_with_ghosts(state, local, both, reads)
            gas, dust = self._with_ghosts(local, both, reads)
            with world.without_communication():
                kicked = self._kick(state, gas, dust, both, frame, dt, None, gas_vel, heat)
                self._kick_azimuth(state, azimuth, both, frame, dt, None)
            return kicked
        self.release()  # forces and ghosts need the memory
        frame, rule = self._frame(state), self._rule(state)
        layout, both = self._fetch_ghosts(state, gas, dust, rule, frame)
        reads = *self.scheme.reads, "per_grain", *(("acc",) if self.heating else ())
        if self.classes.law.several:
            reads += ("class_of",)
        local = self._complete(state, gas, dust)
        azimuth = self._azimuth_with_ghosts(state, local, both, reads)
        gas, dust = self._with_ghosts(local, both, reads)
        layout = layout._replace(
            gas_leaf=_with_leaves_of_ghosts(layout.gas_leaf, gas.pos, layout.leaf_of),
            dust_leaf=_with_leaves_of_ghosts(layout.dust_leaf, dust.pos, layout.leaf_of),
        )
        assert self.scheme.build is not None
        built = self.scheme.build(gas, dust, rule, layout)
        kicked = self._kick(state, gas, dust, both, frame, dt, built, gas_vel, heat)
        self._kick_azimuth(state, azimuth, both, frame, dt, built)
        return kicked

    def _azimuth_with_ghosts(
        self, state: State, local: tuple[Gas, Dust], both: list[Any], reads: tuple[str, ...]
    ) -> tuple[Any, ...] | None:
        """Return the arguments of the kick of azimuthal velocities, with ghosts; None without a shearing box.

        local: arguments of the kick in the plane, without ghosts. both, reads: as in `_with_ghosts`.
        """
        return None if state.gas.across is None else self._with_ghosts(azimuthal(state, *local), both, reads)

    def _kick_azimuth(
        self, state: State, azimuth: tuple[Any, ...] | None, both: list[Any], frame: Frame, dt: float, built: Any
    ) -> None:
        """Kick the azimuthal velocities of local particles; azimuth: result of `_azimuth_with_ghosts`."""
        if azimuth is not None:
            gas, dust = azimuth
            self._call(gas, dust, frame, dt, built, EMPTY)
            set_azimuthal(state, gas.vel[both[0].local_rows], dust.vel[both[1].local_rows])

    def _kick(
        self, state: State, gas: Gas, dust: Dust, both: list[Any], frame: Frame, dt: float, built: Any, gas_vel: Array,
        heat: Array,
    ) -> KickResult:  # fmt: skip
        """Kick local particles and ghosts; set `gas_vel`, `heat` and the velocities of local dust to the results.

        Return the results for local dust that are not velocities. gas, dust: arguments of the scheme, with ghosts.
        both: gas and dust combined with ghosts. built: result of `scheme.build`; None for schemes with pairs.
        gas_vel (n, d): velocity of local gas. heat (n,): heat per mass of local gas; not set if drag does not heat.
        """
        heat_with_ghosts = np.zeros(len(gas.mass) if self.heating else 0)
        kicked = self._call(gas, dust, frame, dt, built, heat_with_ghosts)
        of_gas, of_dust = both
        of_gas.set_local(gas_vel, gas.vel)
        of_dust.set_local(state.dust.vel, dust.vel)
        if self.heating:
            heat[:] = heat_with_ghosts[of_gas.local_rows]

        def stopping_times() -> Array:
            times = kicked.stopping_times
            return (times() if callable(times) else times)[of_dust.local_rows]

        return KickResult(of_dust.local_among(kicked.uncoupled), stopping_times)

    def limit(self, state: Seen) -> float:
        gas, dust, law, frame, work = self.arguments(state)
        gas, dust = self._with_ghosts((gas, dust), self._gather_all(state), gas._fields + dust._fields)
        assert self.scheme.limit is not None
        with world.without_communication():
            return self.scheme.limit(gas, dust, law, frame, work)

    def _with_ghosts(self, local: tuple[Any, ...], both: list[Any], reads: tuple[str, ...]) -> tuple[Any, ...]:
        """Return `local`, the arguments gas and dust of a kick, with ghosts in the arrays whose names are in `reads`.

        Other arrays of the result have no entries, except `acc`, whose ghost entries are then uninitialised. both: gas
        and dust combined with ghosts.
        """
        arrays = [dict(zip(each._fields[:-3], each[:-3], strict=True)) for each in local]  # without order and number
        lengths = np.array([len(array) for named in arrays for array in named.values()])
        filled = iter(self.comm.allreduce(lengths, MPI.MAX) > 0)  # whether an array has entries on any rank
        found = []
        for each, named, combined in zip(local, arrays, both, strict=True):
            sent = [name for name, has_entries in zip(named, filled, strict=False) if has_entries and name in reads]
            extended = {name: array[:0] for name, array in named.items()}
            extended |= zip(sent, combined.all_with_ghosts([named[name] for name in sent]), strict=True)
            if "acc" not in reads:
                extended["acc"] = combined.with_empty_ghosts(each.acc)
            order = combined.global_index, combined.unsorted_rows, combined.local_count
            found.append(type(each)(**extended, **dict(zip(each._fields[-3:], order, strict=True))))
        return tuple(found)

    def _gather_all(self, state: Seen) -> list[Any]:
        """Return gas and dust of all ranks: the exchange of one pair depends on other pairs, on all ranks."""
        return [world.processes.allgather(p) for p in state.species.values()]

    def _fetch_ghosts(
        self, state: State, gas: Gas, dust: Dust, rule: CellRule, frame: Frame
    ) -> tuple[Layout, list[Any]]:
        """Fetch the particles in the blocks that local particles depend on.

        Return the layout of these blocks, and local gas and dust combined with ghosts.
        """
        rings = self.scheme.rings + (HEATING_RINGS if self.heating and self.scheme.rings >= 0 else 0)
        assert self.scheme.layout is not None
        while True:
            layout: Layout = self.scheme.layout(gas, dust, rule, frame, self.leaves)
            lattice, blocks, leaves = layout.lattice, layout.merged, (layout.gas_leaf, layout.dust_leaf)
            blocks.number[-1] = len(blocks.level)  # for particles outside
            own = np.zeros(len(blocks.level), bool)  # whether a block has local particles
            held = self.leaves.local_leaves(lattice, leaves)
            parallel_for(mark_blocks_of_leaves, len(held), held, blocks.number, own, light=True)
            # Nodes are of one level: a block depends on others of its own side, up to `rings` + 2 away.
            widest = int(blocks.level[own].max(initial=0))
            away = -(-(rings + 2 << widest) // MOST) if rings >= 0 else 0
            if self.leaves.update_reach(world.processes.max(away)):
                break
        needed = own if rings < 0 else _needed_blocks(blocks, lattice, own, away, rings, self.dim == 1)
        cells = NeededCells(np.append(needed, False), *leaf_number_ranges(blocks, lattice))
        requests = exchange_requests(self.comm, cells)
        near = _masks_of_largest_blocks(blocks, lattice, np.diff(requests.requested_before[:-1]) > 0)[0]
        both = []
        for p, pos, leaf in zip(state.species.values(), (gas.pos, dust.pos), leaves, strict=True):
            batches = self._batches_near_blocks(pos, lattice, near)
            both.append(FetchedGhosts(p, route_to_requesters(self.comm, leaf, requests, blocks.number, batches)))
        return keep_needed_blocks(layout, own, needed), both

    def _batches_near_blocks(self, pos: Array, lattice: Lattice, mask: Array) -> Array:
        """Return the indices of the batches of positions `pos` that may have particles in the largest blocks of `mask`.

        mask (x, y): which largest blocks of the lattice are meant.
        """
        bounds, along = self.division.bounds(pos), np.array([1.0, self.dim - 1.0])  # 0 in one dimension
        part = *map(float, lattice.first), *(lattice.periodic * along * lattice.whole).tolist()
        given = bounds, along * lattice.origin, lattice.side, part, MOST, mask
        return concatenate(parallel_for(batches_near, len(bounds), *given, least=LEAST))


def _needed_blocks(blocks: Merged, lattice: Lattice, own: Array, away: int, rings: int, flat: bool) -> Array:
    """Return the mask (blocks,) of the blocks that local particles depend on.

    own (blocks,): mask of the blocks with local particles. away: largest distance of searched blocks, in sides of a
    largest block. rings: number of rings of nodes that a kick depends on. flat: whether the scene is
    one-dimensional. Only largest blocks within `away` of a block in `own` and of another block are searched.
    """
    needed, held = own.copy(), _masks_of_largest_blocks(blocks, lattice, own)
    some = blocks_in(blocks.first_leaf, dilate(held[0], lattice, away) & dilate(held[1], lattice, away))
    if len(some) > 0:
        lattices, found = levels.lattice_levels(*lattice.shape, lattice.joined, LEVELS + 1), own[some]
        home, _, about, near = levels.list_nodes(blocks.level[some], blocks.first_leaf[some], lattices, flat)
        mark_blocks(np.flatnonzero(found), home, about, near, rings, found)
        needed[some] = found
    return needed


def _masks_of_largest_blocks(blocks: Merged, lattice: Lattice, chosen: Array) -> Array:
    """Return two masks (2, x, y) of largest blocks: one of those with a chosen block, one of those with any other
    block.

    chosen (blocks,): mask of blocks.
    """
    out = np.zeros((2, *(-(-n // MOST) for n in lattice.shape)), bool)
    mark_top_blocks(blocks.first_leaf, chosen, out)
    return out


def leaf_number_ranges(blocks: Merged, lattice: Lattice) -> tuple[Array, Array]:
    """Return the first index of the leaves of each block, and one more than the last index, (blocks + 1,) each.

    Leaves are numbered in the whole lattice: by largest block, and along a Z-curve within each largest block. The last
    entry is for particles outside the lattice.
    """
    count = len(blocks.level)
    begin, end = np.full(count + 1, 2**62), np.full(count + 1, 2**62 + 1)
    block_number_ranges(blocks.first_leaf, blocks.level, lattice.first, -(-lattice.whole[1] // MOST), begin, end)
    return begin, end


def keep_needed_blocks(layout: Layout, own: Array, needed: Array) -> Layout:
    """Return `layout` with the needed blocks alone, blocks with local particles first. Changes `layout.merged.number`.

    own, needed (blocks,): masks of the blocks with local particles, and of the needed blocks, which include them.
    """
    some, blocks = np.concatenate([np.flatnonzero(own), np.flatnonzero(needed & ~own)]), layout.merged
    number = np.full(len(blocks.level) + 2, -1, np.int32)  # -1: of no block
    number[some] = np.arange(len(some))
    parallel_for(renumber, len(blocks.number), blocks.number, number, light=True)
    merged = Merged(blocks.number, *(each[some] for each in blocks[1:]))
    return layout._replace(merged=merged, own=int(np.count_nonzero(own)))


def _with_leaves_of_ghosts(leaf: Array, pos: Array, leaf_of: Callable[[Array], Array]) -> Array:
    """Return the leaves (n,) of local particles and ghosts.

    leaf: leaves of the local particles. pos (n, d): positions of local particles and ghosts. leaf_of: function that
    returns the leaves of positions.
    """
    local, of_ghosts = len(leaf), leaf_of(pos[len(leaf) :])
    both = alloc.grow(leaf, len(pos))
    if both is None:
        return np.concatenate([leaf, of_ghosts])
    both[local:] = of_ghosts
    return both
