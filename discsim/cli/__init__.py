"""The command line. Arguments are checked before any slow import and before any file is written."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any

from discsim.cli import process
from discsim.cli.base import NOT_WRITTEN, WRONG_INPUT, app, fail
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
        status = _print_error(str(error))
    except OSError as fault:
        status = _print_error(system_message(fault, "read or written", "a file"), NOT_WRITTEN)
    flush_error = _flush_output()
    if flush_error is not None and flush_error.errno != errno.EPIPE and not status:
        status = _print_error(system_message(flush_error, "written", "standard output"), NOT_WRITTEN)
    raise SystemExit(status)


def _print_error(message: str, status: int = WRONG_INPUT) -> Any:
    """Print an error message, and return the exit status of the process."""
    try:
        fail(message, status)
    except SystemExit as end:
        return end.code


def _flush_output() -> OSError | None:
    """Flush standard output. Return the OSError of a failure, such as EPIPE for a closed pipe, else None.

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
