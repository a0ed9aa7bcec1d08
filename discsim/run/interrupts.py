"""Signals that end a run."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

ANNOUNCED = (signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU)


class Interrupts:
    """Signal handlers of a run: the first signal is recorded for the end of a step, the second raises
    KeyboardInterrupt.

    Signals are Ctrl-C, SIGTERM, the end of the terminal, and those with which batch systems announce the end of a
    job. Signals that a parent process makes its children ignore, as nohup does, stay ignored.
    """

    def __init__(self) -> None:
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, *ANNOUNCED):
            if number not in ANNOUNCED or signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._note)

    def __exit__(self, *fault: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number
