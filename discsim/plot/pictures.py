"""Colour maps of fields: in x and y, in azimuth and radius, or in radius and time; and comparisons of two maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from discsim.output.bins import spaced_edges
from discsim.output.drawing import Picture, axis_unit, body_marks, map_picture
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.names import field_named
from discsim.output.fields.values import fields_on_pixels, fields_on_polar_pixels
from discsim.output.run import profiles_in_time
from discsim.output.sources import read_for_fields, times_and_units
from discsim.plot import marks, overlays
from discsim.scene.orbits import stated_orbit

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
Pictures = dict[str, Picture]  # by name of the field


def map_pictures(snap: Snapshot, names: Sequence[str], display: DisplayOptions) -> Pictures:
    """Return pictures of the fields `names` in x and y. Raises PlotError in 1D."""
    _require_two_dimensions(snap)
    window = display.map_window(snap)
    binned = fields_on_pixels(snap, window, display.pixels, display.optics)
    made = {name: map_picture(binned, name, window, display.arcsec_per_au(snap.units)) for name in names}
    return {name: overlays.over_pixels(picture, binned, display) for name, picture in made.items()}


def polar_pictures(snap: Snapshot, names: Sequence[str], display: DisplayOptions) -> Pictures:
    """Return pictures of the fields `names` in azimuth and radius. Raises PlotError in 1D."""
    _require_two_dimensions(snap)
    inner, outer = display.radii(snap, is_polar=True)
    binned = fields_on_polar_pixels(snap, inner, outer, display.pixels, display.optics, display.log_radius)
    length, unit = axis_unit(snap, "length")
    sides = np.array([-180.0, 180.0]), length * np.array([inner, outer])
    if display.log_radius:
        sides = (
            np.linspace(-180.0, 180.0, display.pixels + 1),
            length * spaced_edges(inner, outer, display.pixels // 2, log=True),
        )
    labels = r"$\varphi$ [deg]", f"r{unit}"
    bodies = [
        (float(np.degrees(np.arctan2(y, x))), float(np.hypot(x, y)), False)
        for x, y, star in body_marks(snap)
        if not star and inner <= np.hypot(x, y) / length <= outer
    ]
    made = {
        name: Picture(
            snap, name, field_named(name).factor(snap.units) * binned[name].T, *sides, labels, bodies,
            log_axis="y" if display.log_radius else "",
        )
        for name in names
    }  # fmt: skip
    return {name: overlays.over_pixels(picture, binned, display, polar=True) for name, picture in made.items()}


# Functions that return the pictures of a snapshot, by kind.
PICTURE_MAKERS: dict[str, Callable[[Snapshot, Sequence[str], DisplayOptions], Pictures]] = {
    "map": map_pictures,
    "polar": polar_pictures,
}


def time_pictures(
    files: Sequence[Path], names: Sequence[str], display: DisplayOptions, in_orbits: bool = True
) -> Pictures:
    """Return pictures of the fields `names` in radius (in 1D position) and time, from the snapshots `files` of a run.

    By default the range of radii contains those of the disc in the first and last snapshot. With `in_orbits`, the unit
    of time is the orbit of run.until or run.every, if the scene gives one of them in orbits.
    """
    first = read_for_fields(files[0], [*names, *overlays.needed_fields(display)])
    in_time = marks.TimeMarks(first, display)
    lines = {name: overlays.contour_field(display, name, first) for name in names}
    every = list(dict.fromkeys([*names, *(name for name in lines.values() if name)]))
    edges, values = profiles_in_time(files, every, display, in_time.visit)
    (length, unit), (year, time_unit) = axis_unit(first, "length"), time_axis(first, in_orbits)
    between = year * time_edges(np.array(times_and_units(files)[0]))
    labels = f"{'r' if first.dimensions == 2 else 'x'}{unit}", f"t{time_unit}"
    made = {
        name: Picture(
            first, name, field_named(name).factor(first.units) * values[name], length * edges, between, labels
        )
        for name in names
    }
    axis = "x" if display.log_radius else ""
    made = {name: replace(picture, log_axis=axis) for name, picture in made.items()}
    over = in_time.overlay(length, year)
    return {
        name: replace(picture, overlays=[*overlays.contours_over(picture, line, values[line or name], display), over])
        for (name, picture), line in zip(made.items(), lines.values(), strict=True)
    }


def time_axis(snap: Snapshot, in_orbits: bool = True) -> tuple[float, str]:
    """Return the factor from code units to the unit of a time axis, and this unit as " [yr]" or " [orbits at 5 au]"."""
    if in_orbits and (orbit := stated_orbit(snap.scene_text, snap.units)):
        return 1.0 / orbit.period, f" [{orbit.unit}]"
    return axis_unit(snap, "time")


def time_edges(times: Array) -> Array:
    """Return the edges (n + 1,) of bins around the times (n,) of snapshots.

    The edges lie halfway between successive times, and at the first and last time. A single time gets a bin of width 1.
    """
    if len(times) == 1:
        return times[0] + np.array([-0.5, 0.5])
    return np.concatenate([times[:1], (times[1:] + times[:-1]) / 2, times[-1:]])


def _require_two_dimensions(snap: Snapshot) -> None:
    """Raise PlotError for a 1D snapshot."""
    if snap.dimensions == 1:
        raise PlotError("a run in one dimension has no map; use --profile, --time or --against")


def comparison(one: Picture, other: Picture) -> tuple[Picture, Normalize, str]:
    """Return a picture that compares two pictures of a field, its colour range and its label.

    Its values are the ratio other / one for a field with a logarithmic scale, else the difference other - one. Raises
    PlotError if the two pictures have different pixels.
    """
    if one.values.shape != other.values.shape or not all(
        np.allclose(a, b) for a, b in zip((one.x, one.y), (other.x, other.y), strict=True)
    ):
        raise PlotError(
            "the two runs cover different times or regions; choose runs with equal snapshot times and regions"
        )
    field, one = one.field, replace(one, overlays=())
    if field.scale == "log":
        low = 1e-3 * max(np.nanmax(one.values), np.nanmax(other.values), 1e-300)
        seen = (one.values > low) & (other.values > low) if field.kind == "density" else one.values > 0
        values = np.divide(other.values, one.values, where=seen, out=np.full(one.values.shape, np.nan))
        most = float(np.nanquantile(np.abs(np.log(values)), 0.99)) if seen.any() else 1.0
        most = float(np.clip(most, np.log(1.05), 5.0))
        name = one.text.partition(" [")[0]
        return (
            replace(one, values=values, overlays=()),
            LogNorm(np.exp(-most), np.exp(most), clip=True),
            f"ratio of {name}",
        )
    values = other.values - one.values
    ends = np.abs(values[np.isfinite(values)])
    most = float(np.quantile(ends, 0.99)) if ends.size else 1.0
    return replace(one, values=values), Normalize(-(most or 1.0), most or 1.0, clip=True), f"difference of {one.text}"
