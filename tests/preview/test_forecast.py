"""The forecast of `discsim check`: steps, time and memory of a run before it is made."""

import json
import os
import platform
import re
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import changed
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.effects import effect_classes
from discsim.effects.base import Counts
from discsim.effects.drag import Effect as Drag
from discsim.effects.gas import NEIGHBOUR, RECONSTRUCTED
from discsim.preview.check import report
from discsim.preview.evolution import EstimatedEvolution
from discsim.preview.forecast import expected_steps, forecast, slowness, store_slowness, stored_slowness
from discsim.run.runner import run_scene
from setups import SETUPS

SMALL = ["gas.particles=20000", "dust.particles=20000", "space.cells=128"]
SMALLEST = ["gas.particles=2000", "dust.particles=2000", "space.cells=64"]


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "discsim" / "speed.json"


# Steps: within a factor 1.5, as what is expected of noise, edges and streams is known no better

WITHIN = 1.5
DISCS = sorted((Path(__file__).parents[1] / "scenes_of_published_discs").glob("*.toml"))


def forecast_over_run(scene, most=None):
    """Steps that are foreseen over those that a run takes, to its end or in its first `most` steps."""
    sim = Simulation(scene)
    sim.evolve(scene.run.until, lambda: sim.state.step == most, read_only=True)
    return expected_steps(scene, sim.time).number / sim.state.step, sim


def settings_for(scene, gas, dust):
    """Changes to fewer particles."""
    found = [f"gas.particles={gas}"] if scene.gas else []
    several = len(scene.dust or ()) > 1
    return found + [f"dust.{f'{i}.' if several else ''}particles={dust}" for i, _ in enumerate(scene.dust or ())]


CHEAP = {
    "star_dust": ["dust.particles=1000"],
    "bump": ["dust.particles=1000"],
    "disc": ["gas.particles=1500", "dust.particles=300"],
    "gas_disc": ["gas.particles=2000"],
    "dusty_box": [],
    "dusty_wave": ["gas.particles=100", "dust.particles=100", "gas.smoothing_length=0.03"],
    "dusty_shock": ["gas.particles=200", "dust.particles=200", "gas.smoothing_length=0.02"],
    "settling": ["gas.particles=100", "dust.particles=100"],
    "oblique_wave": ["gas.particles=900", "dust.particles=900", "gas.smoothing_length=0.06"],
    "sheet": ["gas.particles=1024", "space.cells=32"],
    "gresho": ["gas.particles=900"],
}
LONG = ("settling", "oblique_wave", "gresho", "sheet")
WHOLE = [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CHEAP]


@pytest.mark.parametrize("setup", WHOLE)
def test_steps_of_whole_runs_are_foreseen(setup):
    ratio, _ = forecast_over_run(load_scene(f"setups/{setup}.toml", CHEAP[setup]))
    assert 1.0 / WITHIN < ratio < WITHIN


@pytest.mark.parametrize("path", DISCS, ids=lambda path: path.stem)
def test_published_discs_pass_check(path):
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 0, done.stderr
    assert load_scene(path).title in done.stdout and "time step set by" in done.stdout


def test_first_steps_of_a_published_disc_are_foreseen():
    """With few particles; `analysis/forecast_steps.py` has whole runs, and those of all particles."""
    path = next(path for path in DISCS if path.stem == "hl_tau")
    ratio, _ = forecast_over_run(load_scene(path, settings_for(load_scene(path), 3000, 1000)), 60)
    assert 1.0 / WITHIN < ratio < WITHIN


def test_steps_of_a_planet_beside_a_belt_are_foreseen():
    """Steps of all its grains, from before the planet has stirred them to the first that it meets."""
    ratio, sim = forecast_over_run(load_scene(next(path for path in DISCS if path.stem == "fomalhaut")), 500)
    assert 1.0 / WITHIN < ratio < WITHIN and sim.limited_by == "companion"


@pytest.mark.slow
@pytest.mark.parametrize("path", [*SETUPS, *DISCS], ids=lambda path: path.stem)
def test_steps_are_foreseen_with_all_particles(path):
    """The first sixty steps, of grains alone the first five hundred."""
    scene = load_scene(path)
    ratio, _ = forecast_over_run(scene, 60 if scene.gas else 500)
    assert 1.0 / WITHIN < ratio < WITHIN


