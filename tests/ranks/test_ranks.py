"""Runs on several MPI ranks, more than there are cores too: the same bits as on one."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from launched import ENVIRONMENT, LONGEST, MARKS, command_of, differing
from recipes import PAGES, files_of, write_package
from runs import DISC, GROWING_RINGS, RINGS, assert_same_files, assert_same_run

import discsim
from discsim import load_scene, read_snapshot
from discsim.run.runner import run_scene

pytestmark = MARKS
UNTIL = ["run.until=0.5"]  # five steps, of which the first sorts; the star takes gas and dust in each


def on_ranks(number, scene, folder, *more, settings=UNTIL):
    """Run a scene file with `number` ranks of one thread each; status and what is on stderr."""
    command = command_of(number, scene, folder, settings)
    done = subprocess.run([*command, *more], capture_output=True, text=True, env=ENVIRONMENT, timeout=LONGEST)
    return done.returncode, done.stderr


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "disc.toml"
    path.write_text(DISC)
    return path


@pytest.fixture(scope="module")
def one(scene, tmp_path_factory):
    """The run on one rank."""
    folder = tmp_path_factory.mktemp("one") / "run"
    assert run_scene(load_scene(scene, UNTIL), folder, quiet=True) == 0
    return folder


def assert_same(one, other):
    """Histories, and all that the last snapshots hold, bit for bit."""
    assert (one / "history.csv").read_text() == (other / "history.csv").read_text()
    names = sorted(path.name for path in (one / "snapshots").iterdir())
    assert names == sorted(path.name for path in (other / "snapshots").iterdir())
    mine, theirs = (read_snapshot(folder / "snapshots" / names[-1]) for folder in (one, other))
    assert mine.time == theirs.time and mine.gas.count < 1000 and mine.dust.count < 1100
    for name, species in mine.species.items():
        for key, array in vars(species).items():
            if isinstance(array, np.ndarray):
                np.testing.assert_array_equal(array, getattr(theirs.species[name], key), err_msg=f"{name}.{key}")
    for name, arrays in mine.open_step.arrays.items():
        for key, array in arrays.items():
            np.testing.assert_array_equal(array, theirs.open_step.arrays[name][key], err_msg=f"{name}.{key}")


def test_ranks_have_the_bits_of_one(scene, one, tmp_path):
    """A disc with self-gravity, two-way drag, viscosity and a star that takes gas and dust."""
    assert on_ranks(3, scene, tmp_path / "run") == (0, "")
    assert_same(one, tmp_path / "run")


def test_another_number_of_ranks_goes_on(scene, one, tmp_path):
    assert on_ranks(3, scene, tmp_path / "run", settings=["run.until=0.25"]) == (0, "")
    assert on_ranks(2, scene, tmp_path / "run", "--resume") == (0, "")
    assert_same(one, tmp_path / "run")


def test_gas_in_rings_goes_on_with_another_number_of_ranks(tmp_path):
    """With all that acts on it at once. Files are the same too, but the seconds in costs.csv and lines of run.log."""
    path, one, others = (tmp_path / name for name in ("rings.toml", "one", "others"))
    path.write_text(RINGS)
    settings = [
        *GROWING_RINGS, 'gas.eos={kind = "adiabatic", gamma = 1.3, aspect_ratio = 0.07}',
        "self_gravity.softening=0.05", 'cooling={kind = "beta", beta = 7.0}', "alpha_viscosity.alpha=0.01",
        "damping.outer=[1.7, 2.0]", "run.every=0.1",
    ]  # fmt: skip
    assert run_scene(load_scene(path, [*settings, "run.until=0.3"]), one, quiet=True) == 0
    for number, until, more in ((3, 0.1, []), (2, 0.2, ["--resume"]), (4, 0.3, ["--resume"])):
        assert on_ranks(number, path, others, *more, settings=[*settings, f"run.until={until}"]) == (0, "")
    assert_same_files(one, others)


def test_what_cannot_run_is_refused_once(scene, tmp_path):
    status, said = on_ranks(2, scene, tmp_path / "run", settings=["star.mas=1"])
    assert status == 2 and "star.mas: unknown key" in said and said.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_stop_by_the_physics_is_told_once(scene, tmp_path):
    """On all ranks at a time."""
    status, said = on_ranks(2, scene, tmp_path / "run", settings=["run.timestep=3", "run.until=6", "run.every=6"])
    assert status == 3 and said.count("stopped by a numerical failure") == 1
    assert (tmp_path / "run" / "checkpoint.h5").exists()


def test_a_directory_that_holds_a_run_is_refused_once(scene, one):
    status, said = on_ranks(2, scene, one)
    assert status == 2 and said.count("\n") == 1 and "already contains a run" in said


@pytest.mark.parametrize("number", [2, 3])
def test_many_scenes_have_the_bits_of_one(number):
    """One for each thing that ranks ask or fetch of each other; test_matrix.py has all that there is."""
    assert differing(number, ["few"]) == []


@pytest.mark.parametrize("recipe", ["effect", "drag_scheme"])
def test_what_others_bring_knows_nothing_of_ranks(tmp_path, recipe):
    """The effect and the scheme of the recipes, as packages beside discsim."""
    files = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))
    write_package(tmp_path, files)
    (scene,) = (tmp_path / name for name in files if name.endswith(".toml") and name != "pyproject.toml")
    home = os.path.dirname(os.path.dirname(discsim.__file__))
    environment = ENVIRONMENT | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{home}"}
    one, three = tmp_path / "one", tmp_path / "three"
    for command in ([sys.executable, "-m", "discsim", "run", str(scene), "-o", str(one)], command_of(3, scene, three)):
        subprocess.run(command, check=True, capture_output=True, env=environment, timeout=LONGEST)
    assert_same_run(one, three)


def test_a_signal_ends_all_ranks_with_a_checkpoint(scene, tmp_path):
    folder = tmp_path / "run"
    command = command_of(2, scene, folder, ["run.until=1000", "run.every=500"])
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=ENVIRONMENT
    ) as run:
        while run.poll() is None and not (folder / "checkpoint.h5").exists():
            time.sleep(0.1)
        before = (folder / "checkpoint.h5").stat().st_mtime_ns
        run.send_signal(signal.SIGTERM)
        said = run.communicate(timeout=LONGEST)[1]
    assert run.returncode == 128 + signal.SIGTERM
    assert said.startswith("interrupted by SIGTERM") and said.count("\n") == 1
    assert (folder / "checkpoint.h5").stat().st_mtime_ns > before
