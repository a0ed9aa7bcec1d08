"""Marks on figures: companions, Hill circles, gap edges, damping zones and the initial profile.

    companions  semi-major axis of each orbit about the disc's centre, and the distances a (1 - e) and a (1 + e) of an
                eccentric orbit; the present distance of an unbound companion
    hill        circle with the Hill radius R_H about each planet          (`formulas/companions.py`)
    gap         edges of the gap of each planet, where Sigma = Sigma_0 / 2   (`output/gaps.py`)
    damping     radii at which [damping] acts                             (`kernels/common/damping.py`)
    initial     profile of the first snapshot of the run

A figure draws all marks that its kind and its run have, except gap edges. DisplayOptions.marks selects others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from discsim.output.drawing import Picture, axis_unit, body_marks
from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.frame import in_code
from discsim.output.fields.names import available_fields, field_named
from discsim.output.gaps import BodyOrbit, companion_orbits, planet_gap
from discsim.output.ink import shade, text_scale
from discsim.output.snapshot import Snapshot, SnapshotError, snapshot_files
from discsim.output.sources import Source, read_for_fields, run_directory
from discsim.plot import curves
from discsim.scene.units import clipped

Array = np.ndarray
KINDS = {
    "map": ("bodies", "damping", "gap", "hill"),
    "polar": ("bodies", "damping", "gap", "hill"),
    "profile": ("companions", "damping", "gap", "initial"),
    "time": ("companions", "damping", "gap"),
}
KIND_TEXT = {"map": "a map", "polar": "a polar map", "profile": "a profile", "time": "a map in time"}
BY_OPTION = frozenset({"gap"})  # marks that are not drawn by default
FROM_START = frozenset({"gap", "initial"})  # marks that need the first snapshot of the run
SMALLEST_HILL = 0.012  # radius of a Hill circle over the side of the map, below which the mark of the body covers it
ECCENTRIC = 0.02  # eccentricity above which the smallest and the largest distance are drawn too
TOGETHER, TOGETHER_ABOVE = 0.02, 0.12  # distance of lines over the width of the axes, below which they share a label
MAX_NAMES = 3  # largest number of companions that one label names

WHITE: dict[str, Any] = {"color": "white", "path_effects": [withStroke(linewidth=2.2, foreground="black")]}
HATCHED: dict[str, Any] = {"facecolor": "none", "edgecolor": (1.0, 1.0, 1.0, 0.4), "hatch": "//", "lw": 0.0}
OUTLINED: dict[str, Any] = {"color": "white", "path_effects": [withStroke(linewidth=1.5, foreground="black")]}
LABEL: dict[str, Any] = {"rotation": 90, "ha": "right", "fontsize": 8, "clip_on": True}
# Shares of ink in the greys of profiles: lines, the initial profile, and ground and edge of damping zones.
LINE_INK, INITIAL_INK, GROUND_INK, EDGE_INK = 0.65, 0.35, 0.1, 0.3
Style = tuple[int, tuple[float, ...]]  # offset and lengths of dashes and of spaces, in line widths
Rings = Iterable[tuple[float, Style]]  # radii and line styles of circles about the centre
Circles = Iterable[tuple[Array, float]]  # middles and radii of Hill circles
DASHED: Style = (0, (6.0, 4.0))
DOTTED: Style = (0, (1.5, 2.5))
DASH_DOT: Style = (0, (7.0, 2.0, 1.5, 2.0))
NO_BRACKETS = str.maketrans("", "", "[]")
DAMPED_LABEL, GAP_LABEL, INITIAL_LABEL = "damping", r"gap edges, $\Sigma = \Sigma_0 / 2$", "initial"


def marks_of(kind: str, snap: Snapshot, display: DisplayOptions) -> frozenset[str]:
    """Return the names of the marks of a figure of this kind, a key of KINDS.

    Raises PlotError for a mark in `display.marks` that the kind or the run of the snapshot does not have.
    """
    if display.marks is None:
        return frozenset(KINDS[kind]) - BY_OPTION
    for name in sorted(display.marks):
        if name not in KINDS[kind]:
            raise _fault(display, name, f"not a mark of {KIND_TEXT[kind]}; expected some of {', '.join(KINDS[kind])}")
        if reason := _missing_reason(name, snap):
            raise _fault(display, name, f"{reason}; remove {name}")
    return display.marks


def _fault(display: DisplayOptions, name: str, text: str) -> PlotError:
    """Return the error for a mark that cannot be drawn."""
    return PlotError(f"{display.prefix}mark: {name}: {text}")


def _missing_reason(name: str, snap: Snapshot) -> str | None:
    """Return the reason why a run lacks a mark, as text for a message; None if the run has the mark."""
    if name == "bodies" and not body_marks(snap):
        return "the run has no star"
    if name == "companions" and not companion_orbits(snap):
        return "the run has no companion"
    if name in ("gap", "hill") and not _planets(snap):
        return "the run has no planet, which is a companion with less than 3% of the star's mass"
    if name == "gap" and snap.gas is None:
        return "the run has no [gas]"
    return "the scene has no [damping]" if name == "damping" and not damped_radii(snap) else None


def _planets(snap: Snapshot) -> list[BodyOrbit]:
    """Return the orbits of the companions that are planets."""
    return [orbit for orbit in companion_orbits(snap) if orbit.is_planet]


def start_snapshot(
    source: Source, snap: Snapshot, names: Sequence[str], kind: str, display: DisplayOptions
) -> Snapshot | None:
    """Return the first snapshot of a run if the marks of a figure need it, else None.

    `source` is where `snap` comes from. Raises PlotError and SnapshotError for marks that are asked for but have no
    first snapshot, or another one than `snap`.
    """
    marks = marks_of(kind, snap, display) & FROM_START
    if not marks:
        return None
    name, is_default = max(marks), display.marks is None
    path = None if isinstance(source, Snapshot) else snapshot_files(source)[-1]
    directory = None if path is None else run_directory(path)
    if path is None or directory is None:
        if is_default:
            return None
        raise _fault(display, name, "needs the first snapshot of the run; give the directory of a run or a file in it")
    file = snapshot_files(directory)[0]
    if "initial" in marks and path.resolve() == file.resolve():
        if is_default:
            return None
        raise _fault(display, "initial", "the snapshot is the first one of its run; choose a later one")
    try:
        start = read_for_fields(file, names)
    except SnapshotError:
        if is_default:
            return None
        raise
    if start.units == snap.units:
        return start
    if is_default:
        return None
    raise _fault(display, name, f"{file} has other units or dimensions than the snapshot; give files of one run")


def damped_radii(snap: Snapshot) -> list[tuple[float, float]]:
    """Return the ranges of radii, in code units, in which [damping] acts; [] without damping.

    Damping is full beyond the far end of a zone too, so the inner range begins at 0 and the outer one has no end.
    Raises SnapshotError if the zones in the snapshot are no pairs of lengths.
    """
    table = snap.tables.get("damping")
    if not isinstance(table, dict) or snap.dimensions != 2:
        return []
    found = []
    for key in ("inner", "outer"):
        if key not in table:
            continue
        try:
            first, last = (in_code(snap.units, value, "length") for value in table[key])
        except (TypeError, ValueError):
            first = last = math.nan
        if not 0.0 < first < last < math.inf:
            shown = clipped(repr(table[key]))
            raise SnapshotError(f"damping.{key} in the scene of the snapshot is {shown}; expected two rising lengths")
        found.append((0.0, last) if key == "inner" else (first, math.inf))
    return found


def annotated(
    made: dict[str, Picture], kind: str, display: DisplayOptions, start: Snapshot | None = None
) -> dict[str, Picture]:
    """Return pictures of a snapshot with their marks; `kind` is "map" or "polar".

    `start` is the first snapshot of the run, for gap edges. Raises PlotError.
    """
    picture = next(iter(made.values()))
    snap, marks = picture.snap, marks_of(kind, picture.snap, display)
    length = axis_unit(snap, "length")[0] * (picture.scale or 1.0)
    zones = damped_radii(snap) if "damping" in marks else []
    rings = [(edge, DASHED) for edge in map(_near_end, zones)]
    if "gap" in marks and start is not None:
        rings += [(edge, DOTTED) for edges in gaps_of(start, snap).values() for edge in edges if edge > 0.0]
    planets = _planets(snap) if "hill" in marks else []
    circles = [(length * planet.place, length * planet.hill) for planet in planets]
    if display.marks is None:
        circles = [each for each in circles if each[1] > SMALLEST_HILL * _side(picture, kind, each[0])]
    draw = _draw_on_map if kind == "map" else _draw_on_polar_map

    def overlay(axes: Axes) -> None:
        if kind == "polar":
            for first, last in _shown_spans(zones, length, axes.get_ylim()):
                axes.axhspan(first, last, **HATCHED)
        draw(axes, [(length * radius, style) for radius, style in rings], circles)

    bodies = picture.marks if "bodies" in marks else ()
    over = _within_limits(overlay)
    return {name: replace(each, overlays=[*each.overlays, over], marks=bodies) for name, each in made.items()}


def _shown_spans(
    zones: Iterable[tuple[float, float]], length: float, ends: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return the parts of damping zones on a radial axis with these ends; `length` is the factor of the axis."""
    found = [(max(ends[0], length * first), min(ends[1], length * last)) for first, last in zones]
    return [(first, last) for first, last in found if first < last]


