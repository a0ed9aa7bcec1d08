"""Worker processes of parallel runs, and messages about runs that failed."""

from __future__ import annotations

import multiprocessing
import os
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TypeVar

from discsim.run.progress import LINE_EVERY
from discsim.study.points import StudyError

Result = TypeVar("Result")


def end_with_parent() -> None:
    """Start a thread that ends this worker process when its parent process has ended.

    Otherwise the worker would never end.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)  # safe at any point, as runs can be resumed

    threading.Thread(target=watch, daemon=True).start()


def results(submitted: Iterable[Future[Result]], say: Callable[[str], None] | None = None) -> Iterator[Result]:
    """Yield the results of the submitted jobs in order. Raises StudyError if a worker process was killed.

    During the wait, a line about the number of finished jobs is printed by `say` every LINE_EVERY seconds.
    """
    jobs = list(submitted)
    try:
        for job in jobs:
            while say is not None and not wait([job], LINE_EVERY).done:
                say(f"    {sum(each.done() for each in jobs)} of {len(jobs)} runs are complete, others continue")
            yield job.result()
    except BrokenProcessPool:
        why = "a process was killed during a run, perhaps because memory was full"
        raise StudyError(f"{why}; repeat the command with a smaller --parallel to continue") from None


def failure_text(fault: Exception) -> str:
    """Return an unexpected exception of a run as one line of text, with the file and line that raised it."""
    last = traceback.extract_tb(fault.__traceback__)[-1]
    text = " ".join(str(fault).split())
    return f"ended by {type(fault).__name__}{f': {text}' if text else ''} ({Path(last.filename).name}:{last.lineno})"
