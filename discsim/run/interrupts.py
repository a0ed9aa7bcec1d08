"""Handlers of the signals that end a run."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

BATCH_SIGNALS = (signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU)


class Interrupts:
    """Signal handlers of a run, active within the context.

    number: first signal received, 0 if none; the run stops after its present step. A second signal raises
    KeyboardInterrupt. Signals are Ctrl-C, SIGTERM, the end of the terminal, and those by which batch systems announce
    the end of a job. Those ignored in the parent process, as under nohup, stay ignored.
    """

    def __init__(self) -> None:
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, *BATCH_SIGNALS):
            if number not in BATCH_SIGNALS or signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._handle)

    def __exit__(self, *fault: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number
