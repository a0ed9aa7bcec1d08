"""Figures of runs and snapshots on matplotlib axes, as `discsim plot` and `discsim movie` draw them.

    ax = discsim.plot.field_map("runs/dusty_disc", "toomre_q")
    ax = discsim.plot.profile(snap, "surface_density", window="80 au")
    ax = discsim.plot.time_map("runs/dusty_disc", "dust.surface_density")

The names of fields are those of `discsim plot --fields`. matplotlib is imported with this module.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from discsim.output.drawing import draw, norm_of, scale_bar
from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.look import Look, look_of
from discsim.output.fields.names import known, listed, of_run
from discsim.output.snapshot import Snapshot, files_of
from discsim.parts import FIELDS
from discsim.plot import curves, pictures
from discsim.plot.compose import limited
from discsim.plot.film import Film, usual_path
from discsim.plot.sources import Source, read

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FieldError", "PlotError", "field_map", "fields", "movie", "phase", "polar_map", "profile", "time_map"]


def field_map(source: Source, field: str = "gas.surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """Draw a field on the plane, with star, companions and a scale bar.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`.
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **look
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`, and `limits`, the lowest
        and highest value shown, in the unit of the axes.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    return _picture(source, field, ax, look_of(**look), "map")


def polar_map(source: Source, field: str = "gas.surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """Draw a field in azimuth and radius.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`.
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **look
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`, and `limits`, the lowest
        and highest value shown, in the unit of the axes.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    return _picture(source, field, ax, look_of(**look), "polar")


def profile(source: Source, field: str = "surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """Draw azimuthal averages of a field against radius, one line per species; in 1D the particles against x.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field : str
        Name of the field, as in `discsim plot --fields`. A name without a species, like "surface_density", draws all
        species.
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **look
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`, and `limits`, the lowest
        and highest value shown, in the unit of the axes.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    snap, how, ax = read(source, known(field)), look_of(**look), _axes(ax)
    names = of_run(field, snap)
    for name, curve in curves.profile(snap, names, how).items():
        curves.draw_curve(ax, snap, curve, FIELDS[name], label=name.partition(".")[0].replace("_", " "))
    curves.finish_profile(ax, snap, names, how)
    return ax


def time_map(source: str | Path, field: str = "gas.surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """Draw a field against radius (in 1D x) and time, from all snapshots of a run.

    Parameters
    ----------
    source : str or Path
        Directory of a run.
    field : str
        Name of the field, as in `discsim plot --fields`.
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **look
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`, and `limits`, the lowest
        and highest value shown, in the unit of the axes.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    files, how, ax = files_of(source), look_of(**look), _axes(ax)
    name = _one(field, read(files[0], known(field)))
    picture = pictures.in_time(files, [name], how)[name]
    draw(ax, picture, limited(how, norm_of([picture]), picture))
    return ax


def phase(
    source: Source, field: str = "gas.v_r", against: str = "gas.radius", ax: Axes | None = None, **look: Any
) -> Axes:
    """Draw the distribution of particle mass over two fields.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    field, against : str
        Names of the fields on the y axis and on the x axis, both of particles of the same species.
    ax : Axes, optional
        matplotlib axes to draw on; by default those of a new figure.
    **look
        `window`, `pixels`, `distance`, `wavelength` and `opacity` as in `Snapshot.field`, and `limits`, the lowest
        and highest value shown, in the unit of the axes.

    Returns
    -------
    Axes
        The axes drawn on.

    Raises
    ------
    PlotError, FieldError, SnapshotError
        If an argument is invalid, the run lacks the field, or a snapshot cannot be read.
    """
    snap, ax = read(source, [*known(field), *known(against)]), _axes(ax)
    curves.phase(ax, snap, _one(field, snap), _one(against, snap), look_of(**look))
    return ax


def movie(source: str | Path, path: str | Path | None = None, *words: str, rate: float = 10.0, **look: Any) -> Path:
    """Write a film with one frame per snapshot of a run.

    Parameters
    ----------
    source : str or Path
        Directory of a run.
    path : str or Path, optional
        File to write, ending in .mp4 (needs the extra `movie`) or .gif; by default in `plots` of the run.
    *words : str
        Names of the fields; by default "surface_density".
    rate : float
        Frames per second.
    **look
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
    film = Film(Path(source), words, rate=rate, look=look_of(**look))
    where = Path(path) if path is not None else usual_path(film)
    film.save(where)
    return where


def fields() -> list[tuple[str, str, str]]:
    """Return the available fields.

    Returns
    -------
    list of tuple of str
        Name, unit and description with equation of each field.
    """
    return list(listed())


def _picture(source: Source, field: str, ax: Axes | None, look: Look, kind: str) -> Axes:
    snap, ax = read(source, known(field)), _axes(ax)
    name = _one(field, snap)
    picture = {"map": pictures.maps, "polar": pictures.polar}[kind](snap, [name], look)[name]
    draw(ax, picture, limited(look, norm_of([picture]), picture))
    if picture.scale is not None:
        scale_bar(ax, picture)
    return ax


def _one(word: str, snap: Snapshot) -> str:
    """Return the field name for a word; for a field of several species, that of the first."""
    return of_run(word, snap)[0]


def _axes(ax: Axes | None) -> Axes:
    """Return `ax`, or the axes of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots()[1]