def _near_end(zone: tuple[float, float]) -> float:
    """Return the radius of the end of a damping zone that faces the disc."""
    return zone[1] if zone[0] == 0.0 else zone[0]


def _side(picture: Picture, kind: str, place: Array) -> float:
    """Return the length that the longer side of a picture has at a place, in units of the radial axis."""
    sides = float(np.ptp(picture.x)), float(np.ptp(picture.y))
    return max(sides) if kind == "map" else min(2.0 * math.pi * float(np.hypot(*place)), sides[1])


def _within_limits(draw: Callable[[Axes], None]) -> Callable[[Axes], None]:
    """Return a function that draws without a change of the limits of the axes."""

    def overlay(axes: Axes) -> None:
        limits = axes.axis()
        draw(axes)
        axes.axis(limits)

    return overlay


def _draw_on_map(axes: Axes, rings: Rings, circles: Circles) -> None:
    """Draw circles about the centre with line styles, and Hill circles at places, in the units of the axes."""
    for radius, style in rings:
        axes.add_patch(Circle((0.0, 0.0), radius, fill=False, lw=1.0, ls=style, **WHITE))
    for place, radius in circles:
        axes.add_patch(Circle((float(place[0]), float(place[1])), radius, fill=False, lw=1.0, **WHITE))


