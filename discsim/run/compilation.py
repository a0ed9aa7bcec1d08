"""What a run does while kernels compile: it says so, and a second process takes its part."""

from __future__ import annotations

import subprocess
import time
import traceback
from collections.abc import Callable

from numba import config
from numba.core import caching, event

from discsim.run import ahead
from discsim.run.interrupts import Interrupts
from discsim.scene import Scene

CORES: int = config.NUMBA_DEFAULT_NUM_THREADS  # type: ignore[attr-defined]


class Compilation(event.Listener):
    """Tells, once, that kernels compile which numba's cache does not hold; a second process takes its part."""

    def __init__(self, scene: Scene, say: Callable[[str], None]) -> None:
        self.scene, self.say, self.told = scene, say, False
        self.second: subprocess.Popen[bytes] | None = None

    def on_start(self, event: event.Event) -> None:
        if not self.told:
            self.told = True
            self.say("compiling those that numba's cache does not hold: once, up to a minute for a scene with drag")
            self.second = ahead.begin(self.scene) if CORES > 1 else None

    def on_end(self, event: event.Event) -> None:
        pass

    def wait(self, interrupts: Interrupts) -> None:
        """Until what the second process compiles is there to be loaded."""
        while self.second is not None and self.second.poll() is None and not interrupts.number:
            time.sleep(0.05)

    def close(self) -> None:
        if self.second is not None:
            self.second.kill()
            self.second.wait()


def of_numba_cache(fault: BaseException) -> bool:
    """True if an exception was raised while numba wrote its cache."""
    frames = traceback.walk_tb(fault.__traceback__)
    return any(frame.f_globals.get("__name__") == caching.__name__ for frame, _ in frames)
