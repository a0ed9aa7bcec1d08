"""The last two checkpoints of a run; the run resumes from the newer one, if it is intact."""

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

    last, before: paths of the last checkpoint and of the one before it. chosen: path of the checkpoint to resume from,
    which `newest` sets. fault: reason why `chosen` is not `last`, otherwise "".
    """

    def __init__(self, directory: Path) -> None:
        self.last, self.before = (directory / name for name in CHECKPOINTS)
        self.chosen, self.fault = self.last, ""

    def newest(self) -> tuple[dict[str, Any], Values]:
        """Set `chosen` to the newest readable checkpoint, and return its arrays by group and its single values.

        The groups of particles are left out. Raises CheckpointError if neither checkpoint can be read.
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

    def refuse_lost_snapshots(self, folder: Path, number: int, last_output: float) -> None:
        """Raise CheckpointError if resuming would remove a snapshot that the run does not write again.

        folder: directory of the snapshots. number, last_output: number of snapshots before the checkpoint, and time
        of the last snapshot before it. Resuming removes the snapshots from `number` on, so each must be later than
        `last_output`.
        """
        for path in later_snapshots(folder, number):
            with suppress(SnapshotError), hdf5.open_file_of_kind(path, SnapshotError, "snapshot") as file:
                if time_of(file) <= last_output:
                    wrong = (
                        f"damaged checkpoint: its time is later than that of {path}, but its number of "
                        f"snapshots is {number}"
                    )
                    raise CheckpointError(f"{self.chosen}: {wrong}; resume from another checkpoint")

    def keep_chosen(self) -> None:
        """Rename the chosen checkpoint to `last`, so that the next checkpoint does not overwrite it."""
        if self.chosen != self.last:
            rename_file(self.chosen, self.last)
            self.chosen = self.last


def later_snapshots(folder: Path, number: int) -> list[Path]:
    """Return the paths of the snapshots in `folder` that are numbered `number` or above."""
    return [path for path in folder.glob("*.h5") if path.stem.isdecimal() and int(path.stem) >= number]