COLD = {
    "units": {"system": "code"},
    "run": {"until": 40.0, "courant": 0.4},
    "space": {"size": 12.0},
    "initial": {"kind": "disc", "mass": 1e-4, "inner": 2.0, "outer": 5.0},
    "gas": {
        "particles": 1500,
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.004, "reference_radius": 3.0},
        "viscosity": {"alpha": 0.1, "beta": 0.5},
    },
    "star": {"mass": 0.7, "accretion_radius": 1.8},
}


WARM = {"eos": {"kind": "locally-isothermal", "aspect_ratio": 0.08, "reference_radius": 3.0}}


def test_the_star_sets_the_steps_of_a_cold_disc():
    """Sound would take 62 times as long over h as the step about the star is."""
    scene = load_scene(COLD)
    ratio, sim = forecast_over_run(scene)
    assert 1.0 / WITHIN < ratio < WITHIN and sim.limited_by == "star"
    steps = forecast(scene).steps
    assert steps.limiter == "star" and steps.share == 1.0
    # The nearest gas is within half a spacing of the inner edge, or nearer.
    nearest = float(steps.where.removeprefix("at "))
    assert 1.8 <= nearest <= 2.0 + 0.5 * (np.pi * 21.0 / 1500) ** 0.5
    assert f"star at {nearest:g}" in report(scene)


