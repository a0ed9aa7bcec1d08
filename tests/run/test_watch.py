"""What watches a run from Python: callbacks that change nothing, times that are landed on, progress, tables."""

import builtins
import copy
import math
import pickle
import signal

import numpy as np
import pytest
from astropy import units as u
from runs import assert_same_arrays, at_step, state_bits

from discsim import Simulation, load_scene, read_snapshot, simulate
from discsim.output.snapshot_writer import write_snapshot
from discsim.parts import Lazy

SCENE = {
    "title": "a <disc>",
    "units": {"system": "code"},
    "run": {"until": 0.3, "courant": 0.1},
    "space": {"size": 8.0, "cells": 32},
    "initial": {"kind": "disc", "mass": 0.05, "inner": 1.0, "outer": 2.0},
    "gas": {"particles": 600, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
    "dust": {"particles": 200, "ratio": 0.1},
    "drag": {"law": "stokes-number", "stokes": 0.1},
    "star": {"mass": 1.0},
}


def made(**run):
    return Simulation(SCENE | {"run": SCENE["run"] | run})


def test_to_look_after_each_step_changes_no_bit():
    alone, watched, seen = made(), made(), []

    def look(sim):
        seen.append((sim.time, sim.state.velocity_lag, sim.gas.vel.copy()))
        sim.dust.vel = np.full_like(sim.dust.vel, 9.0)  # lost at the end

    alone.run()
    watched.run(callback=look)
    assert state_bits(alone) == state_bits(watched)
    times = [time for time, _, _ in seen]
    assert times == sorted(set(times)) and times[-1] == 0.3 and len(times) == watched.state.step > 3
    assert all(lag == 0.0 for _, lag, _ in seen)  # velocities are at the time of places
    np.testing.assert_array_equal(seen[-1][2], watched.gas.vel)


def test_times_of_a_callback_are_landed_on():
    times = []
    made().run(every=0.07, callback=lambda sim: times.append(sim.time))
    assert times == [0.07, 0.14, 0.21, 0.28, 0.3]  # as decimal numbers, and the end


def test_interrupted_it_calls_at_the_same_times_and_has_the_same_bits(monkeypatch):
    straight, parts, times = made(), made(), []
    straight.run(every=0.1, callback=lambda sim: None)
    at_step(monkeypatch, 4, lambda sim: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        parts.run(every=0.1, callback=lambda sim: times.append(sim.time))
    assert parts.state.step == 4 and 0.0 < parts.time < 0.3
    parts.run(every=0.1, callback=lambda sim: times.append(sim.time))
    assert times == [0.1, 0.2, 0.3] and state_bits(straight) == state_bits(parts)


def test_a_callback_ends_a_run():
    sim = made()
    sim.run(callback=lambda sim: sim.state.step == 2)
    assert sim.state.step == 2 and sim.state.velocity_lag == 0.0
    sim.run(every=0.1, callback=lambda sim: True)
    assert sim.time in (0.1, 0.2)


def test_progress_is_told_to_the_time_that_was_asked_for(capsys):
    sim = made()
    sim.run(0.05, progress=True)
    assert f"step {sim.state.step}  t = 0.05 of 0.05" in capsys.readouterr().out
    sim.run(0.06)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "given", [{"every": 0.1}, {"every": 0.0, "callback": print}, {"every": -1.0, "callback": print}]
)
def test_every_needs_a_time_and_a_callback(given):
    sim = made()
    with pytest.raises(ValueError, match="expected a positive time, and the argument callback"):
        sim.run(**given)
    assert sim.time == 0.0


# About 1 Msun the orbit at r au takes r^1.5 yr.
@pytest.mark.parametrize(
    ("until", "every"),
    [(1.0 * u.yr, 0.5 * u.yr), ("1 yr", "0.5 yr"), ("1 orbit at 1 au", "0.5 orbits at 1 au")],
)
def test_times_may_be_quantities_and_texts(until, every):
    grains = {
        "run": {"until": "2 yr", "courant": 0.05}, "space": {"size": "8 au"}, "star": {"mass": "1 Msun"},
        "dust": {"ratio": 1.0},
    }  # fmt: skip
    own = {"pos": [[1.0, 0.0]] * u.au, "vel": [[0.0, 29.78]] * u.km / u.s, "mass": [1.0] * u.g}
    sim, times = Simulation(grains, particles={"dust": own}), []
    sim.run(until=until, every=every, callback=lambda sim: times.append(sim.time))
    assert (times * sim.units.time).to_value("yr") == pytest.approx([0.5, 1.0], rel=1e-4)  # a Gaussian year: 365.257 d
    # The Earth, once around; a phase error of some (Omega dt)^2 of the orbit.
    assert sim.dust.pos[0] == pytest.approx([1.0, 0.0], abs=0.02)


# Snapshots


def test_a_snapshot_that_is_written_is_that_of_a_run_and_changes_no_bit(tmp_path):
    """A snapshot has the same bits written by a run, in a callback, in `synchronised`, or between two steps."""
    until = 0.13
    run = simulate(SCENE | {"run": SCENE["run"] | {"until": until, "snapshots": 1}}, tmp_path / "run")
    straight, written = made(until=until), made(until=until)
    straight.run()
    written.run(callback=lambda sim: sim.write_snapshot(tmp_path / "callback.h5"))
    written.write_snapshot(tmp_path / "closed.h5")
    open_step = made()
    open_step.evolve(until)
    assert open_step.state.velocity_lag > 0.0
    open_step.write_snapshot(tmp_path / "open.h5")
    with open_step.synchronised():
        open_step.write_snapshot(tmp_path / "synchronised.h5")
    for name in ("callback", "closed", "open", "synchronised"):
        snap = read_snapshot(tmp_path / f"{name}.h5")
        assert snap.time == run[-1].time == until and snap.dust.stokes is not None  # a column of an effect
        for species in ("gas", "dust"):
            assert_same_arrays(vars(run[-1].species[species]), vars(snap.species[species]))
        assert (snap.open_step.lag > 0.0) == (name != "closed")
    assert state_bits(written) == state_bits(straight)
    unseen = made()
    unseen.evolve(until)
    for sim in (unseen, open_step):
        sim.evolve(until + 0.01)
    assert state_bits(open_step) == state_bits(unseen)


def test_a_snapshot_of_own_grains_with_an_own_force_has_fields(tmp_path):
    """Grains of one mass in a ring: its mass over its area; before the first step as well."""
    phi = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    pos = 1.5 * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    tables = {key: SCENE[key] for key in ("units", "run", "space")} | {"dust": {"ratio": 1.0}, "star": {"mass": 2.0}}
    own = {"pos": pos, "vel": 0.0 * pos, "mass": np.full(40, 0.25)}
    sim = Simulation(tables, particles={"dust": own})
    sim.add_force(lambda p, time: 2.0 * p.pos / 1.5**3, on="dust", limit=0.3)  # against the star's gravity
    for _ in range(2):
        sim.write_snapshot(tmp_path / "a.h5")
        snap = read_snapshot(tmp_path / "a.h5")
        assert snap.time == sim.time
        found = snap.field("dust.surface_density", edges=[1.4, 1.6]).value
        assert found == pytest.approx([10.0 / (np.pi * (1.6**2 - 1.4**2))], rel=1e-12)
        np.testing.assert_allclose(snap.dust.pos, pos, rtol=0, atol=1e-5)  # the star is softened by some 1e-3
        sim.run(0.2)


# Tables of pandas


def test_particles_are_a_table_of_pandas(tmp_path):
    sim = made()
    sim.step()
    write_snapshot(tmp_path / "0.h5", sim.scene, sim.time, sim.gas, sim.dust, {})
    for frame, p in ((sim.gas.to_pandas(), sim.gas), (read_snapshot(tmp_path / "0.h5").gas.to_pandas(), None)):
        assert frame.index.name == "ids" and len(frame) == 600
        rows = frame.loc[sim.gas.ids]
        np.testing.assert_allclose(rows[["x", "y"]], sim.gas.pos, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(rows[["vx", "vy"]], sim.gas.vel)
        np.testing.assert_array_equal(rows["density"], sim.gas.density)
        if p is not None:
            np.testing.assert_array_equal(rows[["ax", "ay"]], sim.gas.acc)
            frame["x"] = 0.0  # a copy
            assert sim.gas.pos.any()
    assert set(sim.dust.to_pandas()["species"]) == {0}


def test_without_pandas_one_is_told(monkeypatch):
    found = builtins.__import__

    def absent(name, *arguments):
        if name == "pandas":
            raise ImportError(name)
        return found(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(ImportError, match=r"needs pandas.*pip install -e '[.]\[pandas\]'"):
        made().gas.to_pandas()


# What notebooks show


def test_notebooks_show_small_tables_with_escaped_words(tmp_path):
    sim = made()
    sim.step()
    write_snapshot(tmp_path / "0.h5", sim.scene, sim.time, sim.gas, sim.dust, {})
    for shown, words in (
        (sim.scene._repr_html_(), ("until", "0.3", "gas, gas.viscosity, dust, star, drag", "600")),
        (sim._repr_html_(), ("<th style", "step", "8 x 8, open")),
        (read_snapshot(tmp_path / "0.h5")._repr_html_(), ("200 particles: pos, vel, mass, ids", "time")),
    ):
        assert "a &lt;disc&gt;" in shown and "<disc>" not in shown
        assert all(word in shown for word in words)
    assert "<td" in load_scene(SCENE | {"title": ""})._repr_html_()


def test_times_that_are_none_are_refused():
    sim = made()
    for until in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match="expected a finite time"):
            sim.run(until)
    for every in (math.nan, math.inf, 0.0, -1.0, 1e-300, 2e-7 * 0.3):
        with pytest.raises(ValueError, match=r"every = .*; (expected|choose)"):
            sim.run(0.3, every=every, callback=lambda sim: None)
    assert sim.time == 0.0 and sim.state.step == 0


def test_a_simulation_is_saved_and_not_pickled():
    for copied in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="cannot be pickled or copied; use save"):
            copied(made())


def test_scenes_and_lazy_modules_can_be_pickled():
    scene = load_scene(SCENE)
    assert pickle.loads(pickle.dumps(scene)) == scene == copy.deepcopy(scene)
    again = pickle.loads(pickle.dumps(Lazy("discsim.formulas.smoothing")))
    assert again.SMOOTHING is copy.copy(again).SMOOTHING


ARRAYS = {"gas": ("pos", "vel", "mass", "h", "ids", "density"), "dust": ("pos", "vel", "mass", "species")}


@pytest.mark.parametrize("look", ["callback", "synchronised"])
def test_arrays_that_are_looked_at_cannot_be_written_to(look):
    alone, watched, seen = made(until=0.05), made(until=0.05), []

    def write(sim):
        for species, names in ARRAYS.items():
            for name in names:
                array = getattr(getattr(sim, species), name)
                with pytest.raises(ValueError, match="read-only"):
                    array[3] = array[2]
                seen.append(name)
        sim.gas.ids = sim.gas.ids[::-1].copy()
        sim.state.time, sim.state.ledger.accreted_gas = 7.0, 5.0

    alone.run()
    if look == "callback":
        watched.run(callback=write)
    else:
        watched.step(0.01)
        with watched.synchronised():
            write(watched)
        alone = made(until=0.05)
        alone.step(0.01)
        for sim in (alone, watched):
            sim.run()
    assert len(seen) >= 10 and state_bits(alone) == state_bits(watched)
    assert watched.time == 0.05 and watched.state.ledger.accreted_gas == alone.state.ledger.accreted_gas
    watched.gas.vel[3] = 0.0  # theirs again


@pytest.mark.parametrize("act", ["step", "run", "evolve", "restore"])
def test_a_step_while_somebody_looks_is_refused(tmp_path, act):
    sim = made()
    sim.step()
    sim.save(tmp_path / "a.h5")
    acts = {"step": lambda: sim.step(), "run": lambda: sim.run(0.2), "evolve": lambda: sim.evolve(0.2),
            "restore": lambda: sim.restore(tmp_path / "a.h5")}  # fmt: skip

    def nested(sim):
        with sim.synchronised():
            acts[act]()

    with pytest.raises(RuntimeError, match=r"the state is being read.* call this method afterwards"):
        sim.run(0.1, callback=nested)
    with sim.synchronised(), pytest.raises(RuntimeError, match="being read"):
        acts[act]()
    alone, time = made(), sim.time
    alone.step()
    alone.evolve(time)
    sim.run(0.1)
    alone.run(0.1)
    assert state_bits(sim) == state_bits(alone)


def test_a_checkpoint_of_a_callback_goes_on_to_the_bits_of_the_run(tmp_path):
    whole, again = made(), made()
    whole.run(every=0.13, callback=lambda sim: sim.save(tmp_path / f"{sim.time}.h5"))
    again.restore(tmp_path / "0.13.h5")
    assert again.state.velocity_lag > 0.0  # the closing kick is still to come
    again.run(every=0.13, callback=lambda sim: None)
    assert state_bits(whole) == state_bits(again)
    assert whole.costs.calls == again.costs.calls
