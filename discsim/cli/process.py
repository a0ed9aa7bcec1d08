"""Settings of Python and of the C library for the process of a command. Importing discsim does not change them.

`collect_garbage_rarely`: imports and compilation create many long-lived objects. Without this setting, the garbage
collector scans these objects repeatedly, for 10% of a start with cached kernels and 8% of a start with compilation. The
objects that a step creates are freed without the garbage collector.

`keep_freed_memory`: freed memory of arrays stays with the process, for the next arrays. By default glibc returns arrays
above 32 MB to the system as soon as they are freed. Each step allocates arrays of the same sizes again, and the
system maps and clears fresh memory page by page. This takes 10% of a step of 1e6 and 1e7 particles (2026-11). All
threads use one arena, because the arenas of helper threads would still return memory. A user's own malloc settings
take precedence.
"""

import atexit
import ctypes
import gc
import os
import sys

TRIM_THRESHOLD, MMAP_MAX, ARENA_MAX = -1, -4, -8  # parameters of mallopt (malloc.h)
# Environment variables with the user's own settings of malloc.
USER_SETTINGS = (
    "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_MMAP_MAX_", "MALLOC_TOP_PAD_", "MALLOC_ARENA_MAX",
    "MALLOC_ARENA_TEST",
)  # fmt: skip


def collect_garbage_rarely() -> None:
    """Make Python's garbage collector run rarely, and not at the end of the process."""
    gc.set_threshold(100_000, 20, 100)
    atexit.register(gc.freeze)


def keep_freed_memory() -> None:
    """Make glibc's malloc keep freed memory. Do nothing without glibc, or if the user has set malloc's parameters."""
    if any(name in os.environ for name in USER_SETTINGS) or "glibc.malloc" in os.environ.get("GLIBC_TUNABLES", ""):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(TRIM_THRESHOLD, -1)  # never
        mallopt(ARENA_MAX, 1)
        mallopt(MMAP_MAX, 0)  # large arrays come from the heap, whose freed memory stays with the process
