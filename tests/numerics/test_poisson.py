"""The potential of a sheet on the grid, and the self-gravity made from it."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from clouds import centred, cloud, gravity, maclaurin_disc, scattered

from discsim import SceneError, Simulation
from discsim.effects.self_gravity import Effect
from discsim.exact import maclaurin
from discsim.numerics import thread_pool
from discsim.numerics.grid import Grid
from discsim.numerics.operators import accelerate, longest_step
from discsim.numerics.poisson import Plummer, Poisson, Workers


@pytest.mark.parametrize("batches", [0, 1, 40])
def test_each_batch_is_treated_once(batches):
    seen = []
    Workers((64, 64), False, 0).run_batches(lambda worker, batch: seen.append(batch), batches)  # a rank may have none
    assert seen == list(range(batches))


@pytest.mark.parametrize("shape", [(16, 16), (20, 14), (7, 37), (33, 2)])
@pytest.mark.parametrize("softening", [0.02, 0.3])
def test_open_potential_is_the_direct_sum_over_nodes(shape, softening):
    cell = 0.1
    surface_density = np.random.default_rng(1).random(shape)
    x, y = (c.ravel() * cell for c in np.indices(shape))
    distance = np.sqrt((x - x[:, None]) ** 2 + (y - y[:, None]) ** 2 + softening**2)
    direct = -(surface_density.ravel() * cell**2 / distance).sum(axis=1).reshape(shape)
    potential = Poisson(shape, cell, Plummer(softening), periodic=False).solve(surface_density)
    # What is promised; the FFT's own rounding is 1e-15.
    assert np.abs(potential / direct - 1).max() < 1e-10


@pytest.mark.parametrize("shape", [(16, 16), (20, 14), (5, 37), (7, 12), (17, 9), (33, 14)])  # padded by 0, 1 and 3
def test_open_potential_goes_on_beyond_the_edges(shape):
    """Two nodes on every side, the direct sum as well where nothing lies at the edges; within, the same bits."""
    cell, softening = 0.1, 0.07
    surface_density = np.random.default_rng(1).random(shape)
    surface_density[[0, -1]] = surface_density[:, [0, -1]] = 0.0
    x, y = (c.ravel() * cell for c in np.indices(shape))
    to_x, to_y = (c.ravel() * cell - 2 * cell for c in np.indices((shape[0] + 4, shape[1] + 4)))
    distance = np.sqrt((x - to_x[:, None]) ** 2 + (y - to_y[:, None]) ** 2 + softening**2)
    direct = -(surface_density.ravel() * cell**2 / distance).sum(axis=1).reshape(shape[0] + 4, shape[1] + 4)
    found, within = (
        Poisson(shape, cell, Plummer(softening), periodic=False, border=border).solve(surface_density)
        for border in (2, 0)
    )
    assert np.abs(found / direct - 1).max() < 1e-10
    np.testing.assert_array_equal(found[2:-2, 2:-2], within)


@pytest.mark.parametrize(("shape", "waves"), [((64, 32), (3, -2)), ((45, 20), (0, 1)), ((64, 1), (5, 0))])
def test_periodic_potential_of_a_wave(shape, waves):
    cell, softening = 0.05, 0.07
    k = 2 * np.pi * np.array(waves) / (np.array(shape) * cell)
    i, j = np.indices(shape)
    wave = np.sin(cell * (k[0] * i + k[1] * j) + 0.4)
    potential = Poisson(shape, cell, Plummer(softening), periodic=True).solve(3 + wave)
    size = np.hypot(*k)
    exact = -2 * np.pi * np.exp(-size * softening) / size * wave
    # Rounding only; the phases of the wave are large numbers.
    np.testing.assert_allclose(potential, exact, atol=1e-13 * np.abs(exact).max())


def test_a_periodic_grid_has_no_border():
    with pytest.raises(ValueError, match="expected border = 0, not 2"):
        Poisson((16, 16), 0.1, Plummer(0.1), periodic=True, border=2)


def test_open_boundaries_need_two_dimensions():
    with pytest.raises(ValueError, match="two dimensions"):
        Poisson((64, 1), 0.1, Plummer(0.1), periodic=False)


def maclaurin_error(cells, softening, count):
    """rms error over rms force, at least two softenings from the disc's edge."""
    gas = cloud(maclaurin_disc(count), 1 / count)
    gravity(centred(cells, 2.5), softening, gas)
    radius = np.hypot(*gas.pos.T)
    exact = (maclaurin.radial_acceleration(radius, 1.0, 1.0, softening) / radius)[:, None] * gas.pos
    inside = radius < 1 - 2 * softening
    return np.sqrt(((gas.acc - exact)[inside] ** 2).sum() / (exact[inside] ** 2).sum())


