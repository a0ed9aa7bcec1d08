"""A start from a snapshot whose physics has not changed goes on as its run does, whatever that foresees."""

import h5py
import numpy as np
import pytest
from runs import assert_same_run, put_out

from discsim import Simulation, load_scene, read_snapshot
from discsim.physics import profile
from discsim.run.runner import run_scene
from discsim.scene import SceneError

LOCALLY = {"kind": "locally-isothermal", "aspect_ratio": 0.1}
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.1}
DUST = {"dust": {"particles": 200, "ratio": 0.1}}
TSC = DUST | {"drag": {"law": "stokes-number", "stokes": 0.1}}
PLANET = {"mass": 0.02, "semi_major_axis": 1.5, "softening": "0.2"}
INERTIAL = {"mass": 1.0, "accretion_radius": 1.01, "grows": True, "frame": "inertial"}

GAS = {"particles": 600, "kernel": "wendland-c4", "viscosity": {}}


def scene(eos=LOCALLY, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": 10.0},
        "space": {"size": 8.0, "cells": 32},
        "initial": {"kind": "disc", "mass": 0.05, "inner": 1.0, "outer": 2.0},
        "gas": GAS | {"eos": eos},
        "star": {"mass": 1.0},
        **tables,
    }


CASES = {
    "viscosity": scene(),
    "viscosity, u": scene(gas=GAS | {"eos": ADIABATIC, "viscosity": {"pairs": "all"}, "conductivity": {}}),
    "tsc": scene(**TSC),
    "tsc, heat": scene(ADIABATIC, **TSC),
    "tsc, one-way": scene(dust=DUST["dust"], drag=TSC["drag"] | {"direction": "one-way"}),
    "pairs": scene(dust=DUST["dust"], drag={"law": "constant", "K": 1.0, "scheme": "lab14"}),
    "self-gravity": scene(self_gravity={"softening": 0.1}, **TSC),
    "alpha_viscosity": scene(alpha_viscosity={"alpha": 0.05}),
    "cooling": scene(ADIABATIC, cooling={"kind": "beta", "beta": 1.0}),
    "sizes": scene(
        dust=DUST["dust"] | {"grain_size": {"smallest": 1e-5, "largest": 1e-2}, "grain_density": 1.0},
        drag={"law": "epstein"},
    ),
    "growth": scene(
        gas=GAS | {"kernel": "cubic", "eos": LOCALLY},
        dust=DUST["dust"] | {"grain_size": 1e-5, "grain_density": 1.0},
        drag={"law": "epstein"},
        growth={"fragmentation_speed": 0.1, "alpha": 1e-3, "small_size": 1e-6},
    ),
    "dust diffusion": scene(dust_diffusion={"alpha": 0.01}, **TSC),
    "radiation pressure": scene(radiation_pressure={"beta": 0.2}, **TSC),
    "polar grid": scene(
        gas={"method": "grid", "particles": 600, "eos": ADIABATIC},
        alpha_viscosity={"alpha": 0.05},
        companion=[PLANET | {"orbit": "live", "eccentricity": 0.2}],
        **TSC,
    ),
    "live companion": scene(companion=[PLANET | {"orbit": "live", "eccentricity": 0.2}], **TSC),
    "inertial frame": scene(
        star=INERTIAL,
        companion=[PLANET | {"orbit": "live", "accretion_radius": 0.1, "accretion_rate": 30.0},
                   PLANET | {"semi_major_axis": 3.0, "ramp": 1.0, "phase": 70.0}],
        **TSC,
    ),
}  # fmt: skip


SEEN = ("pos", "vel", "mass", "ids", "u", "small", "size")


def step(sim):
    """One, whose closing kick stays open as in a run."""
    sim.evolve(10.0, lambda: True)


def restarted(given, path, **keys):
    return Simulation(given | {"initial": {"kind": "snapshot", "file": str(path), **keys}})


def seen(sim):
    """Particles by ids, and bodies, closed."""
    with sim.synchronised() as state:
        out = {}
        for name, p in state.species.items():
            order = np.argsort(p.ids)
            held = {k: v[order].copy() for k, v in p.arrays().items() if k in SEEN}
            out |= {f"{name}.{k}": v for k, v in held.items()}
        if state.bodies is not None:
            out |= {f"bodies.{k}": getattr(state.bodies, k).copy() for k in ("mass", "pos", "vel")}
        return out


