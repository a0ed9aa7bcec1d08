"""Drag cells: gas and dust sorted into blocks of a lattice, and the schemes that relax each block by itself."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.drag.cloud import densities_of_sparse_dust
from discsim.drag.frame import clockwise, frame
from discsim.kernels.drag import blocks as kernels
from discsim.kernels.drag.blocks import IGNORE, INSIDE, LEVELS
from discsim.kernels.drag.cells import Corners, relax_blocks
from discsim.kernels.drag.frame import Frame
from discsim.kernels.drag.types import Law, Species
from discsim.numerics import room, world
from discsim.numerics.layout import leaves
from discsim.numerics.sorting import counting_sort, counts
from discsim.numerics.threads import share
from discsim.numerics.totals import mean
from discsim.parts import Lazy
from discsim.physics.eos import thermal_speed

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import State

growth = Lazy("discsim.physics.growth")
Array = np.ndarray
NONE = np.empty(0)
NOBODY = np.empty(0, np.int64)
ABOUT_GRAINS = "about grains"  # the name of what is agreed on
# A leaf's h are added in whole units of 2^-H_BITS of the largest, without rounding for 2^23 of them: sums then hang
# on no order, and say to 9 digits whether a block is large enough.
H_BITS = 30

# Steps of the cells' origin, in fractions of the largest block: n a 2^k mod 1 is well spread for k = 0..5 (for
# n <= 60, n |n a 2^k - nearest whole number| >= .17; found by search).
SHIFT_STEP = np.array([0.70493075, 0.64794019])


class Lattice(NamedTuple):
    """Leaves that blocks are made of: whole grid cells in two dimensions. They cover the grid from `origin` on over
    `extent` leaves, and a `margin` of as many on every side of it; beyond that nobody is coupled. Of the `whole` of
    them there are here those of a `shape` from the `first` on: all, unless other processes have some.
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
        """Whether it joins itself along each axis (2,)."""
        return self.periodic & (np.array(self.shape) == self.whole)


class Merged(NamedTuple):
    """Blocks of leaves: the `number` of that which each leaf is in, with one entry more, and of each block its first
    leaf (ix, iy) in this part of the lattice, level and whether want of particles `enlarged` it.
    """

    number: Array
    first_leaf: Array
    level: Array
    enlarged: Array


class Layout(NamedTuple):
    """Where blocks are, on a lattice with the origin of this step, and the leaf of each particle, the last of those
    outside.
    """

    lattice: Lattice
    merged: Merged
    gas_leaf: Array
    dust_leaf: Array


class Blocks(NamedTuple):
    """Members of each block: order[start[block] : start[block + 1]] of the gas, and of the dust by population.

    The last two blocks hold the gas and the dust outside the lattice.
    """

    gas_order: Array
    gas_start: Array
    dust_order: Array
    dust_start: Array
    first_leaf: Array  # (blocks, 2), as of `Merged`
    level: Array  # (blocks,)
    enlarged: Array  # (blocks,)
    lattice: Lattice  # with the origin of this step

    def period(self, size: Array) -> Array:
        """The period of a space of this size (2,), inf where it is open."""
        return size if self.lattice.periodic else np.full(2, np.inf)

    def squares(self) -> tuple[Array, Array]:
        """The lower corner (blocks, 2) and the side (blocks,) of each block."""
        lattice, corners, sides = self.lattice, np.empty((len(self.level), 2)), np.empty(len(self.level))
        share(
            kernels.squares_of, len(sides), self.first_leaf, self.level, lattice.origin, lattice.first, lattice.side,
            corners, sides, light=True,
        )  # fmt: skip
        return corners, sides


