"""Drag cells: merge leaves of a lattice to blocks, sort gas and dust into blocks, and apply drag in each block.

A leaf is a small square. A block is a square of 1, 2, 4, ... by as many leaves (`kernels/drag/blocks.py`), and is the
drag cell of a scheme.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from discsim.drag.base import EMPTY, NO_ROWS, CellRule, DragLaw, Dust, Gas, KickContext, KickResult
from discsim.drag.frame import is_clockwise
from discsim.kernels.drag import blocks as kernels
from discsim.kernels.drag import types
from discsim.kernels.drag.blocks import IGNORE, INSIDE, LEVELS
from discsim.kernels.drag.cells import BlockCorners, relax_blocks
from discsim.kernels.drag.frame import Frame
from discsim.numerics import alloc, world
from discsim.numerics.grid import Grid
from discsim.numerics.layout import leaf_side_and_counts
from discsim.numerics.sorting import counting_sort, key_counts
from discsim.numerics.threads import parallel_for

Array = np.ndarray
# For its sum over a leaf, h is rounded to a whole multiple of 2^-H_BITS times the largest h, which keeps 9 digits. Sums
# over up to 2^23 particles are then exact, and do not depend on the order of the particles.
H_BITS = 30

# Shift a of the lattice's origin in each step along x and y, as a fraction of the side of the largest blocks. The
# values were found by search: n a 2^k mod 1 is well spread over the steps n, for k = 0 to 5 (n |n a 2^k - nearest whole
# number| >= 0.17 for n <= 60).
SHIFT_STEP = np.array([0.70493075, 0.64794019])


class Lattice(NamedTuple):
    """Lattice of square leaves that covers the grid of a run, or the part of the lattice that a rank has.

    origin (2,): lower corner of the grid. extent (2,): size of the grid in leaves. margin: number of additional
    leaves on every side of the grid; particles outside the lattice feel no drag. side: side of a leaf, in two
    dimensions a whole number of grid cells. whole: number of leaves of the whole lattice along x and y. periodic:
    whether space is periodic. first, shape: the part of this rank begins at the leaf `first` and has `shape` leaves
    along x and y; in serial runs this part is the whole lattice.
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
        """Two booleans (2,): whether this rank's part of the lattice is periodic along x, and along y."""
        return self.periodic & (np.array(self.shape) == self.whole)


class Merged(NamedTuple):
    """Blocks into which the leaves of a part of a lattice are merged.

    number (leaves + 1,): index of the block of each leaf; the last entry is for particles outside the lattice.
    first_leaf (blocks, 2): indices (ix, iy) of the lowest leaf of each block in this part of the lattice. level
    (blocks,): log2 of the side of each block in leaves. enlarged (blocks,): whether a block was enlarged for lack of
    particles.
    """

    number: Array
    first_leaf: Array
    level: Array
    enlarged: Array


class Layout(NamedTuple):
    """Blocks of a time step, and the leaf of each particle.

    lattice: lattice of leaves with the origin of this step. merged: blocks of the lattice. own: number of blocks with
    local particles; these blocks come first. leaf_of: function that returns the leaves (n,) of positions (n, d).
    gas_leaf, dust_leaf (n,): index of the leaf of each particle; for particles outside the lattice, the number of
    leaves.
    """

    lattice: Lattice
    merged: Merged
    own: int
    leaf_of: Callable[[Array], Array]
    gas_leaf: Array
    dust_leaf: Array


class Blocks(NamedTuple):
    """Blocks, and the particles in each of them.

    The gas particles in block b have the indices gas_order[gas_start[b] : gas_start[b + 1]]. The dust particles of
    class c in block b have the indices dust_order[dust_start[i] : dust_start[i + 1]] with i = b k + c, if there are k
    classes. Two additional blocks at the end have the gas outside the lattice and the dust outside the lattice.

    first_leaf, level, enlarged: as in `Merged`. own: number of blocks with local particles; these blocks come first.
    lattice: lattice of leaves with the origin of this step.
    """

    gas_order: Array
    gas_start: Array
    dust_order: Array
    dust_start: Array
    first_leaf: Array
    level: Array
    enlarged: Array
    own: int
    lattice: Lattice

    def squares(self) -> tuple[Array, Array]:
        """Return the lower corner (blocks, 2) and the side (blocks,) of each block."""
        lattice, corners, sides = self.lattice, np.empty((len(self.level), 2)), np.empty(len(self.level))
        parallel_for(
            kernels.block_squares, len(sides), self.first_leaf, self.level, lattice.origin, lattice.first, lattice.side,
            corners, sides, light=True,
        )  # fmt: skip
        return corners, sides


class OneRank:
    """Communication between ranks for a layout, in a serial run; `ranks/leaves.py` has the class for MPI runs."""

    def part_of(self, lattice: Lattice, shift: Array, positions: Sequence[Array]) -> Lattice:
        """Return the part of a lattice that this rank needs: here the whole lattice.

        shift (2,): shift of the lattice's origin in leaves. positions: arrays (n, d) of local positions.
        """
        return lattice

    def summed(self, lattice: Lattice, *sums: Array) -> Sequence[Array]:
        """Return for each leaf the sums over all ranks; sums (leaves + 1,): sums over local particles."""
        return sums


