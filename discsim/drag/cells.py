"""Drag cells: sorting of gas and dust into blocks of a lattice, and relaxation of each block by itself."""

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
from discsim.numerics import alloc, world
from discsim.numerics.layout import leaves
from discsim.numerics.sorting import counting_sort, counts
from discsim.numerics.threads import parallel_for
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
ABOUT_GRAINS = "about grains"  # key of `about_grains` in `drag.agree`
# The h of a leaf are added in whole units of 2^-H_BITS of the largest, exactly for up to 2^23 of them. The sums are
# independent of the order, and accurate to 9 digits.
H_BITS = 30

# Steps of the cells' origin, in fractions of the largest block: n a 2^k mod 1 is well spread for k = 0..5 (for
# n <= 60, n |n a 2^k - nearest whole number| >= 0.17; found by search).
SHIFT_STEP = np.array([0.70493075, 0.64794019])


class Lattice(NamedTuple):
    """Lattice of leaves, of which blocks are made; in two dimensions a leaf is a whole number of grid cells wide.

    The lattice covers the grid from `origin` (2,) on over `extent` (2,) leaves of width `side`, with a `margin` of
    leaves on every side. Particles beyond the margin are uncoupled. `whole` is the number of leaves along each axis.
    This process has a part of the lattice, `shape` leaves from the leaf `first` on; in serial runs the part is the
    whole.
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
        """True along each axis (2,) on which this part is periodic."""
        return self.periodic & (np.array(self.shape) == self.whole)


class Merged(NamedTuple):
    """Blocks of leaves.

    number (leaves + 1,): block of each leaf; the last entry is for particles outside. Of each block: `first_leaf`
    (blocks, 2), its first leaf (ix, iy) in this part of the lattice; `level` (blocks,), log2 of its width in leaves;
    `enlarged` (blocks,), whether it has grown for lack of particles.
    """

    number: Array
    first_leaf: Array
    level: Array
    enlarged: Array


class Layout(NamedTuple):
    """Blocks of a lattice with the origin of this step, and the leaf (n,) of each particle.

    Particles outside the lattice have the last leaf.
    """

    lattice: Lattice
    merged: Merged
    gas_leaf: Array
    dust_leaf: Array


class Blocks(NamedTuple):
    """Members of each block: order[start[block] : start[block + 1]] of the gas, and of the dust by block and
    population.

    The last two blocks hold the gas and the dust outside the lattice.
    """

    gas_order: Array
    gas_start: Array
    dust_order: Array
    dust_start: Array
    first_leaf: Array  # (blocks, 2), as in `Merged`
    level: Array  # (blocks,)
    enlarged: Array  # (blocks,)
    lattice: Lattice  # with the origin of this step

    def period(self, size: Array) -> Array:
        """Return the period of a space of this size (2,); inf where it is open."""
        return size if self.lattice.periodic else np.full(2, np.inf)

    def squares(self) -> tuple[Array, Array]:
        """Return the lower corner (blocks, 2) and the side (blocks,) of each block."""
        lattice, corners, sides = self.lattice, np.empty((len(self.level), 2)), np.empty(len(self.level))
        parallel_for(
            kernels.squares_of, len(sides), self.first_leaf, self.level, lattice.origin, lattice.first, lattice.side,
            corners, sides, light=True,
        )  # fmt: skip
        return corners, sides


def lattice(drag: Drag, state: State, lengths: Array) -> Lattice:
    """Return a lattice of leaves wide enough for the smoothing `lengths` (n,) of the gas.

    An open lattice has room for shifts of its origin by up to one largest block.
    """
    grid, dim = state.grid, drag.dim
    wanted, count = drag.agree("wanted leaf", lambda: (wanted_leaf(drag, state, lengths), state.gas.everywhere))
    side, numbers = leaves(drag.width.rounded * wanted, grid.cell, grid.shape[:dim], grid.periodic, count)
    extent = np.array(grid.shape) * grid.cell / side
    if not grid.periodic:
        # A whole number of largest blocks, so that the mirror image of a lattice has the mirror images of its blocks.
        numbers = [(-(-n // 2**LEVELS) + 1) * 2**LEVELS for n in numbers]
    whole = numbers[0], numbers[1] if dim == 2 else 1
    return Lattice(np.array(grid.origin), extent, 0, side, whole, grid.periodic, (0, 0), whole)


def wanted_leaf(drag: Drag, state: State, lengths: Array) -> float:
    """Return the least side of leaves, from the scene or the scheme."""
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
    """Build blocks of `leaves`.

    lengths (n,): smoothing lengths of the gas. least, size, dust_wanted: the fields (gas, dust), size and dust_in of
    `kernels.Wanted`. shifted: whether the lattice moves with every step. mirrored: whether it moves to its mirror
    image by y -> -y.
    """
    shift, part, keys, (n_gas, n_dust, outside) = _placed(drag, state, leaves, shifted, mirrored)
    if not leaves.periodic and outside > 0:
        leaves = _widened(leaves, drag.dim)  # for particles off the grid, by the same number of leaves on every side
        shift, part, keys, (n_gas, n_dust, _) = _placed(drag, state, leaves, shifted, mirrored)
    # With drag.cell_length a leaf has the wanted side; with a number of h leaves double up to it.
    length = leaves.side if drag.drag.cell_length else 0.0
    wanted = leaves.side, size, length, *least, drag.soft, drag.hard, dust_wanted
    merged = drag.agree(
        "blocks",
        lambda: merge(*_in_leaves(drag, part, n_gas, n_dust, keys[0], lengths), part.shape, *wanted),
    )
    return Layout(part._replace(origin=leaves.origin - shift * leaves.side), merged, *keys)


def sort_into_blocks(drag: Drag, state: State, layout: Layout) -> Blocks:
    """Sort gas and dust into blocks. Overwrites the leaves of particles in `layout`."""
    lattice, (number, first_leaf, level, enlarged), gas_key, dust_key = layout
    # Particles outside the lattice are uncoupled: a block of its own for each species.
    count, population = len(level), drag.classes.number
    number[-1] = count
    parallel_for(kernels.block_keys, len(gas_key), gas_key, number, NOBODY, 1, light=True)
    number[-1] = count + 1
    parallel_for(kernels.block_keys, len(dust_key), dust_key, number, drag.classes.of, population, light=True)
    gas = counting_sort(gas_key, count + 2, state.gas.place, state.gas.loose)
    dust = counting_sort(dust_key, (count + 2) * population, state.dust.place, state.dust.loose)
    return Blocks(*gas, *dust, first_leaf, level, enlarged, lattice)


def _placed(drag: Drag, state: State, leaves: Lattice, shifted: bool, mirrored: bool) -> tuple[Any, ...]:
    """Return the shift (2,) of a lattice, the part of this process, the leaves of its gas and dust, and their
    `_numbers`.
    """
    both = state.gas, state.dust
    shift = _shift(drag, state, leaves, shifted, mirrored)
    of = f"of the lattice with a margin of {leaves.margin}"
    part = drag.agree(f"part {of}", lambda: drag.agree.part_of(leaves, shift, both))
    find = partial(_leaf_of_each, part, shift)
    keys = [drag.agree.leaves(f"{kind} {of}", p.pos, find) for kind, p in zip(("gas", "dust"), both, strict=True)]
    return shift, part, keys, drag.agree(f"numbers {of}", lambda: _numbers(part, *keys))


def _numbers(part: Lattice, *keys: Array) -> tuple[Array, Array, int]:
    """Return the local gas and dust in each leaf, and the number of particles of all processes outside the lattice."""
    count = math.prod(part.shape) + 1
    gas, dust = (counts(key, count) for key in keys)
    return gas, dust, int(world.together.sum(int(gas[-1]) + int(dust[-1])))


def _in_leaves(
    drag: Drag, part: Lattice, n_gas: Array, n_dust: Array, key: Array, h: Array
) -> tuple[Array, Array, Array]:
    """Return the gas and dust in each leaf (leaves,) and the sum of the gas's h, over all processes."""
    unit = 2.0 ** (math.frexp(world.together.most(float(h.max(initial=0.0))))[1] - H_BITS)
    held = np.zeros(len(n_gas))
    kernels.add_in_units(key, h, 1.0 / unit, held)
    n_gas, n_dust, held = drag.agree.summed(part, n_gas, n_dust, held)
    held *= unit
    return n_gas, n_dust, held