@pytest.mark.parametrize("case", CASES)
def test_it_goes_on_as_the_run(case, tmp_path):
    sim = Simulation(CASES[case])
    for _ in range(5):
        step(sim)
    put_out(sim, tmp_path / "0001.h5")
    again = restarted(CASES[case], tmp_path / "0001.h5")
    assert again.time == 0.0 and again.state.step == 0
    for _ in range(4):
        step(sim)
        step(again)
    old, new = seen(sim), seen(again)
    assert old.keys() == new.keys()
    for name, array in old.items():
        # Speeds and radii are about 1; rounding of sums in another order, over four steps.
        np.testing.assert_allclose(new[name], array, rtol=0, atol=1e-13, err_msg=name)


def test_a_snapshot_of_what_goes_on_goes_on_too(tmp_path):
    given = CASES["inertial frame"]
    sims = [Simulation(given)]
    for k in range(3):
        for sim in sims:
            for _ in range(3):
                step(sim)
        put_out(sims[-1], tmp_path / f"{k}.h5")
        sims.append(restarted(given, tmp_path / f"{k}.h5"))
    first, last = seen(sims[0]), seen(sims[-1])
    assert len(first["gas.ids"]) < 600  # the star and a companion have taken some
    for name, array in first.items():
        np.testing.assert_allclose(last[name], array, rtol=0, atol=1e-12, err_msg=name)


@pytest.fixture(scope="module")
def binary(tmp_path_factory):
    """A run with two companions in an inertial frame after some steps, and its snapshot."""
    sim, path = Simulation(CASES["inertial frame"]), tmp_path_factory.mktemp("run") / "0001.h5"
    for _ in range(8):
        step(sim)
    put_out(sim, path)
    return sim, path


def relative(sim):
    """Places and velocities of the companions, and of the gas by ids, from the star."""
    with sim.synchronised() as state:
        b, gas, order = state.bodies, state.gas, np.argsort(state.gas.ids)
        return np.concatenate([
            b.pos[1:] - b.pos[0], b.vel[1:] - b.vel[0], gas.pos[order] - b.pos[0], gas.vel[order] - b.vel[0],
        ])  # fmt: skip


@pytest.mark.parametrize("frame", ["star", "inertial"])
def test_with_other_physics_companions_stay_on_their_way(binary, frame):
    sim, path = binary
    changed = CASES["inertial frame"] | {"alpha_viscosity": {"alpha": 0.01}, "star": INERTIAL | {"frame": frame}}
    again = restarted(changed, path)
    assert again.state.velocity_lag == 0.0
    np.testing.assert_allclose(relative(again), relative(sim), rtol=0, atol=1e-13)
    np.testing.assert_allclose(again.bodies.mass, sim.bodies.mass, rtol=1e-14)  # with what they took
    np.testing.assert_allclose(again.bodies.felt, sim.bodies.felt, rtol=1e-14)  # with the ramp
    wide = np.abs(relative(again)).max()
    assert wide > 1.0 and np.abs(sim.bodies.pos[0]).max() > 1e-3  # so that a frame matters
    step(again)


def test_a_companion_put_in_begins_as_its_table_says(binary):
    sim, path = binary
    changed = CASES["inertial frame"] | {"companion": [CASES["inertial frame"]["companion"][0],
                                                       PLANET | {"semi_major_axis": 2.5, "ramp": 1.0}]}  # fmt: skip
    again = restarted(changed, path)
    b = again.bodies
    assert b.felt[2] == 0.0 and np.abs(b.pos[2] - b.pos[0] - [2.5, 0.0]).max() < 1e-14
    with sim.synchronised() as state:
        old = state.bodies.pos[1] - state.bodies.pos[0]
    assert np.abs(b.pos[1] - b.pos[0] - old).max() < 1e-14


def test_a_snapshot_without_what_is_open_starts_with_closed_velocities(binary, tmp_path):
    sim, path = binary
    old = tmp_path / "old.h5"
    old.write_bytes(path.read_bytes())
    with h5py.File(old, "a") as file:
        del file["discsim/OpenStep"]
    assert read_snapshot(old).open_step is None
    again = restarted(CASES["tsc"], old)
    assert again.state.velocity_lag == 0.0
    gas, order = read_snapshot(old).gas, np.argsort(again.gas.ids)
    with sim.synchronised() as state:
        np.testing.assert_allclose(again.gas.vel[order], gas.vel - state.bodies.vel[0], atol=1e-14)
    step(again)


