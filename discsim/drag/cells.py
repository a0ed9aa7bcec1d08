"""Drag cells: merge leaves of a lattice to blocks, sort gas and dust into blocks, and apply drag in each block.

A block is a square of leaves and the drag cell of a scheme (`kernels/drag/blocks.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from discsim.drag.base import EMPTY, NO_ROWS, CellRule, Dust, Gas, Kicked, Law, Work
from discsim.drag.frame import clockwise
from discsim.kernels.drag import blocks as kernels
from discsim.kernels.drag import types
from discsim.kernels.drag.blocks import IGNORE, INSIDE, LEVELS
from discsim.kernels.drag.cells import Corners, relax_blocks
from discsim.kernels.drag.frame import Frame
from discsim.numerics import alloc, world
from discsim.numerics.grid import Grid
from discsim.numerics.layout import leaves
from discsim.numerics.sorting import counting_sort, key_counts
from discsim.numerics.threads import parallel_for

Array = np.ndarray
# Sums of h over a leaf are sums of whole multiples of 2^-H_BITS times the largest h. They are exact for up to 2^23
# particles, and so independent of their order; h itself is rounded to 9 digits.
H_BITS = 30

# Shift a of the lattice's origin in each step along each axis, as a fraction of the largest block. After n steps,
# n a 2^k mod 1 is well spread for k = 0..5 (n |n a 2^k - nearest whole number| >= 0.17 for n <= 60; found by search).
SHIFT_STEP = np.array([0.70493075, 0.64794019])


class Lattice(NamedTuple):
    """Lattice of square leaves, or the part of it that a process has.

    origin (2,): lower corner of the grid that the lattice covers. extent (2,): size of this grid in leaves. margin:
    number of additional leaves on every side; particles beyond them feel no drag. side: side of a leaf, in two
    dimensions a whole number of grid cells. whole: number of leaves along each axis. periodic: whether space is
    periodic. first, shape: first leaf and number of leaves along each axis of the part of this process; in serial runs
    the part is the whole lattice.
    """

    origin: Array
    extent: Array
    margin: int
    side: float
    whole: tuple[int, int]
    periodic: bool
    first: tuple[int, int]
    shape: tuple[int, int]

    @property
    def joined(self) -> Array:
        """True for each axis (2,) along which this part is periodic."""
        return self.periodic & (np.array(self.shape) == self.whole)


class Merged(NamedTuple):
    """Blocks into which leaves are merged.

    number (leaves + 1,): index of the block of each leaf; the last entry is for particles outside the lattice.
    first_leaf (blocks, 2): lowest leaf (ix, iy) of each block, relative to this part of the lattice. level (blocks,):
    log2 of the width of each block in leaves. enlarged (blocks,): whether a block is wider than its target for lack of
    particles.
    """

    number: Array
    first_leaf: Array
    level: Array
    enlarged: Array


class Layout(NamedTuple):
    """Blocks of a step, and the leaf of each particle.

    lattice: lattice with the origin of this step. merged: its blocks. own: number of blocks with local particles, which
    come first. leaf_of: return the leaves (n,) of positions (n, d). gas_leaf, dust_leaf (n,): leaf of each particle;
    the number of leaves for particles outside the lattice.
    """

    lattice: Lattice
    merged: Merged
    own: int
    leaf_of: Callable[[Array], Array]
    gas_leaf: Array
    dust_leaf: Array


class Blocks(NamedTuple):
    """Particles of each block.

    The indices of the gas in block b are gas_order[gas_start[b] : gas_start[b + 1]]. For dust of class c among k
    classes, the same holds with dust_order, dust_start and b k + c in place of b. Two additional blocks at the end hold
    the gas and the dust outside the lattice.
    """

    gas_order: Array
    gas_start: Array
    dust_order: Array
    dust_start: Array
    first_leaf: Array  # (blocks, 2), as in `Merged`
    level: Array  # (blocks,)
    enlarged: Array  # (blocks,)
    own: int  # number of blocks with local particles, which are the first ones
    lattice: Lattice  # with the origin of this step

    def squares(self) -> tuple[Array, Array]:
        """Return the lower corner (blocks, 2) and the side (blocks,) of each block."""
        lattice, corners, sides = self.lattice, np.empty((len(self.level), 2)), np.empty(len(self.level))
        parallel_for(
            kernels.squares_of, len(sides), self.first_leaf, self.level, lattice.origin, lattice.first, lattice.side,
            corners, sides, light=True,
        )  # fmt: skip
        return corners, sides


class OneRank:
    """Communication that a layout needs, in a serial run; `ranks/leaves.py` has its counterpart for several ranks."""

    def part_of(self, lattice: Lattice, shift: Array, positions: Sequence[Array]) -> Lattice:
        """Return the part of a lattice that contains local positions; `shift` (2,) is in leaves."""
        return lattice

    def summed(self, lattice: Lattice, *held: Array) -> Sequence[Array]:
        """Return sums over all ranks for each leaf of a part, from local sums of integers (leaves + 1,)."""
        return held


def lattice_on(grid: Grid, dim: int, wanted: float, gas: int) -> Lattice:
    """Return a lattice on the grid with leaves that are at least `wanted` wide.

    dim: number of dimensions. gas: number of gas particles. An open lattice is larger than the grid by one block of the
    largest size, so that its origin can shift.
    """
    side, numbers = leaves(wanted, grid.cell, grid.shape[:dim], grid.periodic, gas)
    extent = np.array(grid.shape) * grid.cell / side
    if not grid.periodic:
        # With a whole number of blocks of the largest size, a mirrored lattice has mirrored blocks.
        numbers = [(-(-n // 2**LEVELS) + 1) * 2**LEVELS for n in numbers]
    whole = numbers[0], numbers[1] if dim == 2 else 1
    return Lattice(np.array(grid.origin), extent, 0, side, whole, grid.periodic, (0, 0), whole)


def lay_blocks(
    gas: Gas, dust: Dust, rule: CellRule, ranks: OneRank, dust_in: int, shifted: bool, mirrored: bool = False
) -> Layout:
    """Merge leaves to blocks and return the layout.

    dust_in: where a block needs dust, as in `kernels.Wanted`. shifted: whether the lattice shifts in every step.
    mirrored: whether the lattice is mirrored, y -> -y.
    """
    leaves = rule.lattice
    shift, part, find, keys, (n_gas, n_dust, outside) = _find_leaves(gas, dust, rule, ranks, leaves, shifted, mirrored)
    if not leaves.periodic and outside > 0:
        leaves = _with_margin(leaves, rule.dim)  # a margin for particles outside the grid
        shift, part, find, keys, (n_gas, n_dust, _) = _find_leaves(gas, dust, rule, ranks, leaves, shifted, mirrored)
    wanted = leaves.side, rule.size, rule.length, *rule.fewest, rule.soft, rule.hard, dust_in
    merged = merge(*_sums_in_leaves(ranks, part, n_gas, n_dust, keys[0], rule.lengths), part.shape, *wanted)
    moved = part._replace(origin=leaves.origin - shift * leaves.side)
    return Layout(moved, merged, len(merged.level), find, *keys)


def sort_into_blocks(gas: Gas, dust: Dust, rule: CellRule, layout: Layout) -> Blocks:
    """Sort gas and dust into blocks. Overwrites the leaves of particles in `layout`."""
    lattice, (number, first_leaf, level, enlarged), own, _, gas_key, dust_key = layout
    # Particles outside the lattice feel no drag. They get one additional block for each species.
    count = len(level)
    number[-1] = count
    parallel_for(kernels.block_keys, len(gas_key), gas_key, number, NO_ROWS, 1, light=True)
    number[-1] = count + 1
    parallel_for(kernels.block_keys, len(dust_key), dust_key, number, dust.class_of, rule.classes, light=True)
    sorted_gas = counting_sort(gas_key, count + 2, gas.global_index, gas.unsorted_rows)
    sorted_dust = counting_sort(dust_key, (count + 2) * rule.classes, dust.global_index, dust.unsorted_rows)
    return Blocks(*sorted_gas, *sorted_dust, first_leaf, level, enlarged, own, lattice)


def _find_leaves(
    gas: Gas, dust: Dust, rule: CellRule, ranks: OneRank, leaves: Lattice, shifted: bool, mirrored: bool
) -> tuple[Any, ...]:
    """Return (shift, part, find, keys, numbers) for a lattice of leaves.

    shift (2,): shift of its origin. part: part of this rank. find: return the leaves of positions. keys: leaves of the
    local gas and dust. numbers: result of `_counts_in_leaves`.
    """
    shift = _shift(rule, leaves, shifted, mirrored)
    part = ranks.part_of(leaves, shift, (gas.pos, dust.pos))
    find = partial(_leaf_of_each, part, shift)
    keys = find(gas.pos), find(dust.pos)
    return shift, part, find, keys, _counts_in_leaves(part, *keys)


def _counts_in_leaves(part: Lattice, *keys: Array) -> tuple[Array, Array, int]:
    """Return the numbers of local gas and of local dust in each leaf, and the number of particles outside the lattice.

    The last number is that of all ranks.
    """
    count = math.prod(part.shape) + 1
    gas, dust = (key_counts(key, count) for key in keys)
    return gas, dust, int(world.processes.sum(int(gas[-1]) + int(dust[-1])))


def _sums_in_leaves(
    ranks: OneRank, part: Lattice, n_gas: Array, n_dust: Array, key: Array, h: Array
) -> tuple[Array, Array, Array]:
    """Return sums over all ranks for each leaf (leaves,): numbers of gas and dust particles, and h of the gas.

    key (n,), h (n,): leaf and smoothing length of local gas particles.
    """
    unit = 2.0 ** (math.frexp(world.processes.most(float(h.max(initial=0.0))))[1] - H_BITS)
    held = np.zeros(len(n_gas))
    kernels.add_in_units(key, h, 1.0 / unit, held)
    n_gas, n_dust, held = ranks.summed(part, n_gas, n_dust, held)
    held *= unit
    return n_gas, n_dust, held


def _with_margin(leaves: Lattice, dim: int) -> Lattice:
    """Return a lattice with an additional block of the largest size on every side."""
    nx, ny = leaves.whole
    more = 2 * 2**LEVELS
    whole = nx + more, ny + more if dim == 2 else 1
    return leaves._replace(margin=2**LEVELS, whole=whole, shape=whole)


def _shift(rule: CellRule, leaves: Lattice, shifted: bool, mirrored: bool) -> Array:
    """Return the shift (2,) of the lattice's origin in leaves."""
    shift = np.zeros(2)
    if shifted:
        shift[: rule.dim] = ((rule.step * SHIFT_STEP) % 1.0 * 2**LEVELS)[: rule.dim]
    shift[: rule.dim] += leaves.margin
    if mirrored:
        shift[1] = leaves.whole[1] + 2.0 * leaves.origin[1] / leaves.side - shift[1]
    return shift


