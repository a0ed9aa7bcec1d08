"""Code that all figures share: maps with colour bar, star, companions and scale bar, and axes with units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from discsim.output.bins import RINGS, density_range
from discsim.output.fields.base import UNIT_TEXT, Field
from discsim.output.fields.names import field_label, field_named, of_population
from discsim.output.fields.values import Window, fields_in_rings, has_centre
from discsim.output.ink import contrast, line_scale, shade, text_scale
from discsim.printable import printable

if TYPE_CHECKING:
    from discsim.output.fields.binned import BinnedFields
    from discsim.output.snapshot import Snapshot

Array = np.ndarray

DOLLAR = re.compile(r"(?<!\\)\$")  # a dollar sign that begins or ends mathematics
MAX_LINE = 400  # characters of a line in a title
MAX_BROKEN = 4  # largest number of lines into which a line of text is broken
MAX_TEXT_WIDTH = 2000.0  # largest width in points of a line with mathematics; wider lines may exhaust the memory

# Colours of Okabe & Ito (2008), which colour-blind readers can distinguish, and line styles for print without colour.
COLOURS = {"gas": "#0072B2", "dust": "#D55E00", "small_dust": "#009E73"}
STYLES = {"gas": "-", "dust": "-", "small_dust": "--"}
POPULATION_COLOURS = ("#D55E00", "#56B4E9", "#CC79A7", "#E69F00", "#009E73", "#000000")
TOTAL_COLOUR = "0.5"  # of all dust, next to its populations
LINES = ("-", "--", ":")
PIXELS = 480
PLAIN_RANGE = (1e-4, 1e5)  # range of numbers that are written without a power of ten

# Layout in inches. Positions of axes are fixed, because matplotlib's automatic layout takes longer than drawing.
LEFT, RIGHT, BELOW, TITLE = 0.85, 0.25, 0.55, 0.9  # space left of, right of and below axes, and for titles
COLUMN, MAP, ROW = 5.8, 3.9, 2.9  # pitch of maps, side of a map, pitch of profiles
CLUMP = 30.0  # highest density on a colour scale over the median, so that a small clump does not set the scale
EDGE = 0.08  # smallest distance of the label of a profile from the edge of the figure, in inches
MIN_SIDE = 2.0  # smallest side, for text of the default size, to which the height of the style reduces maps, in inches
BAR = (0.08, 0.2)  # distance and width of a colour bar
LABEL_WIDTH = 0.5  # of a number at the ticks of a horizontal colour bar
BAR_BELOW = (0.57, 0.14, 0.65)  # distance and width of a colour bar below axes, and the space that it adds there


def figure_text(text: str) -> str:
    """Return a text from a user in printable form; dollar signs that are no mathematics for matplotlib are escaped."""
    line = printable(text)
    if not DOLLAR.search(line) or (len(DOLLAR.findall(line)) % 2 == 0 and _can_typeset(line)):
        return line
    return DOLLAR.sub(r"\\$", line)


def broken(line: str, width: float, size: float) -> list[str]:
    """Return a line of text of a size in points as lines of at most `width` inches, broken outside mathematics.

    The line is broken after commas, or at any space if a part between commas is too long.
    """

    def fits(text: str) -> bool:
        few = len(text) < MAX_LINE  # matplotlib takes a second for the width of a thousand characters
        return few and bool(TextPath((0.0, 0.0), text, size=size).get_extents().width < 72.0 * width - size)

    if not line or fits(line):
        return [line]
    words = re.findall(r"(?:\\\$|\$[^$]*\$|\S)+", line)
    parts = [" ".join(words[start:end]) for start, end in pairwise([0, *_after_commas(words), len(words)])]
    found: list[str] = []
    for word in parts if all(map(fits, parts)) else words:
        if found and fits(f"{found[-1]} {word}"):
            found[-1] += f" {word}"
        elif len(found) == MAX_BROKEN:
            found[-1] += " ..."
            break
        else:
            found.append(word)
    return found


def _after_commas(words: Sequence[str]) -> list[int]:
    """Return the indices of the words that follow a comma."""
    return [index + 1 for index, word in enumerate(words[:-1]) if word.endswith(",")]


def _can_typeset(line: str) -> bool:
    """Return whether matplotlib can typeset a line with mathematics, and its size is below MAX_TEXT_WIDTH."""
    try:
        width, height, *_ = MathTextParser("path").parse(line)
    except Exception:  # matplotlib may raise anything for a user's text
        return False
    return max(width, height) < MAX_TEXT_WIDTH


def population_style(number: int) -> dict[str, Any]:
    """Return colour and line style of the dust population `number`."""
    count = len(POPULATION_COLOURS)
    return {"color": POPULATION_COLOURS[number % count], "ls": LINES[number // count % len(LINES)]}


def axis_unit(snap: Snapshot, dimension: str) -> tuple[float, str]:
    """Return the factor from code units to the unit of axes for a physical dimension, and this unit as " [au]".

    The text is "" if the unit has no name, as in the code system.
    """
    plain_field = Field("particles", "", np.asarray, dimension, "")
    unit = plain_field.shown_unit(snap.units)
    return plain_field.factor(snap.units), f" [{UNIT_TEXT.get(unit, unit)}]" if unit else ""


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes to `figure`, and return them; (left, bottom) is their lower left corner. All lengths are in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.ticklabel_format(useOffset=False, scilimits=(-3, 4))  # keeps tick labels narrow
    return axes


def fit_labels(panels: Sequence[Axes], space: float) -> None:
    """Move the left edges of `panels` to the right, until numbers and label of each y axis take at most `space` inches.

    All panels are moved by the same length. Numbers with powers of ten may take more space than LEFT.
    """
    wider = 0.0
    for axes in panels:
        label, dpi = axes.yaxis.get_tightbbox(), axes.figure.dpi
        if label is not None:
            wider = max(wider, (axes.bbox.x0 - label.x0) / dpi - space)
    if wider > 0.0:
        for axes in panels:
            box, across = axes.get_position(), axes.figure.bbox.width / axes.figure.dpi
            axes.set_position((box.x0 + wider / across, box.y0, box.width - wider / across, box.height))


def common_norm(pictures: Iterable[Picture]) -> Normalize:
    """Return one colour range for several pictures of a field.

    For densities and intensities, `density_range` computes it. For other fields it spans the quantiles 0.5% to 99.5%
    of the values, and is symmetric about 0 if the field is signed.
    """
    pictures = list(pictures)
    field, values = pictures[0].field, np.concatenate([picture.values.ravel() for picture in pictures])
    values = values[np.isfinite(values)]
    if field.kind == "density" or field.dimension == "intensity":
        return LogNorm(*density_range(values, clump=CLUMP), clip=True)
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


Mark = tuple[float, float, bool]  # a body in a map: x and y in the units of axes, and True for the star


@dataclass(frozen=True)
class Picture:
    """Values [y, x] of the field `name` to draw as a picture, in the unit of the colour bar.

    `x` and `y` are the first and last edge of the pixels along each axis, or all edges. `labels` are the labels of
    the axes, and `marks` the positions of star and companions. `scale` is the number of axis units per au (or per
    code unit of length) for a map in x and y, and None if the axes have different units. `overlays` are functions that
    draw over the picture. `log_axis` is "x" or "y" if this axis is logarithmic.
    """

    snap: Snapshot
    name: str
    values: Array
    x: Array
    y: Array
    labels: tuple[str, str]
    marks: Sequence[Mark] = ()
    scale: float | None = None
    overlays: Sequence[Callable[[Axes], None]] = ()
    log_axis: str = ""

    @property
    def field(self) -> Field:
        """The definition of the field."""
        return field_named(self.name)

    @property
    def text(self) -> str:
        """The label of the colour bar."""
        return field_label(self.name, self.snap)


def map_picture(binned: BinnedFields, name: str, window: Window, arcsec_per_au: float | None = None) -> Picture:
    """Return the picture of the field `name`, from fields on the pixels of a window.

    With `arcsec_per_au` the axes are in arcsec.
    """
    snap, field = binned.snap, field_named(name)
    length, unit = axis_unit(snap, "length")
    length, unit = (length, unit) if arcsec_per_au is None else (length * arcsec_per_au, " [arcsec]")
    values = field.factor(snap.units) * binned[name].T
    x, y = (length * np.array([low, high]) for low, high in zip(*window, strict=True))
    scale = arcsec_per_au or 1.0
    marks = [(scale * mx, scale * my, star) for mx, my, star in body_marks(snap)]
    inside = [mark for mark in marks if x[0] <= mark[0] <= x[1] and y[0] <= mark[1] <= y[1]]
    along, up = ("radius x", "height y") if "shearing_box" in snap.tables else ("x", "y")
    return Picture(snap, name, values, x, y, (f"{along}{unit}", f"{up}{unit}"), inside, scale)


def draw_picture(
    axes: Axes, picture: Picture, norm: Normalize, colours: Any = None, bar: str | None = None, below: bool = False
) -> None:
    """Draw a picture and its colour bar on `axes`.

    The colour map `colours` and the label `bar` of the colour bar are by default those of the field. The colour bar
    is to the right of the axes, or with `below` below them.
    """
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
    if picture.log_axis:
        axes.set(**{f"{picture.log_axis}scale": "log"})
        side, axis = (x, axes.xaxis) if picture.log_axis == "x" else (y, axes.yaxis)
        set_log_ticks(axis, float(side[0]), float(side[-1]))
    axes.set_facecolor(shade(0.15))  # grey where the values are NaN
    axes.set(xlabel=picture.labels[0], ylabel=picture.labels[1])
    for overlay in picture.overlays:
        overlay(axes)
    for mark_x, mark_y, star in picture.marks:
        mark, size = ("*", 11 * text_scale()) if star else ("o", 6 * text_scale())
        axes.plot(mark_x, mark_y, marker=mark, color="white", markeredgecolor="black", markersize=size)
    draw_colour_bar(axes, shown, picture.text if bar is None else bar, below)


def body_marks(snap: Snapshot) -> list[Mark]:
    """Return the marks of star and companions; [] if the run has no centre."""
    if not has_centre(snap):
        return []
    places = np.zeros((1, 2)) if snap.bodies is None else snap.bodies.pos
    return [(float(x), float(y), number == 0) for number, (x, y) in enumerate(axis_unit(snap, "length")[0] * places)]


def draw_scale_bar(axes: Axes, picture: Picture) -> None:
    """Draw a scale bar at the lower left of `axes` with a map; its length is round, and at most 25% of the side."""
    left, right = picture.x
    side, unit = float(right - left), axis_unit(picture.snap, "length")[1].strip(" []")
    bar = round_number(0.25 * side / (picture.scale or 1.0))  # length in the disc, also if the axes are angles
    x, y, long = left + 0.05 * side, picture.y[0] + 0.05 * side, bar * (picture.scale or 1.0)
    under = picture.values[: len(picture.values) // 8 : 8, : picture.values.shape[1] // 3 : 8]
    colour, other = contrast(axes.images[0], under)
    outline = withStroke(linewidth=4.0 if picture.overlays else 1.5, foreground=other)
    style: dict[str, Any] = {"color": colour, "path_effects": [outline]}
    axes.plot([x, x + long], [y, y], lw=1.5 * line_scale(), solid_capstyle="butt", **style)
    text = f"{bar:g} {unit}".strip()
    axes.text(x + 0.5 * long, y + 0.015 * side, text, ha="center", va="bottom", fontsize=9 * text_scale(), **style)


def round_number(most: float) -> float:
    """Return the largest number not above `most` in the series ..., 0.5, 1, 2, 5, 10, ..."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(n for n in (1.0, 2.0, 5.0) if n * power <= most * (1.0 + 1e-9)))


