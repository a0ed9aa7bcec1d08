"""Processes that make runs side by side, and how a run that fails is told."""

from __future__ import annotations

import multiprocessing
import os
import threading
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TypeVar

from discsim.study.points import StudyError

Result = TypeVar("Result")


def end_with_parent() -> None:
    """Let this process end once its parent is gone, however that ended: it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)  # runs can be resumed, wherever they are

    threading.Thread(target=watch, daemon=True).start()


def results(submitted: Iterable[Future[Result]]) -> Iterator[Result]:
    """Results of jobs in their order. Raises StudyError where a process is gone without one."""
    try:
        yield from (future.result() for future in list(submitted))
    except BrokenProcessPool:
        why = "a process was killed in the midst of a run, perhaps for want of memory"
        raise StudyError(f"{why}; expected fewer --parallel: the same command goes on with the runs there") from None


def in_words(fault: Exception) -> str:
    """An exception that a run was not to raise, on one line with the place that it comes from."""
    last = traceback.extract_tb(fault.__traceback__)[-1]
    text = " ".join(str(fault).split())
    return f"ended by {type(fault).__name__}{f': {text}' if text else ''} ({Path(last.filename).name}:{last.lineno})"