@pytest.mark.parametrize("softening_in_cells", [2, 5])
def test_force_of_a_maclaurin_disc(softening_in_cells):
    # What is promised for 512 cells; the lattice of 1e5 masses gives .0025 at two cells, .0003 at five.
    assert maclaurin_error(512, softening_in_cells * 2.5 / 512, 100_000) < 0.01


def test_force_converges_with_the_square_of_the_cell():
    coarse, fine = (maclaurin_error(cells, 0.1, 200_000) for cells in (32, 64))
    # Both clouds widen the field by (k cell)^2 / 12; 10% for what is left of the next order.
    assert coarse / fine == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_lone_particle_does_not_pull_itself(periodic):
    softening, rng = 0.05, np.random.default_rng(5)
    grid = Grid((-1.0, -1.0), 1 / 32, (64, 48), periodic)
    for pos in rng.uniform([-0.8, -0.8], [0.8, 0.3], (20, 2)):
        gas = cloud([pos], 2.0)
        gravity(grid, softening, gas)
        # Against the largest force it could feel at all, m / softening^2.
        assert np.abs(gas.acc).max() < 1e-12 * 2.0 / softening**2


@pytest.mark.parametrize("periodic", [False, True])
def test_momentum_is_conserved(periodic):
    grid = Grid((0.0, 0.0), 1 / 64, (64, 96), periodic)
    gas, dust = scattered(grid, 400, 6), scattered(grid, 300, 7)
    gravity(grid, 0.02, gas, dust)
    force = np.concatenate([s.mass[:, None] * s.acc for s in (gas, dust)])
    # Rounding of a sum of 700 forces.
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


def test_two_particles_attract_as_softened_points():
    pos = np.array([[-0.5, 0.0], [0.5, 0.25]])
    gas = cloud(pos, [1.0, 3.0])
    gravity(centred(128, 2.0), 0.1, gas)
    separation = pos[1] - pos[0]
    pull = separation / (separation @ separation + 0.01) ** 1.5
    # Clouds of the size of a cell, 1/64, at a distance of 1: (1/64)^2 = 2.4e-4.
    np.testing.assert_allclose(gas.acc, [3 * pull, -pull], rtol=2.4e-4)


def test_only_the_sources_attract_and_everything_is_attracted():
    grid = centred(64, 2.0)
    dust = cloud([[0.5, 0.0]], 1.0)
    gas = cloud([[-0.5, 0.0]], 1.0)
    gravity(grid, 0.1, gas, dust, sources=("gas",))
    assert dust.acc[0, 0] == pytest.approx(-1 / 1.01**1.5, rel=1e-3)  # (cell / distance)^2
    assert np.abs(gas.acc).max() < 1e-10


