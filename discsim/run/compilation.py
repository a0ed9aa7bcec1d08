"""Messages about kernels that numba compiles during a run."""

from __future__ import annotations

import traceback

from numba.core import caching, event

from discsim.run.progress import Progress


class Compilation(event.Listener):
    """Listener that counts and reports compiled kernels; kernels loaded from the cache on disk do not count."""

    def __init__(self, progress: Progress) -> None:
        self.progress, self.count = progress, 0

    def on_start(self, event: event.Event) -> None:
        self.count += 1
        self.progress.compiling(self.count, event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: event.Event) -> None:
        pass


def raised_in_numba_cache(fault: BaseException) -> bool:
    """Return whether an exception was raised while numba wrote its cache."""
    frames = traceback.walk_tb(fault.__traceback__)
    return any(frame.f_globals.get("__name__") == caching.__name__ for frame, _ in frames)
