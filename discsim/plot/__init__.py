"""Figures of runs and snapshots, as `discsim plot` and `discsim movie` make them, onto axes of one's own.

    ax = discsim.plot.field_map("runs/dusty_disc", "toomre_q")
    ax = discsim.plot.profile(snap, "surface_density", window="80 au")
    ax = discsim.plot.time_map("runs/dusty_disc", "dust.surface_density")

A source is the directory of a run (its last snapshot), a snapshot's file, or what `discsim.read_snapshot` gives. Fields
are named as in `discsim plot --fields`. All functions return matplotlib's axes, by default those of a new figure.
`window`, `pixels`, `distance`, `wavelength` and `opacity` are those of `Snapshot.field`, `limits` the least and the
greatest value that is shown. Each function raises PlotError, FieldError or SnapshotError.
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
    """A field on the plane, with star, companions and a scale bar."""
    return _picture(source, field, ax, look_of(**look), "map")


def polar_map(source: Source, field: str = "gas.surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """A field in angle and radius."""
    return _picture(source, field, ax, look_of(**look), "polar")


def profile(source: Source, field: str = "surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """A field against radius, averaged over angle, a line each species; in 1D the particles against x."""
    snap, how, ax = read(source, known(field)), look_of(**look), _axes(ax)
    names = of_run(field, snap)
    for name, curve in curves.profile(snap, names, how).items():
        curves.draw_curve(ax, snap, curve, FIELDS[name], label=name.partition(".")[0].replace("_", " "))
    curves.finish_profile(ax, snap, names, how)
    return ax


def time_map(source: str | Path, field: str = "gas.surface_density", ax: Axes | None = None, **look: Any) -> Axes:
    """A field in radius, in 1D in x, and time, of all the snapshots of a run's directory."""
    files, how, ax = files_of(source), look_of(**look), _axes(ax)
    name = _one(field, read(files[0], known(field)))
    picture = pictures.in_time(files, [name], how)[name]
    draw(ax, picture, limited(how, norm_of([picture]), picture))
    return ax


def phase(
    source: Source, field: str = "gas.v_r", against: str = "gas.radius", ax: Axes | None = None, **look: Any
) -> Axes:
    """The mass of particles over one field and another."""
    snap, ax = read(source, [*known(field), *known(against)]), _axes(ax)
    curves.phase(ax, snap, _one(field, snap), _one(against, snap), look_of(**look))
    return ax


def movie(source: str | Path, path: str | Path | None = None, *words: str, rate: float = 10.0, **look: Any) -> Path:
    """Write a film of fields of a run, as mp4 (with the extra `movie`) or gif; where it is."""
    film = Film(Path(source), words, rate=rate, look=look_of(**look))
    where = Path(path) if path is not None else usual_path(film)
    film.save(where)
    return where


def fields() -> list[tuple[str, str, str]]:
    """Name, unit and equation of each field."""
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
    """The field that a word stands for: where several species have it, that of the first."""
    return of_run(word, snap)[0]


def _axes(ax: Axes | None) -> Axes:
    """Those given, or those of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots()[1]
