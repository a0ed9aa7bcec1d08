"""Who would send what to whom: a whole state cut for any number of ranks by the code that runs on ranks.

Rows of an exchange are particles; `rows[receiver, sender]` is a sparse matrix (ranks, ranks).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from rank_cut import division_of
from rank_sent import Sent, of_transforms
from scipy.sparse import csr_array

from discsim import Simulation
from discsim.kernels.common.grid import BAND
from discsim.kernels.drag.blocks import LEVELS
from discsim.kernels.drag.tsc import levels
from discsim.kernels.mpi.halo import EITHER, mark_blocks, mark_cells
from discsim.numerics.grid import BORDER, Grid
from discsim.numerics.neighbours import keys_in
from discsim.numerics.poisson import ROWS
from discsim.numerics.world import NeededCells
from discsim.ranks.drag import leaf_number_ranges
from discsim.ranks.exchange import needed_ranges
from discsim.ranks.gravity import Nodes, nodes_of_slab_rows
from discsim.ranks.slabs import RankRanges
from discsim.ranks.sph import HALO
from discsim.ranks.windows import Windows, empty_node_ranges

Array = np.ndarray
AT_ONCE = 256  # ranks of which the rows of windows are at hand: of thousands, on a fine grid, they take gigabytes


class Counts(NamedTuple):
    """Of each rank: particles by species, what it sends and receives by exchange, and its part of the grid."""

    particles: dict[str, Array]
    rows: dict[str, csr_array]  # particles, [receiver, sender]
    runs: dict[str, Array]  # of the numbers of cells that each says it needs (ranks,), by exchange
    window: Array  # nodes (ranks,)
    bytes: dict[str, Sent]  # of the grid, by exchange

    def received(self, name: str) -> Array:
        """Ghosts (ranks,) that an exchange brings."""
        return np.asarray(self.rows[name].sum(axis=1)).ravel()


class Cells(NamedTuple):
    """Cells or blocks of a state: that of each particle by exchange, and how to mark those that own ones need."""

    keys: dict[str, Array]
    numbers: tuple[Array, Array]  # from begin up to end, as `numerics/world.py` has them
    mark: Any

    @property
    def count(self) -> int:
        return len(self.numbers[0])


def cells_of_gas(sim: Simulation) -> Cells:
    """Those of neighbours, before forces are made."""
    sph, gas = sim.effects["gas"].sph, sim.gas
    grids, classes = sph.grids_of(gas)

    def mark(mine: Array, out: Array) -> None:
        out |= mark_cells(mine, grids.table, np.zeros(2), grids.table, EITHER, HALO, sph.dim == 1, sph.periodic)

    numbers = np.arange(grids.cells)
    return Cells({"sph gas": keys_in(grids, classes, gas.pos)}, (numbers, numbers + 1), mark)


def blocks_of_drag(sim: Simulation) -> Cells:
    """Those of drag, after forces are made."""
    engine: Any = sim.effects["drag"].engine
    layout = engine.layout(sim.state)
    lattice, blocks, leaves = layout.lattice, layout.merged, (layout.gas_leaf, layout.dust_leaf)
    lattices = levels.lattice_levels(*lattice.shape, lattice.joined, LEVELS + 1)
    home, _, about, near = levels.list_nodes(blocks.level, blocks.first_leaf, lattices, engine.dim == 1)
    blocks.number[-1] = len(blocks.level)
    keys = {f"drag {name}": blocks.number[leaf] for name, leaf in zip(sim.state.species, leaves, strict=True)}

    def mark(mine: Array, out: Array) -> None:
        mark_blocks(mine[mine < len(blocks.level)], home, about, near, engine.scheme.rings, out)

    return Cells(keys, leaf_number_ranges(blocks, lattice), mark)


def rows_of_cells(cells: Cells, owners: dict[str, Array], ranks: int) -> tuple[dict[str, csr_array], dict[str, Array]]:
    """Rows that each rank needs of others: those in the cells that it marks; and runs of these."""
    held = {}
    for name, key in cells.keys.items():
        owner = owners[name.split()[1]]
        held[name] = csr_array((np.ones(len(key)), (key, owner)), (cells.count, ranks))
    all_held = sum(held.values()).tocsc()
    marked, runs = [], []
    for rank in range(ranks):
        mine = np.unique(all_held.indices[all_held.indptr[rank] : all_held.indptr[rank + 1]]).astype(np.int64)
        needed = np.zeros(cells.count, bool)
        needed[mine] = True
        cells.mark(mine, needed)
        marked.append(np.flatnonzero(needed))
        runs.append(len(needed_ranges(NeededCells(needed, *cells.numbers))))
    start = np.cumsum([0, *map(len, marked)])
    needs = csr_array((np.ones(start[-1]), np.concatenate(marked), start), (ranks, cells.count))
    rows = {name: _of_others(needs @ each) for name, each in held.items()}
    return rows, {next(iter(held)): np.array(runs)}  # said once


def _of_others(rows: csr_array) -> csr_array:
    rows = rows.tocsr()
    rows.setdiag(0)
    rows.eliminate_zeros()
    return rows


def nodes_about(grid: Grid, pos: Array) -> tuple[Array, Array]:
    """The first node (n, 2) about each particle, and which of them are on the grid."""
    s = (pos - np.array(grid.origin)) * (1.0 / grid.cell) - 0.5
    on = np.all((s >= 0.0) & (s < np.array(grid.shape) - 1), axis=1)
    return np.where(on[:, None], s, 0.0).astype(np.int32), on


def rows_of_nodes(nodes: Nodes, pos: Array, owner: Array, ranks: int) -> tuple[csr_array, Array, Array]:
    """Rows that each rank needs to sum its nodes, and where the first nodes about these and own ones are, as
    `Windows.from_node_ranges` takes it.
    """
    low, on = nodes_about(nodes.grid, pos)
    ends, bands = empty_node_ranges(nodes.grid, ranks)
    rows = csr_array((ranks, ranks))
    tiles, whose = nodes.tiles, nodes.owner
    needing = np.stack([whose[tiles[0][low[:, 0] + i], tiles[1][low[:, 1] + j]] for i in (0, 1) for j in (0, 1)])
    met = owner[None]  # the ranks that a particle has been counted for
    for ranked in (owner, *needing):
        new = on if ranked is owner else on & ~np.any(met == ranked, axis=0)
        if ranked is not owner:
            rows = rows + csr_array((np.ones(new.sum()), (ranked[new], owner[new])), (ranks, ranks))
            met = np.concatenate([met, ranked[None]])
        x, y = low[new].T
        for k, furthest in enumerate((np.minimum, np.maximum)):
            furthest.at(ends[k], ranked[new], x)
            furthest.at(bands[k], (ranked[new], x // BAND), y)
    return rows, ends, bands


def of_windows(windows: Windows, grid: Grid, ranks: int) -> tuple[dict[str, Sent], Array]:
    """Bytes of density and potential, and the nodes (ranks,) that each has the potential of."""
    border = 0 if grid.periodic else BORDER
    count = grid.shape[0] + 2 * border
    edges = np.array(RankRanges.divide(count, ROWS, ranks).edges)
    out = {}
    for name, size in (("density", grid.shape[0]), ("potential", count)):
        rows = nodes_of_slab_rows(np.arange(size), grid.shape[0], border)
        of_slabs, window = np.empty((ranks, ranks)), np.empty(ranks, np.int64)
        for some in np.array_split(np.arange(ranks), -(-ranks // AT_ONCE)):
            begin, end = windows.column_ranges(slice(some[0], some[-1] + 1), rows, ring=name == "potential")
            until = np.append(np.zeros((len(some), 1), np.int64), np.cumsum(end - begin, axis=1), axis=1)
            of_slabs[some] = 8 * np.diff(until[:, np.minimum(edges, size)], axis=1)
            window[some] = until[:, -1]
        np.fill_diagonal(of_slabs, 0)
        out[name] = Sent.of(of_slabs.T if name == "density" else of_slabs)
    return out, window


class Divided(NamedTuple):
    """A state that is cut for some ranks: what cuts it, and the owner of each particle by species."""

    division: Any
    owners: dict[str, Array]

    @classmethod
    def of(cls, sim: Simulation, ranks: int, parts: int = 0) -> Divided:
        """`parts`: of which each rank has some in turn (`rank_cut.py`)."""
        comm = SimpleNamespace(size=ranks, rank=0, allreduce=lambda values, _: values)
        division = division_of(parts)(sim.scene, comm)
        species = sim.state.species
        division.rebalance(species)
        return cls(division, {name: division.owner[division.tile_of(p.pos)] for name, p in species.items()})


def of_nodes(sim: Simulation, cut: Divided, cells: int | None = None) -> tuple[dict[str, csr_array], Any, Array]:
    """Rows that each rank needs to sum its nodes, by exchange, bytes of the grid, and nodes (ranks,) of windows;
    `cells`: along a side of another grid over the same space.
    """
    ranks, grid, rows = cut.division.comm.size, sim.state.grid, {}
    if cells is not None:
        grid = Grid(grid.origin, grid.cell * grid.shape[0] / cells, (cells, cells), grid.periodic)
    nodes, (ends, bands) = Nodes(grid, cut.division), empty_node_ranges(grid, ranks)
    for name, p in sim.state.species.items():
        rows[f"grid {name}"], *found = rows_of_nodes(nodes, p.pos, cut.owners[name], ranks)
        for both, each in zip((ends, bands), found, strict=True):
            both[:] = np.minimum(both[0], each[0]), np.maximum(both[1], each[1])
    return rows, *of_windows(Windows.from_node_ranges(ends, bands, 0, grid), grid, ranks)


def counts_of(sim: Simulation, cut: Divided, gas: Cells, drag: Cells) -> Counts:
    """What a state asks of the ranks that it is cut for."""
    ranks, grid = cut.division.comm.size, sim.state.grid
    found = [rows_of_cells(each, cut.owners, ranks) for each in (gas, drag)]
    rows, runs = found[0][0] | found[1][0], found[0][1] | found[1][1]
    of_grid, sent, window = of_nodes(sim, cut)
    sent |= of_transforms(grid.shape, grid.periodic, ranks)[0]
    particles = {name: np.bincount(owner, minlength=ranks) for name, owner in cut.owners.items()}
    return Counts(particles, rows | of_grid, runs, window, sent)
