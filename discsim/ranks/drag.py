"""Drag in cells beside that of other ranks: one kick of the gas and dust in the blocks that own particles hang on.

What decides where blocks are (numbers of particles in each leaf and their h, the mean h, the frame) is that of all
ranks: a first look at own particles agrees on it and finds their blocks. Then the kick is made of own particles and
those that others have in these blocks, and about their nodes, as on one rank.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.kernels import levels
from discsim.kernels.blocks import LEVELS
from discsim.kernels.halo import mark_blocks
from discsim.numerics.state import Dust, Gas, State
from discsim.ranks.comm import Comm
from discsim.ranks.exchange import Wide, in_cells

if TYPE_CHECKING:
    from discsim.drag.cells import Blocks
    from discsim.effects.drag import Effect as Drag

Array = np.ndarray
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
    """The kick of a scheme of blocks, in place of `Scheme.relax`."""

    def __init__(self, drag: Drag, comm: Comm) -> None:
        self.comm, self.scheme = comm, drag.scheme

    def __call__(self, drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
        agreement = drag.agree = Agreement()
        blocks = self.scheme.members(drag, state)
        keys = (
            _blocks_of(blocks.gas_order, blocks.gas_start, 1),
            _blocks_of(blocks.dust_order, blocks.dust_start, drag.classes.number),
        )
        needed = self._needed(drag, blocks, keys)
        wides = {
            name: in_cells(self.comm, p, key, needed)
            for (name, p), key in zip(state.species.items(), keys, strict=True)
        }
        gas, dust = wides["gas"], wides["dust"]
        own_acc = {
            name: wides[name].of(acc) if self.comm.mpi.allreduce(len(acc)) > 0 else acc[:0]
            for name, acc in state.own_acc.items()
        }
        both = replace(state, gas=_of(gas, state.gas), dust=_of(dust, state.dust), own_acc=own_acc)
        vel = gas.of(gas_vel)
        agreement.repeat()
        drag.classes.sort(both.dust)
        self.scheme.relax(drag, both, dt, vel, heat)
        drag.classes.sort(state.dust)
        gas_vel[:], state.dust.vel[:] = vel[gas.own], both.dust.vel[dust.own]
        alone = np.zeros(dust.count, bool)
        alone[drag.alone] = True
        drag.alone = np.flatnonzero(alone[dust.own])
        times = drag.found_times
        drag.stopping_times = lambda: (times() if callable(times) else times)[dust.own]

    def _needed(self, drag: Drag, blocks: Blocks, keys: tuple[Array, Array]) -> Array:
        """The blocks (blocks + 2,), with the last two of what is outside, that own particles hang on."""
        count, grid = len(blocks.level), blocks.lattice
        needed, own = np.zeros(count + 2, bool), np.unique(np.concatenate(keys))
        lattices = levels.lattices(*grid.shape, grid.periodic, LEVELS + 1)
        home, _, about, near = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, drag.dim == 1)
        mark_blocks(own[own < count], home, about, near, self.scheme.rings, needed)
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
