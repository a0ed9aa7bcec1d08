"""Selection of snapshots by time, from directories of runs or single files, without reading particles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from discsim.output import hdf5
from discsim.output.fields.base import PlotError
from discsim.output.fields.names import columns
from discsim.output.snapshot import Snapshot, SnapshotError, files_of, read_snapshot
from discsim.output.snapshot_entries import time_of, units_of
from discsim.scene.units import UnitError, Units

Source = Snapshot | str | Path


@dataclass(frozen=True)
class NamedSnapshot:
    """The file of a snapshot, and the name of its run for titles."""

    path: Path
    name: str


def run_directory(source: Path) -> Path | None:
    """Return the run's directory that `source` is or lies in; None for a file that is not in a folder "snapshots"."""
    if source.is_dir():
        return source.parent if source.resolve().name == "snapshots" else source
    return source.resolve().parent.parent if source.resolve().parent.name == "snapshots" else None


def run_name(source: Path) -> str:
    """Return the name of the run's directory; for a file outside a run, the file's name without suffix."""
    directory = run_directory(source)
    return directory.resolve().name if directory is not None else source.stem


def select_snapshots(sources: Iterable[Path], at: Sequence[str] = ()) -> list[NamedSnapshot]:
    """Return the last snapshot of each source, or its snapshot nearest to each time in `at`.

    Raises PlotError, SnapshotError.
    """
    found = []
    for source in sources:
        files = files_of(source)
        picked = [nearest_snapshot(files, text) for text in at] if at else files[-1:]
        found += [NamedSnapshot(path, run_name(source)) for path in picked]
    return found


def nearest_snapshot(files: Sequence[Path], text: str) -> Path:
    """Return the snapshot nearest to a time: a text like "700 yr", or a number in code units. Raises PlotError."""
    times, units = times_of(files)
    try:
        wanted = units.of_text(text, "time")
    except UnitError as error:
        raise PlotError(f"--at: {error}") from None
    return files[int(np.abs(np.array(times) - wanted).argmin())]


def times_of(files: Sequence[Path]) -> tuple[list[float], Units]:
    """Return the times of the files in code units, and the units of the first file. Raises SnapshotError."""
    times, units = [], Units("code")
    for path in files:
        with hdf5.reading(path, SnapshotError, "snapshot") as file:
            times.append(time_of(file))
            units = units_of(file) if len(times) == 1 else units
    return times, units


def read_for_fields(source: Source, names: Iterable[str]) -> Snapshot:
    """Return a snapshot in the frame of the disc's centre, with the columns that the fields `names` need.

    From a directory the last snapshot is read.
    """
    if isinstance(source, Snapshot):
        return source.about_centre()
    return read_snapshot(files_of(source)[-1], columns(names)).about_centre()
