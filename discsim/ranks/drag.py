"""Drag beside that of other ranks: one kick of own gas and dust and all that these hang on, as on one rank.

In cells that is what lies in own particles' blocks, and about their nodes. What decides where blocks are (numbers of
particles in each leaf and their h, the mean h, the frame) is that of all ranks: a first look at own particles agrees on
it and finds their blocks. Between pairs it is all particles, and each rank makes the whole kick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.cells import about_grains
from discsim.kernels import levels
from discsim.kernels.blocks import LEVELS
from discsim.kernels.halo import mark_blocks
from discsim.numerics import world
from discsim.numerics.state import Dust, Gas, State
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import Wide, in_cells

if TYPE_CHECKING:
    from discsim.drag.cells import Blocks
    from discsim.effects.drag import Effect as Drag

Array = np.ndarray
HEAT = 2  # rings more: a node has heat of the particles of its cell, and of nodes about it that have no gas
READ = ("pos", "vel", "acc", "mass", "ids", "immobile", "h", "density", "gradh", "sound_speed", "species")


class Agreement:
    """What has been found together, once more in the same order."""

    def __init__(self) -> None:
        self.found: list[Any] = []
        self.told: Iterator[Any] | None = None

    def __call__(self, find: Callable[[], Any]) -> Any:
        if self.told is not None:
            return next(self.told)
        self.found.append(find())
        return self.found[-1]

    def repeat(self) -> None:
        self.told = iter(self.found)


class DividedDrag:
    """The kick of a scheme, in place of `Scheme.relax`, and the step that it allows, in place of `Scheme.limit`."""

    def __init__(self, drag: Drag, comm: Comm) -> None:
        self.comm, self.scheme = comm, drag.scheme

    def __call__(self, drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
        if self.scheme.members is None:
            wides = self._everyone(state)
            with world.apart():
                self._kick(drag, state, wides, dt, gas_vel, heat)
            return
        agreement = drag.agree = Agreement()
        wides = self._hung_on(drag, state)
        agreement.found.append(self._wide(wides["dust"], about_grains(drag, state)))
        agreement.repeat()
        self._kick(drag, state, wides, dt, gas_vel, heat)

    def limit(self, drag: Drag, state: State) -> float:
        """Of a scheme of pairs: that of all particles."""
        assert self.scheme.limit is not None
        both = self._both(state, self._everyone(state))
        with world.apart():
            return self.scheme.limit(drag, both)

    def _kick(self, drag: Drag, state: State, wides: dict[str, Wide], dt: float, gas_vel: Array, heat: Array) -> None:
        gas, dust = wides["gas"], wides["dust"]
        both, vel = self._both(state, wides), gas.of(gas_vel)
        classes, warmed = drag.classes, np.zeros(gas.count if drag.drag.heating else 0)
        own = classes.of
        classes.of = dust.of(own)
        self.scheme.relax(drag, both, dt, vel, warmed)
        classes.of = own
        gas_vel[:], state.dust.vel[:] = vel[gas.own], both.dust.vel[dust.own]
        if drag.drag.heating:
            heat[:] = warmed[gas.own]
        alone = np.zeros(dust.count, bool)
        alone[drag.alone] = True
        drag.alone = np.flatnonzero(alone[dust.own])
        times = drag.found_times
        drag.stopping_times = lambda: (times() if callable(times) else times)[dust.own]

    def _both(self, state: State, wides: dict[str, Wide]) -> State:
        own_acc = {name: self._wide(wides[name], acc) for name, acc in state.own_acc.items()}
        return replace(state, gas=_of(wides["gas"], state.gas), dust=_of(wides["dust"], state.dust), own_acc=own_acc)

    def _wide(self, wide: Wide, array: Array) -> Array:
        """An array of both, where any rank has entries of it."""
        return wide.of(array) if self.comm.mpi.allreduce(len(array)) > 0 else array[:0]

    def _everyone(self, state: State) -> dict[str, Wide]:
        """All particles: what pairs exchange hangs on others' pairs, and these on others again."""
        return {name: world.together.everyone(p) for name, p in state.species.items()}

    def _hung_on(self, drag: Drag, state: State) -> dict[str, Wide]:
        """The particles of the blocks that own ones hang on."""
        blocks = self.scheme.members(drag, state)
        keys = (
            _blocks_of(blocks.gas_order, blocks.gas_start, 1),
            _blocks_of(blocks.dust_order, blocks.dust_start, drag.classes.number),
        )
        needed = self._needed(drag, blocks, keys)
        return {
            name: in_cells(self.comm, p, key, needed)
            for (name, p), key in zip(state.species.items(), keys, strict=True)
        }

    def _needed(self, drag: Drag, blocks: Blocks, keys: tuple[Array, Array]) -> Array:
        """The blocks (blocks + 2,), with the last two of what is outside, that own particles hang on."""
        count, grid, rings = len(blocks.level), blocks.lattice, self.scheme.rings
        needed, own = np.zeros(count + 2, bool), np.unique(np.concatenate(keys))
        if rings >= 0 and drag.drag.heating:
            rings += HEAT
        lattices = levels.lattices(*grid.shape, grid.periodic, LEVELS + 1)
        home, _, about, near = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, drag.dim == 1)
        mark_blocks(own[own < count], home, about, near, rings, needed)
        return needed


def _blocks_of(order: Array, start: Array, populations: int) -> Array:
    """The block of each particle (n,)."""
    key = np.empty(len(order), np.int64)
    key[order] = np.repeat(np.arange(len(start) - 1) // populations, np.diff(start))
    return key


def _of(wide: Wide, particles: Gas | Dust) -> Any:
    """The particles that a kick reads; arrays that it does not have no entries."""
    arrays = {}
    for name, array in particles.arrays().items():
        if name in READ:
            arrays[name] = wide.of(array)
        elif name in REQUIRED:
            arrays[name] = array[:0]
    return type(particles)(**arrays)


REQUIRED = ("pressure",)  # that gas cannot be made without
