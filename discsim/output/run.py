"""A run as one object: its scene, tables, snapshots and profiles in time, read from its directory at each use.

The run may still be going on: lists of snapshots and tables are read again whenever they are used.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from discsim.numerics.dataframe import dataframe_of_table
from discsim.output.companions import COLUMNS, has_companions
from discsim.output.fields.base import Field, PlotError
from discsim.output.fields.display import DisplayOptions, display_options
from discsim.output.fields.names import field_label, field_named, matching_fields, single_field
from discsim.output.fields.values import smooth_profile
from discsim.output.history import TEXT_COLUMNS, history_columns, read_checked_table
from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot, snapshot_files
from discsim.output.sources import read_for_fields, region_of_runs, time_in_code, times_and_units
from discsim.parts import Lazy
from discsim.printable import printable
from discsim.scene import Scene, load_scene
from discsim.scene.populations import populations_of
from discsim.scene.summary import Rows, Summarised

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from discsim.scene.units import Units

Array = np.ndarray
plots = Lazy("discsim.plot")
KINDS = {"map": "field_map", "polar": "polar_map", "profile": "profile", "time": "time_map"}  # functions of plots
INTEGER_COLUMNS = ("step", "number")
MAX_LINES = 6  # largest number of times in the figure of a profile


@dataclass(frozen=True)
class TimeProfile:
    """A field in rings and in time, from `Run.profile`.

    Attributes
    ----------
    name : str
        Name of the field.
    time : Quantity, shape (times,)
        Times of the snapshots.
    radius : Quantity, shape (rings,)
        Middles of the rings, in 1D of bins in x.
    values : Quantity, shape (times, rings)
        Surface density, or mass-weighted mean, in each ring; NaN for too little mass.
    label : str
        Label of the values with their unit, as in figures.
    log_radius : bool
        Whether the rings are equally spaced in the logarithm of the radius.
    """

    name: str
    time: Any
    radius: Any
    values: Any
    label: str
    log_radius: bool = False

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the profile at up to six times, spread evenly over the snapshots.

        Parameters
        ----------
        ax : Axes, optional
            matplotlib axes to draw on; by default those of a new figure.
        **style
            Arguments of `Axes.plot`.

        Returns
        -------
        Axes
            The axes drawn on.
        """
        from matplotlib import colormaps

        from discsim.output.drawing import BELOW

        is_new, ax = ax is None, plots.axes_or_new(ax)
        if is_new:
            figure: Any = ax.figure
            figure.set_layout_engine("constrained")  # makes room for the legend below
        last, log = len(self.time) - 1, field_named(self.name).scale == "log"
        for number in np.unique(np.linspace(0, last, MAX_LINES).round().astype(int)):
            values = self.values[number].value
            shown = {
                "color": colormaps["viridis"](0.9 * number / max(last, 1)),
                "label": f"t = {self.time[number]:.4g}",
            }
            ax.plot(self.radius.value, np.where(values > 0.0, values, np.nan) if log else values, **shown | style)
        if log:
            ax.set_yscale("log")
            peaks = [np.nanmax(line.get_ydata(), initial=0.0) for line in ax.lines]
            if field_named(self.name).kind == "density" and max(peaks) > 0.0:  # a lone particle must not set the scale
                ax.set_ylim(bottom=max(ax.get_ylim()[0], max(peaks) * 10**-plots.curves.MAX_DECADES), auto=None)
        if self.log_radius:
            ax.set_xscale("log")
        ax.grid(alpha=0.3)
        unit = f" [{self.radius.unit}]".replace("AU", "au") if str(self.radius.unit) else ""
        ax.set(xlabel=f"r{unit}", ylabel=self.label)
        plots.curves.draw_legend(ax, ax.get_legend_handles_labels()[0], BELOW if is_new else None)
        return ax

    def to_pandas(self) -> Any:
        """Return the values as a table with a row for each radius and a column for each time.

        Returns
        -------
        pandas.DataFrame
            The names of its index and columns have their units, like "radius [au]" and "time [yr]"; `attrs` has the
            `field` and the `unit` of the values.

        Raises
        ------
        ImportError
            Without pandas.
        """
        radius, time = (_axis_of_table(name, getattr(self, name)) for name in ("radius", "time"))
        return dataframe_of_table(
            self.values.value.T, radius, time, {"field": self.name, "unit": str(self.values.unit)}
        )


