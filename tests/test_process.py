"""Settings of a process that runs a command."""

import os
import platform
import subprocess
import sys

import pytest

SIZE = 1 << 26  # bytes, beyond the 32 MB above which glibc would give it back
GIVEN_BACK = f"""
import os
from pathlib import Path
import numpy as np
from discsim.cli.process import keep_freed_memory
def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
keep_freed_memory()
array = np.ones({SIZE // 8})
held = resident()
del array
print(held - resident() > {SIZE // 2})
"""
pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other libraries have no such setting")


@pytest.mark.parametrize(
    "told, given_back",
    [
        ({}, False),
        ({"MALLOC_TRIM_THRESHOLD_": "131072"}, True),
        ({"GLIBC_TUNABLES": "glibc.malloc.trim_threshold=131072"}, True),
        ({"GLIBC_TUNABLES": "glibc.rtld.optional_static_tls=512"}, False),
    ],
)
def test_what_a_user_has_told_malloc_stands(told, given_back):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
    done = subprocess.run(
        [sys.executable, "-c", GIVEN_BACK], env=environment | told, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(given_back)