def test_a_sheet_in_one_dimension():
    count, amplitude, softening = 1024, 1e-3, 0.05
    x = (np.arange(count) + 0.5) / count
    gas = cloud(x[:, None], (1 + amplitude * np.sin(2 * np.pi * x)) / count, dimensions=1)
    gravity(Grid((0.0, 0.0), 1 / 256, (256, 1), periodic=True), softening, gas)
    exact = 2 * np.pi * amplitude * np.exp(-2 * np.pi * softening) * np.cos(2 * np.pi * x)
    # (k cell)^2 / 6 = 1.0e-4 of the wave, from the clouds of deposit and gather.
    np.testing.assert_allclose(gas.acc[:, 0], exact, atol=1.5e-4 * np.abs(exact).max())


def test_a_particle_off_the_grid_feels_all_the_mass_at_its_centre_and_pulls_nothing():
    grid = centred(64, 2.0)
    swarm = scattered(grid, 200, 8)
    alone = cloud(swarm.pos, swarm.mass)
    gravity(grid, 0.1, alone)
    gas = cloud(np.concatenate([swarm.pos, [[3.0, -4.0]]]), np.append(swarm.mass, 50.0))
    effect, _ = gravity(grid, 0.1, gas)
    away = gas.pos[-1] - np.average(swarm.pos, axis=0, weights=swarm.mass)
    pull = -swarm.mass.sum() * away / (away @ away + 0.01) ** 1.5
    np.testing.assert_allclose(gas.acc[-1], pull, rtol=1e-12)  # rounding
    np.testing.assert_array_equal(gas.acc[:-1], alone.acc)
    assert effect.outside == 1


def test_nothing_on_the_grid_attracts_nothing():
    gas = cloud([[5.0, 5.0]], 1.0)
    effect, state = gravity(centred(16, 2.0), 0.1, gas)
    assert not gas.acc.any()
    assert longest_step(effect, state, accelerate(effect, state)) == float("inf")
    assert effect.potential_energy(state) == 0


def test_potential_energy_is_the_sum_over_pairs():
    grid, softening = centred(32, 2.0), 0.2
    place = np.random.default_rng(9).integers(4, 28, (30, 2))
    gas = cloud(np.stack([grid.nodes(0)[place[:, 0]], grid.nodes(1)[place[:, 1]]], axis=1), 0.1)
    dust = cloud([[1.0, 1.0]], 0.5)  # off the grid: in the field, but no source of it
    distance = np.sqrt(((gas.pos[:, None] - gas.pos) ** 2).sum(axis=2) + softening**2)
    pairs = -0.5 * (0.1**2 / distance).sum()
    away = ((dust.pos[0] - gas.pos.mean(axis=0)) ** 2).sum() + softening**2
    outsider = -0.5 * 0.5 * 3.0 / np.sqrt(away)
    effect, state = gravity(grid, softening, gas, dust)
    # Particles on nodes: the direct sum, to the FFT's rounding.
    assert effect.potential_energy(state) == pytest.approx(pairs + outsider, rel=1e-12)
    assert Effect(state.scene, state).potential_energy(state) == pytest.approx(pairs + outsider, rel=1e-12)


def test_one_way_dust_does_not_limit_the_step():
    gas = cloud([[-0.5, 0.0], [0.0, 0.0]], 1.0)
    dust = cloud([[-0.45, 0.0]], 0.0)
    one_way = SimpleNamespace(direction="one-way")
    effect, state = gravity(centred(64, 2.0), 0.05, gas, dust, drag=one_way)
    of_gas, of_dust = (np.sqrt(0.05 / np.hypot(*p.acc.T).max()) for p in (gas, dust))
    found = accelerate(effect, state)
    assert longest_step(effect, state, found) == pytest.approx(of_gas, rel=1e-12)
    state.scene.drag = None
    assert longest_step(effect, state, found) == pytest.approx(of_dust, rel=1e-12) and of_dust < of_gas


def test_a_solver_made_for_one_thread_may_have_more(monkeypatch):
    """Each batch of rows on a plan of its own, and the same bits."""
    surface_density = np.random.default_rng(1).random((100, 90))
    solver = Poisson((100, 90), 0.1, Plummer(0.2), periodic=False)
    found = []
    for threads in (1, 5):
        monkeypatch.setattr(thread_pool, "number_of_threads", lambda threads=threads: threads)
        found.append(solver.solve(surface_density))
    np.testing.assert_array_equal(*found)