def _leaf_of_each(part: Lattice, shift: Array, pos: Array) -> Array:
    """Return the leaf (n,) of each position (n, d); the number of leaves for positions outside the lattice."""
    low, high = shift - part.margin, shift + part.extent + part.margin
    key = alloc.allocate_like(pos, np.uint32)
    parallel_for(
        kernels.leaf_keys, len(pos), pos, part.origin, shift, low, high, 1.0 / part.side,
        part.whole, part.first, part.shape, part.periodic, key, light=True,
    )  # fmt: skip
    return key


def merge(gas: Array, dust: Array, h_sum: Array, shape: tuple[int, int], *wanted: Any) -> Merged:
    """Merge leaves to blocks.

    gas, dust (leaves,): numbers of particles in each leaf. h_sum (leaves,): sum of the gas's h in each leaf. shape:
    number of leaves along each axis. wanted: fields of `kernels.Wanted`.
    """
    width, height = ((side - 1 >> np.arange(LEVELS + 1)) + 1 for side in shape)
    begin = np.append(0, np.cumsum(width * height))
    tree = kernels.Tree(begin, width, height, *np.zeros((2, begin[-1]), bool))
    held = np.zeros(width[-1] * height[-1], np.int64)
    parallel_for(kernels.merge, len(held), gas, dust, h_sum, kernels.Wanted(*wanted), tree, held, least=1)
    start = np.append(0, np.cumsum(held))
    count = start[-1]
    number = np.full(begin[1] + 1, -1, np.int32)
    first_leaf, level, flag = np.empty((count, 2), np.int32), np.empty(count, np.int64), np.empty(count, bool)
    parallel_for(kernels.number_blocks, len(held), start, tree, number, first_leaf, level, flag, least=1)
    return Merged(number, first_leaf, level, flag)


