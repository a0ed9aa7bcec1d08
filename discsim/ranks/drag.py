"""Drag on several ranks: a kick of own gas and dust together with the ghosts that they depend on.

The results are the same as on one rank. In schemes with cells, ghosts are the particles in the blocks (drag cells) of
own particles and in other blocks near the nodes of these. The blocks depend on the particles of all ranks: on their
numbers and h in each leaf, on the mean h, and on the frame. These are computed collectively first, and then the
blocks of own particles. In schemes with pairs, ghosts are all particles of other ranks, and each rank computes the
whole kick.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.drag.base import CellRule, Dust, Gas, KickResult
from discsim.drag.cells import Layout, Merged
from discsim.drag.engine import Engine, Prepared, Seen
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
from discsim.numerics.world import Needed
from discsim.ranks.exchange import asked_of, in_cells, joined
from discsim.ranks.leaves import Leaves, widened

if TYPE_CHECKING:
    from discsim.drag.cells import Lattice
    from discsim.ranks.division import Division
    from discsim.scene import Scene

Array = np.ndarray
# Further rings of nodes if drag heats gas: a node gets heat from particles of its cell and from near nodes without gas.
HEATING_RINGS = 2


class DividedDrag(Engine):
    """Drag `Engine` of one rank."""

    def __init__(self, scene: Scene, star: tuple[float, float], division: Division) -> None:
        super().__init__(scene, star)
        self.division, self.comm, self.heating = division, division.comm, scene.drag.heating
        self.leaves = Leaves(self.comm)

    def _relax(self, state: State, dt: float, gas_vel: Array, heat: Array, prepared: Prepared | None) -> KickResult:
        gas, dust = self._positions(state, gas_vel)
        if self.scheme.layout is None:
            wides = self._fetch_all(state)
            gas, dust = self._with_ghosts(self._complete(state, gas, dust), wides, gas._fields + dust._fields)
            with world.without_communication():
                return self._kick(state, gas, dust, wides, self._frame(state), dt, None, gas_vel, heat)
        self.release()  # forces and ghosts need the memory
        frame, rule = self._frame(state), self._rule(state)
        layout, wides = self._fetch_ghosts(state, gas, dust, rule, frame)
        reads = *self.scheme.reads, "per_grain", *(("acc",) if self.heating else ())
        if self.classes.law.several:
            reads += ("class_of",)
        gas, dust = self._with_ghosts(self._complete(state, gas, dust), wides, reads)
        layout = layout._replace(
            gas_leaf=_with_leaves_of_ghosts(layout.gas_leaf, gas.pos, layout.leaf_of),
            dust_leaf=_with_leaves_of_ghosts(layout.dust_leaf, dust.pos, layout.leaf_of),
        )
        assert self.scheme.build is not None
        built = self.scheme.build(gas, dust, rule, layout)
        return self._kick(state, gas, dust, wides, frame, dt, built, gas_vel, heat)

    def _kick(
        self, state: State, gas: Gas, dust: Dust, wides: list[Any], frame: Frame, dt: float, built: Any, gas_vel: Array,
        heat: Array,
    ) -> KickResult:  # fmt: skip
        """Kick own particles and ghosts, set the velocities and the heat of own ones, and return results for own dust.

        wides: combined gas and dust (`Wide`). built: result of `scheme.build`; None for schemes with pairs. gas_vel,
        heat (n, ...): arrays of own gas for the results.
        """
        warmed = np.zeros(len(gas.mass) if self.heating else 0)
        kicked = self._call(gas, dust, frame, dt, built, warmed)
        of_gas, of_dust = wides
        of_gas.keep(gas_vel, gas.vel)
        of_dust.keep(state.dust.vel, dust.vel)
        if self.heating:
            heat[:] = warmed[of_gas.own]
        times = kicked.stopping_times
        uncoupled = of_dust.own_among(kicked.uncoupled)
        return KickResult(uncoupled, lambda: (times() if callable(times) else times)[of_dust.own])

    def limit(self, state: Seen) -> float:
        gas, dust, law, frame, context = self.arguments(state)
        gas, dust = self._with_ghosts((gas, dust), self._fetch_all(state), gas._fields + dust._fields)
        assert self.scheme.limit is not None
        with world.without_communication():
            return self.scheme.limit(gas, dust, law, frame, context)

    def _with_ghosts(self, both: tuple[Any, ...], wides: list[Any], reads: tuple[str, ...]) -> tuple[Any, ...]:
        """Return gas and dust with ghosts in the arrays `reads`; all other arrays, except `acc`, have no entries.

        both: arguments gas and dust of a kick, without ghosts. wides: combined gas and dust (`Wide`). If `acc` is not
        among `reads`, its ghost entries are uninitialised.
        """
        named = [dict(zip(each._fields[:-3], each[:-3], strict=True)) for each in both]  # without order and number
        lengths = np.array([len(array) for arrays in named for array in arrays.values()])
        present = iter(self.comm.reduced(lengths, MPI.MAX) > 0)  # whether arrays have entries on any rank
        found = []
        for each, arrays, wide in zip(both, named, wides, strict=True):
            sent = [name for name, there in zip(arrays, present, strict=False) if there and name in reads]
            extended = {name: array[:0] for name, array in arrays.items()}
            extended |= zip(sent, wide.of_all([arrays[name] for name in sent]), strict=True)
            if "acc" not in reads:
                extended["acc"] = wide.beside(each.acc)
            order = wide.global_index, wide.unsorted_rows, wide.local
            found.append(type(each)(**extended, **dict(zip(each._fields[-3:], order, strict=True))))
        return tuple(found)

    def _fetch_all(self, state: Seen) -> list[Any]:
        """Fetch all particles of other ranks: the exchange of one pair depends on other pairs, on all ranks."""
        return [world.processes.everyone(p) for p in state.species.values()]

    def _fetch_ghosts(
        self, state: State, gas: Gas, dust: Dust, rule: CellRule, frame: Frame
    ) -> tuple[Layout, list[Any]]:
        """Fetch the particles in the blocks that own particles depend on.

        Return the layout of these blocks, and own gas and dust combined with ghosts.
        """
        rings = self.scheme.rings + (HEATING_RINGS if self.heating and self.scheme.rings >= 0 else 0)
        assert self.scheme.layout is not None
        while True:
            layout: Layout = self.scheme.layout(gas, dust, rule, frame, self.leaves)
            lattice, blocks, leaves = layout.lattice, layout.merged, (layout.gas_leaf, layout.dust_leaf)
            blocks.number[-1] = len(blocks.level)  # for particles outside
            own = np.zeros(len(blocks.level), bool)
            held = self.leaves.held(lattice, leaves)
            parallel_for(mark_blocks_of_leaves, len(held), held, blocks.number, own, light=True)
            # Nodes are of one level: a block depends on others of its own side, up to `rings` + 2 away.
            widest = int(blocks.level[own].max(initial=0))
            away = -(-(rings + 2 << widest) // MOST) if rings >= 0 else 0
            if self.leaves.suffices(world.processes.most(away)):
                break
        needed = own if rings < 0 else _needed_blocks(blocks, lattice, own, away, rings, self.dim == 1)
        asked = asked_of(self.comm, Needed(np.append(needed, False), *numbers_of(blocks, lattice)))
        near = _masks_of_largest_blocks(blocks, lattice, np.diff(asked.number[:-1]) > 0)[0]
        wides = [
            in_cells(self.comm, p, leaf, asked, blocks.number, self._batches_near_blocks(pos, lattice, near))
            for p, pos, leaf in zip(state.species.values(), (gas.pos, dust.pos), leaves, strict=True)
        ]
        return only_needed(layout, own, needed), wides

    def _batches_near_blocks(self, pos: Array, lattice: Lattice, marked: Array) -> Array:
        """Return the numbers of the batches of positions that may have particles in marked largest blocks.

        marked (x, y): mask of largest blocks.
        """
        bounds, along = self.division.bounds(pos), np.array([1.0, self.dim - 1.0])  # 0 in one dimension
        part = *map(float, lattice.first), *(lattice.periodic * along * lattice.whole).tolist()
        given = bounds, along * lattice.origin, lattice.side, part, MOST, marked
        return joined(parallel_for(batches_near, len(bounds), *given, least=LEAST))


def _needed_blocks(blocks: Merged, lattice: Lattice, own: Array, away: int, rings: int, flat: bool) -> Array:
    """Return the mask (blocks,) of the blocks that particles in own blocks depend on.

    own (blocks,): mask of blocks with own particles. away: distance up to which blocks are searched, in largest blocks.
    rings: number of rings of nodes that a kick depends on. flat: whether the scene is one-dimensional. The search
    covers only largest blocks near both own blocks and others.
    """
    needed, held = own.copy(), _masks_of_largest_blocks(blocks, lattice, own)
    some = blocks_in(blocks.first_leaf, widened(held[0], lattice, away) & widened(held[1], lattice, away))
    if len(some) > 0:
        lattices, found = levels.lattice_levels(*lattice.shape, lattice.joined, LEVELS + 1), own[some]
        home, _, about, near = levels.list_nodes(blocks.level[some], blocks.first_leaf[some], lattices, flat)
        mark_blocks(np.flatnonzero(found), home, about, near, rings, found)
        needed[some] = found
    return needed


def _masks_of_largest_blocks(blocks: Merged, lattice: Lattice, chosen: Array) -> Array:
    """Return two masks (2, x, y) of largest blocks: those with any chosen block in them, and those with any other.

    chosen (blocks,): mask of blocks.
    """
    out = np.zeros((2, *(-(-n // MOST) for n in lattice.shape)), bool)
    mark_top_blocks(blocks.first_leaf, chosen, out)
    return out


def numbers_of(blocks: Merged, lattice: Lattice) -> tuple[Array, Array]:
    """Return for each block the range of leaves that it covers in the whole lattice: first number, and end.

    Leaves are numbered by largest block, and along a Z-curve within each. The last entry is for particles outside.
    """
    count = len(blocks.level)
    begin, end = np.full(count + 1, 2**62), np.full(count + 1, 2**62 + 1)
    block_number_ranges(blocks.first_leaf, blocks.level, lattice.first, -(-lattice.whole[1] // MOST), begin, end)
    return begin, end


def only_needed(layout: Layout, own: Array, needed: Array) -> Layout:
    """Return a layout that has only the needed blocks, own blocks first. Changes `layout.merged.number`.

    own, needed (blocks,): masks of blocks.
    """
    some, blocks = np.concatenate([np.flatnonzero(own), np.flatnonzero(needed & ~own)]), layout.merged
    number = np.full(len(blocks.level) + 2, -1, np.int32)  # -1: of no block
    number[some] = np.arange(len(some))
    parallel_for(renumber, len(blocks.number), blocks.number, number, light=True)
    merged = Merged(blocks.number, *(each[some] for each in blocks[1:]))
    return layout._replace(merged=merged, own=int(np.count_nonzero(own)))


def _with_leaves_of_ghosts(leaf: Array, pos: Array, leaf_of: Callable[[Array], Array]) -> Array:
    """Return the leaves (n,) of own particles and ghosts at positions pos (n, d); leaf: those of own particles."""
    local, both = len(leaf), alloc.grow(leaf, len(pos))
    if both is None:
        return np.concatenate([leaf, leaf_of(pos[local:])])
    both[local:] = leaf_of(pos[local:])
    return both
