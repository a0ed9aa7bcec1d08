"""Numbers of small scenes with many effects are those that were recorded: an edit that changes results says so.

`tests/helpers/recorded.py` lists what is recorded, and records it again after a change that is meant.
"""

import pytest
import recorded

LONG = {"disc_933", "settling_70", "snapshot_374", "snapshot_674", "table_92", "table_277", "vortex_11"}  # to compile
SCENES = [pytest.param(path, marks=[pytest.mark.slow] * (path.stem in LONG), id=path.stem) for path in recorded.SCENES]
REMEDY = "if that is meant: python tests/helpers/recorded.py --write"


@pytest.mark.parametrize("path", SCENES)
def test_a_scene_gives_the_numbers_that_were_recorded(path):
    found = recorded.changes(recorded.recorded()[path.stem], recorded.of_run(path))
    assert not found, "\n".join([*found[:20], REMEDY])


def test_checks_print_the_numbers_that_were_recorded():
    found = recorded.changes(recorded.recorded()["checks"], recorded.of_checks())
    assert not found, "\n".join([*found[:20], REMEDY])


def test_recorded_numbers_see_a_change_of_one_particle():
    one = {"gas.pos": recorded.moments([[0.3, 2.0], [1.7, -0.4], [0.9, 1.1]])}
    other = {"gas.pos": recorded.moments([[0.3, 2.0], [0.9, 1.1], [1.7, -0.4]])}
    assert recorded.changes(one, one) == [] and len(recorded.changes(one, other)) == 1
    assert recorded.changes(one, {}) == ["gas.pos: gone"]