@pytest.mark.parametrize("scheme", ["mk", "esph"])
def test_an_explicit_drag_sets_the_steps_of_grains_that_stop_soon(scheme):
    """Dust with half of the gas's mass, which a stopping time of 0.002 holds: the step is that, the sound's 0.05."""
    drag = {"law": "stopping-time", "t_stop": 0.002, "scheme": scheme}
    box = {
        "units": {"system": "code"},
        "run": {"until": 0.05},
        "space": {"dimensions": 1, "size": 2.0, "boundary": "periodic"},
        "initial": {"kind": "wave"},
        "gas": {"particles": 60, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": 60, "ratio": 0.5},
        "drag": drag,
    }
    ratio, sim = forecast_over_run(load_scene(box))
    assert sim.limited_by == "drag" and 1.0 / WITHIN < ratio < WITHIN
    one_way = load_scene(changed(box, drag={"direction": "one-way"}))
    assert expected_steps(one_way).limiter == "gas"


@pytest.mark.parametrize(("gravity", "most"), [({"softening": 0.05}, 3.0), ({"softening": 0.8}, 1.2)])
def test_a_disc_that_falls_apart_takes_more_steps_the_shorter_its_softening(gravity, most):
    """Clumps of a disc with Q < 1 fall together until they are within the softening; with Q = 2 there are none."""
    disc = changed(COLD, self_gravity=gravity, run={"until": 60.0}, gas=WARM, space={"cells": 256})
    start = {"perturbation": 0.1, "mass": None}
    calm, broken = (load_scene(changed(disc, initial={**start, "toomre_q": q})) for q in (2.0, 0.4))
    ratio = expected_steps(broken).number / expected_steps(calm).number
    assert (ratio > most) if most > 2.0 else (ratio < most)


def test_clumps_that_keep_their_heat_are_hotter_by_two_thirds_of_the_contrast():
    """T ~ Sigma^(2/3): c_s of clumps that are four times as dense is 4^(1/3) of the start's, and h half of it."""
    eos = {"kind": "adiabatic", "gamma": 1.6, "aspect_ratio": 0.08, "reference_radius": 3.0}
    start = {"perturbation": 0.1, "mass": None, "toomre_q": 0.9}
    disc = changed(COLD, self_gravity={"softening": 0.01}, gas={"eos": eos}, space={"cells": 512}, initial=start)
    evolution = EstimatedEvolution(
        load_scene(changed(disc, cooling={"kind": "beta", "beta": 1.3}, run={"until": 200.0}))
    )
    first, last = (evolution.state_at(time).at for time in (0.0, 200.0))
    np.testing.assert_allclose(last.density / first.density, 4.0, rtol=1e-12)
    np.testing.assert_allclose(last.sound_speed / first.sound_speed, 4.0 ** (1.0 / 3.0), rtol=1e-12)
    np.testing.assert_allclose(last.h / first.h, 0.5, rtol=1e-12)


@pytest.mark.parametrize("stokes", [0.2, 3.0])
def test_the_inner_edge_of_given_dust_comes_in_as_it_drifts(stokes):
    """2 eta v_K St / (1 + St^2) at 2 about .7, eta v_K = (p + q) c^2 / 2 v_K with p = 1 and q = .5; and is nearest."""
    given = {"surface_density": 1e-3, "eos": COLD["gas"]["eos"] | {"aspect_ratio": 0.05}}
    drag = {"law": "stokes-number", "stokes": stokes, "direction": "one-way"}
    tables = changed(COLD, gas=None, background=given, dust={"particles": 40_000, "ratio": 0.01}, drag=drag)
    evolution = EstimatedEvolution(load_scene(tables))
    kepler = (0.7 / 2.0) ** 0.5
    speed2 = 0.05**2 * (0.7 / 3.0) * (2.0 / 3.0) ** -0.5
    drift = 1.5 * speed2 / kepler * stokes / (1.0 + stokes**2)
    first, last = (evolution.state_at(time).nearest for time in (0.0, 30.0))
    assert first == pytest.approx(2.0, rel=0.02)  # half of a spacing
    assert first - last == pytest.approx(30.0 * drift, rel=0.03)  # by the slope between two of 129 places


def test_light_that_outweighs_the_star_sets_the_steps_of_its_grains():
    scene = changed(COLD, dust={"particles": 300, "ratio": 0.5}, drag={"law": "stokes-number", "stokes": 0.1},
        radiation_pressure={"beta": 3.0})  # fmt: skip
    steps = expected_steps(load_scene(scene))
    assert steps.limiter == "radiation_pressure"
    star = expected_steps(load_scene(changed(scene, radiation_pressure={"beta": 0.3})))
    assert star.limiter == "star" and steps.number == pytest.approx(3.0**0.5 * star.number, rel=1e-6)


def test_an_eccentric_companion_takes_the_steps_of_its_mean_frequency():
    """The mean over time of 1 / r^(3/2) of a Kepler ellipse: r = a (1 - e cos E), dM = (1 - e cos E) dE."""
    other = {"mass": 0.2, "semi_major_axis": 0.2, "eccentricity": 0.5, "softening": "0.01", "phase": 40}
    steps = expected_steps(load_scene(COLD | {"companion": [other]}))
    anomaly = (np.arange(4000) + 0.5) * 2.0 * np.pi / 4000
    mean = np.mean((1.0 - 0.5 * np.cos(anomaly)) ** -0.5) * (0.9 / 0.2**3) ** 0.5
    assert steps.limiter == "companion" and "orbit of companion 1" in steps.where
    assert steps.number == pytest.approx(40.0 * mean / (0.4 * 0.5), rel=1e-3)  # 64 phases, half of 1/Omega


def test_check_says_what_to_do_about_a_close_binary():
    close = {"mass": 0.3, "semi_major_axis": 0.03, "softening": "0.01"}
    disc = changed(COLD, star={"frame": "inertial", "centre": "barycentre"})
    pair = load_scene(disc | {"companion": [close]})
    text = report(pair)
    assert "companion by the orbit of companion 1" in text
    line = next(line for line in text.splitlines() if "remove the companion" in line)
    # Of one star with the mass of both; 3/4 m M / (m + M)^2 (a / r)^2 of a ring in place of a point.
    alone = load_scene(changed(COLD, star={"mass": 1.0, "frame": "inertial"}))
    times = expected_steps(pair).number / expected_steps(alone).number
    told = float(re.search(r"about (\S+) times", line)[1])
    # One digit, and an inner edge that a second star is taken to drive inwards faster.
    assert times > 400.0 and 0.6 < told / times < 1.6 and "star.mass = 1" in line
    assert f"{0.75 * 0.3 * 0.7 * (0.03 / 2.0) ** 2:.1g}" in line
    wide = {"mass": 0.3, "semi_major_axis": 0.8, "softening": "0.01"}
    assert "remove the companion" not in report(load_scene(disc | {"companion": [wide]}))


def test_a_close_binary_whose_orbit_sets_no_step_is_no_warning():
    """Its orbit is short, but sound of hot gas in narrow h allows still less."""
    hot = {"particles": 90_000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.25, "reference_radius": 3.0}}
    pair = {"mass": 0.3, "semi_major_axis": 0.62, "softening": "0.01"}
    disc = changed(COLD, gas=hot, star={"frame": "inertial", "centre": "barycentre"}) | {"companion": [pair]}
    text = report(load_scene(disc))
    assert re.search("time step set by +gas", text) and "remove the companion" not in text


