"""The command line. Arguments are checked before any slow import and before any file is written."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any

from discsim.cli import process
from discsim.cli.base import NOT_WRITTEN, app, fail
from discsim.userfiles import system_message

# isort: off
from discsim.cli import runs, scenes, costs, results, sky, exports, analyse  # the help lists the commands in this order

__all__ = ["analyse", "app", "costs", "exports", "main", "results", "runs", "scenes", "sky"]


def main() -> None:
    """Run the command `discsim` and end the process with its exit status."""
    process.collect_garbage_rarely()
    process.keep_freed_memory()
    status: Any = 0
    try:
        app(prog_name="discsim")
    except SystemExit as end:
        status = end.code
    flush_error = _flush_output()
    if flush_error is not None and flush_error.errno != errno.EPIPE and not status:
        fail(system_message(flush_error, "written", "standard output"), NOT_WRITTEN)
    raise SystemExit(status)


def _flush_output() -> OSError | None:
    """Flush standard output. Return the OSError if this fails, such as EPIPE for a closed pipe, else None.

    After a failure standard output is redirected to the null device, so that Python does not flush it again.
    """
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as fault:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        return fault
    return None
