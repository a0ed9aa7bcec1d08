"""Scripts of analysis/ about stability, speed and cost: stability_map, throughput, cost_of_accuracy, drift_cost."""

import csv
import io
from importlib import import_module as script
from types import SimpleNamespace

import numpy as np
import pytest
from drags import POLAR
from rich.console import Console

from discsim import Simulation
from discsim.numerics import threads
from discsim.parts import DEFAULT_SCHEME, SCHEMES


@pytest.mark.parametrize("coefficient", [1e-6, 1.0, 1e12])
@pytest.mark.parametrize("ratio", [1e-6, 1e6])
def test_no_wave_is_out_of_reach_of_the_default_scheme(coefficient, ratio):
    """The corners of the map: at 120 particles the velocities are right to .5%, from free to one body."""
    module = script("stability_map")
    found = module.run("tsc", coefficient, ratio, 120)
    assert found["error"] < 0.005
    # 34 steps, as sound sets them.
    assert found["stiffness"] == pytest.approx(module.END / 34 * coefficient * (1 + 1 / ratio), rel=0.2)


def test_a_blow_up_is_seen(monkeypatch):
    module = script("stability_map")

    def blow():
        raise module.PhysicsError("gas particle 3 is not finite")

    monkeypatch.setattr(module, "run_of", lambda *a, **k: SimpleNamespace(run=blow))
    assert module.run("tsc", 1.0, 1.0, 60)["error"] == np.inf


@pytest.fixture
def step_cost(monkeypatch):
    """Steps measured without what takes seconds of its own."""
    module = script("step_cost")
    monkeypatch.setattr(module, "triad", lambda: 1e-9)
    monkeypatch.setattr(module, "fft_pair", lambda cells: 1e-3)
    return module


@pytest.mark.parametrize("name", ["gas", "box", "gravity", "dust one-way", "dust two-way", "mix"])
def test_throughput_measures_what_it_names(name, step_cost):
    tables = step_cost.case(name, 1500 if "dust" in name else 500, 1)
    found = step_cost.measure(tables)
    assert set(found["effects"]) == {"gas"} | ({"star"} if name != "box" else set()) | (
        {"self_gravity"} if name not in ("gas", "box") else set()
    ) | ({"dust", "drag"} if found["dust"] else set())  # fmt: skip
    # A few at the inner edge fall onto the star.
    assert found["dust"] == pytest.approx(
        {"dust one-way": 1500, "dust two-way": 1500, "mix": 5000}.get(name, 0), rel=0.1
    )
    # Near the sharp edges kernels are wider than the 25 neighbours inside.
    assert found["neighbours"] == pytest.approx(25, rel=0.1)
    assert 0.0 < sum(found["effects"].values()) <= found["cpu"]
    assert "dust" not in step_cost.without_dust(tables)
    if found["dust"]:
        assert tables["drag"]["scheme"] == DEFAULT_SCHEME


def test_throughput_of_the_main_job_is_told_by_pass(step_cost):
    tables = step_cost.case("main", 0, 1)
    assert tables["drag"]["scheme"] == DEFAULT_SCHEME
    assert step_cost.case("main", 0, 1, "idic")["drag"]["scheme"] == "idic"
    tables["gas"]["particles"], tables["dust"]["particles"] = 3000, 6000
    found = step_cost.measure(tables)
    passes = found["passes"]
    expected = {"forces", "subtract_interpolated", "attract_mutually", "are_finite", "collect", "fit", "scatter"}
    assert expected <= set(passes) and min(passes.values()) >= 0.0
    # Each loop once: all of them are most of a step, and no more than it.
    assert 0.5 * found["cpu"] < sum(passes.values()) <= found["cpu"]
    text = io.StringIO()
    script("throughput").show_cases([{"case": "main", "cpu_of_dust": 0.0, **found}], Console(file=text, width=200))
    assert "forces" in text.getvalue() and "outside of loops" in text.getvalue()
    for share in (threads.parallel_for, threads.parallel_for_ranges, threads.parallel_for_fused):  # watched no more
        assert share.__module__ == threads.__name__


def test_throughput_sets_threads_beside_each_other():
    """Minimum and median of lines made again; no table where each line has one number of threads."""
    show = script("throughput").show_threads
    line = {"case": "main", "gas": 100_000, "dust": 200_000}
    rows = [{**line, "threads": n, "cpu": cpu, "wall": cpu / n} for n, cpu in ((1, 0.08), (2, 0.088), (1, 0.1))]
    text = io.StringIO()
    show(rows, Console(file=text, width=200))
    one, two = (" ".join(each.split()) for each in text.getvalue().splitlines() if "main" in each)
    assert one == "main 1e5 2e5 1 2 267, 300 267, 300 1.00 1.00, 1.00 1.00, 1.00"
    assert two == "main 1e5 2e5 2 1 293, 293 147, 147 2.00 1.10, 0.98 0.55, 0.49"
    show(rows[::2], Console(file=(none := io.StringIO())))
    assert none.getvalue() == ""


def test_throughput_sets_eight_sizes_beside_one(monkeypatch):
    throughput = script("throughput")
    monkeypatch.setattr(throughput, "STEPS", 1)
    rows = throughput.show_sizes(600, ["tsc"], Console(file=io.StringIO()))
    assert [(row["per_gas"], row["sizes"]) for row in rows] == [(2, 1), (2, 8), (10, 1), (10, 8)]
    assert all(0.0 < row["kick"] < row["step"] for row in rows)
    sim = Simulation(throughput.of_sizes(600, 2, 8, "tsc"))
    sim.step()
    assert sim.effects["drag"].engine.classes.number == 8  # each size a class of its own


