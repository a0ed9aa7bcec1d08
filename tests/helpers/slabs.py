"""For mpiexec: the pull, potential and sums of particles on many grids, of each rank alone and of all together; what
differs, a line a case.

mpiexec -n 4 python tests/helpers/slabs.py
"""

import sys
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from clouds import cloud

from discsim.kernels.gravity.poisson import TILE
from discsim.numerics.grid import Grid
from discsim.numerics.mesh import Mesh
from discsim.numerics.poisson import Plummer, Poisson, ThinDisc
from discsim.ranks.comm import Comm
from discsim.ranks.division import Division
from discsim.ranks.gravity import divided_mesh

CELL = 0.05
# Shape, whether periodic, kernel, and how particles lie.
CASES = {
    "open": ((64, 64), False, Plummer(0.1), "disc"),
    "thin-disc": ((45, 60), False, ThinDisc(0.1), "disc"),
    "many columns": ((20, 150), False, Plummer(0.05), "even"),
    "padded": ((33, 40), False, Plummer(0.1), "even"),
    "few rows": ((5, 33), False, ThinDisc(0.2), "even"),
    "off the grid": ((40, 37), False, Plummer(0.1), "beyond"),
    "all off the grid": ((16, 16), False, Plummer(0.1), "far"),
    "one clump": ((64, 64), False, Plummer(0.1), "clump"),
    "periodic": ((64, 48), True, Plummer(0.1), "even"),
    "periodic disc": ((96, 96), True, ThinDisc(0.1), "disc"),
    "periodic corner": ((40, 50), True, Plummer(0.1), "corner"),
    "periodic and narrow": ((90, 3), True, ThinDisc(0.1), "even"),
    "sheet": ((64, 1), True, Plummer(0.1), "even"),
}


def particles(lie, sides, number, seed, dim):
    """In a space about the origin, in an order of their own."""
    rng = np.random.default_rng(seed)
    places = {
        "even": lambda: rng.uniform(-0.499, 0.499, (number, 2)) * sides,
        "beyond": lambda: rng.normal(0.0, 0.3, (number, 2)) * sides,
        "far": lambda: 3.0 * sides + rng.random((number, 2)),
        "disc": lambda: 0.4 * sides.min() * _disc(rng, number),
        "corner": lambda: CELL * (0.7 + 0.5 * rng.random((number, 2))) - 0.5 * sides,  # about the first nodes
        "clump": lambda: 0.01 * rng.random((number, 2)) + 0.2,
    }
    out = cloud(places[lie]()[:, :dim], rng.random(number) + 0.1, dim)
    out.global_index = np.arange(number, dtype=np.uint64)
    return out


def _disc(rng, number):
    angle, radius = 2 * np.pi * rng.random(number), np.sqrt(rng.random(number))
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def found(mesh, species):
    """Rows (n, d + 1) of each species, its pull and the potential; and how many of a rank's particles are off."""
    mesh.solve(species, ["gas", "dust"])
    mesh.differentiate()
    off = 0
    for p in species.values():
        p.acc[:] = 0.0
        off += mesh.pull([(p.pos, p.acc)])[0][1]
    return {n: np.column_stack([p.acc, mesh.potential(p.pos)]) for n, p in species.items()}, off


def differences(comm, shape, periodic, kernel, lie):
    dim = 1 if shape[1] == 1 else 2
    sides = CELL * np.array(shape)
    corner = tuple(-0.5 * sides) if dim == 2 else (-0.5 * sides[0], 0.0)
    grid = Grid(corner, CELL, shape, periodic)
    space = SimpleNamespace(
        dimensions=dim, size=tuple(sides[:dim]), cells=max(shape), boundary="periodic" if periodic else "open"
    )
    division = Division(SimpleNamespace(space=space, centred=True), comm)
    alone = Mesh(grid, kernel)
    mesh = divided_mesh(alone, division)
    wrong = ["kernel"] if dim == 2 and not same_kernel(mesh) else []
    for seed in (1, 2):  # arrays that are kept hold nothing of the last time
        species = {n: particles(lie, sides, 2000, 10 * seed + k, dim) for k, n in enumerate(("gas", "dust"))}
        expected, off = found(alone, species)
        division.rebalance(species)
        own = {n: np.flatnonzero(division.owner[division.tile_of(p.pos)] == comm.rank) for n, p in species.items()}
        for name, p in species.items():
            p.take(own[name])
        got, off_here = found(mesh, species)
        for name in species:
            wrong += [name] if got[name].tobytes() != expected[name][own[name]].tobytes() else []
        wrong += ["off"] if comm.mpi.allreduce(off_here) != off else []
        if off:
            wrong += [
                "sums"
                for a, b in zip(mesh.density_sums(), alone.density_sums(), strict=True)
                if a.tobytes() != b.tobytes()
            ]
    return wrong


def same_kernel(mesh):
    """Whether the rows of its transform are those of one rank."""
    grid, of_rank = mesh.grid, mesh.slabs._kernel
    whole = Poisson(grid.shape, grid.cell, mesh.kernel, grid.periodic, mesh.border)._kernel
    first = TILE * mesh.slabs._tiles.edges[mesh.comm.rank]
    return whole[first : first + len(of_rank)].tobytes() == of_rank.tobytes()


def main():
    comm = Comm()
    for name, case in CASES.items():
        wrong = comm.mpi.allgather(differences(comm, *case))
        if comm.rank == 0:
            print(f"{name}: {', '.join(sorted({*chain(*wrong)})) or 'the same'}", flush=True)


if __name__ == "__main__":
    main()