def _draw_on_polar_map(axes: Axes, rings: Rings, circles: Circles) -> None:
    """Draw the same on axes with azimuth in degrees and radius."""
    for radius, style in rings:
        axes.axhline(radius, lw=1.0, ls=style, **WHITE)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for place, radius in circles:
        x, y = place[0] + radius * np.cos(turn), place[1] + radius * np.sin(turn)
        angle = np.degrees(np.arctan2(y, x))
        angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # a circle across 180 degrees is drawn in two parts
        axes.plot(angle, np.hypot(x, y), lw=1.0, **WHITE)


def gaps_of(start: Snapshot, snap: Snapshot) -> dict[int, tuple[float, float]]:
    """Return the edges of gaps in code units by the number of the companion; NaN for an edge that there is not."""
    return {planet.number: planet_gap(start, snap, planet) for planet in _planets(snap)}


def gap_notes(starts: Sequence[Snapshot | None], snaps: Sequence[Snapshot]) -> list[str]:
    """Return the line below the title of a figure with gap edges, as a list; [] without first snapshots `starts`."""
    texts = []
    for start, snap in zip(starts, snaps, strict=True):
        length, unit = axis_unit(snap, "length")
        for edges in () if start is None else gaps_of(start, snap).values():
            ends = ["-" if math.isnan(edge) else f"{length * edge:.3g}" for edge in edges]
            texts.append("none" if ends == ["-", "-"] else f"{' to '.join(ends)}{unit.translate(NO_BRACKETS)}")
    return [f"{GAP_LABEL}: {'; '.join(texts)}"] if texts else []


