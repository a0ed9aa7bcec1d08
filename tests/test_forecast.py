"""The forecast of `discsim check`: steps, time and memory of a run before it is made."""

import json
import os
import time

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.check import report
from discsim.forecast import forecast, learn, slowness

SMALL = ["gas.particles=20000", "dust.particles=20000", "space.cells=128"]


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "discsim" / "speed.json"


@pytest.mark.parametrize("setup", ["stable_disc", "twin_twoway"])
def test_steps_are_foreseen(setup, store):
    """Of discs at a twentieth of their time: within a factor 1.3, as noise and the edges have it."""
    scene = load_scene(f"setups/{setup}.toml", SMALL)
    sim = Simulation(scene)
    until = 0.05 * scene.run.until
    sim.run(until)
    assert sim.state.step == pytest.approx(0.05 * forecast(scene).steps, rel=0.3)


def test_steps_of_dust_alone_are_foreseen(store):
    scene = load_scene("setups/star_dust.toml", ["dust.particles=1000"])
    sim = Simulation(scene)
    sim.run()
    assert sim.state.step == pytest.approx(forecast(scene).steps, rel=0.3)


def test_every_effect_costs(store):
    """A forecast without an effect is cheaper, and none costs less than nothing."""
    scene = load_scene("setups/dusty_disc.toml")
    whole = forecast(scene)
    for without in (["drag"], ["drag", "dust"], ["self_gravity"]):
        part = forecast(load_scene("setups/dusty_disc.toml", without=without))
        assert 0 < part.step_seconds < whole.step_seconds and part.memory <= whole.memory
    more = forecast(load_scene("setups/dusty_disc.toml", ["gas.particles=400000"]))
    assert more.steps == pytest.approx(2 * whole.steps, rel=1e-6)  # half the spacing
    assert forecast(load_scene("setups/dusty_wave.toml")) is None


def test_the_next_forecast_knows_this_machine(store):
    scene = load_scene("setups/stable_disc.toml")
    first = forecast(scene)
    assert slowness() == 1.0
    for taken in (3.0, 0.5):  # what was learnt before is replaced, not compounded
        learn(scene, taken * first.step_seconds)
        assert slowness() == pytest.approx(taken)
        assert forecast(scene).seconds == pytest.approx(taken * first.seconds)
    store.write_text("{")
    assert slowness() == 1.0
    store.write_text(json.dumps({"slowness": float("nan")}))
    assert slowness() == 1.0


def test_what_cannot_be_kept_is_not(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    learn(load_scene("setups/stable_disc.toml"), 1.0)
    assert slowness() == 1.0 and os.listdir(tmp_path) == ["file"]


def test_check_tells_the_forecast(store):
    text = report(load_scene("setups/dusty_disc.toml"))
    for words in ("steps, about", "CPU time of the run, about", "memory, about"):
        assert words in text
    assert "in one dimension runs take seconds" in report(load_scene("setups/dusty_wave.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "setup", ["dusty_disc", "gas_disc", "stable_disc", "twin_twoway", "background_dust", "star_dust"]
)
def test_time_is_foreseen(setup, store):
    """Within a factor 1.5, once another run has told the machine's speed: twenty steps against the stored figures."""
    taken = {}
    for name in ("fragmenting_disc", setup):
        sim = Simulation(load_scene(f"setups/{name}.toml"))
        left = [4]

        def enough(left=left):
            left[0] -= 1
            return left[0] == 0

        sim.evolve(np.inf, enough)
        start, left[0] = time.process_time(), 20
        sim.evolve(np.inf, enough)
        taken[name] = (time.process_time() - start) / 20
    learn(load_scene("setups/fragmenting_disc.toml"), taken["fragmenting_disc"])
    expected = forecast(load_scene(f"setups/{setup}.toml")).step_seconds
    assert 1 / 1.5 < expected / taken[setup] < 1.5
