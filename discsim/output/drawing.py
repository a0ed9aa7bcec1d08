"""Functions for all figures: maps with colour bar, star, companions and scale bar, and axes with units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from discsim.output.bins import RINGS, range_of_mass
from discsim.output.fields.base import UNIT_TEXT, Field
from discsim.output.fields.values import Window, has_centre, in_rings
from discsim.parts import FIELDS
from discsim.printable import printable

if TYPE_CHECKING:
    from discsim.output.fields.binned import Binned
    from discsim.output.snapshot import Snapshot

Array = np.ndarray

DOLLAR = re.compile(r"(?<!\\)\$")  # a dollar sign that begins or ends mathematics
MAX_TEXT_WIDTH = 2000.0  # largest width in points of a line with mathematics; wider lines may exhaust the memory

# Colours of Okabe & Ito (2008), which colour-blind readers can distinguish; line styles for print without colour.
COLOURS = {"gas": "#0072B2", "dust": "#D55E00", "small_dust": "#009E73"}
STYLES = {"gas": "-", "dust": "-", "small_dust": "--"}
PIXELS = 480
PLAIN_RANGE = (1e-4, 1e5)  # range of numbers that are written without a power of ten

# Layout in inches. Fixed positions of axes: matplotlib's automatic layout takes longer than drawing.
LEFT, RIGHT, BELOW, TITLE = 0.85, 0.25, 0.55, 0.9  # space next to and below axes, and for titles
COLUMN, MAP, ROW = 5.8, 3.9, 2.9  # pitch of maps, side of a map, pitch of profiles
BAR = (0.08, 0.2)  # distance and width of a colour bar


def figure_text(text: str) -> str:
    """Return a user's text for a figure; dollar signs are escaped if matplotlib cannot typeset them as mathematics."""
    line = printable(text)
    if not DOLLAR.search(line) or (len(DOLLAR.findall(line)) % 2 == 0 and _can_typeset(line)):
        return line
    return DOLLAR.sub(r"\\$", line)


def _can_typeset(line: str) -> bool:
    """Return whether matplotlib can typeset a line with mathematics in a reasonable size."""
    try:
        width, height, *_ = MathTextParser("path").parse(line)
    except Exception:  # matplotlib may raise anything for a user's text
        return False
    return max(width, height) < MAX_TEXT_WIDTH


def in_units(snap: Snapshot, dimension: str) -> tuple[float, str]:
    """Return, for a physical dimension, the factor from code units to the unit of axes, and that unit in brackets."""
    plain_field = Field("particles", "", np.asarray, dimension, "")
    unit = plain_field.shown_unit(snap.units)
    return plain_field.factor(snap.units), f" [{UNIT_TEXT.get(unit, unit)}]" if unit else ""


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return new axes at a fixed position; (left, bottom) is their lower left corner. All lengths are in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.ticklabel_format(useOffset=False, scilimits=(-3, 4))  # keeps tick labels narrow
    return axes


def norm_of(pictures: Iterable[Picture]) -> Normalize:
    """Return one colour range for several pictures of a field.

    For densities and intensities it is that of `range_of_mass`. For other fields it contains the values between the
    quantiles 0.5% and 99.5%, and is symmetric about 0 if the field is signed.
    """
    pictures = list(pictures)
    field, values = pictures[0].field, np.concatenate([picture.values.ravel() for picture in pictures])
    values = values[np.isfinite(values)]
    if field.kind == "density" or field.dimension == "intensity":
        return LogNorm(*range_of_mass(values), clip=True)
    if field.scale == "log":
        values = values[values > 0]
    if not values.size:
        return LogNorm(0.1, 1.0, clip=True) if field.scale == "log" else Normalize(-1.0, 1.0, clip=True)
    low, high = (float(each) for each in np.quantile(values, (0.005, 0.995)))
    if field.scale == "signed":
        most = max(abs(low), abs(high)) or 1.0
        return Normalize(-most, most, clip=True)
    if field.scale == "log" and high > 1.5 * low:
        return LogNorm(low, high, clip=True)
    # A nearly uniform field gets a margin of 5% on either side.
    margin = max(0.05 * abs(high), 1e-300) if high - low < 0.05 * abs(high) else 0.0
    return Normalize(low - margin, high + margin, clip=True)