def draw_on_profile(
    axes: Axes, snaps: Sequence[Snapshot], names: Sequence[str], display: DisplayOptions, start: Snapshot | None = None
) -> None:
    """Draw the marks of a profile with curves of the fields `names`. Raises PlotError.

    `start` is the first snapshot of the run, for gap edges and the initial profile of a single snapshot. Axes that
    have a mark already do not get it twice.
    """
    snap, marks = snaps[-1], marks_of("profile", snaps[-1], display)
    length = axis_unit(snap, "length")[0]
    low, high = (length * each for each in display.radii(snap))
    drawn = {artist.get_gid() for artist in axes.get_children()}
    if "initial" in marks and start is not None:
        _draw_initial(axes, start, names, replace(display, ends=display.radii(snap)))
    if "damping" in marks and "damping" not in drawn:
        label = DAMPED_LABEL
        ground: dict[str, Any] = {"facecolor": shade(GROUND_INK), "edgecolor": shade(EDGE_INK), "lw": 0.6}
        for first, last in _shown_spans(damped_radii(snap), length, (low, high)):
            axes.axvspan(first, last, **ground, zorder=0, label=label, gid="damping")
            label = "_"
    if "gap" in marks and start is not None and "gap" not in drawn:
        edges = [length * edge for both in gaps_of(start, snap).values() for edge in both if low < length * edge < high]
        _draw_verticals(axes, edges, "gap", color=shade(1.0), ls=DOTTED, lw=1.4, label=GAP_LABEL)
    if "companions" in marks and "companions" not in drawn:
        _draw_companions(axes, [orbit for each in snaps for orbit in companion_orbits(each)], length, (low, high))


def _draw_initial(axes: Axes, start: Snapshot, names: Sequence[str], display: DisplayOptions) -> None:
    """Draw the curves of a first snapshot in grey; fields that it lacks are left out."""
    drawn = {line.get_gid() for line in axes.lines}
    there = [name for name in names if f"initial {name}" not in drawn and _has_field(name, start)]
    for name, curve in curves.profile_curves(start, there, display).items():
        label = "_" if INITIAL_LABEL in axes.get_legend_handles_labels()[1] else INITIAL_LABEL
        style = {"color": shade(INITIAL_INK), "lw": 0.9, "zorder": 1.5, "label": label, "gid": f"initial {name}"}
        curves.draw_curve(axes, start, curve, field_named(name), **style)


def _has_field(name: str, snap: Snapshot) -> bool:
    """Return whether a snapshot has a field."""
    try:
        return bool(available_fields(name, snap))
    except FieldError:
        return False


def _draw_verticals(axes: Axes, places: Sequence[float], gid: str, label: str = "_", **style: Any) -> None:
    """Draw vertical lines over the height of the axes."""
    for x in places:
        axes.axvline(x, gid=gid, zorder=1.2, label=label, **style)
        label = "_"


def _draw_companions(axes: Axes, orbits: Sequence[BodyOrbit], length: float, ends: tuple[float, float]) -> None:
    """Draw the radii of orbits as vertical lines with names."""
    low, high = ends
    radii = [(length * orbit.radius, orbit.number) for orbit in orbits if low < length * orbit.radius < high]
    apart = [length * each for orbit in orbits for each in apsides(orbit) if low < length * each < high]
    grey = shade(LINE_INK)
    _draw_verticals(axes, [radius for radius, _ in radii], "companions", color=grey, ls=DASH_DOT, lw=1.0)
    _draw_verticals(axes, apart, "companions", color=grey, ls=DOTTED, lw=0.9)
    style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8 * text_scale(), "color": grey}
    for x, text in _labels(radii, len({orbit.number for orbit in orbits}), TOGETHER_ABOVE * (high - low)):
        axes.text(x, 1.01, text, transform=axes.get_xaxis_transform(), **style)  # above the axes, away from curves


