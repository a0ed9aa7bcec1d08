"""Polar cells that are divided among ranks: rings of each rank, and the bits of one rank."""

from importlib.util import find_spec
from threading import Barrier, Thread
from types import SimpleNamespace

import numpy as np
import pytest

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from polar_cells import Disc, ring, rotating

from discsim import load_scene
from discsim.ranks.polar import DividedCells, RingDivision

SCENE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 5.0},
    "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.6, "outer": 1.5},
    "star": {"mass": 1.3},
    "gas": {"method": "grid", "particles": 4000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07}},
    "dust": {"particles": 3000, "ratio": 0.3},
    "drag": {"law": "stokes-number", "stokes": 0.03},
}


class Messages:
    """Exchange between threads that act as ranks."""

    def __init__(self, size):
        self.size, self.sent, self.barrier = size, {}, Barrier(size, timeout=60.0)

    def comm(self, rank):
        def alltoallv(sent, send_counts, receive_counts):
            assert len(sent) == send_counts.sum()
            self.barrier.wait()
            for to, part in enumerate(np.split(sent, np.cumsum(send_counts)[:-1])):
                self.sent[rank, to] = part
            self.barrier.wait()
            parts = [self.sent[source, rank] for source in range(self.size)]
            assert [len(part) for part in parts] == receive_counts.tolist()
            return np.concatenate(parts)

        return SimpleNamespace(rank=rank, size=self.size, alltoallv=alltoallv)


def viscous_steps(disc, steps=4, dt=0.03):
    """Steps of a disc with a viscosity and a share of small dust that differ from cell to cell; returns what leaves."""
    lost = 0.0
    for _ in range(steps):
        lost = lost + disc.step(dt)
        heat = None if disc.u is None else np.zeros(len(disc.mass))
        disc.cells.add_viscosity(disc.density, 1e-3 * disc.density, disc.acc, heat)
        disc.rate = disc.rate if heat is None else disc.rate + heat
    return lost


def part_of(disc, cells, some=slice(None)):
    """Some cells of a disc."""
    sound, u = (None if each is None else each[some].copy() for each in (disc.sound, disc.u))
    share = np.random.default_rng(2).random(len(disc.mass))[some]
    part = Disc(cells, disc.density[some], 0.0, 0.0 * disc.mass[some], sound, u, disc.gamma, star=1.3, share=share)
    part.vel[:] = disc.vel[some]
    part.forces(0.0)
    return part


def step_on_rank(disc, messages, edges, rank, out):
    division = SimpleNamespace(comm=messages.comm(rank), ring_edges=np.array(edges))
    try:
        cells = DividedCells(disc.cells, division)
        own = part_of(disc, cells, slice(edges[rank] * cells.angles, edges[rank + 1] * cells.angles))
        out[rank] = own, viscous_steps(own)
    except BaseException:
        messages.barrier.abort()
        raise


def warm(cells):
    """Adiabatic gas with some noise."""
    return rotating(cells, noise=0.2)


def torn(cells):
    """Isothermal gas of random velocities: in a step more leaves through both sides of a cell than a limit allows."""
    some = rotating(cells, noise=0.8)
    return Disc(cells, some.density, 20.0 * some.v_r, some.v_phi, sound=0.1 + 0.0 * some.mass)


@pytest.mark.parametrize("closed", [True, False], ids=["closed", "open"])
@pytest.mark.parametrize("make", [warm, torn])
@pytest.mark.parametrize(
    "edges", [(0, 7, 13), (0, 1, 1, 6, 9, 12, 13), (0, 0, 13)], ids=["even", "uneven", "one of two"]
)
def test_gas_on_ranks_has_the_bits_of_one(edges, make, closed):
    """And so has small dust that moves with it. Of uneven ranks one has no rings, and two have a single one."""
    cells = ring(13, 31, 0.4, 1.6, closed)
    begun, messages, out = make(cells), Messages(len(edges) - 1), {}
    threads = [Thread(target=step_on_rank, args=(begun, messages, edges, rank, out)) for rank in range(messages.size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    disc = part_of(begun, cells)
    lost = viscous_steps(disc)
    parts = [out[rank][0] for rank in range(messages.size)]
    for name in ("mass", "vel", "acc", "small") + (() if disc.u is None else ("u", "rate")):
        np.testing.assert_array_equal(np.concatenate([getattr(each, name) for each in parts]), getattr(disc, name))
    assert min(each.limit for each in parts) == disc.limit
    np.testing.assert_array_equal(sum(out[rank][1] for rank in out), lost)
    assert (lost[:, 0] != 0.0).all() == (lost[:, 4] != 0.0).all() == (not closed)


def divided(number, rank=0, **gas):
    scene = load_scene(SCENE | {"gas": SCENE["gas"] | gas})
    return RingDivision(scene, SimpleNamespace(size=number, rank=rank, allreduce=lambda values, _: values))


def particles(division, dust=0.0):
    """Gas at the cells, and some dust per cell at the inner edge."""
    r, number = division._ring_radius, division.angles
    phi = (np.arange(number) + 0.5) * 2.0 * np.pi / number
    pos = np.stack([np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi))], axis=-1).reshape(-1, 2)
    inside = np.resize(pos[: 3 * number], (int(dust * len(pos)), 2))
    keys = np.arange(len(pos), dtype=np.uint64)
    return {"gas": SimpleNamespace(pos=pos, count=len(pos), global_index=keys), "dust": SimpleNamespace(pos=inside)}


@pytest.mark.parametrize("number", [2, 3, 7])
def test_ranks_own_whole_rings_and_equal_loads(number):
    """Equal to 5% and a ring: tiles are about as wide as two rings."""
    division = divided(number)
    given = particles(division)
    assert division.rebalance(given)
    owner = division.owner_of("gas", given["gas"]).reshape(-1, division.angles)
    assert np.all(owner == owner[:, :1]) and np.all(np.diff(owner[:, 0]) >= 0)
    rings, mean = np.bincount(owner[:, 0], minlength=number), len(owner) / number
    assert np.all(np.abs(rings - mean) <= 0.05 * mean + 1.0)
    np.testing.assert_array_equal(rings, np.diff(division.ring_edges))


def test_dust_belongs_to_the_rank_of_the_gas_around_it():
    """Except in tiles that the border crosses: with 256 tiles along a side of 5, less than 5% of the disc."""
    division = divided(2, particles=100_000)
    given = particles(division)
    division.rebalance(given)
    owner, as_dust = (division.owner_of(name, given["gas"]) for name in ("gas", "dust"))
    r = np.hypot(*given["gas"].pos.T)
    far = np.abs(r - r[owner == 1].min()) > 1.5 / division.tiles_per_length
    np.testing.assert_array_equal(owner[far], as_dust[far])
    assert 0.0 < np.mean(owner != as_dust) < 0.05


def test_dust_at_the_inner_edge_moves_rings_to_other_ranks():
    """One grain for each cell of the disc, in its three innermost rings: their rank has fewer rings."""
    division = divided(2)
    division.rebalance(particles(division))
    before = division.ring_edges[1]
    assert division.rebalance(particles(division, dust=1.0))
    assert division.ring_edges[1] < before
    gas = particles(division)["gas"]
    gas.global_index = gas.global_index[: before * division.angles]  # what rank 0 had
    gas.pos = gas.pos[: len(gas.global_index)]
    leaving = division.leaving_rows("gas", gas, None)
    np.testing.assert_array_equal(leaving, np.arange(division.ring_edges[1] * division.angles, len(gas.pos)))
