"""Settings of Python and of the C library for a process that runs a command; a script or notebook keeps its own.

`collect_rarely`: imports and compiling make many objects that stay. Looking through them over and over takes a tenth of
a warm start and a twelfth of a cold one, and what a step makes is freed without that.

`keep_freed`: memory of arrays that are freed stays with the process, for the next ones. glibc gives arrays above 32 MB
back to the system as soon as they are freed. Steps make such arrays of the same sizes again and again, and each would
be fresh memory, which the system maps and clears page by page at the first touch: a tenth of a step of 1e6 and 1e7
particles (2026-11). All threads use one arena: those of helpers would be given back. Where somebody has told malloc
what to do, that stands.
"""

import atexit
import ctypes
import gc
import os
import sys

TRIM_THRESHOLD, MMAP_MAX, ARENA_MAX = -1, -4, -8  # parameters of mallopt (malloc.h)
# What sets these too.
TOLD = (
    "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_MMAP_MAX_", "MALLOC_TOP_PAD_", "MALLOC_ARENA_MAX",
    "MALLOC_ARENA_TEST",
)  # fmt: skip


def collect_rarely() -> None:
    """Look for garbage seldom, and not at all when the process ends."""
    gc.set_threshold(100_000, 20, 100)
    atexit.register(gc.freeze)


def keep_freed() -> None:
    """Have malloc keep what is freed, all of this process, where it is glibc's; elsewhere nothing changes."""
    if any(name in os.environ for name in TOLD) or "glibc.malloc" in os.environ.get("GLIBC_TUNABLES", ""):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(TRIM_THRESHOLD, -1)  # never
        mallopt(ARENA_MAX, 1)
        mallopt(MMAP_MAX, 0)  # arrays come from where what is freed stays