def draw_colour_bar(axes: Axes, image: Any, label: str, below: bool = False) -> None:
    """Draw the colour bar of an image to the right of its axes, or with `below` below them."""
    figure, bar = axes.figure, (1.0 + BAR[0] / MAP, 0.0, BAR[1] / MAP, 1.0)
    assert isinstance(figure, Figure)
    if below:
        axes.apply_aspect()
        height = axes.get_position().height * figure.get_size_inches()[1] / text_scale()
        bar = (0.0, -(BAR_BELOW[0] + BAR_BELOW[1]) / height, 1.0, BAR_BELOW[1] / height)
    bar_axes = axes.inset_axes(bar)
    figure.colorbar(image, cax=bar_axes, label=label, orientation="horizontal" if below else "vertical")
    if isinstance(image.norm, LogNorm):
        width = axes.get_position().width * figure.get_size_inches()[0] / text_scale()
        most = int(width / LABEL_WIDTH) if below else 99
        set_log_ticks(bar_axes.xaxis if below else bar_axes.yaxis, image.norm.vmin, image.norm.vmax, most)


def set_log_ticks(axis: Axis, low: float | None, high: float | None, most: int = 99) -> None:
    """Label at most `most` ticks of a logarithmic axis from `low` to `high` with plain numbers, if these are short.

    matplotlib takes longer to typeset powers of ten than to draw the lines. An axis over at most two decades gets ticks
    at 1, 2 and 5 times powers of ten; over at most a factor of 4 it gets evenly spaced ticks.
    """
    if not low or not high or not (high <= 100.0 * low or PLAIN_RANGE[0] <= low < high < PLAIN_RANGE[1]):
        return
    if high > 100.0 * low:
        axis.set_minor_locator(LogLocator(subs=[2.0, 5.0]))
        axis.set_minor_formatter(NullFormatter())
    else:
        is_wide = high > 4.0 * low
        # Two decades have up to seven ticks at 1, 2 and 5.
        subs = [1.0, 2.0, 5.0] if 3.0 * np.log10(high / low) + 1.0 <= most else [1.0, 3.0]
        even = MaxNLocator(max(1, min(6, most - 1)), steps=[1, 2, 5, 10])
        axis.set_major_locator(LogLocator(subs=subs) if is_wide else even)
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, index: number_text(value)))


