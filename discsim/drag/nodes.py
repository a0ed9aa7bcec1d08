"""Drag between nodes of a lattice (`drag/tsc.py`): one kick, from clouds about particles to the nodes and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.drag.cells import Blocks, lattice, sort_into_blocks, wanted_leaf
from discsim.drag.cloud import densities_of_sparse_dust
from discsim.drag.frame import clockwise, frame
from discsim.kernels import levels, nodes_fit, nodes_relax, nodes_scatter
from discsim.kernels import nodes as kernels
from discsim.kernels.blocks import IGNORE, LEVELS, NEAR, mass_in
from discsim.kernels.drag import free_kick
from discsim.kernels.frame import Frame
from discsim.numerics.threads import share

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import State

Array = np.ndarray
NONE = np.empty(0)


class Nodes(NamedTuple):
    """The nodes in reach of blocks: of each block its own `home`, of each node the nodes `about` it and the blocks
    `near` it (n, 9), and its place `centre` (n, 2); `sums` (n, species, ...) of what is about it.
    """

    home: Array
    about: Array
    near: Array
    centre: Array
    sums: Array


class Members(NamedTuple):
    """The particles of the gas or of the dust as kernels take them; `number` of its populations, from the `begin`th
    species on, and of each particle `packed` (n, FIELDS) and the `norm` of its weights.
    """

    name: str
    vel: Array
    density: Array
    sound: Array
    order: Array
    start: Array
    number: int
    begin: int
    packed: Array
    norm: Array


class Change(NamedTuple):
    """What the relaxation changes at nodes: `sharp` velocities and `slopes`, the gas's `spin`, the `rate` of each
    species' drag and the `heat`.
    """

    sharp: Array
    slopes: Array
    spin: Array
    rate: Array
    heat: Array


def relax(drag: Drag, state: State, dt: float, gas_vel: Array, heat: Array) -> None:
    size = drag.scheme.cells.share * (drag.drag.cell or 0.0)
    # A node has the dust of nine cells.
    dust_wanted = NEAR if drag.two_way else IGNORE
    about_star = frame(drag, state)
    leaves = lattice(drag, state, wanted_leaf(drag, state))
    blocks = sort_into_blocks(drag, state, leaves, (1, 0), size, dust_wanted, True, clockwise(about_star))
    both = _members(drag, state, blocks, gas_vel)
    nodes, cells = _gather(drag, state, blocks, both, about_star)
    change = _relax_nodes(drag, state, blocks, nodes, cells, dt, len(heat) > 0)
    _scatter(drag, state, blocks, both, nodes, change, dt)
    if len(heat) > 0:
        nodes_scatter.pass_on(nodes.sums, nodes.about, change.heat)
        share(
            nodes_scatter.spread_heat, len(blocks.level), nodes.home, nodes.about, blocks.gas_order, blocks.gas_start,
            drag.dim == 1, both[0].packed, nodes.sums, change.heat, heat, least=64,
        )  # fmt: skip
    start = blocks.dust_start[:: drag.law.populations]
    time = drag.stopping_times
    drag.note_uncoupled(
        state.dust,
        lambda mass: mass[time == np.inf].sum() + mass_in(mass, blocks.dust_order, start, blocks.enlarged, time),
    )


def _members(drag: Drag, state: State, blocks: Blocks, gas_vel: Array) -> tuple[Members, Members]:
    gas, dust = state.gas, state.dust
    sparse = densities_of_sparse_dust(drag, state)
    packed, grains = (np.zeros((p.count, kernels.FIELDS)) for p in (gas, dust))
    return (
        Members(
            "gas", gas_vel, gas.density, gas.sound_speed, blocks.gas_order, blocks.gas_start, 1, 0, packed, NONE
        ),
        Members(
            "dust", dust.vel, sparse, NONE, blocks.dust_order, blocks.dust_start, drag.law.populations, 1, grains,
            np.empty(dust.count),
        ),
    )  # fmt: skip


def _gather(
    drag: Drag, state: State, blocks: Blocks, both: tuple[Members, Members], about_star: Frame
) -> tuple[Nodes, Array]:
    """The nodes with the sums of what is about them, and those of each cell alone."""
    flat, count, species = drag.dim == 1, len(blocks.level), drag.law.populations + 1
    node, at, first, width, height, wrap = levels.place_blocks(
        blocks.level, blocks.first_leaf, *blocks.lattice.shape, blocks.lattice.periodic, LEVELS + 1
    )
    home, dense, about, near = levels.list_nodes(node, blocks.level, first, width, height, wrap, flat, at)
    total = len(near)
    cells, clouds = np.zeros((count, species, kernels.MOMENTS)), np.zeros((count, species, 9, kernels.SQUARE + 1))
    sums = np.zeros((total, species, kernels.SQUARE + 1))
    for name, vel, density, sound, order, start, number, begin, packed, norm in both:
        p, own = state.species[name], state.own_acc[name]
        share(
            kernels.pack, count, order, start, number, p.pos, vel, own, p.mass, density, sound,
            drag.law.code, blocks.corners, blocks.sides, drag.size, blocks.lattice.periodic, about_star, packed,
            least=64,
        )  # fmt: skip
        share(
            kernels.deposit, count, home, about, start, number, begin, flat, len(own) > 0, packed, sums,
            norm, cells, clouds, least=64,
        )  # fmt: skip
        share(kernels.collect, total, near, begin, begin + number, clouds, sums, least=64)
    centre = levels.node_centres(dense, first, height, blocks.lattice.origin, blocks.lattice.side)
    return Nodes(home, about, near, centre, sums), cells


def _mean_sound(state: State, blocks: Blocks, nodes: Nodes, cells: Array) -> Array:
    """Sound speed (n,) of the gas about each node."""
    count, sound = len(blocks.level), np.zeros(len(nodes.near))
    number = np.diff(blocks.gas_start[: count + 1])
    of_block = np.repeat(np.arange(count), number)
    speeds = np.bincount(of_block, state.gas.sound_speed[blocks.gas_order[: len(of_block)]], count)
    share(nodes_relax.mean_sound, len(sound), nodes.near, cells, speeds / np.maximum(number, 1), sound, least=64)
    return sound


def _relax_nodes(
    drag: Drag, state: State, blocks: Blocks, nodes: Nodes, cells: Array, dt: float, heating: bool
) -> Change:
    dim, total, sums, about = drag.dim, len(nodes.near), nodes.sums, nodes.about
    species = drag.law.populations + 1
    slopes = np.zeros((total, dim, dim))
    change, drive, rate = np.zeros((total, species, dim)), np.zeros((total, species, dim)), np.zeros((total, species))
    source_slopes, known = np.zeros((total, species, dim, dim)), np.zeros((total, species), np.bool_)
    pooled = species if drag.two_way else 1
    share(nodes_fit.fit_slopes, total, nodes.near, cells, sums, pooled, slopes, source_slopes, known, least=64)
    sound = _mean_sound(state, blocks, nodes, cells) if drag.law.nonlinear else None
    share(
        nodes_relax.relax_nodes, total, about, sums, nodes.centre, slopes, source_slopes, known, sound, drag.law.code,
        drag.law.grains, drag.two_way, dt, drag.exponential, drag.law.several, *drag.star, change, drive, rate,
        least=64,
    )  # fmt: skip
    sharp = np.empty_like(change)
    share(nodes_relax.sharpen, total, about, sums, drag.two_way, change, sharp, least=64)
    share(nodes_relax.sharpen_drive, total, about, sums, drag.two_way, drive, sharp, least=64)
    spin = np.zeros(total if dim == 2 and drag.two_way else 0)
    share(nodes_relax.turn, len(spin), sums, sharp, spin, least=64)
    sharp_slopes = np.empty_like(slopes)
    share(nodes_relax.sharpen_slopes, total, about, sums, slopes, sharp_slopes, least=64)
    heat = np.zeros(total if heating else 0)
    share(nodes_scatter.node_heat, len(heat), sums, sharp, dt, heat, least=64)
    return Change(sharp, sharp_slopes, spin, rate, heat)


def _scatter(
    drag: Drag, state: State, blocks: Blocks, both: tuple[Members, Members], nodes: Nodes, change: Change, dt: float
) -> None:
    count = len(blocks.level)
    drag.stopping_times = np.full(state.dust.count, np.inf)
    times: dict[str, Any] = {"gas": NONE, "dust": drag.stopping_times}
    for name, vel, _, _, order, start, number, begin, packed, norm in both:
        acc = state.species[name].acc
        share(
            nodes_scatter.apply_nodes, count, nodes.home, nodes.about, order, start, begin, number, packed,
            len(state.own_acc[name]) > 0, norm, nodes.sums, change.slopes, change.sharp,
            change.spin if begin == 0 else NONE, change.rate, dt, drag.exponential, vel, acc, times[name],
            change.heat, least=64,
        )  # fmt: skip
        free_kick(order[start[count * number] :], vel, acc, dt)  # outside the lattice
