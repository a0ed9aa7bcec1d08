"""Three hundred random scenes with units: whole, killed and resumed, on two threads; the same bits, or one message."""

from collections import Counter

import pytest
from randomscenes import outcomes, unseen

EACH, ALL = 20, 300
seen: Counter[str] = Counter()


@pytest.mark.parametrize("first", range(0, ALL, EACH))
def test_random_scenes_leave_the_same_bits_in_three_runs(tmp_path, monkeypatch, first):
    ends, parts = outcomes(range(first, first + EACH), tmp_path, monkeypatch)
    seen.update(parts)
    assert ends["ran"] >= 0.8 * EACH  # others are refused, or end by their physics


def test_random_scenes_have_seen_every_part():
    """All effects, starts, equations of state, schemes and laws."""
    if sum(seen.values()) < ALL:
        pytest.skip("not all of them have run in this process")
    assert unseen(seen) == []
