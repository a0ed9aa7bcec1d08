"""Drag on several ranks: one kick of own gas and dust and of the ghosts that they depend on, as on one rank.

For schemes in cells the ghosts are the particles in the blocks of own particles and about their nodes. The positions
of blocks depend on the particles of all ranks: on their numbers in each leaf and their h, the mean h, and the frame.
A first pass over own particles finds these collectively, and then the blocks of own particles. For schemes of pairs
the ghosts are all particles of other ranks, and each rank computes the whole kick.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from discsim.drag.cells import ABOUT_GRAINS, Merged, about_grains
from discsim.drag.known import Known
from discsim.kernels.drag.blocks import LEVELS, MOST
from discsim.kernels.drag.tsc import levels
from discsim.kernels.mpi.halo import (
    batches_near,
    block_number_ranges,
    blocks_in,
    mark_blocks,
    mark_held,
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
    from discsim.effects.drag import Effect as Drag
    from discsim.ranks.division import Division

Array = np.ndarray
HEAT = 2  # more rings: a node gets heat from the particles of its cell, and from nodes about it that have no gas


class Agreement(Known):
    """Collective results of the first pass over own particles, for use in the kick."""

    def __init__(self, parts: Leaves) -> None:
        self.parts, self.found, self._own_blocks = parts, dict[str, Any](), 0
        self._leaves = dict[str, Array]()
        self._held: Array | None = None

    def __call__(self, name: str, find: Callable[[], Any]) -> Any:
        if name not in self.found:
            self.found[name] = find()
        return self.found[name]

    def own_blocks(self, count: int) -> int:
        return self._own_blocks

    def part_of(self, lattice: Lattice, shift: Array, species: Sequence[Any]) -> Lattice:
        return self.parts.part_of(lattice, shift, species)

    def summed(self, lattice: Lattice, *held: Array) -> list[Array]:
        out, self._held = self.parts.summed(lattice, *held)
        return out

    def held(self, lattice: Lattice, leaves: Sequence[Array]) -> Array:
        """Return which leaves of a part hold own particles, also if `summed` was not called.

        `leaves` has the leaf of each own particle, by species.
        """
        if self._held is None:
            self._held = np.zeros(math.prod(lattice.shape) + 1, bool)
            for leaf in leaves:
                self._held[leaf] = True
            self._held = self._held[:-1]
        return self._held

    def leaves(self, name: str, pos: Array, find: Callable[[Array], Array]) -> Array:
        """Return the leaf of each position, as `Known.leaves`.

        The second call finds the leaves of ghosts alone. The leaves of own particles are those of the first call,
        whose array the caller may overwrite afterwards.
        """
        known = self._leaves.pop(name, None)
        if known is None:
            known = self._leaves[name] = find(pos)
            return known
        own, both = len(known), alloc.grow(known, len(pos))
        if both is None:
            return np.concatenate([known, find(pos[own:])])
        both[own:] = find(pos[own:])  # those of ghosts
        return both

    def leave(self, own: Array, needed: Array) -> None:
        """Keep only the blocks `needed` (blocks,) in the results, with the `own` ones first."""
        some = np.concatenate([np.flatnonzero(own), np.flatnonzero(needed & ~own)])
        self._own_blocks = int(np.count_nonzero(own))
        for name, each in self.found.items():
            self.found[name] = _some(each, some) if isinstance(each, Merged) else each


def _some(blocks: Merged, some: Array) -> Merged:
    """Return the blocks `some`, and renumber blocks in their leaves in place."""
    number = np.full(len(blocks.level) + 2, -1, np.int32)  # -1: of no block
    number[some] = np.arange(len(some))
    parallel_for(renumber, len(blocks.number), blocks.number, number, light=True)
    return Merged(blocks.number, *(each[some] for each in blocks[1:]))


class DividedDrag:
    """Kick of a scheme, in place of `Scheme.relax`, and its time-step limit, in place of `Scheme.limit`."""

    def __init__(self, drag: Drag, division: Division) -> None:
        self.division, self.comm, self.drag, self.scheme = division, division.comm, drag, drag.scheme
        self.leaves = Leaves(self.comm)

    def __call__(self, drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
        if self.scheme.members is None:
            wides = self._everyone(state)
            with world.apart():
                self._kick(drag, state, wides, dt, gas_vel, heat)
            return
        self.forget()
        wides = self._hung_on(drag, state)
        self._kick(drag, state, wides, dt, gas_vel, heat)
        drag.agree = Known()  # frees arrays of leaves

    def forget(self) -> None:
        """Free the arrays of the last kick, which its stopping times refer to: forces need the memory."""
        self.drag.stopping_times = np.empty(0)
        self.drag.buffers.clear()

    def limit(self, drag: Drag, state: State) -> float:
        """Return the time-step limit of a scheme of pairs, that of all particles."""
        assert self.scheme.limit is not None
        both = self._both(state, self._everyone(state))
        with world.apart():
            return self.scheme.limit(drag, both)

    def _kick(self, drag: Drag, state: State, wides: dict[str, Any], dt: float, gas_vel: Array, heat: Array) -> None:
        gas, dust = wides["gas"], wides["dust"]
        if self.scheme.members is None:
            both, vel = self._both(state, wides), gas.of(gas_vel)
        else:
            both = self._both_in_cells(drag, state, wides, gas_vel)
            vel = both.gas.vel
        classes, warmed = drag.classes, np.zeros(gas.count if drag.drag.heating else 0)
        own = classes.of
        if classes.several or self.scheme.members is None:
            classes.of = dust.of(own)
        self.scheme.relax(drag, both, dt, vel, warmed)
        classes.of = own
        gas.keep(gas_vel, vel)
        dust.keep(state.dust.vel, both.dust.vel)
        if drag.drag.heating:
            heat[:] = warmed[gas.own]
        drag.alone = dust.own_among(drag.alone)
        times = drag.found_times
        drag.stopping_times = lambda: (times() if callable(times) else times)[dust.own]

    def _both(self, state: State, wides: dict[str, Any]) -> State:
        """Return a state with all arrays of own particles and ghosts."""
        there = self._there([*state.own_acc.values()])
        own_acc = {
            name: wides[name].of(acc) if some else acc[:0]
            for (name, acc), some in zip(state.own_acc.items(), there, strict=True)
        }
        species: dict[str, Any] = {
            name: type(p)(**{key: wides[name].of(array) for key, array in p.arrays().items() if key != "place"})
            for name, p in state.species.items()
        }
        return replace(state, own_acc=own_acc, **species)

    def _both_in_cells(self, drag: Drag, state: State, wides: dict[str, Any], gas_vel: Array) -> State:
        """Return a state with the arrays of own particles and ghosts that the scheme reads.

        The gas has the velocities `gas_vel`. The data of `about_grains` are fetched with those of the dust, and
        stored as a collective result.
        """
        reads = {*self.scheme.reads, *(("acc",) if drag.drag.heating else ())}
        held = {name: p.arrays() for name, p in state.species.items()}
        held["gas"]["vel"] = gas_vel
        beside = {"own_acc gas": state.own_acc["gas"], "own_acc dust": state.own_acc["dust"]}
        beside["about dust"] = about = about_grains(drag, state)
        there = dict(zip(beside, self._there([*beside.values()]), strict=True))
        found: dict[str, Any] = {}
        own_acc = {}
        for name, arrays in held.items():
            sent = {key: array for key, array in arrays.items() if key in reads}
            sent |= {key: beside[key] for key in beside if there[key] and key.endswith(name)}
            both = dict(zip(sent, wides[name].of_all([*sent.values()]), strict=True))
            own_acc[name] = both.pop(f"own_acc {name}", state.own_acc[name][:0])
            about = both.pop(f"about {name}", about)
            found[name] = _made(state.species[name], wides[name], both)
        drag.agree(ABOUT_GRAINS, lambda: about)
        return replace(state, own_acc=own_acc, **found)

    def _there(self, arrays: list[Array]) -> list[bool]:
        """Return for each array whether it has entries on any rank."""
        return list(self.comm.reduced(np.array([len(array) for array in arrays]), MPI.MAX) > 0)

    def _everyone(self, state: State) -> dict[str, Any]:
        """Fetch all particles: a pair's exchange depends on other pairs, and through these on all ranks."""
        return {name: world.together.everyone(p) for name, p in state.species.items()}

    def _hung_on(self, drag: Drag, state: State) -> dict[str, Any]:
        """Fetch the particles of the blocks that own particles depend on."""
        rings = self.scheme.rings + (HEAT if drag.drag.heating and self.scheme.rings >= 0 else 0)
        while True:
            agreement = drag.agree = Agreement(self.leaves)
            lattice, blocks, *leaves = self.scheme.members(drag, state)
            blocks.number[-1] = len(blocks.level)  # for particles outside
            own = np.zeros(len(blocks.level), bool)
            held = agreement.held(lattice, leaves)
            parallel_for(mark_held, len(held), held, blocks.number, own, light=True)
            # Nodes are of one level: a block depends on others of its own side, up to `rings` + 2 away.
            widest = int(blocks.level[own].max(initial=0))
            away = -(-(rings + 2 << widest) // MOST) if rings >= 0 else 0
            if self.leaves.suffices(world.together.most(away)):
                break
        needed = own if rings < 0 else _needed(blocks, lattice, own, away, rings, drag.dim == 1)
        asked = asked_of(self.comm, Needed(np.append(needed, False), *numbers_of(blocks, lattice)))
        near = _largest_with(blocks, lattice, np.diff(asked.number[:-1]) > 0)[0]
        wides = {
            name: in_cells(self.comm, p, leaf, asked, blocks.number, self._batches(p.pos, lattice, near))
            for (name, p), leaf in zip(state.species.items(), leaves, strict=True)
        }
        agreement.own_grains = wides["dust"].own
        agreement.leave(own, needed)
        return wides

    def _batches(self, pos: Array, lattice: Lattice, marked: Array) -> Array:
        """Return the batches of positions of which any may be in largest blocks that are `marked` (x, y)."""
        bounds, along = self.division.bounds(pos), np.array([1.0, self.drag.dim - 1.0])  # 0 in one dimension
        part = *map(float, lattice.first), *(lattice.periodic * along * lattice.whole).tolist()
        given = bounds, along * lattice.origin, lattice.side, part, MOST, marked
        return joined(parallel_for(batches_near, len(bounds), *given, least=LEAST))


def _needed(blocks: Merged, lattice: Lattice, own: Array, away: int, rings: int, flat: bool) -> Array:
    """Return the blocks (blocks,) that particles of `own` blocks (blocks,) depend on.

    They are at most `away` largest blocks from own ones. The search covers only largest blocks near both own blocks
    and others.
    """
    needed, held = own.copy(), _largest_with(blocks, lattice, own)
    some = blocks_in(blocks.first_leaf, widened(held[0], lattice, away) & widened(held[1], lattice, away))
    if len(some) > 0:
        lattices, found = levels.lattices(*lattice.shape, lattice.joined, LEVELS + 1), own[some]
        home, _, about, near = levels.list_nodes(blocks.level[some], blocks.first_leaf[some], lattices, flat)
        mark_blocks(np.flatnonzero(found), home, about, near, rings, found)
        needed[some] = found
    return needed


def _largest_with(blocks: Merged, lattice: Lattice, chosen: Array) -> Array:
    """Return the largest blocks (2, x, y) that hold any of the `chosen` blocks (blocks,), and any others."""
    out = np.zeros((2, *(-(-n // MOST) for n in lattice.shape)), bool)
    mark_top_blocks(blocks.first_leaf, chosen, out)
    return out


def numbers_of(blocks: Merged, lattice: Lattice) -> tuple[Array, Array]:
    """Return the ranges of numbers of blocks in the whole lattice, from begin up to end, in leaves.

    The order is by largest block, and along a Z-curve in each. One more entry, for particles outside, comes last.
    """
    count = len(blocks.level)
    begin, end = np.full(count + 1, 2**62), np.full(count + 1, 2**62 + 1)
    block_number_ranges(blocks.first_leaf, blocks.level, lattice.first, -(-lattice.whole[1] // MOST), begin, end)
    return begin, end


def _made(particles: Any, wide: Any, both: dict[str, Array]) -> Any:
    """Return particles with the arrays of own particles and ghosts in `both`; other required arrays have no entries.

    `acc` is an exception: it has own entries, and uninitialised ones of ghosts.
    """
    arrays = both if "acc" in both else both | {"acc": wide.beside(particles.acc)}
    for each in fields(particles):
        if each.default is MISSING:
            arrays.setdefault(each.name, getattr(particles, each.name)[:0])
    made = type(particles)(place=wide.place, **arrays)
    made.loose = wide.loose
    return made
