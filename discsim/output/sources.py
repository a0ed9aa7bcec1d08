"""Snapshots of directories of runs or of single files: selection by time, reading, and the region of a whole run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output import hdf5
from discsim.output.fields.base import PlotError
from discsim.output.fields.names import needed_columns
from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot, snapshot_files
from discsim.output.snapshot_entries import scene_text_of, tables_of, time_of, units_of
from discsim.scene.orbits import mentions_orbits, time_in_code_units
from discsim.scene.units import UnitError, Units, clipped

if TYPE_CHECKING:
    from discsim.output.fields.display import DisplayOptions

Source = Snapshot | str | Path


@dataclass(frozen=True)
class NamedSnapshot:
    """The file of a snapshot, and the name of its run for titles."""

    path: Path
    name: str


def run_directory(source: Path) -> Path | None:
    """Return the directory of the run that `source` belongs to; None for a file outside a run.

    `source` may be the directory of a run, its folder "snapshots", or a file in this folder.
    """
    if source.is_dir():
        return source.parent if source.resolve().name == "snapshots" else source
    return source.resolve().parent.parent if source.resolve().parent.name == "snapshots" else None


def run_name(source: Path) -> str:
    """Return the name of the run's directory; for a file outside a run, the file's name without suffix."""
    directory = run_directory(source)
    return directory.resolve().name if directory is not None else source.stem


def select_snapshots(sources: Iterable[Path], at: Sequence[str] = ()) -> list[NamedSnapshot]:
    """Return the last snapshot of each source; with times `at`, for each time the snapshot nearest to it.

    Raises PlotError for an invalid time, SnapshotError.
    """
    found = []
    for source in sources:
        files = snapshot_files(source)
        picked = [nearest_snapshot(files, text) for text in at] if at else files[-1:]
        found += [NamedSnapshot(path, run_name(source)) for path in picked]
    return found


def nearest_snapshot(files: Sequence[Path], text: str) -> Path:
    """Return the snapshot whose time is nearest to `text`: "700 yr", "40 orbits at 5.2 au", or "3.5" in code units.

    Raises PlotError if `text` is no time, SnapshotError.
    """
    times, units = times_and_units(files)
    scene_text = read_scene_text(files[0]) if mentions_orbits(text) else ""
    return files[int(np.abs(np.array(times) - time_in_code(text, units, scene_text, "--at")).argmin())]


def read_scene_text(path: Path) -> str:
    """Return the scene in a snapshot as TOML, with its entries checked. Raises SnapshotError."""
    with hdf5.open_file_of_kind(path, SnapshotError, "snapshot") as file:
        text = scene_text_of(file)
        tables_of(text, units_of(file))
    return text


def time_in_code(given: Any, units: Units, scene_text: str, name: str) -> float:
    """Return a time, a text like "700 yr" or "40 orbits", a Quantity or a number, in code units. Raises PlotError.

    `scene_text` is the scene of the run as TOML, `name` the argument in messages.
    """
    try:
        value = time_in_code_units(given, units, scene_text)
    except UnitError as error:
        raise PlotError(f"{name}: {error}") from None
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        shown = clipped(" ".join(str(given).split()))
        raise PlotError(f'{name}: {shown} is not a time; expected one like "500 yr", or a number in code units')
    return value


def times_and_units(files: Sequence[Path]) -> tuple[list[float], Units]:
    """Return the times of the snapshots `files` in code units, and the units of the first. Raises SnapshotError."""
    times, units = [], Units("code")
    for path in files:
        with hdf5.open_file_of_kind(path, SnapshotError, "snapshot") as file:
            times.append(time_of(file))
            units = units_of(file) if len(times) == 1 else units
    return times, units


def read_for_fields(source: Source, names: Iterable[str]) -> Snapshot:
    """Return a snapshot relative to the disc's centre, with the columns that the fields `names` need.

    `source` is a file, a directory of a run (its last snapshot), or a Snapshot, whose columns stay as they are.
    """
    if isinstance(source, Snapshot):
        return source.about_centre()
    return read_snapshot(snapshot_files(source)[-1], needed_columns(names)).about_centre()


def region_of_runs(display: DisplayOptions, runs: Iterable[Sequence[Path]], kind: str) -> DisplayOptions:
    """Return display options with one region for runs: it contains those of the first and last snapshot of each.

    `runs` are the files of each run in the order of time. Raises PlotError, SnapshotError.
    """
    return display.common_to([read_for_fields(files[k], ()) for files in runs for k in (0, -1)], kind)


def region_of_profiles(display: DisplayOptions, sources: Sequence[Source], snaps: Sequence[Snapshot]) -> DisplayOptions:
    """Return display options with the region of profiles of `snaps`: that of the runs from which `sources` are.

    Snapshots outside a run, and those of a run with unreadable snapshots, have their own region. Raises PlotError.
    """
    try:
        files = [snapshot_files(each)[-1] for each in sources if not isinstance(each, Snapshot)]
        folders = [run_directory(each) for each in files]
        if len(folders) == len(snaps) and all(folders):
            return region_of_runs(display, [snapshot_files(each) for each in folders if each], "profile")
    except SnapshotError:
        pass
    return display.common_to(snaps, "profile")
