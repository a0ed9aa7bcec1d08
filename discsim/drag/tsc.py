"""tsc: drag between nodes of a lattice with the weights of a triangular-shaped cloud.

The slip at a node, from velocities of nine cells and slopes within each species, relaxes exactly with the
accelerations inside; its change is scattered with the weights that gathered it, so that momentum and, but for nodes
with next to no gas, angular momentum are exact; what is left of a particle decays towards its own species' line
(equations in `kernels/nodes.py`). About a star velocities are taken relative to circular orbits (`drag/frame.py`).
Cells are those of `drag/cells.py` at the power of two nearest to the wanted side, each side a lattice of its own, whose
origin moves with every step.
"""

from __future__ import annotations

import numpy as np

from discsim.drag.cells import lattice, sort_into_blocks
from discsim.drag.cloud import densities_of_sparse_dust
from discsim.drag.frame import clockwise, frame
from discsim.kernels import levels
from discsim.kernels import nodes as kernels
from discsim.kernels.blocks import IGNORE, LEVELS, NEAR, mass_in
from discsim.kernels.drag import free_kick
from discsim.numerics.layout import NEAREST, leaf_of_nodes
from discsim.numerics.threads import share

NONE = np.empty(0)


def relax(drag, state, dt, gas_vel, heat):
    wanted = drag.drag.cell_length
    if wanted is None:
        wanted = leaf_of_nodes(drag.drag.cell, float(np.exp(np.log(state.gas.h).mean())), state.gas.h.min())
    size = NEAREST * (drag.drag.cell or 0.0)
    # A node has the dust of nine cells.
    dust_wanted = NEAR if drag.two_way else IGNORE
    about_star = frame(drag, state)
    leaves = lattice(drag, state, wanted)
    blocks = sort_into_blocks(drag, state, leaves, (1, 0), size, dust_wanted, True, clockwise(about_star))
    gas, dust, dim, count = state.gas, state.dust, drag.dim, len(blocks.level)
    population = drag.law.populations
    species = population + 1
    node, at, first, width, height, wrap = levels.place_blocks(
        blocks.level, blocks.first_leaf, *blocks.lattice.shape, blocks.lattice.periodic, LEVELS + 1
    )
    home, dense, about, near = levels.list_nodes(node, blocks.level, first, width, height, wrap, dim == 1, at)
    total = len(near)
    cells, clouds = np.zeros((count, species, kernels.MOMENTS)), np.zeros((count, species, 9, kernels.SQUARE + 1))
    nodes = np.zeros((total, species, kernels.SQUARE + 1))
    packed, norm = {}, {"gas": NONE, "dust": np.empty(dust.count)}
    members = {
        "gas": (gas_vel, gas.density, gas.sound_speed, blocks.gas_order, blocks.gas_start, 1, 0),
        "dust": (
            dust.vel,
            densities_of_sparse_dust(drag, state),
            NONE,
            blocks.dust_order,
            blocks.dust_start,
            population,
            1,
        ),
    }
    for name, (vel, density, sound, order, start, number, begin) in members.items():
        p, own = state.species[name], state.own_acc[name]
        packed[name] = np.zeros((p.count, kernels.FIELDS))
        share(
            kernels.pack, count, order, start, number, p.pos, vel, own, p.mass, density, sound,
            drag.law.code, blocks.corners, blocks.sides, drag.size, blocks.lattice.periodic, about_star, packed[name],
            least=64,
        )  # fmt: skip
        share(
            kernels.deposit, count, home, about, start, number, begin, dim == 1, len(own) > 0, packed[name], nodes,
            norm[name], cells, clouds, least=64,
        )  # fmt: skip
        share(kernels.collect, total, near, begin, begin + number, clouds, nodes, least=64)
    centre = levels.node_centres(dense, first, height, blocks.lattice.origin, blocks.lattice.side)
    slopes = np.zeros((total, dim, dim))
    change, drive, rate = np.zeros((total, species, dim)), np.zeros((total, species, dim)), np.zeros((total, species))
    source_slopes, known = np.zeros((total, species, dim, dim)), np.zeros((total, species), np.bool_)
    pooled = species if drag.two_way else 1
    share(kernels.fit_slopes, total, near, cells, nodes, pooled, slopes, source_slopes, known, least=64)
    sound = None
    if drag.law.nonlinear:
        sound = np.zeros(total)
        number = np.diff(blocks.gas_start[: count + 1])
        of_block = np.repeat(np.arange(count), number)
        speeds = np.bincount(of_block, gas.sound_speed[blocks.gas_order[: len(of_block)]], count)
        share(kernels.mean_sound, total, near, cells, speeds / np.maximum(number, 1), sound, least=64)
    share(
        kernels.relax_nodes, total, about, nodes, centre, slopes, source_slopes, known, sound, drag.law.code,
        drag.law.grains, drag.two_way, dt, drag.exponential, drag.law.several, *drag.star, change, drive, rate,
        least=64,
    )  # fmt: skip
    sharp = np.empty_like(change)
    share(kernels.sharpen, total, about, nodes, drag.two_way, change, sharp, least=64)
    share(kernels.sharpen_drive, total, about, nodes, drag.two_way, drive, sharp, least=64)
    spin = np.zeros(total if dim == 2 and drag.two_way else 0)
    share(kernels.turn, len(spin), nodes, sharp, spin, least=64)
    sharp_slopes = np.empty_like(slopes)
    share(kernels.sharpen_slopes, total, about, nodes, slopes, sharp_slopes, least=64)
    node_heat = np.zeros(total if len(heat) > 0 else 0)
    share(kernels.node_heat, len(node_heat), nodes, sharp, dt, node_heat, least=64)
    drag.stopping_times = np.full(dust.count, np.inf)
    times = {"gas": NONE, "dust": drag.stopping_times}
    for name, (vel, _, _, order, start, number, begin) in members.items():
        acc = state.species[name].acc
        share(
            kernels.apply_nodes, count, home, about, order, start, begin, number, packed[name],
            len(state.own_acc[name]) > 0, norm[name], nodes, sharp_slopes, sharp, spin if begin == 0 else NONE,
            rate, dt, drag.exponential, vel, acc, times[name], node_heat, least=64,
        )  # fmt: skip
        free_kick(order[start[count * number] :], vel, acc, dt)  # outside the lattice
    if len(heat) > 0:
        kernels.pass_on(nodes, about, node_heat)
        share(
            kernels.spread_heat, count, home, about, blocks.gas_order, blocks.gas_start, dim == 1, packed["gas"], nodes,
            node_heat, heat, least=64,
        )  # fmt: skip
    start = blocks.dust_start[::population]
    time = drag.stopping_times
    drag.note_uncoupled(
        dust, lambda mass: mass[time == np.inf].sum() + mass_in(mass, blocks.dust_order, start, blocks.enlarged, time)
    )
