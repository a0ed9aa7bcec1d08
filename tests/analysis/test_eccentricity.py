"""analysis/eccentricity.py on orbits whose eccentricity is known."""

from importlib import import_module as script

import numpy as np
import pytest
from test_studies import even, gas_of

from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

DISC = """
units.system = "code"
run.until = 60.0
space.size = 12.0
star.mass = 0.7
[initial]
kind = "disc"
mass = 1e-3
inner = 1.2
outer = 2.9
[gas]
particles = 500
eos = {kind = "locally-isothermal", aspect_ratio = 0.05, temperature_index = 1.0}
"""


def run_of(directory, growth_time, mode=1):
    """Snapshots of orbits whose e grows by exp(1) in a time; with `mode` 2, of a motion with two arms."""
    (directory / "snapshots").mkdir(parents=True)
    (directory / "scene.toml").write_text(DISC)
    scene = load_scene(directory / "scene.toml")
    pos = even(8000, 1.2, 2.9)
    r, phi = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
    for k, time in enumerate(np.linspace(0.0, 60.0, 21)):
        gas = gas_of(pos, 1.0)
        radial = 3e-5 * np.exp(time / growth_time) * np.sqrt(0.7 / r) * np.sin(mode * phi - 0.8)
        gas.vel[:] = radial[:, None] * pos / r[:, None]
        write_snapshot(directory / "snapshots" / f"snapshot_{k:04}.h5", scene, time, gas, None, {})
    return directory


def test_the_growth_of_a_known_eccentricity(tmp_path, capsys):
    """e from 3e-5 to .06 in 60 time units, with a growth time of 7.9; a motion of two arms has none of it."""
    measure = script("eccentricity")
    assert measure.main([str(run_of(tmp_path / "one", 7.9))]) == 0
    *_, last, _, said = capsys.readouterr().out.splitlines()
    assert float(last.split()[-2]) == pytest.approx(3e-5 * np.exp(60.0 / 7.9), rel=0.02)  # lattice: few per cent
    assert said.startswith("grows by a factor of e in ") and float(said.split()[-1]) == pytest.approx(7.9, rel=1e-3)
    assert measure.main([str(run_of(tmp_path / "two", 7.9, mode=2))]) == 0
    assert "no growth time" in capsys.readouterr().out


def test_decay_and_radii(tmp_path, capsys):
    measure = script("eccentricity")
    run = run_of(tmp_path / "run", -9.0)
    assert measure.main([str(run), "--inner", "1.5", "--outer", "2.2", "--from", "1e-9"]) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("falls by a factor of e in ") and float(said.split()[-1]) == pytest.approx(9.0, rel=1e-3)
    assert measure.main([str(run), "--inner", "5"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
