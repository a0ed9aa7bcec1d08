"""Kick of the scheme tsc (`drag/tsc.py`): gather particles to nodes, relax the slip at nodes, scatter to particles."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from discsim.drag.base import EMPTY, CellRule, DragLaw, Dust, Gas, KickContext, KickResult
from discsim.drag.cells import Blocks, Layout, OneRank, law_over, lay_blocks, sort_into_blocks, species_in
from discsim.drag.frame import is_clockwise
from discsim.kernels.common.simd import LANES
from discsim.kernels.drag.blocks import IGNORE, LEVELS, NEAR, uncoupled_particles
from discsim.kernels.drag.cells import kick_freely
from discsim.kernels.drag.frame import Frame
from discsim.kernels.drag.tsc import antidiffusion, columns, fit, gather, grains, heat, levels, relax, scatter
from discsim.kernels.drag.tsc.nodes import BX, FIELDS, CellSums, DragChanges, NodeImpulses, NodeSums, Slopes
from discsim.kernels.drag.types import Species
from discsim.numerics import world
from discsim.numerics.alloc import aligned
from discsim.numerics.threads import parallel_for, parallel_for_fused

Array = np.ndarray
FEW_GRAINS = 6  # mean number of grains of a class in a cell above which sums over cells are cheaper than single grains
LEAST = 64  # smallest number of blocks or nodes in a chunk of a parallel loop


class NodeCells(NamedTuple):
    """Drag cells of a kick: their particles, and the neighbours of cells and nodes.

    blocks: the blocks with their particles; a block is a cell. rows: two arrays, for gas and for dust. Particles are
    stored in rows of LANES particles of the same block and class. For each class in each block, the array has the
    number of rows that come before the first row of the class. row_count: number of rows in the tables of sums.
    corners, sides: lower corners (cells, 2) and sides (cells,) of the cells. centre_node, species_row: as in
    `CellSums`. stencil, node_cells, centre: as in `NodeSums`; both are in `kernels/drag/tsc/nodes.py`.
    """

    blocks: Blocks
    rows: tuple[Array, Array]
    corners: Array
    sides: Array
    centre_node: Array
    species_row: Array
    row_count: int
    stencil: Array
    node_cells: Array
    centre: Array


def layout(gas: Gas, dust: Dust, rule: CellRule, frame: Frame, ranks: OneRank) -> Layout:
    """Return the layout of the drag cells, as `Scheme.layout`."""
    dust_in = NEAR if rule.two_way else IGNORE  # a node has the dust of nine cells: dust in a neighbour is enough
    return lay_blocks(gas, dust, rule, ranks, dust_in, True, is_clockwise(frame))


def build(gas: Gas, dust: Dust, rule: CellRule, layout: Layout) -> NodeCells:
    """Return the cells of the next kick, as `Scheme.build`."""
    blocks = sort_into_blocks(gas, dust, rule, layout)
    grid, lattices = blocks.lattice, levels.lattice_levels(*blocks.lattice.shape, blocks.lattice.joined, LEVELS + 1)
    listed = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, rule.dim == 1)
    centre_node, place, stencil, node_cells = listed
    centre = np.empty((len(stencil), 2))
    parallel_for(levels.node_centres, len(stencil), place, grid.origin, grid.side, grid.first, centre)
    species_row = np.empty((len(centre_node), rule.classes + 1), np.int32)
    rows = np.empty(len(centre_node) + 1, np.int64), np.empty(species_row[:, 1:].size + 1, np.int64)
    row_count = columns.number_rows(blocks.gas_start, blocks.dust_start, species_row, *rows)
    return NodeCells(blocks, rows, *blocks.squares(), centre_node, species_row, row_count, stencil, node_cells, centre)


def kick(
    gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, built: NodeCells, context: KickContext
) -> KickResult:  # fmt: skip
    """Kick gas and dust in place over dt, as `Scheme.kick`; built: result of `build`."""
    blocks, classes = built.blocks, len(law.grains)
    few = classes > 1 and _has_few_grains(blocks, classes, dust.local)
    of_gas, of_dust = species_in(gas, dust, classes, blocks)
    cells, nodes = _allocate_sums(built, classes, law, context, few and len(dust.acc_unshared) == 0)
    gas_columns, collect_gas = _gather_species(context, of_gas, cells, nodes, built.rows[0], frame, law.code)
    parallel_for_fused([collect_gas], len(nodes.stencil), least=LEAST)  # sums of dust depend on which nodes have gas
    dust_columns, collect_dust = _gather_species(context, of_dust, cells, nodes, built.rows[1], frame, law.code)
    impulse = _relax_nodes(of_gas, of_dust, blocks, cells, nodes, collect_dust, law, frame, dt, context)
    # With heating, the blocks of ghosts are kicked too, as their losses of energy also heat local gas.
    kicked, rate = len(built.sides) if len(context.heat) > 0 else blocks.own, np.empty((len(built.sides), classes))
    kinds = [(of_dust, dust_columns, rate)]
    if law.two_way:  # with one-way drag the caller discards the gas velocities
        kinds.insert(0, (of_gas, gas_columns, np.empty((len(built.sides), 1))))
    passes = [
        (scatter.scatter, kind, cells, nodes, impulse, *packed, dt, law.exponential, rates)
        for kind, packed, rates in kinds
    ]
    parallel_for_fused(passes, kicked, least=LEAST)  # gas first: the order affects the rounding of the heat of nodes
    for kind, *_ in kinds:  # particles outside the lattice
        kick_freely(kind.order[kind.start[len(built.sides) * kind.number] :], kind.vel, kind.acc, dt)
    if len(context.heat) > 0:
        heat.move_heat_to_gas(nodes, impulse.heat)
        given = of_gas, cells, nodes, impulse.heat, *gas_columns, context.heat
        parallel_for(heat.spread_heat, len(built.sides), *given, least=LEAST)
    return KickResult(
        uncoupled_particles(of_dust.order, of_dust.start, rate, blocks.enlarged, kicked),
        lambda: _stopping_times(of_dust, cells, nodes, impulse, dust_columns),
    )


def _scratch_array(context: KickContext, name: str, *shape: int) -> Array:
    """Return the scratch array `name` of the run with this shape, uninitialised.

    Its memory is reused in each kick: allocating it again would cost as much time as the loops that use it.
    """
    size, buffer = math.prod(shape), context.buffers.get(name, EMPTY)
    if len(buffer) < size:
        buffer = context.buffers[name] = aligned((size + size // 16,))
    return buffer[:size].reshape(shape)


def _has_few_grains(blocks: Blocks, classes: int, local: int) -> bool:
    """Return whether classes have fewer than FEW_GRAINS grains in the cells that contain them, on average.

    With few grains it is cheaper to sum single grains at the nodes than to sum the grains of each cell first. The
    average is over all ranks. local: number of local grains.
    """
    start = blocks.dust_start[: len(blocks.level) * classes + 1]
    filled = np.flatnonzero(np.diff(start))
    cells = np.count_nonzero(blocks.dust_order[start[filled]] < local)  # cells whose first grain is local
    held = np.count_nonzero(blocks.dust_order[: start[-1]] < local)
    return bool(world.processes.sum(held) < FEW_GRAINS * world.processes.sum(cells))


def _allocate_sums(
    built: NodeCells, classes: int, law: DragLaw, context: KickContext, by_grain: bool
) -> tuple[CellSums, NodeSums]:  # fmt: skip
    """Return cells and nodes with uninitialised arrays for their sums.

    by_grain: whether nodes sum single grains instead of the sums over the grains of each cell.
    """
    blocks, _, corners, sides, centre_node, species_row, row_count, stencil, node_cells, centre = built
    count = len(sides)
    given = _scratch_array(context, "given of cells", count if by_grain else row_count, 9, FIELDS)
    own = _scratch_array(context, "own of cells", row_count, 3, FIELDS)
    total = _scratch_array(context, "all dust of cells", count if by_grain else 0, 3, FIELDS)
    share = _scratch_array(context, "shares of grains", len(blocks.dust_order) if by_grain else 0)
    square = np.empty(len(stencil) if context.dim == 2 and law.two_way else 0)
    return (
        CellSums(corners, sides, centre_node, species_row, given, own, total, share, context.period),
        NodeSums(stencil, node_cells, centre, aligned((len(stencil), classes + 1, FIELDS)), square),
    )


def _gather_species(
    context: KickContext, kind: Species, cells: CellSums, nodes: NodeSums, rows: Array, frame: Frame, law: int
) -> tuple[tuple[Array, Array], tuple[Any, ...]]:
    """Gather the particles of a species to the sums of cells, and return (packed, collect).

    packed: two arrays, the start of the packed particles of each class in each block, and the packed particles; the
    first array is empty if nodes sum single grains. collect: the kernel that sums the species at nodes, and its
    arguments, for `parallel_for_fused`.
    """
    name, count = ("gas", "dust")[kind.first], len(cells.side)
    if kind.first > 0 and len(cells.dust_moments) > 0:
        row = _scratch_array(context, "rows of grains", len(kind.order), FIELDS)
        parallel_for(grains.gather_grains, count, kind, cells, nodes, frame, law, row, cells.scaled_mass, least=LEAST)
        return (np.empty(0, np.int64), row.ravel()), (grains.collect_grains, kind, nodes, row, cells.scaled_mass)
    begin = (FIELDS if len(kind.source) > 0 else BX) * LANES * rows
    column = _scratch_array(context, f"columns of {name}", int(begin[-1]))
    square = np.empty((count if kind.first == 0 and len(nodes.square) > 0 else 0, 9))
    parallel_for(gather.gather, count, kind, cells, nodes, frame, law, begin, column, square, least=LEAST)
    return (begin, column), (gather.collect, kind, cells, nodes, square)


def _means_in_blocks(values: Array, blocks: Blocks) -> Array:
    """Return the mean of `values` (n,) over the gas particles in each block (blocks,); 0 in a block without gas."""
    number = np.diff(blocks.gas_start[: len(blocks.level) + 1])
    of_block = np.repeat(np.arange(len(number)), number)
    summed = np.bincount(of_block, values[blocks.gas_order[: len(of_block)]], len(number))
    return summed / np.maximum(number, 1)


def _motion_of_gas(
    gas: Species, blocks: Blocks, cells: CellSums, nodes: NodeSums, dt: float
) -> Array:  # fmt: skip
    """Return the mean velocity (2, nodes) of the gas near each node, half-way through a kick by accelerations."""
    out = np.zeros((2, len(nodes.stencil)))
    for c in range(gas.vel.shape[1]):
        means = _means_in_blocks(gas.vel[:, c] + 0.5 * dt * gas.acc[:, c], blocks)
        parallel_for(relax.mean_over_gas, len(nodes.stencil), nodes, cells.moments, means, out[c], least=LEAST)
    return out


def _relax_nodes(
    gas: Species, dust: Species, blocks: Blocks, cells: CellSums, nodes: NodeSums, collect: tuple[Any, ...],
    law: DragLaw, frame: Frame, dt: float, context: KickContext,
) -> NodeImpulses:  # fmt: skip
    """Sum the dust at nodes with `collect`, relax the slip there, and return the changes to scatter to particles."""
    total, species = nodes.sums.shape[:2]
    sourced = np.array([len(gas.source) > 0] + [len(dust.source) > 0] * (species - 1))
    slopes = Slopes(aligned((total, 4)), aligned((total, species, 4)), np.zeros((total, species), bool))
    passes = [collect, (fit.fit, cells, nodes, context.dim, law.two_way, sourced, slopes)]
    sound = None
    if law.nonlinear:
        sound = np.empty(total)
        passes.append((relax.mean_over_gas, nodes, cells.moments, _means_in_blocks(gas.sound, blocks), sound))
    parallel_for_fused(passes, total, least=LEAST)
    change = DragChanges(*aligned((2, total, species, 2)), *aligned((2, total, species)))
    parallel_for(
        relax.relax, total, nodes, slopes, sourced, sound, law_over(law, dt), frame, law.several, change, least=LEAST
    )
    heating = len(context.heat) > 0
    impulse = NodeImpulses(
        aligned((total, species, LANES)), aligned((total, 4)), np.empty(total if heating else 0),
        np.empty((total if heating and len(nodes.square) > 0 else 0, 2, LANES)),
    )  # fmt: skip
    motion = _motion_of_gas(gas, blocks, cells, nodes, dt) if heating and law.two_way else np.empty((2, 0))
    parallel_for(
        antidiffusion.restore, total, nodes, slopes.pooled, change, motion, law.two_way, dt, impulse, least=LEAST
    )
    return impulse


def _stopping_times(
    dust: Species, cells: CellSums, nodes: NodeSums, impulse: NodeImpulses, packed: tuple[Array, Array]
) -> Array:
    """Return the stopping time (n,) of each dust particle; inf for particles without gas.

    packed: as in `_gather_species`.
    """
    time = np.full(len(dust.mass), np.inf)
    parallel_for(scatter.stopping_times, len(cells.side), dust, cells, nodes, impulse.value, *packed, time, least=LEAST)
    return time
