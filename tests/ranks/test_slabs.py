"""The potential by slabs on several MPI ranks, more than there are cores too: the same bits as on one."""

from pathlib import Path

import pytest
from launched import MARKS, lines_of

pytestmark = MARKS
SLABS = Path(__file__).parents[1] / "helpers" / "slabs.py"


@pytest.mark.parametrize(("number", "threads"), [(2, 1), (3, 2), (7, 1)])
def test_slabs_have_the_bits_of_one_rank(number, threads):
    """Open and periodic grids, both kernels, sheets, particles off the grid, ranks without rows or particles."""
    lines = lines_of(number, SLABS, threads=threads)
    assert len(lines) == 13
    assert [line for line in lines if not line.endswith(": the same")] == []
