"""Two checkpoints of a run, the last one and the one before it; a run resumes from the newest intact one."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from discsim.output import hdf5
from discsim.output.checkpoint import CheckpointError, Values, checked_checkpoint
from discsim.output.files import renamed
from discsim.output.snapshot import SnapshotError
from discsim.output.snapshot_entries import time_of
from discsim.run.directory import CHECKPOINTS


class Checkpoints:
    """Checkpoints of a directory.

    chosen: the checkpoint to resume from. fault: why that is not the last one.
    """

    def __init__(self, directory: Path) -> None:
        self.last, self.before = (directory / name for name in CHECKPOINTS)
        self.chosen, self.fault = self.last, ""

    def newest(self) -> tuple[dict[str, Any], Values]:
        """Return arrays by group, except those of particles, and values of the newest readable checkpoint.

        Raises CheckpointError.
        """
        try:
            return checked_checkpoint(self.last)
        except CheckpointError as fault:
            self.chosen, self.fault = self.before, str(fault)
        try:
            return checked_checkpoint(self.before)
        except CheckpointError as fault:
            both = f"{self.fault}; {fault}" if self.before.exists() else self.fault
            raise CheckpointError(both) from None

    def refuse_to_lose(self, folder: Path, number: int, put_out: float) -> None:
        """Raise CheckpointError if a snapshot would be removed and not made again.

        number: snapshots that the checkpoint counts. put_out: time of the last of them. Snapshots from `number` on
        are removed at a resume, so each has to be later than `put_out`.
        """
        for path in later_snapshots(folder, number):
            with suppress(SnapshotError), hdf5.reading(path, SnapshotError, "snapshot") as file:
                if time_of(file) <= put_out:
                    wrong = f"damaged checkpoint: it counts only {number} snapshots, but {path} is older than it"
                    raise CheckpointError(f"{self.chosen}: {wrong}; resume from another checkpoint")

    def settle(self) -> None:
        """Rename the chosen checkpoint to the last one, so that the next one does not replace it."""
        if self.chosen != self.last:
            renamed(self.chosen, self.last)
            self.chosen = self.last


def later_snapshots(folder: Path, number: int) -> list[Path]:
    """Return the snapshots in a folder from `number` on."""
    return [path for path in folder.glob("*.h5") if path.stem.isdecimal() and int(path.stem) >= number]