def test_laws_that_refer_to_the_first_start_go_on(tmp_path):
    """Sigma_ref, and alpha that is a power of r, of a snapshot of a run that began with a snapshot, in other units."""
    grains = {"dust": DUST["dust"], "drag": {"law": "stokes-over-density", "stokes": 0.1}}
    viscous = {"alpha_viscosity": {"alpha": 0.01, "index": 0.5}}
    code = scene(**grains, **viscous)
    first = Simulation(code)
    step(first)
    put_out(first, tmp_path / "0.h5")
    second = restarted(code, tmp_path / "0.h5")
    step(first)
    step(second)
    np.testing.assert_allclose(seen(second)["dust.vel"], seen(first)["dust.vel"], atol=1e-13)
    put_out(second, tmp_path / "1.h5")
    third = restarted(code, tmp_path / "1.h5")
    assert profile.reference_density(third.scene) == profile.reference_density(first.scene) > 0.0
    physical = {name: table for name, table in code.items() if name != "units"}
    physical |= {"run": {"until": "1 yr"}, "space": {"size": "8 au", "cells": 32}, "star": {"mass": "1 Msun"}}
    physical |= {"initial": {"kind": "disc", "mass": "0.05 Msun", "inner": "1 au", "outer": "2 au"}}
    sim = Simulation(physical)
    sim.step()
    put_out(sim, tmp_path / "2.h5")
    start = {"kind": "snapshot", "file": str(tmp_path / "2.h5")}
    found = [load_scene(physical | {"units": units, "initial": start})
             for units in ({}, {"length": "10 au", "mass": "1 Msun"})]  # fmt: skip
    sigma = [one.units.quantity(profile.reference_density(one), "density").to_value("g/cm2") for one in found]
    assert sigma[0] == pytest.approx(sigma[1], rel=1e-12)


def test_a_law_without_a_reference_is_told(tmp_path):
    sim = Simulation(scene(**DUST))
    put_out(sim, tmp_path / "0.h5")
    with h5py.File(tmp_path / "0.h5", "a") as file:
        del file["discsim"].attrs["reference_density"]
    law = scene(**DUST, drag={"law": "stokes-over-density", "stokes": 0.1})
    older = restarted(law, tmp_path / "0.h5")  # its own scene has it
    assert profile.reference_density(older.scene) == profile.reference_density(sim.scene)
    put_out(restarted(scene(**DUST), tmp_path / "0.h5"), tmp_path / "1.h5")
    with h5py.File(tmp_path / "1.h5", "a") as file:
        del file["discsim"].attrs["reference_density"]
    with pytest.raises(SceneError, match=r"had no Sigma_ref.*; choose a drag\.law other than"):
        restarted(law, tmp_path / "1.h5")


def test_runs_from_snapshots_meet(tmp_path, monkeypatch):
    """From files of runs: one from the first snapshot of another has that one's later snapshots."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    given = CASES["live companion"]
    assert run_scene(load_scene(given | {"run": {"until": 0.3, "snapshots": 3}}), tmp_path / "a", quiet=True) == 0
    start = {"kind": "snapshot", "file": str(tmp_path / "a/snapshots/0001.h5")}
    later = given | {"initial": start, "run": {"until": 0.2, "snapshots": 2}}
    assert run_scene(load_scene(later), tmp_path / "b", quiet=True) == 0
    one, other = (read_snapshot(tmp_path / name) for name in ("a/snapshots/0003.h5", "b/snapshots/0002.h5"))
    for kind in ("gas", "dust", "bodies"):
        for name in ("pos", "vel", "mass"):
            ours, theirs = (getattr(getattr(snap, kind), name) for snap in (one, other))
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)
    straight, parts = tmp_path / "b", tmp_path / "c"  # and such a run resumes to the same bits
    short = load_scene(later | {"run": {"until": 0.1, "snapshots": 1}})
    assert run_scene(short, parts, quiet=True) == 0
    assert run_scene(load_scene(later), parts, resume=True, quiet=True) == 0
    assert_same_run(straight, parts)
    assert (straight / "companions.csv").read_text() == (parts / "companions.csv").read_text()
