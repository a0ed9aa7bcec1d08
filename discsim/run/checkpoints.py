"""The last two checkpoints of a run; a run resumes from the newest one that is intact."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from discsim.output import hdf5
from discsim.output.checkpoint import CheckpointError, Values, check_checkpoint
from discsim.output.files import rename_file
from discsim.output.snapshot import SnapshotError
from discsim.output.snapshot_entries import time_of
from discsim.run.directory import CHECKPOINTS


class Checkpoints:
    """Checkpoint files of a run directory.

    last, before: paths of the last checkpoint and of the previous one. chosen: path of the checkpoint to resume from.
    fault: reason why `chosen` is not `last`, otherwise "".
    """

    def __init__(self, directory: Path) -> None:
        self.last, self.before = (directory / name for name in CHECKPOINTS)
        self.chosen, self.fault = self.last, ""

    def newest(self) -> tuple[dict[str, Any], Values]:
        """Choose the newest readable checkpoint; return its arrays by group, without particles, and its single values.

        Raises CheckpointError if neither checkpoint can be read.
        """
        try:
            return check_checkpoint(self.last)
        except CheckpointError as fault:
            self.chosen, self.fault = self.before, str(fault)
        try:
            return check_checkpoint(self.before)
        except CheckpointError as fault:
            both = f"{self.fault}; {fault}" if self.before.exists() else self.fault
            raise CheckpointError(both) from None

    def refuse_lost_snapshots(self, folder: Path, number: int, put_out: float) -> None:
        """Raise CheckpointError if resuming would remove a snapshot that the run does not write again.

        folder: snapshots. number: number of snapshots before the checkpoint. put_out: time of the last of these.
        Resuming removes the snapshots numbered `number` and above, so each must be later than `put_out`.
        """
        for path in later_snapshots(folder, number):
            with suppress(SnapshotError), hdf5.open_file_of_kind(path, SnapshotError, "snapshot") as file:
                if time_of(file) <= put_out:
                    wrong = f"damaged checkpoint: it counts only {number} snapshots, but {path} is older than it"
                    raise CheckpointError(f"{self.chosen}: {wrong}; resume from another checkpoint")

    def settle(self) -> None:
        """Rename the chosen checkpoint to `last`, so that the next checkpoint does not overwrite it."""
        if self.chosen != self.last:
            rename_file(self.chosen, self.last)
            self.chosen = self.last


def later_snapshots(folder: Path, number: int) -> list[Path]:
    """Return the paths of the snapshots in `folder` that are numbered `number` or above."""
    return [path for path in folder.glob("*.h5") if path.stem.isdecimal() and int(path.stem) >= number]
