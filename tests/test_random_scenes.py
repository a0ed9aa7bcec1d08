"""A handful of the random scenes of `-m faults`, and what is typed of all of them."""

from collections import Counter

import pytest
from randomscenes import draw, outcomes, parts_of, scene_file, unseen

from discsim import load_scene


def test_some_random_scenes_leave_the_same_bits_in_three_runs(tmp_path, monkeypatch):
    """A tube and a disc with a companion, killed and on two threads."""
    ends, _ = outcomes((3, 12), tmp_path, monkeypatch)
    assert ends["ran"] == 2


def test_random_scenes_have_every_part():
    seen: Counter[str] = Counter()
    for seed in range(300):
        seen.update(parts_of(draw(seed)))
    assert unseen(seen) == [] and min(seen.values()) >= 3


@pytest.mark.parametrize("first", [0, 150])
def test_random_scenes_are_valid_as_they_are_typed(tmp_path, first):
    """With units, after some draws at most; but for those that begin with a snapshot."""
    for seed in range(first, first + 7):
        if draw(seed)["initial"]["kind"] != "snapshot":
            path, _ = scene_file(seed, tmp_path)
            assert path is not None and load_scene(path).title.startswith(f"scene {seed}"), draw(seed)