def lattice_on(grid: Grid, dim: int, least_side: float, gas: int) -> Lattice:
    """Return the lattice that covers a grid, with leaves that are at least `least_side` wide.

    dim: number of dimensions. gas: number of gas particles. In open space the lattice is larger than the grid by one
    block of the largest size, so that its origin can shift.
    """
    side, numbers = leaf_side_and_counts(least_side, grid.cell, grid.shape[:dim], grid.periodic, gas)
    extent = np.array(grid.shape) * grid.cell / side
    if not grid.periodic:
        # With a whole number of blocks of the largest size, a mirrored lattice has mirrored blocks.
        numbers = [(-(-n // 2**LEVELS) + 1) * 2**LEVELS for n in numbers]
    whole = numbers[0], numbers[1] if dim == 2 else 1
    return Lattice(np.array(grid.origin), extent, 0, side, whole, grid.periodic, (0, 0), whole)


def lay_blocks(
    gas: Gas, dust: Dust, rule: CellRule, ranks: OneRank, dust_in: int, shifted: bool, mirrored: bool = False
) -> Layout:
    """Find the leaf of each particle, merge leaves to blocks, and return the layout.

    dust_in: where a block needs dust: IGNORE, NEAR or INSIDE of `kernels/drag/blocks.py`. shifted: whether the lattice
    shifts in every step. mirrored: whether the lattice is mirrored, y -> -y.
    """
    leaves = rule.lattice
    shift, part, find, keys, (n_gas, n_dust, outside) = _find_leaves(gas, dust, rule, ranks, leaves, shifted, mirrored)
    if not leaves.periodic and outside > 0:
        leaves = _with_margin(leaves, rule.dim)  # a margin for particles outside the grid
        shift, part, find, keys, (n_gas, n_dust, _) = _find_leaves(gas, dust, rule, ranks, leaves, shifted, mirrored)
    required = leaves.side, rule.size, rule.length, *rule.fewest, rule.soft, rule.hard, dust_in
    merged = merge(*_sums_in_leaves(ranks, part, n_gas, n_dust, keys[0], rule.lengths), part.shape, *required)
    moved = part._replace(origin=leaves.origin - shift * leaves.side)
    return Layout(moved, merged, len(merged.level), find, *keys)


def sort_into_blocks(gas: Gas, dust: Dust, rule: CellRule, layout: Layout) -> Blocks:
    """Return the blocks of a layout with their gas and dust. Overwrites `gas_leaf` and `dust_leaf` of `layout`."""
    lattice, (number, first_leaf, level, enlarged), own, _, gas_key, dust_key = layout
    # Particles outside the lattice feel no drag: their gas and their dust get one additional block each.
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
    """Return (shift, part, find, keys, numbers) for a lattice of leaves; arguments as in `lay_blocks`.

    shift (2,): shift of the lattice's origin in leaves. part: part of the lattice that this rank has. find: function
    that returns the leaves of positions. keys: leaves of the local gas and of the local dust. numbers: result of
    `_counts_in_leaves`.
    """
    shift = _lattice_shift(rule, leaves, shifted, mirrored)
    part = ranks.part_of(leaves, shift, (gas.pos, dust.pos))
    find = partial(_leaf_of_each, part, shift)
    keys = find(gas.pos), find(dust.pos)
    return shift, part, find, keys, _counts_in_leaves(part, *keys)


def _counts_in_leaves(part: Lattice, *keys: Array) -> tuple[Array, Array, int]:
    """Return the numbers of gas and of dust particles in each leaf, and the number of particles outside the lattice.

    The numbers in leaves are those of local particles; the number outside is summed over all ranks. keys: leaf of each
    local gas particle (n,), and of each local dust particle.
    """
    count = math.prod(part.shape) + 1
    gas, dust = (key_counts(key, count) for key in keys)
    return gas, dust, int(world.processes.sum(int(gas[-1]) + int(dust[-1])))


def _sums_in_leaves(
    ranks: OneRank, part: Lattice, n_gas: Array, n_dust: Array, key: Array, h: Array
) -> tuple[Array, Array, Array]:
    """Return three sums over the particles of all ranks in each leaf: numbers of gas and of dust, and h of the gas.

    n_gas, n_dust: numbers of local particles in each leaf. key, h (n,): leaf and smoothing length of each local gas
    particle.
    """
    unit = 2.0 ** (math.frexp(world.processes.max(float(h.max(initial=0.0))))[1] - H_BITS)
    h_sum = np.zeros(len(n_gas))
    kernels.add_in_units(key, h, 1.0 / unit, h_sum)
    n_gas, n_dust, h_sum = ranks.summed(part, n_gas, n_dust, h_sum)
    h_sum *= unit
    return n_gas, n_dust, h_sum


def _with_margin(leaves: Lattice, dim: int) -> Lattice:
    """Return the lattice `leaves` with an additional block of the largest size on every side."""
    nx, ny = leaves.whole
    more = 2 * 2**LEVELS
    whole = nx + more, ny + more if dim == 2 else 1
    return leaves._replace(margin=2**LEVELS, whole=whole, shape=whole)


def _lattice_shift(rule: CellRule, leaves: Lattice, shifted: bool, mirrored: bool) -> Array:
    """Return the shift (2,) of the lattice's origin in this step, in leaves; arguments as in `lay_blocks`."""
    shift = np.zeros(2)
    if shifted:
        shift[: rule.dim] = ((rule.step * SHIFT_STEP) % 1.0 * 2**LEVELS)[: rule.dim]
    shift[: rule.dim] += leaves.margin
    if mirrored:
        shift[1] = leaves.whole[1] + 2.0 * leaves.origin[1] / leaves.side - shift[1]
    return shift


def _leaf_of_each(part: Lattice, shift: Array, pos: Array) -> Array:
    """Return the index of the leaf of each position (n, d); for positions outside the lattice, the number of leaves.

    part: part of the lattice that this rank has. shift (2,): shift of the lattice's origin in leaves.
    """
    low, high = shift - part.margin, shift + part.extent + part.margin
    key = alloc.allocate_like(pos, np.uint32)
    parallel_for(
        kernels.leaf_keys, len(pos), pos, part.origin, shift, low, high, 1.0 / part.side,
        part.whole, part.first, part.shape, part.periodic, key, light=True,
    )  # fmt: skip
    return key


def merge(gas: Array, dust: Array, h_sum: Array, shape: tuple[int, int], *required: Any) -> Merged:
    """Merge leaves to blocks, and return the blocks.

    gas, dust (leaves,): numbers of gas and dust particles in each leaf. h_sum (leaves,): sum of the smoothing lengths
    of the gas in each leaf. shape: number of leaves along x and y. required: fields of `BlockRequirements` of
    `kernels/drag/blocks.py`.
    """
    width, height = ((side - 1 >> np.arange(LEVELS + 1)) + 1 for side in shape)
    begin = np.append(0, np.cumsum(width * height))
    tree = kernels.Tree(begin, width, height, *np.zeros((2, begin[-1]), bool))
    held = np.zeros(width[-1] * height[-1], np.int64)
    requirements = kernels.BlockRequirements(*required)
    parallel_for(kernels.merge, len(held), gas, dust, h_sum, requirements, tree, held, least=1)
    start = np.append(0, np.cumsum(held))
    count = start[-1]
    number = np.full(begin[1] + 1, -1, np.int32)
    first_leaf, level, flag = np.empty((count, 2), np.int32), np.empty(count, np.int64), np.empty(count, bool)
    parallel_for(kernels.number_blocks, len(held), start, tree, number, first_leaf, level, flag, least=1)
    return Merged(number, first_leaf, level, flag)


def law_over(law: DragLaw, dt: float) -> types.LawOverStep:
    """Return the drag law of a kick and its length dt, in the form that kernels take."""
    return types.LawOverStep(law.code, law.grains, law.two_way, dt, law.exponential)


def species_in(gas: Gas, dust: Dust, classes: int, blocks: Blocks) -> tuple[types.Species, types.Species]:
    """Return gas and dust, each sorted into blocks, in the form that kernels take. classes: number of dust classes."""
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
    """Return the layout of the blocks of `relax_in_blocks`, as `Scheme.layout`; linear: as in `relax_in_blocks`."""
    dust_in = INSIDE if rule.two_way else IGNORE
    return lay_blocks(gas, dust, rule, ranks, dust_in, linear, linear and is_clockwise(frame))


def relax_in_blocks(
    gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, blocks: Blocks, context: KickContext, linear: bool
) -> KickResult:
    """Kick gas and dust in place, with drag between the particles of each block (`kernels/drag/cells.py`).

    The other arguments are those of `Scheme.kick`. linear: whether the velocity field of a species in a block is a
    linear function of position; otherwise it is uniform.
    """
    classes = len(law.grains)
    corners = np.concatenate([blocks.squares()[0], np.zeros((2, 2))])
    times = np.empty((len(corners), classes))
    parallel_for(
        relax_blocks, len(corners), *species_in(gas, dust, classes, blocks), BlockCorners(corners, context.period),
        law_over(law, dt), linear, law.nonlinear, law.several, frame, times, context.heat, least=64,
    )  # fmt: skip
    start = blocks.dust_start[::classes]
    empty = np.append(blocks.enlarged, [True, True]) | (np.diff(blocks.gas_start) == 0)
    return KickResult(
        kernels.particles_in_blocks(blocks.dust_order, start, empty),
        lambda: kernels.particle_stopping_times(times, blocks.dust_order, blocks.dust_start),
    )
