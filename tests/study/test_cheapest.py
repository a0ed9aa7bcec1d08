"""`discsim cost --error`: the search with real runs of a small wave, its files and messages, and with fakes."""

import json
import os
import signal
from functools import cache
from types import SimpleNamespace

import pytest
from test_cost import WAVE, invoke

from discsim import Simulation, load_scene
from discsim.preview.check import report
from discsim.scene import SceneError
from discsim.study import runs as study_runs
from discsim.study.cheapest import Cheapest, SearchOptions
from discsim.study.errors import measure_of
from discsim.study.frontier import _choice_lines, _cost_of_own_error, _has_knob, _knob_table, fit_powers
from discsim.study.knobs import Knobs
from discsim.study.runs import DeadlineError
from discsim.study.trials import Measured, Trial, with_rung

FEW = [
    "--keep",
    "drag.scheme",
    "--keep",
    "gas.kernel",
    "--keep",
    "gas.precision",
]  # no kernels to compile but the default's


@pytest.fixture
def wave(tmp_path):
    path = tmp_path / "wave.toml"
    path.write_text(WAVE)
    return path


def kept(directory):
    return [json.loads(line) for line in (directory / "runs.jsonl").read_text().splitlines()[1:]]


def test_the_cheapest_setting_of_a_wave(wave, tmp_path):
    out = tmp_path / "found"
    done = invoke(wave, "--error", "0.5%", *FEW, "-o", out)
    assert done.exit_code == 0, done.output
    for words in (
        "cheapest for 0.5%: ",
        "the scene: ",
        "effect of each knob",
        "search: ",
        "times the scene's",
    ):
        assert words in done.output and words in (out / "cost.log").read_text()
    assert (out / "cost.png").stat().st_size > 10_000
    # The file is a scene with the settings found, and its run has that error.
    found = load_scene(out / "cheapest.toml")
    assert found.run.threads is None and found.run.seed == 1
    sim = Simulation(found)
    sim.run()
    assert max(measure_of(found).errors(sim).values()) <= 0.005
    # What was measured is what a check of that scene says.
    assert "measured error (exact)" in report(found)
    assert "measured error" not in report(load_scene(out / "cheapest.toml", ["drag.K=4"]))
    # Again, nothing is run anew, and the end is the same.
    lines, text = len(kept(out)), (out / "cheapest.toml").read_text()
    again = invoke(wave, "--error", "0.5%", *FEW, "-o", out)
    assert again.exit_code == 0 and len(kept(out)) == lines and (out / "cheapest.toml").read_text() == text


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--error", "x"], "--error x: not an error; expected a number above 0, like 1% or 0.01"),
        (["--error", "-1%"], "--error -1%: not an error"),
        (["--error", "nan"], "--error nan: not an error"),
        (["--error", "2"], '--error 2: an error of 200%; expected less than 100%; for 2 per cent write "2%"'),
        (["--error", "1"], 'an error of 100%; expected less than 100%; for 1 per cent write "1%"'),
        (["--error", "250%"], "--error 250%: an error of 250%; expected less than 100%, like 2%"),
        (["--error", "300"], "--error 300: an error of 30000%; expected less than 100%, like 2%"),
        (["--error", "1%", "--budget", "soon"], "--budget soon: not a positive wall-clock time"),
        (["--error", "1%", "--budget", "-1 h"], "expected a time like"),
        (["--error", "1%", "--measure", "dust-profil"], 'did you mean "dust-profile"'),
        (["--error", "1%", "--keep", "drag.cel"], 'did you mean "drag.cell"'),
        (["--error", "1%", "--vary", "drag.schem=idic"], 'did you mean "scheme"'),
        (["--error", "1%", "--vary", "drag.schem=idic"], "--vary drag.schem=idic: drag.schem: unknown key"),
        (
            ["--error", "1%", "--measure", "gas-profile", "--reference", "gas.partcles=7"],
            "--reference gas.partcles=7: ",
        ),
        (["--error", "1%", "--measure", "gas-profile", "--reference", "gas.particle=7"], 'did you mean "particles"'),
        (["--error", "1%", "--measure", "gas-profile", "--reference", "gas.particles"], "not a key with a value"),
        (["--measure", "exact", "--vary", "drag.K=1,2"], "--measure: used only with --error"),
        ([], "nothing to do; add --error 1% to find the cheapest setting, or --vary with values of a key"),
    ],
)
def test_faults_are_one_line_and_write_nothing(wave, tmp_path, arguments, words):
    done = invoke(wave, *arguments, "-o", tmp_path / "found")
    assert done.exit_code == 2 and words in done.output and len(done.output.strip().splitlines()) == 1
    assert not (tmp_path / "found").exists()


