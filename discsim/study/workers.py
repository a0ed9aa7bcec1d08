"""Processes that make runs side by side."""

from __future__ import annotations

import multiprocessing
import os
import threading


def end_with_parent() -> None:
    """Let this process end once its parent is gone, however that ended: it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)  # runs can be resumed, wherever they are

    threading.Thread(target=watch, daemon=True).start()