def test_a_start_that_settles_is_part_of_the_forecast():
    """The gas alone settles, for orbits at the reference radius, 2 about 0.7: in the steps of the start."""
    drag = {"law": "stopping-time", "t_stop": 0.3}
    dusty = changed(COLD, gas=WARM, dust={"particles": 700, "ratio": 0.1}, drag=drag)
    settling = changed(dusty, initial={"relax": 0.3, "reference_radius": 2.0})
    scene = load_scene(settling)
    found, without = forecast(scene), forecast(load_scene(dusty))
    assert without.relaxation == 0.0 and without.seconds == without.steps.number * without.step_seconds
    assert found.seconds == pytest.approx(without.seconds + found.relaxation)
    gas_alone = load_scene(changed(COLD, gas=WARM))
    step = effect_classes(gas_alone)["gas"].nanoseconds(gas_alone, Counts(1500, 0, 0)) * 1e-9 * slowness()
    steps = Simulation(scene).relaxed.steps
    assert found.relaxation / step == pytest.approx(steps, rel=0.3)
    longer = forecast(load_scene(changed(settling, initial={"relax": 0.6})))
    assert longer.relaxation == pytest.approx(2.0 * found.relaxation)
    assert "CPU time before t = 0" in report(scene)


# CPU time and memory


def test_every_effect_costs(store):
    """A forecast without an effect is cheaper, and none costs less than nothing."""
    scene = load_scene("setups/dusty_disc.toml")
    whole = forecast(scene)
    for without in (["drag"], ["drag", "dust"], ["self_gravity"]):
        part = forecast(load_scene("setups/dusty_disc.toml", without=without))
        assert 0 < part.step_seconds < whole.step_seconds and part.memory <= whole.memory
    more = forecast(load_scene("setups/dusty_disc.toml", ["gas.particles=400000"]))
    assert 1.3 < more.steps.number / whole.steps.number < 2.0  # half the spacing of the gas, and the same star


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
    assert many.step_seconds - few.step_seconds == pytest.approx(
        1000 * 1e-9 * RECONSTRUCTED * NEIGHBOUR["double"] * more
    )


def run_here(scene, slow, cpu=100.0, wall=None):
    """As if a run had taken `slow` times the stored figures, and so many CPU seconds."""
    step = slow * forecast(scene).step_seconds / slowness()
    store_slowness(scene, cpu / step, cpu, cpu if wall is None else wall)


def test_the_next_forecast_knows_this_machine(store):
    scene = load_scene("setups/stable_disc.toml")
    first = forecast(scene)
    assert slowness() == 1.0 and stored_slowness() == []
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
    for name in ("MIN_CPU_SECONDS", "MIN_CPU_FRACTION", "MIN_STEP_SECONDS"):
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
    assert stored_slowness() == pytest.approx([2.0] * 7)


def test_each_machine_of_a_shared_home_has_its_own_runs(store, monkeypatch):
    scene = load_scene("setups/stable_disc.toml")
    run_here(scene, 3.0)
    monkeypatch.setattr("platform.node", lambda: "another")
    assert stored_slowness() == []
    run_here(scene, 0.5)
    assert stored_slowness() == pytest.approx([0.5])
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(store.parent.parent))
    assert stored_slowness() == pytest.approx([3.0])


def test_what_cannot_be_kept_is_not(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    run_here(load_scene("setups/stable_disc.toml"), 3.0)
    assert slowness() == 1.0 and os.listdir(tmp_path) == ["file"]


def test_check_tells_the_forecast(store):
    text = report(load_scene("setups/dusty_disc.toml"))
    for words in ("number of steps", "CPU time of the run", "memory"):
        assert words in text
    assert "stored values, as no long run was made here yet" in text
    for number, words in enumerate(("the last long run on", "the last 2 long runs on")):
        run_here(load_scene("setups/dusty_disc.toml"), 1.0 + number)
        assert words in report(load_scene("setups/dusty_disc.toml"))
    assert "seconds (one dimension)" in report(load_scene("setups/dusty_wave.toml"))


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
    store_slowness(load_scene("setups/fragmenting_disc.toml"), 1000, 1000 * taken["fragmenting_disc"], 0.0)
    expected = forecast(load_scene(f"setups/{setup}.toml")).step_seconds
    assert 1 / 1.5 < expected / taken[setup] < 1.5