HELPERS = Path(__file__).parents[1] / "helpers"
THREADS = """
import hashlib, sys
sys.path.insert(0, {here!r})
from clouds import cloud, gravity, maclaurin_disc
from discsim.numerics.grid import Grid
from discsim.numerics.threads import set_threads
for periodic, corner in ((False, -1.3), (True, -1.25)):
    for threads in (1, 2, 2):
        set_threads(threads)
        gas, dust = cloud(maclaurin_disc(20_000), 1e-5), cloud(maclaurin_disc(7_001)[::-1], 1e-6)
        gravity(Grid((corner, corner), 2.6 / 135, (135, 130), periodic), 0.05, gas, dust)
        print(periodic, hashlib.sha256(gas.acc.tobytes() + dust.acc.tobytes()).hexdigest())
"""


def test_the_same_bits_on_any_number_of_threads():
    script = THREADS.format(here=str(HELPERS))
    env = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    run = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, check=True)
    lines = run.stdout.split("\n")[:-1]
    assert len(lines) == 6
    assert len(set(lines)) == 2


@pytest.mark.parametrize("length", ["1 au", "10 au"])
def test_the_pull_of_a_sheet_in_1d_does_not_depend_on_the_units(length):
    """2 pi G Sigma A exp(-k softening) at a wave's flanks, in cm/s2, whatever a code unit is."""
    scene = {
        "units": {"length": length},
        "run": {"until": "1 yr"},
        "space": {"dimensions": 1, "size": "100 au", "boundary": "periodic", "cells": 256},
        "initial": {"kind": "sheet", "surface_density": "10 g/cm2", "amplitude": 0.01},
        "gas": {"particles": 1024, "eos": {"kind": "isothermal", "sound_speed": "1 km/s"}},
        "self_gravity": {"softening": "5 au"},
    }
    sim = Simulation(scene)
    pull = np.abs(sim.acceleration("self_gravity")[0]).max() * sim.units.cgs("acceleration")
    exact = 2 * np.pi * 6.674e-8 * 10.0 * 0.01 * np.exp(-2 * np.pi * 0.05)
    assert pull == pytest.approx(exact, rel=3e-3)  # cells of 1/256 wave, and harmonics of .01


@pytest.mark.parametrize("kind", ["box", "wave"])
def test_a_volume_density_has_no_pull_in_1d(kind):
    """A volume density, taken for a surface density, would pull the harder the longer a code unit of length is."""
    scene = {
        "units": {"length": "10 au"},
        "run": {"until": "1 yr"},
        "space": {"dimensions": 1, "size": "100 au", "boundary": "periodic"},
        "initial": {"kind": kind},
        "gas": {"particles": 32, "eos": {"kind": "isothermal", "sound_speed": "1 km/s"}},
        "self_gravity": {"softening": "5 au"},
    }
    with pytest.raises(SceneError, match=f".{kind}. has a volume density; set initial.kind = .sheet., or space.d"):
        Simulation(scene)


def test_forces_do_not_depend_on_those_before():
    """Arrays that are kept from step to step hold nothing of the last one."""
    grid = centred(32, 2.0)
    gas, other = scattered(grid, 300, seed=3), scattered(grid, 300, seed=4)
    other.pos[0] = 1.0  # off the grid: it feels the mass on it as one point
    effect, state = gravity(grid, 0.2, gas)
    gas.pos[:], gas.mass[:], gas.acc[:] = other.pos, other.mass, 0.0
    accelerate(effect, state)
    again, anew = gravity(grid, 0.2, other)
    assert effect.outside == 1 and np.array_equal(gas.acc, other.acc)
    assert effect.potential_energy(state) == again.potential_energy(anew)
