"""Handlers of signals that stop a run or a step at its next safe point."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from types import FrameType
from typing import Any, Self

BATCH_SIGNALS = (signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU)


def run_signals() -> list[int]:
    """Return the signals that stop a run: Ctrl-C, SIGTERM, and the signals of terminals and batch systems.

    SIGHUP is sent when the terminal closes; batch systems announce the end of a job by it or by other BATCH_SIGNALS.
    Signals that the parent process ignores, as under nohup, are left out and stay ignored.
    """
    heard = [number for number in BATCH_SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    return [signal.SIGINT, signal.SIGTERM, *heard]


class Interrupts:
    """Handlers of `signals`, active within the context.

    number: number of the first signal received, 0 if none; the caller has to stop at its next safe point. A second
    signal raises KeyboardInterrupt at once.
    """

    def __init__(self, signals: Sequence[int]) -> None:
        self.signals, self.number = signals, 0
        self._former_handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in self.signals:
            self._former_handlers[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *fault: object) -> None:
        for number, handler in self._former_handlers.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            raise KeyboardInterrupt("stopped by a second signal, perhaps within a step")
        self.number = number