def test_a_study_of_cost_is_made_once(tmp_path):
    module = script("cost_of_accuracy")
    vary = ["drag.scheme=idic,tsc", module.particles(24, 48)]
    study = module.made(module.wave(500.0), vary, tmp_path / "wave")
    again = module.made(module.wave(500.0), vary, tmp_path / "wave")
    assert [p.cpu for p in study.points] == [p.cpu for p in again.points]
    prices = {name: module.cost_of_error(points, 0.01, module.updates) for name, points in study.lines().items()}
    assert prices["scheme = tsc"][0] < prices["scheme = idic"][0]


@pytest.fixture
def cost_module(monkeypatch):
    """The script with some of its constants, and without the figures that each study draws of itself (test_cost.py)."""
    monkeypatch.setattr("discsim.study.costfigure.cost_figure", lambda study, path: path.touch())

    def reduced(**constants):
        module = script("cost_of_accuracy")
        for name, value in constants.items():
            monkeypatch.setattr(module, name, value)
        return module

    return reduced


def rows_of(file):
    return list(csv.DictReader(file.read_text().splitlines()))


def test_waves_and_shocks_are_made_with_every_scheme(cost_module, tmp_path, capsys):
    module = cost_module(WAVE_K=(0.5,), SHOCK_K=(5.0,), WAVES=(24, 48), FINER_WAVES=(24, 48), SHOCKS=(30, 40))
    assert module.main(["-o", str(tmp_path), "--studies", "wave,shock"]) == 0
    for problem in ("wave-0.5", "shock"):
        rows = [row for folder in tmp_path.glob(f"{problem}*") for row in rows_of(folder / "cost.csv")]
        assert sorted({row["drag.scheme"] for row in rows}) == sorted({*SCHEMES} - {*POLAR})
        assert all(row["status"] == "done" for row in rows)
        errors = {(row["drag.scheme"], row["gas.particles"]): float(row["error"]) for row in rows}
        assert all(error < 0.3 for error in errors.values())
        assert all(errors[name, "48"] < 0.7 * error for (name, count), error in errors.items() if count == "24")
        # The ends of a tube are held: its momentum is none to keep.
        assert all((row["momentum"] == "") == (problem == "shock") for row in rows)
    for name in ("cost_wave.png", "cost_shock.png"):
        assert (tmp_path / name).stat().st_size > 10_000
    assert "updates to 1%" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        module.main(["--studies", "waves"])


def test_waves_across_a_square(cost_module, tmp_path):
    module = cost_module(SQUARES=(12,), FINER_SQUARES=(12,))
    assert module.main(["-o", str(tmp_path), "--studies", "oblique"]) == 0
    finer = {
        row["drag.scheme"]: row
        for name in ("oblique", "oblique-explicit")
        for row in rows_of(tmp_path / name / "cost.csv")
    }
    # Steps of t_stop against steps of sound, for four times the error.
    assert int(finer["mk"]["steps"]) > 50 * int(finer["tsc"]["steps"])
    assert float(finer["mk"]["error"]) > 4.0 * float(finer["tsc"]["error"])


def test_the_sheet_grows_as_it_must_with_more_cells(cost_module, tmp_path):
    module = cost_module(CELLS=(16, 64), SHEETS=(900,))
    assert module.main(["-o", str(tmp_path), "--studies", "sheet"]) == 0
    coarse, fine = (float(row["error"]) for row in rows_of(tmp_path / "sheet" / "cost.csv"))
    assert fine < 0.2 * coarse and fine < 0.02  # of e^5
    assert (tmp_path / "cost_sheet.png").exists()


@pytest.mark.slow
def test_what_discs_keep_against_the_courant_factor(cost_module, tmp_path, capsys):
    module = cost_module(COURANTS=(0.15, 0.6), DISC=800, ORBITS=0.3)
    assert module.main(["-o", str(tmp_path), "--studies", "courant"]) == 0
    plain, dusty, complete = (rows_of(tmp_path / f"courant-{name}" / "cost.csv") for name in (
        "gas", "gas-dust-drag", "gas-dust-drag-self-gravity"))  # fmt: skip
    assert all(float(row["angular_momentum"]) < 1e-13 for row in plain)
    assert all(1e-13 < float(row["angular_momentum"]) < 1e-5 for row in dusty + complete)  # the drag's nodes
    assert float(plain[0]["energy"]) < 0.4 * float(plain[1]["energy"])
    assert (tmp_path / "cost_courant.png").exists() and "Courant factor" in capsys.readouterr().out


@pytest.mark.slow
def test_cost_of_the_drift(tmp_path, capsys):
    module = script("drift_cost")
    wanted = [case for case in module.cases((1500,), (1,)) if case.gas == "given" and case.stokes == 0.01]
    wanted.append(module.Case("quintic", 0.1, "tsc", 2000, 2))
    rows = module.make(tmp_path / "drift", Console(), wanted)
    for row in rows:
        if row["gas"] == "given":
            assert row["drift"] == pytest.approx(1.0, abs=0.05), row
        assert row["cpu"] > 0.0 and row["error"] > 0.0
    assert rows[-1]["of_headwind"] == pytest.approx(1.0, abs=0.25)  # 2000 particles
    again = module.make(tmp_path / "drift", Console(), wanted)
    assert [row["cpu"] for row in again] == [row["cpu"] for row in rows]
    assert (tmp_path / "cost_drift.png").exists() and "of_headwind" in capsys.readouterr().out
