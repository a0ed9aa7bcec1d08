"""Compiled kernels follow the sources of all kernels, not those of their own file alone."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import discsim
from discsim.jit import cache

# A kernel of a file of its own, which compiles in a moment.
CALLER = """
from discsim.jit.decorators import jit
from discsim.kernels.drag.laws import stopping_time

@jit
def slowing(grain):
    return stopping_time(1, grain, 1.0, 1.0, 1.0, 1.0)
"""
TIME = """
import numpy as np
from discsim.kernels import caller
print(caller.__file__, caller.slowing(np.array([0.25, 0.0, 0.5, 0.0, 1.0])))
"""
# What is left of a slip of 1 after t = .2 with eps = 1.
SLIP = """
import discsim
from discsim import Simulation
tables = {
    "units": {"system": "code"}, "run": {"until": 0.2, "timestep": 0.1}, "space": {"dimensions": 1, "size": 1.0,
    "boundary": "periodic"}, "initial": {"kind": "box", "gas_velocity": 1.0}, "dust": {"particles": 40, "ratio": 1.0},
    "gas": {"particles": 40, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    "drag": {"law": "stopping-time", "t_stop": 0.25, "scheme": "idic"},
}
sim = Simulation(tables)
sim.run()
print(discsim.__file__, abs(sim.gas.vel.mean() - sim.dust.vel.mean()))
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the package, whose compiled kernels lie beside it."""
    there = tmp_path / "discsim"
    shutil.copytree(Path(discsim.__file__).parent, there, ignore=shutil.ignore_patterns("__pycache__"))
    return there


def result(copy, script):
    environment = os.environ | {"PYTHONPATH": str(copy.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=copy.parent, capture_output=True, text=True, check=True
    )
    file, found = done.stdout.split()
    assert Path(file).is_relative_to(copy)
    return float(found)


def change(copy, old, new):
    """Another law of drag, with the size and the times of its file as they were."""
    laws = copy / "formulas" / "laws.py"
    text, times = laws.read_text(), laws.stat()
    assert old in text and len(old) == len(new)
    laws.write_text(text.replace(old, new))
    os.utime(laws, ns=(times.st_atime_ns, times.st_mtime_ns))


def compiled(copy):
    return {path: path.stat().st_mtime_ns for path in copy.rglob("*.nb[ci]")}


def test_a_change_of_another_file_is_compiled(copy):
    (copy / "kernels" / "caller.py").write_text(CALLER)
    value, size = "value = grain[VALUE]\n", "value = grain[SIZE ]\n"
    assert result(copy, TIME) == 0.25
    change(copy, value, size)
    assert result(copy, TIME) == 0.5
    change(copy, size, value)
    before = compiled(copy)
    assert result(copy, TIME) == 0.25 and compiled(copy) == before  # what both are compiled to is kept


@pytest.mark.slow
def test_a_run_has_the_physics_of_its_sources(copy):
    assert result(copy, SLIP) == pytest.approx(2.718281828 ** (-2 * 0.2 / 0.25), rel=1e-6)
    change(copy, "        return value\n", "        return 8 * 1\n")
    assert result(copy, SLIP) == pytest.approx(2.718281828 ** (-2 * 0.2 / 8), rel=1e-6)


def test_what_was_compiled_long_ago_goes(tmp_path):
    """All but the last ones used, and those that a run of today may still add to."""
    old = [tmp_path / f"kernels-{number:02}" for number in range(2 * cache.FOLDERS_KEPT)]
    for number, path in enumerate(old):
        path.mkdir()
        (path / "one.nbi").touch()
        os.utime(path, (time.time() - 2e5 + number,) * 2)
    (tmp_path / "other").mkdir()
    os.utime(old[0])
    cache.remove_old_folders(old[1])
    assert sorted(tmp_path.glob("kernels-*")) == [*old[:2], *old[cache.FOLDERS_KEPT :]]
    assert (tmp_path / "other").is_dir()
