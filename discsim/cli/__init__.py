"""The command line: what to run is checked here, before anything slow is imported or anything is written."""

from __future__ import annotations

from discsim import collect_rarely
from discsim.cli.base import app, refuse
from discsim.printable import UserError

# isort: off
from discsim.cli import runs, scenes, costs, looking  # in the order in which the help has their commands

__all__ = ["app", "costs", "looking", "main", "runs", "scenes"]


def main() -> None:
    """Entry point of the command `discsim`."""
    collect_rarely()
    try:
        app(prog_name="discsim")
    except UserError as error:
        refuse(str(error))
