"""Figures of runs and snapshots on matplotlib axes, as `discsim plot` and `discsim movie` draw them.

    ax = discsim.plot.field_map("runs/dusty_disc", "toomre_q")
    ax = discsim.plot.profile(snap, "surface_density", window="80 au")
    ax = discsim.plot.profile(snap, "dust.0.surface_density", ax=ax)  # of one population of dust
    ax = discsim.plot.time_map("runs/dusty_disc", "dust.surface_density")

`discsim plot --fields` lists the names of fields. Importing this module imports matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discsim.output.drawing import draw_picture, draw_scale_bar
from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.display import DisplayOptions, display_options
from discsim.output.fields.names import available_fields, field_named, field_rows, matching_fields, species_text
from discsim.output.snapshot import Snapshot, snapshot_files
from discsim.output.sources import Source, read_for_fields, region_of_profiles
from discsim.output.style import use_style
from discsim.plot import curves, marks, overlays, pictures
from discsim.plot.compose import colour_range
from discsim.plot.film import Film, default_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "FieldError",
    "PlotError",
    "field_map",
    "fields",
    "movie",
    "phase",
    "polar_map",
    "profile",
    "time_map",
    "use_style",
]


def field_map(source: Source, field: str = "gas.surface_density", ax: Axes | None = None, **options: Any) -> Axes:
    """Draw a field on the plane, with star, companions and a scale bar.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`. Of one population of dust, by number or name, it is
        "dust.0.surface_density" or "dust.pebbles.v_r".
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **options
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`; `limits`, the lowest and
        highest value shown, in the unit of the axes; and `mark`, `cmap`, `contours` and `streamlines`, as in
        `discsim plot`.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    return _draw_picture(source, field, ax, display_options(**options), "map")


def polar_map(source: Source, field: str = "gas.surface_density", ax: Axes | None = None, **options: Any) -> Axes:
    """Draw a field in azimuth and radius.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`. Of one population of dust, by number or name, it is
        "dust.0.surface_density" or "dust.pebbles.v_r".
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **options
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`; `limits`, the lowest and
        highest value shown, in the unit of the axes; and `mark`, `cmap`, `log_radius`, `contours` and `streamlines`,
        as in `discsim plot`.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    return _draw_picture(source, field, ax, display_options(**options), "polar")


def profile(source: Source, field: str = "surface_density", ax: Axes | None = None, **options: Any) -> Axes:
    """Draw azimuthal averages of a field against radius, one line per species; in 1D the particles against x.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`. A name without a species, like "surface_density", draws all
        species. Of one population of dust, by number or name, it is "dust.0.surface_density" or "dust.pebbles.v_r".
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **options
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`; `limits`, the lowest and
        highest value shown, in the unit of the axes; and `mark` and `log_radius`, as in `discsim plot`.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    snap, ax = read_for_fields(source, matching_fields(field)), axes_or_new(ax)
    display = region_of_profiles(display_options(**options).used_for("profile"), [source], [snap])
    names = available_fields(field, snap)
    for name, curve in curves.profile_curves(snap, names, display).items():
        label = species_text(name, snap, of_each=snap.dimensions == 1)
        curves.draw_curve(ax, snap, curve, field_named(name), label=label)
    start = marks.start_snapshot(source, snap, names, "profile", display)
    marks.draw_on_profile(ax, [snap], names, display, start)
    curves.finish_profile(ax, snap, names, display)
    return ax


def time_map(
    source: str | Path | Sequence[Path], field: str = "gas.surface_density", ax: Axes | None = None, **options: Any
) -> Axes:
    """Draw a field against radius (in 1D x) and time, from all snapshots of a run.

    Parameters
    ----------
    source : str, Path or sequence of Path
        Directory of a run, or files of its snapshots.
    field : str
        Name of the field, as in `discsim plot --fields`. Of one population of dust, by number or name, it is
        "dust.0.surface_density" or "dust.pebbles.v_r".
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **options
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`; `limits`, the lowest and
        highest value shown, in the unit of the axes; and `mark`, `cmap`, `log_radius` and `contours`, as in
        `discsim plot`.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    files = snapshot_files(source) if isinstance(source, str | Path) else list(source)
    display, ax = display_options(**options).used_for("time"), axes_or_new(ax)
    name = _first_name(field, read_for_fields(files[0], matching_fields(field)))
    picture = pictures.time_pictures(files, [name], display)[name]
    draw_picture(ax, picture, colour_range(display, [picture]), display.cmap)
    return ax


def phase(
    source: Source, field: str = "gas.v_r", against: str = "gas.radius", ax: Axes | None = None, **options: Any
) -> Axes:
    """Draw the distribution of particle mass over two fields.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field, against : str
        Names of the fields on the y axis and on the x axis, both of particles of the same species, or of the same
        population of dust, like "dust.0.v_r" and "dust.0.radius".
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **options
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`; `limits`, the lowest and
        highest value shown, in the unit of the axes; and `mark` and `cmap`, as in `discsim plot`.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    display = display_options(**options).used_for("phase")
    snap, ax = read_for_fields(source, [*matching_fields(field), *matching_fields(against)]), axes_or_new(ax)
    curves.draw_phase(ax, snap, _first_name(field, snap), _first_name(against, snap), display)
    return ax


def movie(
    source: str | Path, path: str | Path | None = None, *words: str, rate: float = 10.0, dpi: int | None = None,
    **options: Any,
) -> Path:  # fmt: skip
    """Write a film with one frame per snapshot of a run.

    Parameters
    ----------
    source : str or Path
        Directory of a run.
    path : str or Path, optional
        File to write, ending in .mp4 (needs the extra `movie`) or .gif; by default in `plots` of the run, an mp4, or
        without this extra a gif.
    *words : str
        Names of the fields, like "dust.0.surface_density" of one population of dust; by default "surface_density".
    rate : float
        Frames per second.
    dpi : int, optional
        Pixels per inch of the frames.
    **options
        As in `field_map`.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks a field, or a snapshot cannot be read.
    OSError
        If the file cannot be written.
    """
    film = Film(Path(source), words, rate=rate, display=display_options(**options), dpi=dpi)
    where = Path(path) if path is not None else default_path(film)
    film.save(where)
    return where


def fields() -> list[tuple[str, str, str]]:
    """Return the available fields.

    Returns
    -------
    list of tuple of str
        Name, unit and description with equation of each field.
    """
    return list(field_rows())


def _draw_picture(source: Source, field: str, ax: Axes | None, display: DisplayOptions, kind: str) -> Axes:
    """Draw a field as a picture of the given kind, a key of PICTURE_MAKERS; return the axes."""
    wanted = [*matching_fields(field), *overlays.needed_fields(display.used_for(kind))]
    snap, ax = read_for_fields(source, wanted), axes_or_new(ax)
    name = _first_name(field, snap)
    start = marks.start_snapshot(source, snap, [name], kind, display)
    picture = marks.annotated(pictures.PICTURE_MAKERS[kind](snap, [name], display), kind, display, start)[name]
    draw_picture(ax, picture, colour_range(display, [picture]), display.cmap)
    if picture.scale is not None:
        draw_scale_bar(ax, picture)
    return ax


def _first_name(word: str, snap: Snapshot) -> str:
    """Return the full name of the field `word`; for a name like "v_r", that of the first species that has it."""
    return available_fields(word, snap)[0]


def axes_or_new(ax: Axes | None) -> Axes:
    """Return `ax`, or the axes of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots()[1]
