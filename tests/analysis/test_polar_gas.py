"""analysis/polar_gas.py: its exact solutions, and its files at a low resolution."""

import csv
from importlib import import_module as script

import numpy as np
import pytest

module = script("polar_gas")


def test_the_standing_wave_is_a_solution():
    """Its potential has curl v = 0, div grad psi = -k^2 psi, and no radial velocity at the edges."""
    k = module.standing_wavenumber((0.9, 2.1), 2)
    cells = module.square_cells(200, 0.9, 2.1, 1.4)
    vel = module.standing_velocity(cells, k, (0.9, 2.1), 2)
    r = cells.geometry.radius
    out = cells.pos / np.hypot(*cells.pos.T)[:, None]
    radial = (vel * out).sum(axis=1).reshape(cells.shape)
    around = (vel * out[:, ::-1] * [-1.0, 1.0]).sum(axis=1).reshape(cells.shape)
    curl = np.gradient(r[:, None] * around, r, axis=0) - np.gradient(radial, cells.geometry.angle, axis=1)
    assert np.abs(curl[2:-2, 2:-2]).max() < 1e-3 * k  # (k dr)^2 / 6
    ends = [
        np.polyval(np.polyfit(r[part], radial[part], 2), edge)
        for part, edge in ((slice(3), 0.9), (slice(-3, None), 2.1))
    ]
    assert np.abs(ends).max() < 1e-4
    assert np.abs(vel).max() == pytest.approx(1.0)


def test_a_packet_without_pressure_and_gravity_has_epicycles():
    disc = module.Disc(0.0, 0.0, 0.03, 15.0, 1.0)
    times = np.linspace(0.0, 3.0, 7)
    assert module.exact_amplitude(times, disc, 4.2) == pytest.approx(np.cos(np.sqrt(4.2) * times), abs=1e-12)


def test_table_and_figure(tmp_path, capsys, monkeypatch):
    """Sod's tube and gravity at two resolutions: the rows of both methods, and orders."""
    for name, resolutions in (("sod", (30, 60)), ("gravity", (12, 24))):
        monkeypatch.setitem(module.PROBLEMS, name, (module.PROBLEMS[name][0], resolutions))
    assert module.main(["-o", str(tmp_path), "--problems", "sod,gravity", "--levels", "2"]) == 0
    rows = list(csv.DictReader((tmp_path / "polar_gas.csv").read_text().splitlines()))
    expected = [("sod", "grid"), ("sod", "sph"), ("gravity", "grid"), ("gravity", "sph")]
    assert [(row["problem"], row["method"]) for row in rows] == [each for each in expected for _ in range(2)]
    assert all((row["order"] == "") == (number % 2 == 0) for number, row in enumerate(rows))
    assert 0.7 < float(rows[1]["order"]) < 1.3  # shocks
    assert [float(row["needed"]) for row in rows[::2]] == [0.125, 1.0, 1.0, 1.0]
    assert float(rows[0]["cpu"]) > 0.0
    assert (tmp_path / "polar_gas.md").read_text().count("\n") == len(rows) + 2
    assert (tmp_path / "polar_gas.png").stat().st_size > 5_000 and "sod" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        module.main(["--problems", "waves"])


@pytest.mark.parametrize("problem", ["isothermal", "wave", "sedov", "gresho", "stable", "unstable"])
@pytest.mark.parametrize("method", ["grid", "sph"])
def test_each_problem_at_a_low_resolution(problem, method, monkeypatch):
    if problem in module.DISCS:
        monkeypatch.setitem(module.DISCS, problem, module.DISCS[problem]._replace(until=0.2))
    row = module.measure(problem, method, 60 if problem == "isothermal" else 6 if problem in module.DISCS else 16)
    assert 0.0 < row["error"] < 0.8
    assert row["count"] > 50