Mark = tuple[float, float, bool]  # x and y in the units of axes, and whether the mark is the star


@dataclass(frozen=True)
class Picture:
    """Values [y, x] of a field `name` to draw as a picture, in the units of axes.

    `x` and `y` are the first and last edge, or all edges, of the pixels along each axis. `marks` are the positions of
    star and companions. `scale` is the number of axis units per au (or per code unit of length) for a map in x and y,
    and None if the axes have different units.
    """

    snap: Snapshot
    name: str
    values: Array
    x: Array
    y: Array
    labels: tuple[str, str]
    marks: Sequence[Mark] = ()
    scale: float | None = None

    @property
    def field(self) -> Field:
        found: Field = FIELDS[self.name]
        return found

    @property
    def text(self) -> str:
        """The label of the colour bar."""
        return self.field.text(self.snap.units)


def map_picture(binned: Binned, name: str, window: Window, arcsec_per_au: float | None = None) -> Picture:
    """Return the picture of a field on the pixels of a window; with `arcsec_per_au`, axes are in arcsec."""
    snap, field = binned.snap, FIELDS[name]
    length, unit = in_units(snap, "length")
    length, unit = (length, unit) if arcsec_per_au is None else (length * arcsec_per_au, " [arcsec]")
    values = field.factor(snap.units) * binned[name].T
    x, y = (length * np.array([low, high]) for low, high in zip(*window, strict=True))
    at = arcsec_per_au or 1.0
    marks = [(at * mx, at * my, star) for mx, my, star in body_marks(snap)]
    inside = [mark for mark in marks if x[0] <= mark[0] <= x[1] and y[0] <= mark[1] <= y[1]]
    return Picture(snap, name, values, x, y, (f"x{unit}", f"y{unit}"), inside, at)


def draw(axes: Axes, picture: Picture, norm: Normalize, colours: str | None = None, bar: str | None = None) -> None:
    """Draw a picture and its colour bar; `colours` is a colour map, `bar` a label, to replace those of the field."""
    values, x, y = picture.values, picture.x, picture.y
    if isinstance(norm, LogNorm) and picture.field.kind == "density" and bar is None:
        values = np.maximum(values, 1e-300)  # empty pixels get the lowest colour
    style: dict[str, Any] = {"norm": norm, "cmap": colours or picture.field.colours}
    if len(x) == len(y) == 2:
        extent = (x[0], x[1], y[0], y[1])
        equal: Any = "equal" if picture.scale is not None else "auto"
        shown: Any = axes.imshow(values, origin="lower", extent=extent, aspect=equal, interpolation="bilinear", **style)
    else:
        shown = axes.pcolormesh(x, y, values, rasterized=True, **style)
    axes.set_facecolor("0.85")  # grey where the values are NaN
    axes.set(xlabel=picture.labels[0], ylabel=picture.labels[1])
    for mark_x, mark_y, star in picture.marks:
        mark, size = ("*", 11) if star else ("o", 6)
        axes.plot(mark_x, mark_y, marker=mark, color="white", markeredgecolor="black", markersize=size)
    colour_bar(axes, shown, picture.text if bar is None else bar)


def body_marks(snap: Snapshot) -> list[Mark]:
    """Return the marks (x, y, is star) of star and companions, in the units of axes; [] if the run has no centre."""
    if not has_centre(snap):
        return []
    places = np.zeros((1, 2)) if snap.bodies is None else snap.bodies.pos
    return [(float(x), float(y), number == 0) for number, (x, y) in enumerate(in_units(snap, "length")[0] * places)]


