r"""Contour lines of a field and streamlines of a velocity, drawn over a picture of another field.

Streamlines follow u = v - Omega \hat z x r, the velocity of gas or dust in a frame about the disc's centre:

    scene      Omega = 0
    kepler     Omega = Omega_K(r), which leaves the motion relative to circular orbits
    companion  Omega = (x v_y - y v_x) / r^2 of a companion, in whose frame the flow past it is nearly steady

u is computed for each particle, and then averaged over pixels by mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from discsim.output.drawing import Picture, axis_unit, common_norm, number_text
from discsim.output.fields.base import FieldError, PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.frame import omega
from discsim.output.fields.names import (
    available_fields,
    field_named,
    matching_fields,
    split_population,
    with_populations,
)
from discsim.output.ink import contrast, line_scale, text_scale

if TYPE_CHECKING:
    from discsim.output.fields.binned import BinnedFields
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
MAX_DEFAULT_LEVELS = 6
STREAM_COLOURS = {"white": "#a6dcff", "black": "#123f66"}  # of streamlines, by the ink of contours
Pictures = Mapping[str, Picture]


@dataclass(frozen=True)
class Contours:
    """Labelled contour lines of a picture, which is not shown itself; without `levels` they are `default_levels`."""

    picture: Picture
    levels: Sequence[float] = ()

    def __call__(self, axes: Axes) -> None:
        """Draw the lines on axes."""
        picture, ends, (ink, edge) = self.picture, (axes.get_xlim(), axes.get_ylim()), _inks(axes)
        values = np.ma.masked_invalid(picture.values)
        levels = self.levels or default_levels(common_norm([picture]))
        inside = [level for level in levels if values.count() and values.min() < level < values.max()]
        if inside:
            lines = axes.contour(*middles(picture), values, inside, colors=ink, linewidths=0.8 * line_scale())
            lines.set(path_effects=_outline(1.8, edge))
            for text in axes.clabel(lines, fmt=number_text, fontsize=8 * text_scale()):
                text.set_path_effects(_outline(1.8, edge))
        _note(axes, f"contours: {picture.text}" + ("" if inside else " (no level in this range)"), 0)
        axes.set(xlim=ends[0], ylim=ends[1])


@dataclass(frozen=True)
class Streamlines:
    """Lines along the vectors (u, v) [y, x] at the pixels of a picture; `line` is the line of `text` in the corner."""

    picture: Picture
    u: Array
    v: Array
    text: str
    line: int = 0

    def __call__(self, axes: Axes) -> None:
        """Draw the lines on axes."""
        (x, y), (ink, edge) = middles(self.picture), _inks(axes)
        ends, before = (axes.get_xlim(), axes.get_ylim()), len(axes.patches)
        even = np.linspace(y[0], y[-1], len(y))  # streamplot needs equal distances, also on a logarithmic axis
        u, v = (_at_heights(field, y, even) for field in (self.u, self.v))
        shown = axes.streamplot(
            x,
            even,
            u,
            v,
            density=1.2,
            color=STREAM_COLOURS[ink],
            linewidth=0.7 * line_scale(),
            arrowsize=0.8 * text_scale(),
        )
        shown.lines.set_path_effects(_outline(1.6, edge))
        for arrow in axes.patches[before:]:
            arrow.set_path_effects(_outline(1.2, edge))
        _note(axes, self.text, self.line)
        axes.set(xlim=ends[0], ylim=ends[1])


def _at_heights(field: Array, y: Array, even: Array) -> Array:
    """Return a field [y, x] at the heights `even`; NaN stays masked."""
    if not np.allclose(y, even):
        field = np.stack([np.interp(even, y, column) for column in field.T], axis=1)
    return np.ma.masked_invalid(field)


def middles(picture: Picture) -> tuple[Array, Array]:
    """Return the middles of the pixels of a picture along x and along y."""
    found = []
    for edges, count in zip((picture.x, picture.y), picture.values.shape[::-1], strict=True):
        every = np.linspace(edges[0], edges[-1], count + 1) if len(edges) == 2 else np.asarray(edges)
        found.append(0.5 * (every[1:] + every[:-1]))
    return found[0], found[1]


def _inks(axes: Axes, rows: slice = slice(None), columns: slice = slice(None)) -> tuple[str, str]:
    """Return the colour of lines over a part of a picture, and that of their outlines."""
    shown: Any = next(iter([*axes.images, *axes.collections]))
    values: Array = np.ma.filled(np.ma.asarray(shown.get_array(), dtype=float), np.nan)
    return contrast(shown, values[rows, columns])


def _outline(width: float, colour: str) -> list[Any]:
    return [withStroke(linewidth=width * line_scale(), foreground=colour)]


def _note(axes: Axes, text: str, line: int) -> None:
    """Write a text into the upper left corner of axes, in the line with this number."""
    size = 8.5 * text_scale()
    shape = next(iter([*axes.images, *axes.collections])).get_array().shape
    ink, edge = _inks(axes, slice(-shape[0] // 8, None), slice(None, shape[1] // 2))
    where = (0.6 * size, -(0.6 + 1.5 * line) * size)
    axes.annotate(
        text, (0.0, 1.0), where, "axes fraction", "offset points", ha="left", va="top", fontsize=size, color=ink,
        zorder=6, bbox={"facecolor": edge, "edgecolor": "none", "alpha": 0.6, "pad": 0.15 * size},
    )  # fmt: skip


def default_levels(norm: Normalize) -> list[float]:
    """Return at most MAX_DEFAULT_LEVELS round levels within the range of colours."""
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
    if isinstance(norm, LogNorm) and high > 4.0 * low:
        powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        for factors in ((1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
            levels = np.multiply.outer(powers, factors).ravel()
            levels = levels[(levels > low) & (levels < high)]
            if len(levels) <= MAX_DEFAULT_LEVELS:
                break
        return [float(level) for level in levels[:: -(-len(levels) // MAX_DEFAULT_LEVELS) or 1]]
    ticks = MaxNLocator(MAX_DEFAULT_LEVELS - 1, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(tick) for tick in ticks if low < tick < high]


def with_common_levels(pictures_by_run: Sequence[Pictures]) -> list[dict[str, Picture]]:
    """Return pictures in which all contours of a field have the same levels, also those of several populations."""
    groups: dict[str, list[Picture]] = {}
    for each in pictures_by_run:
        for drawn in (overlay for picture in each.values() for overlay in picture.overlays):
            if isinstance(drawn, Contours):
                groups.setdefault(split_population(drawn.picture.name)[1], []).append(drawn.picture)
    levels = {name: default_levels(common_norm(group)) for name, group in groups.items()}

    def common(overlay: Callable[[Axes], None]) -> Callable[[Axes], None]:
        if not isinstance(overlay, Contours) or overlay.levels:
            return overlay
        return replace(overlay, levels=levels[split_population(overlay.picture.name)[1]])

    return [
        {name: replace(picture, overlays=[common(each) for each in picture.overlays]) for name, picture in run.items()}
        for run in pictures_by_run
    ]


def needed_fields(display: DisplayOptions) -> list[str]:
    """Return the names of fields, besides those of the pictures, whose columns contours and streamlines need."""
    names = matching_fields(display.contours[0]) if display.contours else []
    return [*names, *(["gas.v_x", "dust.v_x"] if display.streamlines else [])]


def contour_field(display: DisplayOptions, name: str, snap: Snapshot) -> str | None:
    """Return the field of the contours over a picture of the field `name`; None without contours. Raises FieldError.

    A word without a species, like "surface_density", is the field of the species and population of the picture.
    """
    if display.contours is None:
        return None
    try:
        names, (population, plain) = available_fields(display.contours[0], snap), split_population(name)
    except FieldError as error:
        raise FieldError(f"{display.prefix}contours: {error}") from None
    found = next((each for each in names if each.partition(".")[0] == plain.partition(".")[0]), names[0])
    return with_populations([found], [population] if population is not None else [])[0]


def contours_over(picture: Picture, name: str | None, values: Array, display: DisplayOptions) -> list[Contours]:
    """Return the contours of the field `name` over a picture; `values` [y, x] are in code units."""
    if name is None or display.contours is None:
        return []
    shown = replace(picture, name=name, values=field_named(name).factor(picture.snap.units) * values, overlays=())
    return [Contours(shown, display.contours[1])]


def over_pixels(picture: Picture, binned: BinnedFields, display: DisplayOptions, polar: bool = False) -> Picture:
    """Return a picture with the contours and streamlines of the options. Raises PlotError, FieldError."""
    name = contour_field(display, picture.name, picture.snap)
    found: list[Callable[[Axes], None]] = [
        *contours_over(picture, name, binned[name].T if name else picture.values, display)
    ]
    if display.streamlines is not None:
        found.append(replace(_streamlines(picture, binned, display, polar), line=len(found)))
    return replace(picture, overlays=[*picture.overlays, *found])


def _streamlines(picture: Picture, binned: BinnedFields, display: DisplayOptions, polar: bool) -> Streamlines:
    """Return the streamlines of the species and population of a picture; of gas for a field of gas and dust."""
    population, plain = split_population(picture.name)
    species = plain.partition(".")[0]
    if species not in ("gas", "dust"):
        species = "gas" if binned.snap.gas is not None else "dust"
    binned = binned.of_population(population) if population is not None and species == "dust" else binned
    snap, frame = binned.snap, str(display.streamlines)
    try:
        available_fields(f"{species}.v_phi_excess" if frame == "kepler" else f"{species}.v_y", snap)
    except FieldError as error:
        raise FieldError(f"{display.prefix}streamlines: {error}") from None
    p = snap.species[species]
    rate = _angular_velocity(snap, p.radius, frame, f"{display.prefix}streamlines")
    vel = p.vel - rate[:, None] * np.stack([-p.pos[:, 1], p.pos[:, 0]], axis=1)
    if polar:
        safe = np.maximum(p.radius, 1e-300)
        turning = (p.pos[:, 0] * vel[:, 1] - p.pos[:, 1] * vel[:, 0]) / safe**2
        parts = np.degrees(turning), axis_unit(snap, "length")[0] * (p.pos * vel).sum(axis=1) / safe
    else:
        parts = vel[:, 0], vel[:, 1]
    u, v = (binned.mean(species, part).T for part in parts)
    kind, _, number = frame.partition(".")
    words = {"scene": "", "kepler": " minus Kepler", "companion": f", rotating with companion {number or 1}"}[kind]
    return Streamlines(picture, u, v, f"streamlines: {species}{words}")


def _angular_velocity(snap: Snapshot, radius: Array, frame: str, argument: str) -> Array:
    """Return the angular velocity (n,) of a frame at these radii (n,). Raises PlotError without the companion."""
    kind, _, text = frame.partition(".")
    if kind != "companion":
        return omega(snap, radius) if kind == "kepler" else np.zeros_like(radius)
    number, bodies = int(text or 1), snap.bodies
    if bodies is None or bodies.vel is None or number >= bodies.count:
        count = 0 if bodies is None else bodies.count - 1
        wanted = f"one from companion.1 to companion.{count}, or " if count else ""
        raise PlotError(f"{argument}: the run has no companion {number}; expected {wanted}scene or kepler")
    (x, y), (vx, vy) = bodies.pos[number], bodies.vel[number]
    return np.full_like(radius, (x * vy - y * vx) / (x * x + y * y))
