"""analysis/gap.py and torque.py on discs and torques that are known."""

import csv
import os
from importlib import import_module as script

import numpy as np
import pytest
from test_studies import even, gas_of

from discsim.output.companions import COLUMNS
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

DISC = """
units.system = "code"
run.until = 2.0
space.size = 8.0
star.mass = 1.0
[gas]
particles = 500
eos = {kind = "locally-isothermal", aspect_ratio = 0.05, temperature_index = 1.0}
"""
TABLES = (
    DISC
    + """
[alpha_viscosity]
alpha = 0.01
[companion]
mass = 1e-3
semi_major_axis = 1.0
softening = 0.6
[initial]
kind = "disc"
surface_density = 1.0
surface_density_index = 1.0
inner = 0.5
outer = 3.0
"""
)
NAMES = ("time", "number", "mass", "x", "y", "semi_major_axis", "torque_gas")


def run_of(directory, rows):
    """A run's directory with a scene and the rows of companions.csv."""
    (directory / "snapshots").mkdir(parents=True)
    (directory / "scene.toml").write_text(TABLES)
    full = [dict.fromkeys(COLUMNS, 0) | dict(zip(NAMES, row, strict=True)) for row in rows]
    with (directory / "companions.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        writer.writeheader()
        writer.writerows(full)
    return directory


def test_a_known_gap(tmp_path, capsys):
    """A ring that keeps a quarter of its gas has that depth; what is near the planet is no part of it."""
    run = run_of(tmp_path / "run", [(t, 1, 1e-3, 1.0, 0.0, 1.0, 0.0) for t in (0.0, 1.0)])
    scene = load_scene(run / "scene.toml")
    pos = even(60_000, 0.4, 3.0)
    r, near = np.hypot(*pos.T), np.hypot(pos[:, 0] - 1.0, pos[:, 1]) < 0.1
    for k, kept in enumerate((1.0, 0.25)):
        gas = gas_of(pos, 1.0)
        gas.mass *= np.where(np.abs(r - 1.0) < 0.15, kept, 1.0)
        gas.mass[near] *= 1.0 + 50.0 * k  # its own disc
        write_snapshot(run / "snapshots" / f"{k:04d}.h5", scene, float(k), gas, None)
    other = run_of(tmp_path / "other", [(0.0, 1, 1e-3, 1.0, 0.0, 1.0, 0.0)])
    for k, mass in enumerate((1.0, 0.5)):
        write_snapshot(other / "snapshots" / f"{k:04d}.h5", scene, float(k), gas_of(pos, mass), None)
    assert script("gap").main([str(run), "-o", str(tmp_path)]) == 0
    found = script("gap").Gap(run, 10.0)
    assert found.depth("gas") == pytest.approx(0.25, abs=0.01)  # 250 particles a ring, of which rings are smoothed
    assert found.inside("gas") == pytest.approx(0.25, abs=0.02)  # of which the smoothed edges are near
    assert found.theory == pytest.approx(1.0 / (1.0 + 0.04 * 1e-6 / 0.05**5 / 0.01), rel=1e-6)
    # The fit of Fung et al. at the very parameters that it is normed to: alpha = .01 and H/r = .05 of TABLES.
    assert found.inside_of_grids == pytest.approx(0.14, rel=1e-6)
    assert found.summit(found.pressure) == pytest.approx(1.15, abs=0.05)  # an edge that is smoothed over five rings
    assert "gas" in capsys.readouterr().out
    assert (tmp_path / "run-gap.png").exists()
    # Of spans of a tenth of an orbit the last one alone has a snapshot; over another run at that time, not its start.
    ((end, depth),) = script("gap").Gap(run, 0.1).history()
    assert end == pytest.approx(1.0 / (2.0 * np.pi), rel=1e-3) and depth == found.depth("gas")
    assert script("gap").Gap(run, 10.0, over=other).depth("gas") == pytest.approx(0.5, abs=0.02)


def test_a_known_torque(tmp_path):
    """-2.5 Gamma_0 with noise that changes from orbit to orbit, on rows at uneven times."""
    random = np.random.default_rng(3)
    time = np.sort(random.random(4000)) * 2.0 * np.pi * 12.0
    unit = (1e-3 / 0.05) ** 2  # Sigma, r and Omega are 1 there
    orbit = time / (2.0 * np.pi)
    value = unit * (-2.5 + np.cos(time) + 0.3 * random.standard_normal(12)[np.minimum(orbit.astype(int), 11)])
    rows = [
        (t, 1, 1e-3, 1.0, 0.0, 1.0, v) for t, v in zip([0.0, *time, 2.0 * np.pi * 12.0], [0, *value, 0], strict=True)
    ]
    found = script("torque").torque(run_of(tmp_path / "run", rows), 2.0)
    assert found.mean == pytest.approx(-2.5, abs=3.0 * found.error)
    assert 0.05 < found.error < 0.15 and found.orbits == 10  # .3 / sqrt(10) = .09
    assert np.isnan(found.probes)


def test_formula_of_the_torque():
    """At a softening of .4 H that of eq. (49); without a gradient of vortensity none of horseshoes."""
    theory = script("torque").theory
    for p, index in ((0.5, 1.0), (1.0, 0.0), (2.0, -0.5)):
        assert theory(p, index, 0.4)[0] == pytest.approx(-(0.85 + p + 0.9 * index))
    assert theory(1.5, 1.0, 0.6)[0] == pytest.approx(theory(1.5, 1.0, 0.6)[1])
    assert theory(0.5, 0.0, 0.4)[1] == pytest.approx(-2.45 + 0.7)
    assert abs(theory(1.5, 0.0, 0.8)[0]) == pytest.approx(2.35 * 0.5**0.71)


def test_probes_show_the_noise(tmp_path):
    """Of probes beside a planet the torque, over their own mass, scatters as told; a second planet is none."""
    random = np.random.default_rng(5)
    time, unit = np.linspace(0.0, 2.0 * np.pi * 8.0, 400), (1e-3 / 0.05) ** 2
    means = 0.5 * random.standard_normal(40)
    masses, torques = [1e-3] + 40 * [1e-20], [-2.5, *means]
    rows = [
        (t, k + 1, m, 1.0, 0.0, 1.0, unit * m / 1e-3 * value)
        for t in time
        for k, (m, value) in enumerate(zip(masses, torques, strict=True))
    ]
    found = script("torque").torque(run_of(tmp_path / "run", rows), 2.0)
    assert found.mean == pytest.approx(-2.5) and found.error < 1e-12
    assert found.probes == pytest.approx(np.sqrt(np.mean(means**2)))
    heavy = [(t, k, 1e-3, *rest) for t, k, _, *rest in rows]
    with pytest.raises(script("torque").InputError, match="several companions"):
        script("torque").torque(run_of(tmp_path / "two", heavy), 2.0)


@pytest.mark.parametrize("name", ["gap", "torque"])
def test_no_run_is_one_message(tmp_path, capsys, name):
    assert script(name).main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{name}: ")


@pytest.mark.parametrize("name, read", [("gap", "companion_at"), ("torque", "torque")])
def test_a_fifo_in_place_of_a_table_is_not_waited_for(tmp_path, name, read):
    run = run_of(tmp_path / "run", [])
    (run / "companions.csv").unlink()
    os.mkfifo(run / "companions.csv")
    with pytest.raises(OSError, match="is a FIFO, not a plain file"):
        getattr(script(name), read)(run, 0.7)
