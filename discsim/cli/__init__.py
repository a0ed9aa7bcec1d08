"""The command line: what to run is checked here, before anything slow is imported or anything is written."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any

from discsim.cli import process
from discsim.cli.base import NOT_WRITTEN, WRONG_INPUT, app, refuse
from discsim.printable import UserError
from discsim.userfiles import system_message

# isort: off
from discsim.cli import runs, scenes, costs, looking  # in the order in which the help has their commands

__all__ = ["app", "costs", "looking", "main", "runs", "scenes"]


def main() -> None:
    """Entry point of the command `discsim`."""
    process.collect_rarely()
    process.keep_freed()
    status: Any = 0
    try:
        app(prog_name="discsim")
    except SystemExit as end:
        status = end.code
    except UserError as error:
        status = _refused(str(error))
    except OSError as fault:
        status = _refused(system_message(fault, "read or written", "a file"), NOT_WRITTEN)
    lost = _unwritten()
    if lost is not None and lost.errno != errno.EPIPE and not status:
        status = _refused(system_message(lost, "written", "standard output"), NOT_WRITTEN)
    raise SystemExit(status)


def _refused(message: str, status: int = WRONG_INPUT) -> Any:
    """Print a message; returns the exit status."""
    try:
        refuse(message, status)
    except SystemExit as end:
        return end.code


def _unwritten() -> OSError | None:
    """Write what standard output still holds; the fault where that cannot be done, so that Python does not try again.

    Of a pipe whose reader has gone it is EPIPE.
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
