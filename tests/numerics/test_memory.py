"""Memory that a run frees stays with its process."""

import os
import platform
from pathlib import Path

import numpy as np
import pytest

from discsim import Simulation
from tests.helpers.scenes import WAVE

SIZE = 1 << 26  # bytes, beyond the 32 MB above which glibc would give it back


def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other libraries have no such setting")
def test_a_freed_array_leaves_its_memory_for_the_next():
    Simulation(WAVE)
    array = np.ones(SIZE // 8)
    held = resident()
    del array
    assert held - resident() < SIZE // 8  # other threads may free a little