# With a fake in place of runs: error = 0.1 / n + seed's noise, profiles to match


def fake(monkeypatch, price=1e-3, most=None, end=KeyboardInterrupt):
    """Runs that take price * n seconds of CPU, whose exact error is 0.4 / n; `most` of them until `end` is raised."""
    made, scene_at = [], cache(load_scene)

    def one_run(path, overrides, without, limits, say=None):
        if most is not None and len(made) == most:
            raise end
        scene, changed = scene_at(path), dict(each.split("=", 1) for each in overrides)
        n = int(changed.get("gas.particles", scene.gas.particles))
        made.append(overrides)
        cpu = price * n * 0.3 / float(changed.get("run.courant", scene.run.courant))
        if limits.cpu < cpu:
            return {"stopped": "given up", "cpu": limits.cpu, "most": limits.cpu}
        off = 0.4 / n * (1.0 + 0.2 * ((int(changed.get("run.seed", scene.run.seed)) * 7919) % 11 - 5) / 5)
        profile = {"gas": [1.0 - off, off], "dust": [1.0 - 2.0 * off, 2.0 * off]}
        drifts = {"momentum": 0.0, "energy": 0.0}
        errors = {"errors": {"gas": off}}
        return {"cpu": cpu, "steps": 1, "updates": n, "drifts": drifts, "profiles": profile} | errors

    monkeypatch.setattr(study_runs, "one_run", one_run)
    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Drawing takes longer than such a search; others here draw."""
    monkeypatch.setattr("discsim.study.frontier.frontier_figure", lambda study, path: path.touch())


def test_against_a_finer_run_with_the_scatter_between_seeds_as_floor(wave, tmp_path, monkeypatch):
    fake(monkeypatch)
    found = Cheapest(wave, tmp_path / "s", SearchOptions(0.01, measure="dust-profile"), ["gas.particles=400"])
    assert found.make("wave")
    assert found.reference_settings == {"gas.particles": "800", "dust.particles": "120"}
    # Two seeds of the finer run: 2 * 0.4 / 800, times how far the first two seeds are from each other.
    seeds = [1.0 + 0.2 * ((seed * 7919) % 11 - 5) / 5 for seed in (1, 2)]
    assert found.floor == pytest.approx(2.0 * 0.4 / 800 * abs(seeds[0] - seeds[1]))
    assert found.found.error <= 0.01 and found.found.cpu < 0.5 * found.scene.cpu
    assert "the reference run has gas.particles = 800" in (tmp_path / "s" / "cost.log").read_text()
    # No setting is called better than the floor: an error below it is not searched for.
    lower = Cheapest(wave, tmp_path / "s", SearchOptions(1e-6, measure="dust-profile"), ["gas.particles=400"])
    lower.make("wave")
    assert lower.goal == lower.floor
    assert "is below the scatter between seeds" in (tmp_path / "s" / "cost.log").read_text()


def test_the_scenes_own_error_may_be_the_goal(wave, tmp_path, monkeypatch, undrawn):
    fake(monkeypatch)
    found = Cheapest(wave, tmp_path / "s", SearchOptions(None))
    assert found.make("wave")
    assert found.goal == pytest.approx(found.scene.error) and found.found.error <= found.goal
    # The step does nothing to the error of the fake, and costs: a longer one, by a move of 2^0.5, is unstable.
    own, cheapest = (load_scene(path).run.courant for path in (wave, tmp_path / "s" / "cheapest.toml"))
    assert found.found.cpu == pytest.approx(found.scene.cpu * own / cheapest) and cheapest > 1.5 * own
    with pytest.raises(SceneError, match=r"run.courant: .* unstable .*expected at most"):
        load_scene(wave, [f"run.courant={2**0.5 * cheapest}"])


def test_a_search_goes_on_where_ctrl_c_ended_it(wave, tmp_path, monkeypatch, undrawn):
    fake(monkeypatch, most=9)
    stopped = invoke(wave, "--error", "1%", *FEW, "-o", tmp_path / "s")
    assert stopped.exit_code == 130 and "repeat the command to continue" in stopped.output
    assert len(kept(tmp_path / "s")) == 9
    rest = fake(monkeypatch)
    assert invoke(wave, "--error", "1%", *FEW, "-o", tmp_path / "s").exit_code == 0
    whole = fake(monkeypatch)
    assert invoke(wave, "--error", "1%", *FEW, "-o", tmp_path / "t").exit_code == 0
    assert len(rest) == len(whole) - 9
    assert (tmp_path / "s" / "cheapest.toml").read_text() == (tmp_path / "t" / "cheapest.toml").read_text()


def test_what_is_not_reached_is_told_with_the_best_found(wave, tmp_path, monkeypatch):
    fake(monkeypatch)
    vary = ["--vary", "gas.particles,dust.particles=30,120", *FEW]
    done = invoke(wave, "--error", "0.01%", *vary, "-o", tmp_path / "s")
    assert done.exit_code == 4 and not (tmp_path / "s" / "cheapest.toml").exists()
    line = next(line for line in done.output.splitlines() if "was not reached" in line)
    assert "no tested setting reaches this error; closest is gas.particles = 120, dust.particles = 120" in line


def test_the_budget_ends_a_search(wave, tmp_path, monkeypatch, undrawn):
    fake(monkeypatch, most=6, end=DeadlineError(0.5))
    done = invoke(wave, "--error", "0.01%", *FEW, "--budget", "1 h", "-o", tmp_path / "s")
    assert done.exit_code == 4 and "was not reached: the budget of 1 h" in done.output and "closest is" in done.output
    assert len(kept(tmp_path / "s")) == 6
    # What reached the error by then is the answer so far; with more time the search goes on from there.
    so_far = invoke(wave, "--error", "1.5%", *FEW, "-o", tmp_path / "s")
    assert so_far.exit_code == 0 and "not complete" in so_far.output and len(kept(tmp_path / "s")) == 6
    assert (tmp_path / "s" / "cheapest.toml").exists()
    nothing = invoke(wave, "--error", "0.01%", *FEW, "--budget", "1e-9 s", "-o", tmp_path / "t")
    assert nothing.exit_code == 4 and "no run completed" in nothing.output


def test_the_summary_of_a_search_cut_short_has_all_its_runs(wave, tmp_path, monkeypatch, undrawn):
    """The deadline falls between the probes of one batch, of which some have ended."""
    fake(monkeypatch, most=8, end=DeadlineError(0.25))
    done = invoke(wave, "--error", "0.9%", *FEW, "-o", tmp_path / "s")
    runs = kept(tmp_path / "s")
    cpu = sum(run["cpu"] for run in runs) + 0.25
    assert len(runs) == 8 and f"search: 8 runs, {cpu:.3g} s of CPU" in done.output
    # Only a run of the batch that was cut short reaches the error: the one with the particles of the scene.
    assert next(run["settings"] for run in runs if run["errors"]["gas"] <= 0.009) == {}
    assert done.exit_code == 0 and "cheapest for 0.9%: the scene: error 0.8%" in done.output


def test_a_search_says_that_it_replaces_the_result_of_the_last_one(wave, tmp_path, monkeypatch, undrawn):
    fake(monkeypatch)
    cheapest, said, written = tmp_path / "s" / "cheapest.toml", [], []
    for error in ("0.7%", "1.3%", "0.7%"):
        done = invoke(wave, "--error", error, *FEW, "-o", tmp_path / "s")
        assert done.exit_code == 0
        said.append(f"{cheapest} of the last search is replaced; another directory, with -o, keeps both" in done.output)
        written.append((cheapest.read_text(), len(kept(tmp_path / "s"))))
    assert said == [False, True, True]
    assert written[0][0] == written[2][0] != written[1][0] and written[1][1] == written[2][1]


@pytest.mark.parametrize("parallel", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_trial_that_raises_anything_is_given_up(wave, tmp_path, monkeypatch, undrawn, parallel):
    """In a real search starts with fewer than 40 particles are refused, and those with other kernels fail."""
    own = Simulation.__init__

    def begin(sim, scene, *arguments, **named):
        if scene.gas.particles < 40:
            raise SceneError(["no balance"])
        if scene.gas.kernel != "cubic":
            raise IndexError("list index out of range")
        own(sim, scene, *arguments, **named)

    monkeypatch.setattr(Simulation, "__init__", begin)
    keep = ["--keep", "drag.scheme", "--keep", "gas.precision"]
    done = invoke(wave, "--error", "1%", *keep, "--parallel", parallel, "-o", tmp_path / "s")
    assert done.exit_code == 0 and "Traceback" not in done.output, done.output
    assert "cheapest for 1%" in done.output
    for words in ("refused at the start: no balance", "ended by IndexError: list index out of range"):
        assert words in (tmp_path / "s" / "cost.log").read_text()
    assert "quintic (ended by IndexError)" in done.output


@pytest.mark.parametrize("error", ["1%", "scene"])
@pytest.mark.parametrize("fault", [SceneError(["no balance"]), TypeError("no number")])
def test_a_scene_none_of_whose_trials_can_be_run_ends_in_one_message(wave, tmp_path, monkeypatch, error, fault):
    def begin(sim, *arguments, **named):
        raise fault

    monkeypatch.setattr(Simulation, "__init__", begin)
    done = invoke(wave, "--error", error, *FEW, "-o", tmp_path / "s")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and str(fault) in done.stderr
    assert "the scene" in done.stderr


def test_a_killed_process_of_runs_is_one_message(wave, tmp_path, monkeypatch):
    monkeypatch.setattr(Simulation, "__init__", lambda *arguments, **named: os.kill(os.getpid(), signal.SIGKILL))
    done = invoke(wave, "--error", "1%", *FEW, "--parallel", 2, "-o", tmp_path / "s")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and "was killed" in done.stderr


def test_a_run_ends_at_its_limits(wave):
    given_up = study_runs.one_run(wave, [], [], study_runs.Limits(cpu=0.0))
    assert "stopped after" in given_up["stopped"]
    with pytest.raises(DeadlineError):
        study_runs.one_run(wave, [], [], study_runs.Limits(deadline=0.0))


def test_powers_are_those_of_all_pairs():
    def trial(a, b):
        return Trial((a, b), [Measured(3.0 * 2.0 ** (1.5 * a / 2) * 5.0**b, 0.1 * 2.0 ** (-a / 2) * 0.5**b)])

    trials = [trial(a, b) for a, b in ((0, 0), (2, 0), (-2, 1), (1, 1), (5, 7))]
    assert fit_powers(trials, 0, 2.0) == pytest.approx((-1.0, 1.5))
    assert fit_powers(trials[:1], 0, 2.0) is None


def test_knobs_of_particles_are_left_out_where_the_cheapest_scheme_has_cells(wave):
    def run_settings(changes):
        return load_scene(wave, [f"{key}={value}" for key, value in changes.items()])

    knobs = Knobs(run_settings)
    names = [knob.name for knob in knobs.all]
    scheme = names.index("drag.scheme")

    def shown(word):
        at = with_rung((0,) * len(names), scheme, knobs.all[scheme].words.index(word))
        return [name for k, name in enumerate(names) if _has_knob(knobs, at, k)]

    assert shown("") == names and {"gas.kernel", "neighbours", "drag.cell"} < set(names)
    assert shown("emsi-ppm") == ["drag.scheme", "particles", "run.courant"]
    assert set(names) - set(shown("mk")) == {"drag.cell"}  # pairs of particles, no cells

    chosen = Trial(
        with_rung((0,) * len(names), scheme, knobs.all[scheme].words.index("emsi-ppm")), [Measured(2.0, 0.3)]
    )
    study = SimpleNamespace(
        knobs=knobs, runner=SimpleNamespace(trials={chosen.point: chosen}), unchanged=(0,) * len(names)
    )
    table = _knob_table(study, chosen)
    assert [cell.partition(" x ")[0] for cell in table.columns[0].cells] == ["particles", "run.courant"]
    assert [text.partition(" ")[0] for text in _choice_lines(study, chosen)] == ["drag.scheme"]


@pytest.mark.parametrize(
    ("error", "words"), [(0.01015, "the same accuracy in 0.33 of this CPU time"), (0.0104, "no tested setting")]
)
def test_what_the_scenes_own_error_costs(error, words):
    """Seeds of the scene scatter by 1e-4: what is within twice that is as good."""
    scene = Trial((0,), [Measured(3.0, value) for value in (0.0099, 0.01, 0.0101)])
    cheap = Trial((1,), [Measured(1.0, error)])
    study = SimpleNamespace(runner=SimpleNamespace(trials={(0,): scene, (1,): cheap}), settings_text=lambda trial: "")
    assert words in _cost_of_own_error(study, scene)
