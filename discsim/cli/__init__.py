"""The command line. Arguments are checked before any slow import and before any file is written."""

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
from discsim.cli import runs, scenes, costs, looking  # the help lists the commands in this order

__all__ = ["app", "costs", "looking", "main", "runs", "scenes"]


def main() -> None:
    """Run the command `discsim` and end the process with its exit status."""
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
    """Print a message; return the exit status."""
    try:
        refuse(message, status)
    except SystemExit as end:
        return end.code


def _unwritten() -> OSError | None:
    """Flush standard output; return the OSError if that fails (EPIPE for a closed pipe).

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
