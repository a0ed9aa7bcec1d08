"""Every scheme, start, effect and setup on ranks and threads: the bits of one rank. A quarter of an hour."""

import pytest
from launched import differing, needs_mpi

pytestmark = [pytest.mark.slow, needs_mpi]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("number", [1, 2, 3, 4, 7])
def test_all_scenes_have_the_bits_of_one(number, threads):
    """Histories of each step, and all arrays after the last: `helpers/ranked_scenes.py` has the scenes."""
    assert differing(number, ["all"], threads, longest=7200) == []