def _widened(leaves: Lattice, dim: int) -> Lattice:
    """Return the lattice with a margin of the largest block on every side."""
    nx, ny = leaves.whole
    more = 2 * 2**LEVELS
    whole = nx + more, ny + more if dim == 2 else 1
    return leaves._replace(margin=2**LEVELS, whole=whole, shape=whole)


def _shift(drag: Drag, state: State, leaves: Lattice, shifted: bool, mirrored: bool) -> Array:
    """Return the shift (2,) of the lattice in leaves."""
    shift = np.zeros(2)
    if shifted:
        shift[: drag.dim] = (((state.step + state.earlier) * SHIFT_STEP) % 1.0 * 2**LEVELS)[: drag.dim]
    shift[: drag.dim] += leaves.margin
    if mirrored:
        shift[1] = leaves.whole[1] + 2.0 * leaves.origin[1] / leaves.side - shift[1]
    return shift


def _leaf_of_each(part: Lattice, shift: Array, pos: Array) -> Array:
    """Return the leaf (n,) of each position (n, d); the last leaf for positions outside the lattice."""
    low, high = shift - part.margin, shift + part.extent + part.margin
    key = alloc.allocate_like(pos, np.uint32)
    parallel_for(
        kernels.leaf_keys, len(pos), pos, part.origin, shift, low, high, 1.0 / part.side,
        part.whole, part.first, part.shape, part.periodic, key, light=True,
    )  # fmt: skip
    return key