def has_labels(snaps: Sequence[Snapshot], display: DisplayOptions) -> bool:
    """Return whether profiles of the snapshots have labels of companions above the axes."""
    wanted = display.marks is None or "companions" in display.marks
    return wanted and any(companion_orbits(snap) for snap in snaps)


def _labels(radii: Sequence[tuple[float, int]], companions: int, apart: float) -> list[tuple[float, str]]:
    """Return places and texts of labels for lines, given as radii and numbers of companions.

    Lines less than `apart` from each other share a label. `companions` is the number of all companions.
    """
    found, rest = [], sorted(radii)
    while rest:
        together = [each for each in rest if each[0] - rest[0][0] < apart]
        found.append(
            (
                0.5 * (together[0][0] + together[-1][0]),
                companion_label(sorted({number for _, number in together}), companions > 1),
            )
        )
        rest = rest[len(together) :]
    return found


def apsides(orbit: BodyOrbit) -> tuple[float, ...]:
    """Return the smallest and the largest distance of an eccentric orbit, in code units; () of a circular one."""
    e = orbit.eccentricity
    return (orbit.radius * (1.0 - e), orbit.radius * (1.0 + e)) if e > ECCENTRIC else ()


def companion_label(numbers: Sequence[int], several: bool) -> str:
    """Return the label of companions with these numbers; `several`: whether the run has more than one."""
    if not several:
        return "companion"
    if len(numbers) > MAX_NAMES:
        return f"{len(numbers)} companions"
    return f"companion{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


class TimeMarks:
    """Marks of a map in radius and time, collected from the snapshots that `visit` gets.

    `first` is the first snapshot of the run. Raises PlotError.
    """

    def __init__(self, first: Snapshot, display: DisplayOptions) -> None:
        self.first, self.marks = first, marks_of("time", first, display)
        self._lines: dict[tuple[int, str], list[tuple[float, float]]] = {}  # (time, radius) by companion and name

    def visit(self, snap: Snapshot) -> None:
        """Record the orbits of companions, and the edges of gaps."""
        for orbit in companion_orbits(snap) if "companions" in self.marks else ():
            self._add(orbit.number, "radius", snap.time, orbit.radius)
            for name, radius in zip(("nearest", "farthest"), apsides(orbit), strict=False):
                self._add(orbit.number, name, snap.time, radius)
        for number, edges in (gaps_of(self.first, snap) if "gap" in self.marks else {}).items():
            for name, edge in zip(("inner", "outer"), edges, strict=True):
                self._add(number, name, snap.time, edge)

    def _add(self, number: int, name: str, time: float, radius: float) -> None:
        """Append a point to a curve."""
        self._lines.setdefault((number, name), []).append((time, radius))

    def overlay(self, length: float, year: float) -> Callable[[Axes], None]:
        """Return the function that draws the marks; the arguments are the factors of the two axes."""

        def draw(axes: Axes) -> None:
            (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
            zones = damped_radii(self.first) if "damping" in self.marks else []
            for first, last in _shown_spans(zones, length, (low, high)):
                axes.axvspan(first, last, **HATCHED)
            for zone in zones:
                axes.axvline(length * _near_end(zone), lw=1.0, ls=DASHED, **WHITE)
            last_radii = []
            for (number, name), points in self._lines.items():
                time, radius = np.array(points).T
                style: Any = "-" if name == "radius" else DOTTED
                axes.plot(length * radius, year * time, lw=1.2 if name == "radius" else 1.0, ls=style, **WHITE)
                if name == "radius" and low < length * radius[-1] < high:
                    last_radii.append((length * float(radius[-1]), number))
            companions = len({number for number, _ in self._lines})
            for x, text in _labels(last_radii, companions, TOGETHER * (high - low)):
                axes.text(x, top - 0.02 * (top - bottom), text, va="top", **LABEL, **OUTLINED)

        return _within_limits(draw)
