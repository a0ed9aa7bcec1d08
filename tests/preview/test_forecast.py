"""The forecast of `discsim check`: steps, time and memory of a run before it is made."""

import json
import os
import platform
import time

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.effects.base import Counts
from discsim.effects.drag import Effect as Drag
from discsim.effects.gas import NEIGHBOUR
from discsim.preview.check import report
from discsim.preview.forecast import forecast, known_runs, learn, slowness
from discsim.run.runner import run_scene

SMALL = ["gas.particles=20000", "dust.particles=20000", "space.cells=128"]
SMALLEST = ["gas.particles=2000", "dust.particles=2000", "space.cells=64"]


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


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_drag_costs_by_all_that_it_couples(scheme):
    """A grain takes as long as a gas particle: 100 of gas with 2900 of dust three times as long as 900 with 100."""
    scene = load_scene("setups/dusty_disc.toml", [f"drag.scheme={scheme}"])
    few, many = (Drag.nanoseconds(scene, Counts(gas, dust, 64)) for gas, dust in ((900, 100), (100, 2900)))
    assert few > 0.0 and many == pytest.approx(3.0 * few)


@pytest.mark.parametrize(("kernel", "reach"), [("cubic", 2.0), ("quintic", 3.0)])
def test_neighbours_cost_by_their_number(kernel, reach, store):
    """Even gas has pi (reach eta)^2 particles within the support of a kernel, whose h is eta times their distance."""
    few, many = (
        forecast(load_scene("setups/gas_disc.toml", [f"gas.kernel={kernel}", f"gas.eta={eta}", "gas.particles=1000"]))
        for eta in (1.2, 1.5)
    )
    more = np.pi * reach**2 * (1.5**2 - 1.2**2)
    assert many.step_seconds - few.step_seconds == pytest.approx(1000 * 1e-9 * NEIGHBOUR["double"] * more)


def run_here(scene, slow, cpu=100.0, wall=None):
    """As if a run had taken `slow` times the stored figures, and so many CPU seconds."""
    step = slow * forecast(scene).step_seconds / slowness()
    learn(scene, cpu / step, cpu, cpu if wall is None else wall)


def test_the_next_forecast_knows_this_machine(store):
    scene = load_scene("setups/stable_disc.toml")
    first = forecast(scene)
    assert slowness() == 1.0 and known_runs() == []
    for taken, median in ((3.0, 3.0), (0.5, 1.75), (0.6, 0.6)):  # each of the stored figures, never of the last
        run_here(scene, taken)
        assert slowness() == pytest.approx(median)
        assert forecast(scene).seconds == pytest.approx(median * first.seconds)
    for broken in ("{", "[]", '{"slowness": 6.0}', '{"runs": [{"machine": 1}]}', '{"runs": 3}'):
        store.write_text(broken)
        assert slowness() == 1.0
    store.write_text(json.dumps({"runs": [{"machine": platform.node(), "slowness": float("nan")}]}))
    assert slowness() == 1.0


def test_runs_that_say_nothing_of_the_machine_are_not_learnt_from(store):
    """Short ones, ones that waited for others, and ones whose steps are mostly Python's own."""
    scene, small = load_scene("setups/stable_disc.toml"), load_scene("setups/stable_disc.toml", SMALLEST)
    run_here(scene, 6.0, cpu=3.0)
    run_here(scene, 6.0, cpu=100.0, wall=300.0)
    run_here(small, 6.0)
    assert slowness() == 1.0 and not store.exists()
    run_here(scene, 1.2, cpu=100.0, wall=120.0)
    assert slowness() == pytest.approx(1.2)


def test_a_run_that_has_ended_is_learnt_from(store, tmp_path, monkeypatch):
    """Here where any run is long enough: its own CPU seconds a step, over those of the stored figures."""
    for name in ("LONG", "QUIET", "HEAVY_STEP"):
        monkeypatch.setattr(f"discsim.preview.forecast.{name}", 0.0)
    scene = load_scene("setups/star_dust.toml", ["dust.particles=2000", "run.snapshots=1", "run.courant=0.1"])
    start = time.process_time()
    assert run_scene(scene, tmp_path / "out", quiet=True) == 0
    (kept,) = json.loads(store.read_text())["runs"]
    # All that the run took, its start and its figure included, is more than its two hundred steps.
    most = (time.process_time() - start) / 200 / forecast(scene).step_seconds * slowness()
    assert kept["machine"] == platform.node() and 0.0 < kept["slowness"] < most


def test_one_odd_run_does_not_change_the_forecast(store):
    scene = load_scene("setups/stable_disc.toml")
    for taken in (1.0, 1.1, 9.0, 1.2):
        run_here(scene, taken)
    assert slowness() == pytest.approx(1.15)
    for _ in range(7):  # a machine that has become another is known after some runs
        run_here(scene, 2.0)
    assert known_runs() == pytest.approx([2.0] * 7)


def test_each_machine_of_a_shared_home_has_its_own_runs(store, monkeypatch):
    scene = load_scene("setups/stable_disc.toml")
    run_here(scene, 3.0)
    monkeypatch.setattr("platform.node", lambda: "another")
    assert known_runs() == []
    run_here(scene, 0.5)
    assert known_runs() == pytest.approx([0.5])
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(store.parent.parent))
    assert known_runs() == pytest.approx([3.0])


def test_what_cannot_be_kept_is_not(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    run_here(load_scene("setups/stable_disc.toml"), 3.0)
    assert slowness() == 1.0 and os.listdir(tmp_path) == ["file"]


def test_check_tells_the_forecast(store):
    text = report(load_scene("setups/dusty_disc.toml"))
    for words in ("steps, about", "CPU time of the run, about", "memory, about"):
        assert words in text
    assert "stored figures: no long run here yet" in text
    for number, words in enumerate(("the last long run on", "the last 2 long runs on")):
        run_here(load_scene("setups/dusty_disc.toml"), 1.0 + number)
        assert words in report(load_scene("setups/dusty_disc.toml"))
    # The heat of a blast sets the step: not what the cold gas about it would allow.
    assert "its step is not known" in report(load_scene("setups/sedov.toml"))
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
    learn(load_scene("setups/fragmenting_disc.toml"), 1000, 1000 * taken["fragmenting_disc"], 0.0)
    expected = forecast(load_scene(f"setups/{setup}.toml")).step_seconds
    assert 1 / 1.5 < expected / taken[setup] < 1.5