def lattice(drag: Drag, state: State, lengths: Array) -> Lattice:
    """Leaves at least as large as is wanted of smoothing `lengths` (n,), of a lattice that has room to move where it is
    not periodic.
    """
    grid, dim = state.grid, drag.dim
    wanted, count = drag.agree("wanted leaf", lambda: (wanted_leaf(drag, state, lengths), state.gas.everywhere))
    side, numbers = leaves(drag.width.rounded * wanted, grid.cell, grid.shape[:dim], grid.periodic, count)
    extent = np.array(grid.shape) * grid.cell / side
    if not grid.periodic:
        # Whole largest blocks, so that the mirror image of a lattice has the mirror images of its blocks.
        numbers = [(-(-n // 2**LEVELS) + 1) * 2**LEVELS for n in numbers]
    whole = numbers[0], numbers[1] if dim == 2 else 1
    return Lattice(np.array(grid.origin), extent, 0, side, whole, grid.periodic, (0, 0), whole)


def wanted_leaf(drag: Drag, state: State, lengths: Array) -> float:
    """Side that leaves are to have at least, as the scheme or the scene has it."""
    if drag.drag.cell_length is not None:
        return drag.drag.cell_length
    least = world.together.least(float(lengths.min(initial=np.inf)))
    return drag.scheme.cells.leaf(state.scene, drag.width.number, lambda: float(np.exp(mean(np.log(lengths)))), least)


def lay_blocks(
    drag: Drag,
    state: State,
    leaves: Lattice,
    lengths: Array,
    least: tuple[int, int],
    size: float,
    dust_wanted: int,
    shifted: bool,
    mirrored: bool = False,
) -> Layout:
    """Make blocks of `leaves`; `least`, `size` and `dust_wanted` as `merge` has them, `lengths` (n,) of the gas.

    The lattice moves with every step where it is `shifted`; `mirrored`, to where y -> -y takes the other's cells.
    """
    shift, part, keys, (n_gas, n_dust, outside) = _placed(drag, state, leaves, shifted, mirrored)
    if not leaves.periodic and outside > 0:
        leaves = _widened(leaves, drag.dim)  # somebody is off the grid: cells go on, on every side alike
        shift, part, keys, (n_gas, n_dust, _) = _placed(drag, state, leaves, shifted, mirrored)
    # A length's whole cells are the wanted side; a number of h is met by doubling leaves.
    length = leaves.side if drag.drag.cell_length else 0.0
    wanted = leaves.side, size, length, *least, drag.soft, drag.hard, dust_wanted
    merged = drag.agree(
        "blocks",
        lambda: merge(*_in_leaves(drag, part, n_gas, n_dust, keys[0], lengths), part.shape, *wanted),
    )
    return Layout(part._replace(origin=leaves.origin - shift * leaves.side), merged, *keys)


def sort_into_blocks(drag: Drag, state: State, layout: Layout) -> Blocks:
    """Sort gas and dust into blocks; the leaves of particles are overwritten."""
    lattice, (number, first_leaf, level, enlarged), gas_key, dust_key = layout
    # What lies outside the lattice meets nobody: a block of its own for each species.
    count, population = len(level), drag.classes.number
    number[-1] = count
    share(kernels.block_keys, len(gas_key), gas_key, number, NOBODY, 1, light=True)
    number[-1] = count + 1
    share(kernels.block_keys, len(dust_key), dust_key, number, drag.classes.of, population, light=True)
    gas = counting_sort(gas_key, count + 2, state.gas.place, state.gas.loose)
    dust = counting_sort(dust_key, (count + 2) * population, state.dust.place, state.dust.loose)
    return Blocks(*gas, *dust, first_leaf, level, enlarged, lattice)


def _placed(drag: Drag, state: State, leaves: Lattice, shifted: bool, mirrored: bool) -> tuple[Any, ...]:
    """By how many leaves a lattice has moved, the part of it that this process has, the leaves of its gas and dust, and
    what `_numbers` has of them.
    """
    both = state.gas, state.dust
    shift = _shift(drag, state, leaves, shifted, mirrored)
    of = f"of the lattice with a margin of {leaves.margin}"
    part = drag.agree(f"part {of}", lambda: drag.agree.part_of(leaves, shift, both))
    find = partial(_leaf_of_each, part, shift)
    keys = [drag.agree.leaves(f"{kind} {of}", p.pos, find) for kind, p in zip(("gas", "dust"), both, strict=True)]
    return shift, part, keys, drag.agree(f"numbers {of}", lambda: _numbers(part, *keys))


def _numbers(part: Lattice, *keys: Array) -> tuple[Array, Array, int]:
    """Own gas and dust in each leaf, and how many particles of all processes lie outside the lattice."""
    count = math.prod(part.shape) + 1
    gas, dust = (counts(key, count) for key in keys)
    return gas, dust, int(world.together.sum(int(gas[-1]) + int(dust[-1])))


def _in_leaves(
    drag: Drag, part: Lattice, n_gas: Array, n_dust: Array, key: Array, h: Array
) -> tuple[Array, Array, Array]:
    """Gas and dust in each leaf (leaves,) and the sum of the gas's h, of all processes."""
    unit = 2.0 ** (math.frexp(world.together.most(float(h.max(initial=0.0))))[1] - H_BITS)
    held = np.zeros(len(n_gas))
    kernels.add_in_units(key, h, 1.0 / unit, held)
    n_gas, n_dust, held = drag.agree.summed(part, n_gas, n_dust, held)
    held *= unit
    return n_gas, n_dust, held


def _widened(leaves: Lattice, dim: int) -> Lattice:
    """With room for a margin of the largest block on both sides."""
    nx, ny = leaves.whole
    more = 2 * 2**LEVELS
    whole = nx + more, ny + more if dim == 2 else 1
    return leaves._replace(margin=2**LEVELS, whole=whole, shape=whole)


def _shift(drag: Drag, state: State, leaves: Lattice, shifted: bool, mirrored: bool) -> Array:
    """By how many leaves (2,) the lattice has moved."""
    shift = np.zeros(2)
    if shifted:
        shift[: drag.dim] = (((state.step + state.earlier) * SHIFT_STEP) % 1.0 * 2**LEVELS)[: drag.dim]
    shift[: drag.dim] += leaves.margin
    if mirrored:
        shift[1] = leaves.whole[1] + 2.0 * leaves.origin[1] / leaves.side - shift[1]
    return shift


def _leaf_of_each(part: Lattice, shift: Array, pos: Array) -> Array:
    """The leaf of each of places (n, d), the last of those outside the lattice."""
    low, high = shift - part.margin, shift + part.extent + part.margin
    key = room.like(pos, np.uint32)
    share(
        kernels.leaf_keys, len(pos), pos, part.origin, shift, low, high, 1.0 / part.side,
        part.whole, part.first, part.shape, part.periodic, key, light=True,
    )  # fmt: skip
    return key


def merge(gas: Array, dust: Array, h_sum: Array, shape: tuple[int, int], *wanted: Any) -> Merged:
    """The blocks of leaves.

    `gas`, `dust`, `h_sum` (leaves,): particles in each leaf and the sum of the gas's h; `wanted`: `kernels.Wanted`.
    """
    width, height = ((side - 1 >> np.arange(LEVELS + 1)) + 1 for side in shape)
    begin = np.append(0, np.cumsum(width * height))
    tree = kernels.Tree(begin, width, height, *np.zeros((2, begin[-1]), bool))
    held = np.zeros(width[-1] * height[-1], np.int64)
    share(kernels.merge, len(held), gas, dust, h_sum, kernels.Wanted(*wanted), tree, held, least=1)
    start = np.append(0, np.cumsum(held))
    count = start[-1]
    number = np.full(begin[1] + 1, -1, np.int32)
    first_leaf, level, flag = np.empty((count, 2), np.int32), np.empty(count, np.int64), np.empty(count, bool)
    share(kernels.number_blocks, len(held), start, tree, number, first_leaf, level, flag, least=1)
    return Merged(number, first_leaf, level, flag)


def law_of(drag: Drag, dt: float) -> Law:
    return Law(drag.law.code, drag.classes.grains, drag.two_way, dt, drag.exponential)


def species_in(drag: Drag, state: State, blocks: Blocks, gas_vel: Array) -> tuple[Species, Species]:
    """Gas, of velocities `gas_vel`, and dust as kernels take them."""
    gas, dust, own = state.gas, state.dust, state.own_acc
    about = drag.agree(ABOUT_GRAINS, lambda: about_grains(drag, state))
    # Small dust that gas carries drags no grains.
    density = gas.density if gas.small is None else gas.density * growth.gas_share(state.scene, gas)
    return (
        Species(
            gas.pos, gas_vel, gas.acc, own["gas"], gas.mass, density, thermal_speed(state.scene, gas),
            blocks.gas_order, blocks.gas_start, 1, 0,
        ),
        Species(
            dust.pos, dust.vel, dust.acc, own["dust"], dust.mass, about, NONE,
            blocks.dust_order, blocks.dust_start, drag.classes.number, 1,
        ),
    )  # fmt: skip


def about_grains(drag: Drag, state: State) -> Array:
    """What kernels take of each grain (n,) beside its mass; it may have no entries."""
    return densities_of_sparse_dust(drag, state) if state.dust.size is None else drag.classes.relative


def layout_of(drag: Drag, state: State, linear: bool) -> tuple[Layout, Frame]:
    """The blocks of `relax_in_blocks`, and the frame."""
    about_star = frame(drag, state)
    lengths = drag.width.counted(state.gas.pos, state.gas.h)
    layout = lay_blocks(
        drag, state, lattice(drag, state, lengths), lengths, drag.scheme.cells.least(state.scene), drag.width.number,
        INSIDE if drag.two_way else IGNORE, linear, linear and clockwise(about_star),
    )  # fmt: skip
    return layout, about_star


def blocks_of(drag: Drag, state: State, linear: bool) -> tuple[Blocks, Frame]:
    """The members of the blocks of `layout_of`, and the frame."""
    layout, about_star = layout_of(drag, state, linear)
    return sort_into_blocks(drag, state, layout), about_star


def relax_in_blocks(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array, linear: bool) -> None:
    """Relax each block by itself (`kernels/drag/cells.py`), with a velocity linear in it or its mean alone."""
    blocks, about_star = drag.places(state)
    gas, dust = species_in(drag, state, blocks, gas_vel)
    corners = np.concatenate([blocks.squares()[0], np.zeros((2, 2))])
    times = np.empty((len(corners), drag.classes.number))
    share(
        relax_blocks, len(corners), gas, dust, Corners(corners, blocks.period(drag.size)), law_of(drag, dt), linear,
        drag.law.nonlinear, drag.classes.several, about_star, times, heat, least=64,
    )  # fmt: skip
    start = blocks.dust_start[:: drag.classes.number]
    alone = np.append(blocks.enlarged, [True, True]) | (np.diff(blocks.gas_start) == 0)
    drag.alone = kernels.members_of(blocks.dust_order, start, alone)
    drag.stopping_times = lambda: kernels.times_of_members(times, blocks.dust_order, blocks.dust_start)
