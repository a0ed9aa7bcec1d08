"""Selection of snapshots from runs and files, by time, without reading particles."""

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
class Named:
    """The file of a snapshot, and the name of its run for titles."""

    path: Path
    name: str


def directory_of(source: Path) -> Path | None:
    """Return the directory of the run of a directory or snapshot; None for a file elsewhere."""
    if source.is_dir():
        return source.parent if source.resolve().name == "snapshots" else source
    return source.resolve().parent.parent if source.resolve().parent.name == "snapshots" else None


def name_of(source: Path) -> str:
    """Return the name of the run's directory, or the name of a file elsewhere."""
    directory = directory_of(source)
    return directory.resolve().name if directory is not None else source.stem


def chosen(sources: Iterable[Path], at: Sequence[str] = ()) -> list[Named]:
    """Return the last snapshot of each source, or those nearest to the times `at`. Raises PlotError, SnapshotError."""
    found = []
    for source in sources:
        files = files_of(source)
        picked = [nearest(files, text) for text in at] if at else files[-1:]
        found += [Named(path, name_of(source)) for path in picked]
    return found


def nearest(files: Sequence[Path], text: str) -> Path:
    """Return the snapshot nearest to a time like "700 yr", in code units a number. Raises PlotError."""
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


def read(source: Source, names: Iterable[str]) -> Snapshot:
    """Return a snapshot in the frame of its centre, with the columns that fields need; the last one of a directory."""
    if isinstance(source, Snapshot):
        return source.about_centre()
    return read_snapshot(files_of(source)[-1], columns(names)).about_centre()