def law_over(law: Law, dt: float) -> types.Law:
    """Return the law and the time step dt of a kick as arguments of the kernels."""
    return types.Law(law.code, law.grains, law.two_way, dt, law.exponential)


def species_in(gas: Gas, dust: Dust, classes: int, blocks: Blocks) -> tuple[types.Species, types.Species]:
    """Return gas and dust with their blocks as arguments of the kernels."""
    return (
        types.Species(
            gas.pos, gas.vel, gas.acc, gas.acc_unshared, gas.mass, gas.density, gas.thermal_speed,
            blocks.gas_order, blocks.gas_start, 1, 0,
        ),
        types.Species(
            dust.pos, dust.vel, dust.acc, dust.acc_unshared, dust.mass, dust.per_grain, EMPTY,
            blocks.dust_order, blocks.dust_start, classes, 1,
        ),
    )  # fmt: skip


def layout(gas: Gas, dust: Dust, rule: CellRule, frame: Frame, ranks: OneRank, linear: bool) -> Layout:
    """Return the layout of the blocks of `relax_in_blocks`."""
    dust_in = INSIDE if rule.two_way else IGNORE
    return lay_blocks(gas, dust, rule, ranks, dust_in, linear, linear and clockwise(frame))


def relax_in_blocks(
    gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, blocks: Blocks, work: Work, linear: bool
) -> Kicked:
    """Kick gas and dust, with drag between the particles of each block (`kernels/drag/cells.py`).

    linear: whether the velocity of a species in a block is a linear function of position; else it is the mean.
    """
    classes = len(law.grains)
    corners = np.concatenate([blocks.squares()[0], np.zeros((2, 2))])
    times = np.empty((len(corners), classes))
    parallel_for(
        relax_blocks, len(corners), *species_in(gas, dust, classes, blocks), Corners(corners, work.period),
        law_over(law, dt), linear, law.nonlinear, law.several, frame, times, work.heat, least=64,
    )  # fmt: skip
    start = blocks.dust_start[::classes]
    empty = np.append(blocks.enlarged, [True, True]) | (np.diff(blocks.gas_start) == 0)
    return Kicked(
        kernels.members_of(blocks.dust_order, start, empty),
        lambda: kernels.times_of_members(times, blocks.dust_order, blocks.dust_start),
    )
