"""How somebody ends a run from outside."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any


class Interrupts:
    """Ctrl-C, SIGTERM and the end of the terminal: the first is noted, for the end of a step; the second raises
    KeyboardInterrupt. Where nohup has a process outlive its terminal, it does.
    """

    def __init__(self) -> None:
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._note)

    def __exit__(self, *fault: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt
        self.number = number
