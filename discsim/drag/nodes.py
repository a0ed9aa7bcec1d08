"""Kick of the scheme tsc (`drag/tsc.py`): gather particles to nodes of a lattice, relax there, scatter to particles."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from discsim.drag.base import EMPTY, CellRule, Dust, Gas, Kicked, Law, Work
from discsim.drag.cells import Blocks, Layout, OneRank, law_over, lay_blocks, sort_into_blocks, species_in
from discsim.drag.frame import clockwise
from discsim.kernels.common.simd import LANES
from discsim.kernels.drag.blocks import IGNORE, LEVELS, NEAR, members_alone
from discsim.kernels.drag.cells import free_kick
from discsim.kernels.drag.frame import Frame
from discsim.kernels.drag.tsc import columns as nodes_columns
from discsim.kernels.drag.tsc import fit as nodes_fit
from discsim.kernels.drag.tsc import gather as nodes_gather
from discsim.kernels.drag.tsc import grains as nodes_grains
from discsim.kernels.drag.tsc import heat as nodes_heat
from discsim.kernels.drag.tsc import levels
from discsim.kernels.drag.tsc import relax as nodes_relax
from discsim.kernels.drag.tsc import scatter as nodes_scatter
from discsim.kernels.drag.tsc import sharpen as nodes_sharpen
from discsim.kernels.drag.tsc.nodes import BX, FIELDS, Cells, Change, Nodes, Sharp, Slopes
from discsim.kernels.drag.types import Species
from discsim.numerics import world
from discsim.numerics.alloc import aligned
from discsim.numerics.threads import parallel_for, parallel_for_fused

Array = np.ndarray
FEW_GRAINS = 6  # mean number of grains of a class in a cell above which sums over cells are cheaper than single grains
LEAST = 64  # smallest number of blocks or nodes in a chunk of a parallel loop


class NodeCells(NamedTuple):
    """Cells of a kick: the particles of each block, and the stencils of cells and nodes.

    blocks: particles of each block; a block is a cell. rows: two arrays, for gas and for dust. Particles are stored in
    rows of LANES particles of the same block and class; each array has the number of rows before those of each class
    in each block. slots: total number of slots; each species present in a block has one. The other arrays are as in
    `Cells` and `Nodes` of `kernels/drag/tsc/nodes.py`, with corners and sides as `corner` and `side`.
    """

    blocks: Blocks
    rows: tuple[Array, Array]
    corners: Array
    sides: Array
    home: Array
    slot: Array
    slots: int
    about: Array
    near: Array
    centre: Array


def layout(gas: Gas, dust: Dust, rule: CellRule, frame: Frame, ranks: OneRank) -> Layout:
    """Return the layout of the drag cells, as `Scheme.layout`."""
    dust_in = NEAR if rule.two_way else IGNORE  # dust in a neighbouring cell suffices, as a node has that of nine cells
    return lay_blocks(gas, dust, rule, ranks, dust_in, True, clockwise(frame))


def build(gas: Gas, dust: Dust, rule: CellRule, layout: Layout) -> NodeCells:
    """Return the cells of the next kick, as `Scheme.build`."""
    blocks = sort_into_blocks(gas, dust, rule, layout)
    grid, lattices = blocks.lattice, levels.lattices(*blocks.lattice.shape, blocks.lattice.joined, LEVELS + 1)
    home, place, about, near = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, rule.dim == 1)
    centre = np.empty((len(near), 2))
    parallel_for(levels.node_centres, len(near), place, grid.origin, grid.side, grid.first, centre)
    slot = np.empty((len(home), rule.classes + 1), np.int32)
    rows = np.empty(len(home) + 1, np.int64), np.empty(slot[:, 1:].size + 1, np.int64)
    slots = nodes_columns.find_slots(blocks.gas_start, blocks.dust_start, slot, *rows)
    return NodeCells(blocks, rows, *blocks.squares(), home, slot, slots, about, near, centre)


def kick(gas: Gas, dust: Dust, law: Law, frame: Frame, dt: float, there: NodeCells, work: Work) -> Kicked:
    """Kick gas and dust over dt, as `Scheme.kick`."""
    blocks, classes = there.blocks, len(law.grains)
    few = classes > 1 and _has_few_grains(blocks, classes, dust.local)
    of_gas, of_dust = species_in(gas, dust, classes, blocks)
    cells, nodes = _allocate_sums(there, classes, law, work, few and len(dust.acc_unshared) == 0)
    gas_columns, collect_gas = _gather(work, of_gas, cells, nodes, there.rows[0], frame, law.code)
    parallel_for_fused([collect_gas], len(nodes.near), least=LEAST)  # sums of dust depend on which nodes have gas
    dust_columns, collect_dust = _gather(work, of_dust, cells, nodes, there.rows[1], frame, law.code)
    sharp = _relax_nodes(of_gas, of_dust, blocks, cells, nodes, collect_dust, law, frame, dt, work)
    # With heat the blocks of ghosts are kicked too, as the heat of their losses passes on to local gas.
    kicked, rate = len(cells.home) if len(work.heat) > 0 else blocks.own, np.empty((len(cells.home), classes))
    kinds = [(of_dust, dust_columns, rate)]
    if law.two_way:  # one-way drag leaves the gas to `kick_gas`
        kinds.insert(0, (of_gas, gas_columns, np.empty((len(cells.home), 1))))
    passes = [
        (nodes_scatter.scatter, kind, cells, nodes, sharp, *columns, dt, law.exponential, rates)
        for kind, columns, rates in kinds
    ]
    parallel_for_fused(passes, kicked, least=LEAST)  # gas first: the order affects the rounding of the heat of nodes
    for kind, *_ in kinds:
        free_kick(_outside_lattice(kind, cells), kind.vel, kind.acc, dt)
    if len(work.heat) > 0:
        nodes_heat.move_heat_to_gas(nodes, sharp.heat)
        given = of_gas, cells, nodes, sharp.heat, *gas_columns, work.heat
        parallel_for(nodes_heat.spread, len(cells.home), *given, least=LEAST)
    return Kicked(
        members_alone(of_dust.order, of_dust.start, rate, blocks.enlarged, kicked),
        lambda: _stopping_times(of_dust, cells, nodes, sharp, dust_columns),
    )


def _scratch(work: Work, name: str, *shape: int) -> Array:
    """Return the reused scratch array `name`; allocating a new one would cost as much time as the loops on it."""
    size, buffer = math.prod(shape), work.buffers.get(name, EMPTY)
    if len(buffer) < size:
        buffer = work.buffers[name] = aligned((size + size // 16,))
    return buffer[:size].reshape(shape)


def _outside_lattice(kind: Species, cells: Cells) -> Array:
    """Return the indices of the particles outside the lattice."""
    return kind.order[kind.start[len(cells.home) * kind.number] :]


def _has_few_grains(blocks: Blocks, classes: int, local: int) -> bool:
    """Return whether occupied cells have fewer than FEW_GRAINS grains of a class, for which sums cost more than grains.

    The mean number of grains is that of all ranks. local: number of local grains.
    """
    start = blocks.dust_start[: len(blocks.level) * classes + 1]
    filled = np.flatnonzero(np.diff(start))
    cells = np.count_nonzero(blocks.dust_order[start[filled]] < local)  # cells whose first grain is local
    held = np.count_nonzero(blocks.dust_order[: start[-1]] < local)
    return bool(world.processes.sum(held) < FEW_GRAINS * world.processes.sum(cells))


def _allocate_sums(there: NodeCells, classes: int, law: Law, work: Work, by_grain: bool) -> tuple[Cells, Nodes]:
    """Return cells and nodes with uninitialised arrays for their sums; by_grain: whether dust is not summed by cell."""
    blocks, _, corners, sides, home, slot, slots, about, near, centre = there
    count = len(home)
    given = _scratch(work, "given of cells", count if by_grain else slots, 9, FIELDS)
    own = _scratch(work, "own of cells", slots, 3, FIELDS)
    total = _scratch(work, "all dust of cells", count if by_grain else 0, 3, FIELDS)
    share_of = _scratch(work, "shares of grains", len(blocks.dust_order) if by_grain else 0)
    square = np.empty(len(near) if work.dim == 2 and law.two_way else 0)
    return (
        Cells(corners, sides, home, slot, given, own, total, share_of, work.period),
        Nodes(about, near, centre, aligned((len(near), classes + 1, FIELDS)), square),
    )


def _gather(
    work: Work, kind: Species, cells: Cells, nodes: Nodes, rows: Array, frame: Frame, law: int
) -> tuple[tuple[Array, Array], tuple[Any, ...]]:
    """Gather the particles of a species to cells, and return (packed, collect).

    packed: start of the stored particles of each class in each block, and the stored particles; single grains have no
    starts. collect: a kernel that sums the species at nodes, and its arguments.
    """
    name, count = ("gas", "dust")[kind.first], len(cells.home)
    if kind.first > 0 and len(cells.total) > 0:
        row = _scratch(work, "rows of grains", len(kind.order), FIELDS)
        parallel_for(
            nodes_grains.gather_grains, count, kind, cells, nodes, frame, law, row, cells.share,
            least=LEAST,
        )  # fmt: skip
        collect = nodes_grains.collect_grains, kind, nodes, row, cells.share
        return (np.empty(0, np.int64), row.ravel()), collect
    begin = (FIELDS if len(kind.own) > 0 else BX) * LANES * rows
    column = _scratch(work, f"columns of {name}", int(begin[-1]))
    square = np.empty((count if kind.first == 0 and len(nodes.square) > 0 else 0, 9))
    parallel_for(nodes_gather.gather, count, kind, cells, nodes, frame, law, begin, column, square, least=LEAST)
    return (begin, column), (nodes_gather.collect, kind, cells, nodes, square)


def _mean_thermal_speed(gas: Species, blocks: Blocks) -> Array:
    """Return the mean thermal speed of the gas in each block (blocks,)."""
    number = np.diff(blocks.gas_start[: len(blocks.level) + 1])
    of_block = np.repeat(np.arange(len(number)), number)
    speeds = gas.sound[blocks.gas_order[: len(of_block)]]
    return np.bincount(of_block, speeds, len(number)) / np.maximum(number, 1)


def _relax_nodes(
    gas: Species, dust: Species, blocks: Blocks, cells: Cells, nodes: Nodes, collect: tuple[Any, ...], law: Law,
    frame: Frame, dt: float, work: Work,
) -> Sharp:  # fmt: skip
    """Sum the dust at nodes with `collect`, relax the slip there, and return the changes to scatter to particles."""
    total, species = nodes.sums.shape[:2]
    sourced = np.array([len(gas.own) > 0] + [len(dust.own) > 0] * (species - 1))
    slopes = Slopes(aligned((total, 4)), aligned((total, species, 4)), np.zeros((total, species), bool))
    passes = [collect, (nodes_fit.fit, cells, nodes, work.dim, law.two_way, sourced, slopes)]
    sound = None
    if law.nonlinear:
        sound = np.empty(total)
        passes.append((nodes_relax.mean_sound, nodes, cells.own, _mean_thermal_speed(gas, blocks), sound))
    parallel_for_fused(passes, total, least=LEAST)
    change = Change(*aligned((2, total, species, 2)), *aligned((2, total, species)))
    parallel_for(
        nodes_relax.relax, total, nodes, slopes, sourced, sound, law_over(law, dt), frame, law.several, change,
        least=LEAST,
    )  # fmt: skip
    heating = len(work.heat) > 0
    sharp = Sharp(
        aligned((total, species, LANES)), aligned((total, 4)), np.empty(total if heating else 0),
        np.empty((total if heating and len(nodes.square) > 0 else 0, 2, LANES)),
    )  # fmt: skip
    parallel_for(nodes_sharpen.sharpen, total, nodes, slopes.pooled, change, law.two_way, dt, sharp, least=LEAST)
    return sharp


def _stopping_times(dust: Species, cells: Cells, nodes: Nodes, sharp: Sharp, packed: tuple[Array, Array]) -> Array:
    """Return the stopping time (n,) of each dust particle; inf without gas."""
    time = np.full(len(dust.mass), np.inf)
    parallel_for(
        nodes_scatter.stopping_times, len(cells.home), dust, cells, nodes, sharp.value, *packed, time, least=LEAST
    )
    return time
