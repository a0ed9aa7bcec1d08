"""The study of the streaming instability: growth of waves, densities and clumps, at few cells."""

import csv
from importlib import import_module as script

import numpy as np
import pytest

study = script("streaming")


def rows(file):
    with file.open() as stream:
        return list(csv.DictReader(stream))


def test_growth_of_three_cases_and_what_a_second_call_adds(tmp_path, capsys):
    """At 8 cells the error of linA is 2%, that of idic above 100%; a tenth of a growth time adds 3%."""
    few = ["growth", "-o", str(tmp_path), "--cells", "8", "--folds", "0.1"]
    assert study.main([*few, "--cases", "linA", "--schemes", "tsc,idic"]) == 0
    assert study.main([*few, "--cases", "linA,lin3", "--schemes", "tsc"]) == 0
    found = rows(tmp_path / "growth.csv")
    assert [(row["case"], row["scheme"]) for row in found] == [("linA", "tsc"), ("linA", "idic"), ("lin3", "tsc")]
    error = [abs(float(row["error"])) for row in found]
    assert error[0] < 0.06 and error[1] > 0.2 and error[2] < 0.1
    assert float(found[0]["exact_rate"]) == pytest.approx(0.41868, abs=1e-5)
    assert (tmp_path / "growth.png").stat().st_size > 5_000 and "linA" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        study.main([*few, "--cases", "linC"])


def test_density_of_clouds_is_that_of_the_particles():
    """A wave of 3 x 5 wavelengths is smoothed by the clouds alone; the mean is 1 to rounding."""
    side, cells, n = 2.5, 24, 240
    at = (np.stack(np.meshgrid(*2 * [np.arange(n)], indexing="ij"), axis=-1).reshape(-1, 2) + 0.5) / n * side
    k = 2.0 * np.pi / side * np.array([3, 1])
    moved = (at - 0.01 * np.cos(at @ k)[:, None] * k / (k @ k)) % side  # density 1 - 0.01 sin(k.x)
    found = study.density(moved, side, cells)
    assert found.mean() == pytest.approx(1.0, abs=1e-12)
    centres = (np.stack(np.meshgrid(*2 * [np.arange(cells)], indexing="ij"), axis=-1) + 0.5) * side / cells
    smoothing = np.prod(np.sinc(k * side / cells / 2.0 / np.pi) ** 3)
    assert found == pytest.approx(1.0 - 0.01 * smoothing * np.sin(centres @ k), abs=2e-4)


def test_clumps_of_a_short_run(tmp_path, monkeypatch):
    """Random grains begin with Poisson noise and drift as NSH before anything grows."""
    monkeypatch.setitem(study.CLUMPS, "AB", study.CLUMPS["AB"]._replace(until=0.2))
    assert study.main(["clumps", "-o", str(tmp_path), "--cases", "AB", "--cells", "12"]) == 0
    (row,) = rows(tmp_path / "clumps.csv")
    assert 1.5 < float(row["densest_1_percent"]) < float(row["largest"]) <= float(row["peak"]) < 5.0
    assert 0.7 < float(row["drift_over_nsh"]) < 1.3
    assert (tmp_path / "clumps.png").stat().st_size > 5_000