def number_text(value: float) -> str:
    """Return a number as short text; a power of ten is written in mathtext."""
    if PLAIN_RANGE[0] <= abs(value) < PLAIN_RANGE[1] or value == 0:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    power = int(np.floor(np.log10(abs(value))))
    return rf"${value / 10.0**power:.3g}\times10^{{{power}}}$"


def points_1d(snap: Snapshot, name: str) -> tuple[Array, Array]:
    """Return positions (n,) and values (n,) of the field `name` of a 1D snapshot, in the units of axes.

    The points are particles, or bins for a field that is computed from other fields. The density of a species is read
    from the snapshot if it is stored. Other densities are the mass between the fourth neighbours on both sides of a
    particle, divided by the distance between these neighbours.
    """
    field, (snap, name) = field_named(name), of_population(name, snap)
    length, factor = axis_unit(snap, "length")[0], field.factor(snap.units)
    if field.kind == "places":
        edges = np.linspace(snap.lower[0], snap.upper[0], RINGS + 1)
        return length * 0.5 * (edges[1:] + edges[:-1]), factor * fields_in_rings(snap, edges)[name]
    p, values = snap.species[field.species], field.values(snap)
    x = p.pos[:, 0]
    if field.kind == "particles":
        return length * x, factor * values
    if p.density is not None and np.array_equal(values, p.mass):
        return length * x, factor * p.density
    order = np.argsort(x)
    x, total = x[order], np.cumsum(values[order])
    return length * x[4:-4], factor * (total[7:-1] - np.append(0.0, total[:-9])) / (x[8:] - x[:-8])
