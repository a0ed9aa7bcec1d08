"""The two checkpoints of a run, the last and the one before it: it goes on from the newest that is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from discsim.output.checkpoint import CheckpointError, Scalar, checked_checkpoint
from discsim.output.files import renamed
from discsim.run.directory import CHECKPOINTS


class Checkpoints:
    """Those of a directory; `chosen` is the one to go on from, `fault` why it is not the last."""

    def __init__(self, directory: Path) -> None:
        self.last, self.before = (directory / name for name in CHECKPOINTS)
        self.chosen, self.fault = self.last, ""

    def newest(self) -> tuple[dict[str, Any], dict[str, Scalar]]:
        """Arrays by group, but for particles, and values of the newest that can be read. Raises CheckpointError."""
        try:
            return checked_checkpoint(self.last)
        except CheckpointError as fault:
            self.chosen, self.fault = self.before, str(fault)
        try:
            return checked_checkpoint(self.before)
        except CheckpointError as fault:
            both = f"{self.fault}; {fault}" if self.before.exists() else self.fault
            raise CheckpointError(both) from None

    def settle(self) -> None:
        """Have the chosen one as the last: the next one would take the place of the one before it."""
        if self.chosen != self.last:
            renamed(self.chosen, self.last)
            self.chosen = self.last
