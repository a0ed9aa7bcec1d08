"""analysis/methods.py: the scenes of both methods, the reference of errors, and the files."""

import csv
import json
from importlib import import_module as script

import pytest

from discsim import load_scene

module = script("methods")


@pytest.mark.parametrize("setup", module.SETUPS)
@pytest.mark.parametrize("line", module.LINES)
def test_lines_differ_in_the_method_and_the_scheme_alone(setup, line):
    """Dust, drag law, viscosity, star and self-gravity are those of the setup."""
    scene, whole = module.scene_of(setup, line, 4), load_scene(module.shipped(setup).path)
    method, scheme, _ = module.LINES[line]
    assert (scene.gas.method, scene.drag.scheme) == (method, scheme)
    assert scene.dust[0].particles == whole.dust[0].particles // 4
    cells = module.CELLS if method == "grid" else 1.0
    assert scene.gas.particles == round(cells * (whole.gas.particles // 4))
    assert scene.gas.eos == whole.gas.eos and scene.initial == whole.initial
    for key in ("law", "direction", "convention", "stokes"):
        assert getattr(scene.drag, key) == getattr(whole.drag, key)
    for name in ("alpha_viscosity", "self_gravity"):
        assert (name in scene.named) == (name in whole.named)
    assert scene.star == whole.star and scene.run.until == whole.run.until


def run_of(line, part, gas, dust):
    """A stored run with these masses in two rings."""
    return {"setup": "ring_oneway", "line": line, "part": part, "masses": {"gas": gas, "dust": dust}}


def test_error_is_the_mass_in_other_rings_than_in_the_mean_of_the_finest_runs():
    runs = [
        run_of("SPH, tsc", 2, [3.0, 1.0], [0.2, 0.2]),
        run_of("SPH, tsc", 4, [1.0, 3.0], [0.0, 0.4]),
        run_of("grid, emsi", 2, [2.0, 2.0], [0.1, 0.3]),
    ]
    floors = module.add_errors(runs)
    # Means: gas 2.5 and 1.5, dust 0.15 and 0.25.
    assert [run["error of gas"] for run in runs] == pytest.approx([0.5 / 4.0, 1.5 / 4.0, 0.5 / 4.0])
    assert [run["error of dust"] for run in runs] == pytest.approx([0.05 / 0.4, 0.15 / 0.4, 0.05 / 0.4])
    assert floors == {"ring_oneway": pytest.approx({"gas": 0.125, "dust": 0.125})}


def test_table_figure_and_a_second_call_without_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(module, "PARTS", (64, 32, 1, 1))
    monkeypatch.setattr(module, "load_scene", lambda tables: load_scene(tables, ["run.until=0.3"]))
    monkeypatch.setattr(module, "LINES", {name: module.LINES[name] for name in module.FINEST})
    options = ["-o", str(tmp_path), "--setups", "ring_twoway", "--levels", "2"]
    assert module.main(options) == 0
    stored = [json.loads(line) for line in (tmp_path / "methods.jsonl").read_text().splitlines()]
    assert len(stored) == 4 and all(run["cpu"] > 0.0 for run in stored)
    rows = list(csv.DictReader((tmp_path / "methods.csv").read_text().splitlines()))
    assert [row["line"] for row in rows] == ["SPH, tsc", "SPH, tsc", "grid, emsi", "grid, emsi"]
    assert all(1.1 < float(row["r10"]) < float(row["r50"]) < float(row["r90"]) < 2.0 for row in rows)
    assert float(rows[1]["error of dust"]) == pytest.approx(float(rows[3]["error of dust"]))  # of their mean
    assert (tmp_path / "methods.png").stat().st_size > 5_000
    assert (tmp_path / "methods.md").read_text().count("\n") == 6
    monkeypatch.setattr(module, "measured", None)
    assert module.main(options) == 0
    assert "smallest error" in capsys.readouterr().out