class Run(Summarised):
    """A run in a directory, from `discsim.open_run`; a sequence of its snapshots in the order of time.

    `len(run)` is the number of snapshots, `run[-1]` the last `Snapshot`, and `run[2:5]` a `Run` of three of them. Files
    are read at each use, so a run that is going on may be read.

    Attributes
    ----------
    directory : Path
        Directory of the run.
    scene : Scene
        Its scene.
    """

    def __init__(self, directory: Path, scene: Scene, files: Sequence[Path] | None = None) -> None:
        self.directory, self.scene = directory, scene
        self._files = files
        self._times: dict[Path, float] = {}

    @property
    def files(self) -> list[Path]:
        """Paths of the snapshots."""
        return snapshot_files(self.directory) if self._files is None else list(self._files)

    @property
    def units(self) -> Units:
        """Code units."""
        return self.scene.units

    @property
    def times(self) -> Any:
        """Times of the snapshots as an astropy Quantity (snapshots,), in yr, or plain numbers in code units."""
        return _axis_quantity(self.units, np.array(self._times_of(self.files)), "time")

    @property
    def populations(self) -> list[str]:
        """Names of the dust populations, as in "dust.NAME.surface_density"."""
        return [each.name for each in populations_of(self[0].tables)]

    @property
    def history(self) -> Any:
        """The rows of history.csv in code units: a pandas DataFrame, or without pandas a structured array."""
        return _table(self.directory / "history.csv", history_columns(self.scene))

    @property
    def companions(self) -> Any:
        """The rows of companions.csv in code units, as `history`; None if the scene has no companions."""
        return _table(self.directory / "companions.csv", COLUMNS) if has_companions(self.scene) else None

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[Snapshot]:
        return (read_snapshot(path) for path in self.files)

    @overload
    def __getitem__(self, index: int) -> Snapshot: ...

    @overload
    def __getitem__(self, index: slice) -> Run: ...

    def __getitem__(self, index: int | slice) -> Snapshot | Run:
        files = self.files
        if isinstance(index, slice):
            return Run(self.directory, self.scene, files[index])
        if not -len(files) <= index < len(files):
            raise IndexError(f"{printable(self.directory)}: no snapshot {index}; the run has {len(files)}")
        return read_snapshot(files[index])

    def at(self, time: Any) -> Snapshot:
        """Return the snapshot nearest to a time.

        Parameters
        ----------
        time : str, Quantity or float
            Time like "500 yr" or "40 orbits at 5.2 au"; a number is in code units.

        Returns
        -------
        Snapshot
            The snapshot.

        Raises
        ------
        PlotError
            If `time` is no time.
        SnapshotError
            If a snapshot cannot be read.
        """
        return read_snapshot(self._nearest(time))

    def profile(self, field: str, window: Any = None, **options: Any) -> TimeProfile:
        """Return a field in rings for every snapshot.

        Parameters
        ----------
        field : str
            Name of the field, like "gas.surface_density", or "dust.0.v_r" of one population of dust.
        window : str, Quantity or array_like, optional
            Range of radii like "80 au" or "10 au,80 au"; by default that of the disc in the first and last snapshot.
        **options
            `wavelength` and `opacity` as in `Snapshot.field`; with `log_radius=True` the rings are equally spaced in
            the logarithm of the radius.

        Returns
        -------
        TimeProfile
            With `time`, `radius` and `values` as Quantities, and `plot`.

        Raises
        ------
        PlotError, FieldError, SnapshotError
            If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
        """
        files, display = self.files, display_options(window, **options).used_for("profile")
        if not files:
            raise PlotError(f"{printable(self.directory)}: no snapshots in this slice of the run")
        first = read_for_fields(files[0], matching_fields(field))
        name = single_field(field, first)
        edges, values = profiles_in_time(files, [name], display)
        middles = _axis_quantity(self.units, 0.5 * (edges[1:] + edges[:-1]), "length")
        found = field_named(name).quantity(first.units, values[name])
        times = _axis_quantity(self.units, np.array(self._times_of(files)), "time")
        return TimeProfile(name, times, middles, found, field_label(name, first), display.log_radius)

    def plot(self, field: str, kind: str = "map", at: Any = None, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw a field of the run.

        Parameters
        ----------
        field : str
            Name of the field, as in `discsim plot --fields`, or like "dust.0.v_r".
        kind : str
            "map", "polar" (in azimuth and radius), "profile", or "time" (in radius and time, all snapshots).
        at : str, Quantity or float, optional
            Time of the snapshot; by default the last one is drawn.
        ax : Axes, optional
            matplotlib axes to draw on; by default those of a new figure.
        **options
            As in the function of `discsim.plot` for this kind.

        Returns
        -------
        Axes
            The axes drawn on.

        Raises
        ------
        PlotError, FieldError, SnapshotError
            If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
        """
        if kind not in KINDS:
            raise PlotError(f'kind: "{printable(kind)}" is unknown; expected one of {", ".join(KINDS)}')
        if kind == "time":
            if at is not None:
                raise PlotError('at: kind "time" uses all snapshots; leave it out')
            source: Any = self.files
        else:
            source = self._nearest(at) if at is not None else self.files[-1]
        return getattr(plots, KINDS[kind])(source, field, ax=ax, **options)

    def summary(self) -> tuple[str, Rows]:
        """Return the title of the scene, and rows of names and values for display."""
        files = self.files
        ends = [self.scene.show_time(time) for time in self._times_of([*files[:1], *files[-1:]])]
        here = Path.cwd()
        shown = self.directory.relative_to(here) if self.directory.is_relative_to(here) else self.directory
        rows = [("directory", shown), ("snapshots", f"{len(files)}, t = {' to '.join(ends)}" if ends else "0")]
        return self.scene.title or "A run", [*rows, *self.scene.facts]

    def _times_of(self, files: Sequence[Path]) -> list[float]:
        """Return the times of snapshots in code units."""
        new = [path for path in files if path not in self._times]
        self._times.update(zip(new, times_and_units(new)[0], strict=True))
        return [self._times[path] for path in files]

    def _nearest(self, time: Any) -> Path:
        """Return the path of the snapshot nearest to a time. Raises PlotError."""
        files, wanted = self.files, time_in_code(time, self.units, self.scene.text, "at")
        if not files:
            raise PlotError(f"{printable(self.directory)}: no snapshots in this slice of the run")
        return files[int(np.abs(np.array(self._times_of(files)) - wanted).argmin())]


def open_run(directory: str | os.PathLike[str]) -> Run:
    """Open the directory of a run, finished or not.

    Parameters
    ----------
    directory : str or path-like
        Directory that `discsim run` writes, with scene.toml and snapshots.

    Returns
    -------
    Run
        A sequence of snapshots, with the scene and tables of the run.

    Raises
    ------
    SnapshotError
        If there is no run in the directory.
    SceneError
        If its scene has faults.
    """
    path = Path(directory).absolute()
    if not path.is_dir() or not (path / "scene.toml").exists():
        raise SnapshotError(f"{printable(directory)}: no run found; expected a directory with scene.toml and snapshots")
    snapshot_files(path)  # raises SnapshotError if there are none
    return Run(path, load_scene(path / "scene.toml"))


def profiles_in_time(
    files: Sequence[Path],
    names: Sequence[str],
    display: DisplayOptions,
    visit: Callable[[Snapshot], None] | None = None,
) -> tuple[Array, dict[str, Array]]:
    """Return the edges of rings (in 1D of bins in x), and the values [time, ring] of fields, in code units.

    By default the range of radii contains those of the first and last snapshot. `visit` is called with each snapshot.
    """
    display, rows = region_of_runs(display, [files], "time"), []
    edges = np.empty(0)
    for path in files:
        snap = read_for_fields(path, names)
        edges, binned = smooth_profile(snap, display.radii(snap), display.optics, display.log_radius)
        if visit is not None:
            visit(snap)
        rows.append([binned[name] for name in names])
    return edges, {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}


def _axis_quantity(units: Units, values: Array, dimension: str) -> Any:
    """Return values in code units as an astropy Quantity in the unit of axes of figures."""
    return Field("particles", "", np.asarray, dimension, "").quantity(units, values)


def _axis_of_table(name: str, values: Any) -> tuple[str, Array]:
    """Return the name of an axis with its unit, like "radius [au]", and its values."""
    unit = str(values.unit).replace("AU", "au")
    return f"{name} [{unit}]" if unit else name, values.value


def _table(path: Path, columns: Sequence[str]) -> Any:
    """Return the rows of a table as a pandas DataFrame, or without pandas as a structured array. Raises UserError."""
    rows = read_checked_table(path, columns)
    arrays = {}
    for k, name in enumerate(columns):
        kind: Any = str if name in TEXT_COLUMNS else np.int64 if name in INTEGER_COLUMNS else np.float64
        arrays[name] = np.array([row[k] for row in rows], dtype=str).astype(kind)
    if find_spec("pandas"):
        import pandas

        return pandas.DataFrame(arrays)
    table = np.empty(len(rows), [(name, array.dtype) for name, array in arrays.items()])
    for name, array in arrays.items():
        table[name] = array
    return table