def merge(gas: Array, dust: Array, h_sum: Array, shape: tuple[int, int], *wanted: Any) -> Merged:
    """Merge leaves into blocks.

    gas, dust, h_sum (leaves,): particles in each leaf and the sum of the gas's h. wanted: fields of `kernels.Wanted`.
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


def law_of(drag: Drag, dt: float) -> Law:
    """Return the parameters of a kick over dt for the kernels."""
    return Law(drag.law.code, drag.classes.grains, drag.two_way, dt, drag.exponential)


def species_in(drag: Drag, state: State, blocks: Blocks, gas_vel: Array) -> tuple[Species, Species]:
    """Return gas, of velocities `gas_vel` (n, d), and dust in the form that the kernels take."""
    gas, dust, own = state.gas, state.dust, state.own_acc
    about = drag.agree(ABOUT_GRAINS, lambda: about_grains(drag, state))
    # Small dust that gas carries exerts no drag on grains.
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
    """Return the kernels' further input of each grain (n,), or an empty array.

    The input is a density of sparse dust or, where grains have sizes, the stopping time relative to that of the
    class.
    """
    return densities_of_sparse_dust(drag, state) if state.dust.size is None else drag.classes.relative


def layout_of(drag: Drag, state: State, linear: bool) -> tuple[Layout, Frame]:
    """Return the blocks of `relax_in_blocks`, and the Keplerian frame for velocities."""
    about_star = frame(drag, state)
    lengths = drag.width.counted(state.gas.pos, state.gas.h)
    layout = lay_blocks(
        drag, state, lattice(drag, state, lengths), lengths, drag.scheme.cells.least(state.scene), drag.width.number,
        INSIDE if drag.two_way else IGNORE, linear, linear and clockwise(about_star),
    )  # fmt: skip
    return layout, about_star


def blocks_of(drag: Drag, state: State, linear: bool) -> tuple[Blocks, Frame]:
    """Return the members of the blocks of `layout_of`, and the Keplerian frame for velocities."""
    layout, about_star = layout_of(drag, state, linear)
    return sort_into_blocks(drag, state, layout), about_star


def relax_in_blocks(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array, linear: bool) -> None:
    """Relax each block by itself (`kernels/drag/cells.py`), with a velocity linear in position (`linear`) or its mean
    alone.
    """
    blocks, about_star = drag.places(state)
    gas, dust = species_in(drag, state, blocks, gas_vel)
    corners = np.concatenate([blocks.squares()[0], np.zeros((2, 2))])
    times = np.empty((len(corners), drag.classes.number))
    parallel_for(
        relax_blocks, len(corners), gas, dust, Corners(corners, blocks.period(drag.size)), law_of(drag, dt), linear,
        drag.law.nonlinear, drag.classes.several, about_star, times, heat, least=64,
    )  # fmt: skip
    start = blocks.dust_start[:: drag.classes.number]
    alone = np.append(blocks.enlarged, [True, True]) | (np.diff(blocks.gas_start) == 0)
    drag.alone = kernels.members_of(blocks.dust_order, start, alone)
    drag.stopping_times = lambda: kernels.times_of_members(times, blocks.dust_order, blocks.dust_start)