def scale_bar(axes: Axes, picture: Picture) -> None:
    """Draw a scale bar at the lower left of a map that is drawn; its length is round, and at most 25% of the side."""
    left, right = picture.x
    side, unit = float(right - left), in_units(picture.snap, "length")[1].strip(" []")
    bar = round_number(0.25 * side / (picture.scale or 1.0))  # length in the disc, also if the axes are angles
    x, y, long = left + 0.05 * side, picture.y[0] + 0.05 * side, bar * (picture.scale or 1.0)
    part = picture.values[: len(picture.values) // 8, : picture.values.shape[1] // 3]
    under = axes.images[0].to_rgba(np.ma.masked_invalid(part[::8, ::8]))[..., :3]
    light = np.where(np.isnan(part[::8, ::8]), 0.85, under.mean(axis=-1)).mean() > 0.5
    colour, other = ("black", "white") if light else ("white", "black")
    stroke = [withStroke(linewidth=1.5, foreground=other)]
    axes.plot([x, x + long], [y, y], color=colour, lw=1.5, path_effects=stroke, solid_capstyle="butt")
    axes.text(
        x + 0.5 * long,
        y + 0.015 * side,
        f"{bar:g} {unit}".strip(),
        color=colour,
        ha="center",
        va="bottom",
        fontsize=9,
        path_effects=stroke,
    )


def round_number(most: float) -> float:
    """Return the largest number of the series ..., 0.5, 1, 2, 5, 10, ... that is at most `most`."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(n for n in (1.0, 2.0, 5.0) if n * power <= most * (1.0 + 1e-9)))


def colour_bar(axes: Axes, image: Any, label: str) -> None:
    """Draw the colour bar of an image to the right of its axes."""
    bar_axes = axes.inset_axes((1.0 + BAR[0] / MAP, 0.0, BAR[1] / MAP, 1.0))
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.colorbar(image, cax=bar_axes, label=label)
    if isinstance(image.norm, LogNorm):
        log_ticks(bar_axes.yaxis, image.norm.vmin, image.norm.vmax)


def log_ticks(axis: Axis, low: float | None, high: float | None) -> None:
    """Label the ticks of a logarithmic axis with plain numbers, if all of them are short without a power of ten.

    matplotlib takes longer to typeset powers of ten than to draw the lines. An axis over two decades or less gets
    ticks at 1, 2 and 5 times powers of ten, or evenly spaced ticks over less than a factor of 4.
    """
    if not low or not high or not (high <= 100.0 * low or PLAIN_RANGE[0] <= low < high < PLAIN_RANGE[1]):
        return
    if high > 100.0 * low:
        axis.set_minor_locator(LogLocator(subs=[2.0, 5.0]))
        axis.set_minor_formatter(NullFormatter())
    else:
        axis.set_major_locator(
            LogLocator(subs=[1.0, 2.0, 5.0]) if high > 4.0 * low else MaxNLocator(6, steps=[1, 2, 5, 10])
        )
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, place: number_text(value)))


def number_text(value: float) -> str:
    """Return a number as short text; a power of ten is written in mathtext."""
    if PLAIN_RANGE[0] <= abs(value) < PLAIN_RANGE[1] or value == 0:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    power = int(np.floor(np.log10(abs(value))))
    return rf"${value / 10.0**power:.3g}\times10^{{{power}}}$"


def points_1d(snap: Snapshot, name: str) -> tuple[Array, Array]:
    """Return positions (n,) and values (n,) of a field in 1D, in the units of axes.

    They are those of particles; for fields computed from other fields, those of bins. The density of a species is the
    stored one if there is one. Other densities are the mass between the fourth neighbours on either side of a
    particle, over their distance.
    """
    field = FIELDS[name]
    length, factor = in_units(snap, "length")[0], field.factor(snap.units)
    if field.kind == "places":
        edges = np.linspace(snap.lower[0], snap.upper[0], RINGS + 1)
        return length * 0.5 * (edges[1:] + edges[:-1]), factor * in_rings(snap, edges)[name]
    p, values = snap.species[field.species], field.values(snap)
    x = p.pos[:, 0]
    if field.kind == "particles":
        return length * x, factor * values
    if p.density is not None and np.array_equal(values, p.mass):
        return length * x, factor * p.density
    order = np.argsort(x)
    x, total = x[order], np.cumsum(values[order])
    return length * x[4:-4], factor * (total[7:-1] - np.append(0.0, total[:-9])) / (x[8:] - x[:-8])
