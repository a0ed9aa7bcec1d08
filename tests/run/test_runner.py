"""Runs: files of a directory, stopping and going on with the same bits, interrupts, exit statuses."""

import os
import signal
from functools import cache

import numpy as np
import pytest
from runs import DISC, SHOCK, WAVE, assert_same_run, at_step, bits_of, errors_of, rows, scene_of, state_bits

from discsim import Simulation, read_snapshot
from discsim.run.costs import Costs
from discsim.run.outputs import output_times
from discsim.run.runner import run_scene
from discsim.scene import load_scene
from discsim.scene.differences import differences

SCENES = {"disc": DISC, "shock": SHOCK, "wave": WAVE}


@pytest.fixture(autouse=True)
def no_figure(request, monkeypatch):
    """Drawing takes longer than these runs; one test looks at the figure."""
    if request.node.originalname != "test_files_of_a_run":
        monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Scene and directory of the run of each of SCENES that nothing stops, made once, to be read alone."""

    @cache
    def made(name):
        folder = tmp_path_factory.mktemp(name)
        scene = scene_of(folder, SCENES[name])
        assert run_scene(scene, folder / "run", quiet=True) == 0
        return scene, folder / "run"

    return made


# Files


@pytest.mark.parametrize("name", SCENES)
def test_files_of_a_run(tmp_path, name, capsys):
    scene, out = scene_of(tmp_path, SCENES[name]), tmp_path / "deep" / "out"
    assert run_scene(scene, out) == 0
    number = len(output_times(scene.run)) + 1
    assert sorted(os.listdir(out)) == [
        "checkpoint.h5", "checkpoint_before.h5", "costs.csv", "history.csv", "last_state.png", "run.log",
        "scene.toml", "snapshots",
    ]  # fmt: skip
    assert sorted(os.listdir(out / "snapshots")) == [f"{k:04d}.h5" for k in range(number)]
    assert not list(differences(load_scene(out / "scene.toml"), scene))
    assert (out / "last_state.png").read_bytes().startswith(b"\x89PNG")
    shown = capsys.readouterr()
    assert shown.err == "" and shown.out == (out / "run.log").read_text()
    for words in ("effects: gas, ", "loading kernels", "set by", "snapshot 0001", "done at t", str(out)):
        assert words in shown.out


@pytest.mark.parametrize("name", SCENES)
def test_history(straight, name):
    scene, out = straight(name)
    with (out / "history.csv").open() as file:
        assert file.readline().strip() == (
            "step,time,dt,dt_set_by,mass_gas,mass_dust,momentum_x,momentum_y,angular_momentum,kinetic_gas,"
            "kinetic_dust,thermal,potential,accreted_gas,accreted_dust,uncoupled_dust,"
            "accretion_rate_gas,accretion_rate_dust,radiated"
        )
    found = rows(out)
    assert [int(row["step"]) for row in found] == list(range(len(found)))  # a small run: every step
    times = np.array([float(row["time"]) for row in found])
    assert times[0] == 0 and times[-1] == scene.run.until
    # dt is the difference of the times: exact, where these are the same floats.
    assert np.array_equal(np.diff(times), [float(row["dt"]) for row in found[1:]])
    assert {row["dt_set_by"] for row in found} <= set(scene.effects)
    assert set(output_times(scene.run)) <= set(times)


@pytest.mark.parametrize("name", SCENES)
def test_history_agrees_with_snapshots(straight, name):
    scene, out = straight(name)
    by_time = {float(row["time"]): row for row in rows(out)}
    for number, t in enumerate([0.0, *output_times(scene.run)]):
        snap = read_snapshot(out / "snapshots" / f"{number:04d}.h5")
        assert snap.time == t  # exactly
        row = {key: float(value) for key, value in by_time[t].items() if key != "dt_set_by"}
        momentum, spin = np.zeros(2), 0.0
        for kind, p in snap.species.items():
            free = np.ones(p.count, bool) if p.immobile is None else ~p.immobile
            mass, pos, vel = p.mass[free], p.pos[free], p.vel[free]
            # Sums in another order: rounding.
            assert row[f"mass_{kind}"] == pytest.approx(mass.sum(), rel=1e-12)
            assert row[f"kinetic_{kind}"] == pytest.approx((mass * (vel**2).sum(axis=1)).sum() / 2, rel=1e-12)
            momentum[: snap.dimensions] += mass @ vel
            if snap.dimensions == 2:
                spin += mass @ (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])
            if p.u is not None:
                assert row["thermal"] == pytest.approx((mass * p.u[free]).sum(), rel=1e-12)
        scale = snap.gas.mass.sum() * np.abs(snap.gas.vel).max() + 1e-300
        assert [row["momentum_x"], row["momentum_y"]] == pytest.approx(list(momentum), abs=1e-12 * scale)
        assert row["angular_momentum"] == pytest.approx(spin, rel=1e-12)


def test_what_the_star_takes_is_in_the_history(straight):
    _, out = straight("disc")
    first, last = rows(out)[0], rows(out)[-1]
    for kind in ("gas", "dust"):
        lost = float(first[f"mass_{kind}"]) - float(last[f"mass_{kind}"])
        assert lost > 0  # the inner edge is inside the accretion radius
        assert lost == pytest.approx(float(last[f"accreted_{kind}"]), rel=1e-12)  # rounding of the sums
    # Grains that gas is not in one cell with are some at times, at the edges.
    uncoupled = [float(row["uncoupled_dust"]) for row in rows(out)]
    assert 0 <= min(uncoupled) < max(uncoupled) < 1


def test_potential_energy_is_that_of_the_effects(tmp_path):
    text = WAVE.replace('kind = "wave"', 'kind = "box"') + "[external]\ngas = 2\n"
    assert run_scene(scene_of(tmp_path, text, "run.until=0.01"), tmp_path / "out", quiet=True) == 0
    # Unit mass evenly on [0, 1), g = 2: -2 * 0.5; lattice points are symmetric about the middle, to rounding.
    assert float(rows(tmp_path / "out")[0]["potential"]) == pytest.approx(-1.0, rel=1e-12)


def test_pressure_in_a_snapshot_is_that_of_its_energy(tmp_path):
    assert run_scene(scene_of(tmp_path, SHOCK), tmp_path / "out", quiet=True) == 0
    gas = read_snapshot(tmp_path / "out" / "snapshots" / "0004.h5").gas
    assert np.allclose(gas.pressure, 0.4 * gas.density * gas.u, rtol=1e-14, atol=0)  # one product


@pytest.mark.parametrize("integrator", ["kdk", "euler"])
def test_stopping_times_in_every_snapshot(tmp_path, integrator):
    scene, out = scene_of(tmp_path, WAVE, f"run.integrator={integrator}"), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    for number in range(3):
        dust = read_snapshot(out / "snapshots" / f"{number:04d}.h5").dust
        # A mean of equal times, to rounding.
        np.testing.assert_allclose(dust.stopping_time, 0.002, rtol=1e-14)
        assert dust.stokes is None


def test_stokes_numbers_about_a_star(tmp_path):
    assert run_scene(scene_of(tmp_path, DISC, "run.until=0.1"), tmp_path / "out", quiet=True) == 0
    dust = read_snapshot(tmp_path / "out" / "snapshots" / "0000.h5").dust
    stokes = dust.stokes[np.isfinite(dust.stokes)]
    # The law's Omega is that at the mean r^2 of a drag cell; cells of 2h are up to .4 r wide here.
    assert len(stokes) > 500 and np.median(stokes) == pytest.approx(0.1, rel=0.05)
    omega = np.linalg.norm(dust.pos, axis=1) ** -1.5
    assert np.allclose(dust.stokes, dust.stopping_time * omega, rtol=1e-13, atol=0)


def test_costs_are_of_the_effects_named(tmp_path):
    for name, named in (
        ("disc", ["gas", "dust", "star", "self_gravity", "drag"]),
        ("shock", ["gas"]),
        ("wave", ["gas", "dust", "drag"]),
    ):
        assert run_scene(scene_of(tmp_path, SCENES[name]), tmp_path / name, quiet=True) == 0
        found = rows(tmp_path / name, "costs.csv")
        assert [row["effect"] for row in found] == named
        assert all(int(row["calls"]) > 0 and float(row["cpu_seconds"]) >= 0 for row in found)
        assert sum(float(row["share"]) for row in found) == pytest.approx(1, abs=1e-3)  # four digits each


def test_costs_of_what_raises_are_not_added():
    costs = Costs(["gas"])
    with costs("gas", calls=2):
        pass
    seconds = costs.seconds["gas"]
    assert costs.calls == {"gas": 2} and seconds >= 0.0
    with pytest.raises(ValueError, match="half-way"), costs("gas"):
        raise ValueError("half-way")
    assert costs.calls == {"gas": 2} and costs.seconds["gas"] == seconds


def test_a_run_of_one_step(tmp_path):
    scene = scene_of(tmp_path, WAVE, "run.until=1e-6", "run.snapshots=1")
    assert run_scene(scene, tmp_path / "out", quiet=True) == 0
    assert [row["step"] for row in rows(tmp_path / "out")] == ["0", "1"]
    assert all(int(row["calls"]) > 0 for row in rows(tmp_path / "out", "costs.csv"))


def test_large_runs_have_rows_at_intervals_and_outputs(tmp_path, monkeypatch):
    monkeypatch.setattr("discsim.run.runner.FEW_PARTICLES", 100)
    assert run_scene(scene_of(tmp_path, SHOCK), tmp_path / "out", quiet=True) == 0
    steps = [int(row["step"]) for row in rows(tmp_path / "out")]
    outputs = [row for row in rows(tmp_path / "out") if int(row["step"]) % 16 != 0]
    assert {step for step in range(steps[-1]) if step % 16 == 0} <= set(steps)
    assert 1 <= len(outputs) <= 4 and len(set(steps)) == len(steps) < steps[-1]


# Times of outputs


def times_of(tmp_path, *overrides):
    return output_times(scene_of(tmp_path, WAVE.replace("snapshots = 2\n", ""), *overrides).run)


def test_output_times(tmp_path):
    assert times_of(tmp_path, "run.until=1", "run.snapshots=4") == [0.25, 0.5, 0.75, 1.0]
    assert times_of(tmp_path, "run.until=1", "run.every=0.4") == [0.4, 0.8, 1.0]
    assert times_of(tmp_path, "run.until=0.3", "run.every=1") == [0.3]
    assert times_of(tmp_path, "run.until=0.7", "run.snapshots=3")[-1] == 0.7


def test_runs_of_different_lengths_meet_at_the_same_floats(tmp_path):
    # In floats 3 * 0.1 is not 0.3.
    assert times_of(tmp_path, "run.until=0.3", "run.every=0.1") == [0.1, 0.2, 0.3]
    assert times_of(tmp_path, "run.until=0.6", "run.every=0.1")[:3] == [0.1, 0.2, 0.3]
    assert times_of(tmp_path, "run.until=0.6", "run.snapshots=6")[:3] == [0.1, 0.2, 0.3]


# The same bits


@pytest.mark.parametrize("name", SCENES)
def test_looking_changes_no_bit(tmp_path, name):
    scene = scene_of(tmp_path, SCENES[name])
    blind, watched = Simulation(scene), Simulation(scene)

    def look():
        with watched.synchronised() as state:
            assert state.velocity_lag == 0
        if "drag" in watched.effects:
            watched.effects["drag"].current_stopping_times(watched.state)
        watched.save(tmp_path / "look.h5")
        return False

    blind.evolve(scene.run.until)
    watched.evolve(scene.run.until, look)
    assert state_bits(blind) == state_bits(watched)


@pytest.mark.parametrize("changes", [[], ["drag.direction=one-way"], ["drag.scheme=idic-linear"]])
def test_stopping_times_of_a_snapshot_are_those_of_its_closing_kick(tmp_path, monkeypatch, changes):
    """To the bit what they are when the drag is made anew there, which a snapshot then need not do."""
    sim = Simulation(scene_of(tmp_path, DISC, *changes))
    sim.evolve(sim.scene.run.until, lambda: sim.state.step == 2)
    drag = sim.effects["drag"]
    with sim.synchronised() as state:
        kicked = drag._kicked
        drag._kicked = (-1, 0.0)
        anew, uncoupled = drag.current_stopping_times(state), drag.uncoupled
    with sim.synchronised() as state, monkeypatch.context() as patch:
        assert drag._kicked == kicked == (2, state.time)
        patch.setattr(drag.engine, "kick", None)
        np.testing.assert_array_equal(drag.current_stopping_times(state), anew)
        assert drag.uncoupled == uncoupled


def test_stopping_times_that_depend_on_the_slip_are_made_anew(tmp_path, monkeypatch):
    """A kick changes the slip that its own were of."""
    sim = Simulation(scene_of(tmp_path, DISC))
    sim.evolve(sim.scene.run.until, lambda: sim.state.step == 1)
    drag, made = sim.effects["drag"], []
    monkeypatch.setattr(drag.law, "nonlinear", True)
    monkeypatch.setattr(drag.engine, "kick", lambda *given: made.append(given))
    drag._kicked = sim.state.step, sim.state.time
    drag.current_stopping_times(sim.state)
    assert len(made) == 1


@pytest.mark.parametrize("name, step", [("disc", 3), ("disc", 18), ("shock", 7), ("shock", 40), ("wave", 5)])
def test_stopped_and_resumed(tmp_path, monkeypatch, straight, name, step, capsys):
    # The gas is reordered in memory at steps 1, 17, ...: some stops are before one, some after.
    (scene, whole), broken = straight(name), tmp_path / "broken"
    assert len(rows(whole)) > step + 2
    with monkeypatch.context() as patch:
        at_step(patch, step, lambda sim: signal.raise_signal(signal.SIGINT))
        assert run_scene(scene, broken, quiet=True) == 130
    assert int(rows(broken)[-1]["step"]) == step
    said = capsys.readouterr()
    assert said.out == "" and len(errors_of(said.err)) == 1
    assert f"interrupted by SIGINT at t = {float(rows(broken)[-1]['time']):.4g}, step {step}" in said.err
    assert f"discsim run {broken}/scene.toml -o {broken} --resume" in said.err
    assert run_scene(scene, broken, resume=True, quiet=True) == 0
    assert_same_run(whole, broken)


def test_stopped_twice_on_an_output(tmp_path, monkeypatch, straight):
    # The step that lands on an output is the one that is interrupted: its snapshot must not be lost.
    scene, whole = straight("disc")
    landing = [int(row["step"]) for row in rows(whole) if float(row["time"]) in (0.25, 0.5)]
    for resume, step in zip((False, True), landing, strict=True):
        with monkeypatch.context() as patch:
            at_step(patch, step, lambda sim: signal.raise_signal(signal.SIGTERM))
            assert run_scene(scene, tmp_path / "broken", resume=resume, quiet=True) == 143
    assert run_scene(scene, tmp_path / "broken", resume=True, quiet=True) == 0
    assert_same_run(whole, tmp_path / "broken")


@pytest.mark.parametrize("integrator", ["kdk", "euler"])
def test_a_longer_run_goes_on_from_a_finished_one(tmp_path, integrator):
    chosen = f"run.integrator={integrator}"
    whole = scene_of(tmp_path, DISC, chosen, "run.until=1")
    short = scene_of(tmp_path, DISC, chosen, "run.until=0.5", "title=short")
    assert run_scene(whole, tmp_path / "one", quiet=True) == 0
    assert run_scene(short, tmp_path / "two", quiet=True) == 0
    assert run_scene(whole, tmp_path / "two", resume=True, quiet=True) == 0
    assert_same_run(tmp_path / "one", tmp_path / "two")
    assert load_scene(tmp_path / "two" / "scene.toml").run.until == 1.0


def test_what_came_after_the_checkpoint_is_dropped(tmp_path, monkeypatch, straight):
    # A run that is killed has later snapshots and rows than its checkpoint, and perhaps half a row.
    scene, whole = straight("wave")
    at_step(monkeypatch, 3, lambda sim: signal.raise_signal(signal.SIGINT))
    assert run_scene(scene, tmp_path / "broken", quiet=True) == 130
    monkeypatch.undo()
    later = whole / "snapshots" / "0001.h5"
    for name in ("0001.h5", "0007.h5"):
        (tmp_path / "broken" / "snapshots" / name).write_bytes(later.read_bytes())
    lines = (whole / "history.csv").read_text().splitlines(keepends=True)
    (tmp_path / "broken" / "history.csv").write_text("".join(lines[:8]) + "2,0.1")  # of row 2...
    assert run_scene(scene, tmp_path / "broken", resume=True, quiet=True) == 0
    assert_same_run(whole, tmp_path / "broken")


def test_costs_go_on_when_resumed(tmp_path, monkeypatch):
    scene = scene_of(tmp_path, WAVE)
    at_step(monkeypatch, 12, lambda sim: signal.raise_signal(signal.SIGINT))
    assert run_scene(scene, tmp_path / "out", quiet=True) == 130
    monkeypatch.undo()
    assert run_scene(scene, tmp_path / "out", resume=True, quiet=True) == 0
    calls = int(rows(tmp_path / "out", "costs.csv")[0]["calls"])
    steps = int(rows(tmp_path / "out")[-1]["step"])
    # The gas has two calls a step (forces, drift); each process leaves out its first step.
    assert calls == 2 * (steps - 2)


# Loops are shared out where they have more than 8192 entries; odd numbers, so that no piece is like another.
COUNTS = {"disc": ["gas.particles=17011", "dust.particles=19013"], "shock": ["gas.particles=9001"]}


def test_any_number_of_threads_gives_the_same_bits(tmp_path):
    for name, counts in COUNTS.items():
        (tmp_path / f"{name}.toml").write_text(scene_of(tmp_path, SCENES[name], *counts).text)
    found = {}
    for pool, threads in (("1", "1"), ("3", "23")):
        runs = [f"{tmp_path / name}.toml@{number}" for name in COUNTS for number in threads]
        found |= {f"{run} of {pool}": bits for run, bits in bits_of(runs, NUMBA_NUM_THREADS=pool).items()}
    assert len(found) == 6
    for name in COUNTS:
        assert len({bits for run, bits in found.items() if f"/{name}.toml@" in run}) == 1, found


@pytest.mark.parametrize("name, without", [("wave", ()), ("disc", ("self_gravity",)), ("disc", ())])
def test_one_way_dust_leaves_no_trace_in_the_gas(tmp_path, name, without):
    text = SCENES[name].replace("[drag]\n", '[drag]\ndirection = "one-way"\n')
    text = text.replace("[self_gravity]\n", '[self_gravity]\nsources = ["gas"]\n')
    dusty = Simulation(scene_of(tmp_path, text, without=without))
    clean = Simulation(scene_of(tmp_path, text, without=(*without, "dust", "drag")))
    assert dusty.dust is not None and clean.dust is None
    for sim in (dusty, clean):
        sim.run()
    assert dusty.state.step == clean.state.step
    assert state_bits(dusty)["gas"] == state_bits(clean)["gas"]
