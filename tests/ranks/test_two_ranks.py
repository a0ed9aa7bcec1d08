"""Runs on two MPI ranks that one goes on with: what every change must keep of all that `test_ranks.py` shows."""

import subprocess

import pytest
from launched import ENVIRONMENT, LONGEST, command_of, needs_mpi
from runs import DISC, GROWING_RINGS, RINGS, assert_same_run

from discsim.run.runner import run_scene
from discsim.scene import load_scene

pytestmark = needs_mpi
UNTIL = ["run.until=0.5"]  # five steps, of which the first sorts; the star takes gas and dust in each


@pytest.mark.parametrize("text, settings", [(DISC, []), (RINGS, GROWING_RINGS)], ids=["particles", "rings"])
def test_two_ranks_and_then_one_have_the_bits_of_one(text, settings, tmp_path):
    """Gas and dust that go from rank to rank, with self-gravity, two-way drag and a star that takes of both; and rings
    of gas in polar cells, with open edges, a companion that takes gas, and dust that grows and diffuses.
    """
    path, one, two = (tmp_path / name for name in ("disc.toml", "one", "two"))
    path.write_text(text)
    scene = load_scene(path, [*UNTIL, *settings])
    assert run_scene(scene, one, quiet=True) == 0
    command = command_of(2, path, two, ["run.until=0.25", *settings])
    subprocess.run(command, check=True, capture_output=True, env=ENVIRONMENT, timeout=LONGEST)
    assert run_scene(scene, two, resume=True, quiet=True) == 0
    assert_same_run(one, two)
