"""Memory of gas in polar cells, the cost of damping zones, and messages of runs that name cells."""

import tracemalloc

import numpy as np
import pytest
from scenes import changed

from discsim import SceneError, Simulation, load_scene
from discsim.effects.base import Counts
from discsim.effects.damping import OUTSIDE_COST, WITHIN_COST, Effect
from discsim.initial import balance
from discsim.preview.forecast import memory_bytes
from discsim.run.forces import PhysicsError

DISC = {
    "units": {"system": "code"},
    "run": {"until": 4.0},
    "space": {"size": 5.0},
    "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.6, "outer": 1.5, "surface_density_index": 1.0},
    "star": {"mass": 1.3},
    "gas": {"method": "grid", "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07, "temperature_index": 1.0}},
    "companion": {"mass": 3e-4, "semi_major_axis": 1.0, "softening": 0.6},
}
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.07}


def with_cells(count, **gas):
    return changed(DISC, gas=DISC["gas"] | {"particles": count} | gas)


def peak_of_steps(scene):
    """Number of cells, and the largest memory of a run of three steps in bytes, without that of the start."""
    tracemalloc.start()
    try:
        sim = Simulation(load_scene(scene))
        tracemalloc.reset_peak()
        for _ in range(3):
            sim.step()
        return sim.gas.count, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("more", "most"), [({}, 200.0), ({"eos": ADIABATIC}, 310.0)])
def test_memory_of_a_cell(more, most):
    """Arrays of the state take 112 bytes a cell, 176 with energies, and those of the drift 72 or 88.

    Ghost rings add 2%: there are four for about 200 rings. Temporary arrays are the rest.
    """
    Simulation(load_scene(with_cells(900, **more))).step()  # imports and compiles
    small, large = (peak_of_steps(with_cells(count, **more)) for count in (40_000, 160_000))
    assert (large[1] - small[1]) / (large[0] - small[0]) < most


def test_forecast_of_memory():
    """The memory of a cell, with that of writing snapshots, is below that of a particle unless cells have energies."""
    scenes = [with_cells(count, **more) for more in ({}, {"eos": ADIABATIC}) for count in (10_000, 20_000)]
    few, many, heated, more_heated = (memory_bytes(load_scene(scene)) for scene in scenes)
    assert many - few == pytest.approx(490.0 * 10_000, rel=0.01)  # whole rings
    assert more_heated - heated == pytest.approx(720.0 * 10_000, rel=0.01)


def test_forces_and_drift_share_memory_and_change_no_bits():
    """Velocities of the forces are overwritten by each drift; forces before and after it are those of fresh arrays."""
    sim = Simulation(load_scene(with_cells(900)))
    rng = np.random.default_rng(3)
    sim.gas.vel += 0.01 * rng.standard_normal(sim.gas.vel.shape)
    sim.step()
    cells = sim.effects["gas"].cells
    assert np.shares_memory(cells.padded, cells.new) and np.shares_memory(cells.around, cells.swept)
    before = sim.acceleration("gas")[0]
    cells.set_rings(cells.geometry, cells.shape[0])
    cells.fields[:] = cells.new[:] = cells.swept[:] = np.nan
    assert np.array_equal(sim.acceleration("gas")[0], before)


def test_velocities_of_the_start_in_parts(monkeypatch):
    """The mean pull of a companion is that of all particles, whichever are computed together."""
    whole = Simulation(load_scene(with_cells(900)))
    monkeypatch.setattr(balance, "CHUNK", 211)
    assert np.array_equal(Simulation(load_scene(with_cells(900))).gas.vel, whole.gas.vel)


@pytest.mark.parametrize("zones", [{"inner": [0.6, 0.8]}, {"inner": [0.6, 0.8], "outer": [1.3, 1.5]}])
def test_damping_costs_by_the_cells_in_its_zones(zones):
    """Rings are even in ln r, and particles with Sigma ~ 1/r in r."""
    ends = list(zones.values())
    cells = load_scene(changed(with_cells(40_000), damping=zones))
    within = sum(np.log(high / low) for low, high in ends) / np.log(1.5 / 0.6)
    costs = [OUTSIDE_COST, WITHIN_COST - OUTSIDE_COST]
    # A zone may end within a ring, of which there are 76.
    assert Effect.nanoseconds(cells, Counts(1, 0, 0)) == pytest.approx(np.dot(costs, [1.0, within]), abs=160.0 / 76)
    sph = changed(DISC, gas=DISC["gas"] | {"method": "sph", "particles": 900}, damping=zones)
    within = sum(high - low for low, high in ends) / 0.9
    assert Effect.nanoseconds(load_scene(sph), Counts(1, 2, 0)) == pytest.approx(3.0 * np.dot(costs, [1.0, within]))


def test_a_cell_that_is_not_finite_is_a_cell():
    sim = Simulation(load_scene(with_cells(900)))
    sim.gas.vel[17] = np.nan
    with pytest.raises(PhysicsError, match="gas cell 17 is not finite in its vel"):
        sim.step()


@pytest.mark.parametrize("method", ["grid", "sph"])
def test_self_gravity_that_acts_outwards_has_its_own_remedy(method):
    """The inner half of a ring falls outwards. Its temperature is no remedy, but a length of the gravity kernel is."""
    gas = {"method": method, "particles": 1500, "eos": {"kind": "isothermal", "sound_speed": 0.01}}
    scene = changed(DISC, gas=None, companion=None, star={"mass": 1e-3}, space={"size": 2.6, "cells": 128})
    scene |= {"gas": gas, "initial": {"kind": "disc", "mass": 1.3, "inner": 1.0, "outer": 1.2}}
    for softening, remedy in ((1e-3, "; raise self_gravity.softening to 0.02031"), (0.04, "; lower the mass")):
        with pytest.raises(SceneError, match="self-gravity acts outwards") as error:
            Simulation(load_scene(scene | {"self_gravity": {"softening": softening}}))
        assert remedy in str(error.value) and "H/r" not in str(error.value)
