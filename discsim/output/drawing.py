"""What figures share: a map of a field with colour bar, star, companions and scale bar, and axes with units."""

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
from discsim.output.fields.base import WRITTEN, Field
from discsim.output.fields.values import Window, has_centre, in_rings
from discsim.parts import FIELDS
from discsim.printable import printable

if TYPE_CHECKING:
    from discsim.output.fields.binned import Binned
    from discsim.output.snapshot import Snapshot

Array = np.ndarray

DOLLAR = re.compile(r"(?<!\\)\$")  # one that begins or ends mathematics
WIDEST = 2000.0  # points of a line with mathematics: what is wider is no title, and may take all memory

# Of Okabe & Ito (2008), which the colour-blind tell apart, and lines of their own for print without colour.
COLOURS = {"gas": "#0072B2", "dust": "#D55E00", "small_dust": "#009E73"}
STYLES = {"gas": "-", "dust": "-", "small_dust": "--"}
PIXELS = 480
PLAIN = (1e-4, 1e5)  # numbers that are written without a power of ten

# In inches. Axes are put where they go: to let matplotlib find room for their labels takes longer than to draw them.
LEFT, RIGHT, BELOW, TITLE = 0.85, 0.25, 0.55, 0.9  # room beside and under axes; that of titles
COLUMN, MAP, ROW = 5.8, 3.9, 2.9  # pitch of maps, their side, pitch of profiles
BAR = (0.08, 0.2)  # distance and width of a colour bar


def figure_text(text: str) -> str:
    """A text of a user for a figure: mathematics between dollars where matplotlib can typeset it, else as it stands."""
    line = printable(text)
    if not DOLLAR.search(line) or (len(DOLLAR.findall(line)) % 2 == 0 and _typesets(line)):
        return line
    return DOLLAR.sub(r"\\$", line)


def _typesets(line: str) -> bool:
    """True if matplotlib can typeset a line with mathematics, in a size that a figure has."""
    try:
        width, height, *_ = MathTextParser("path").parse(line)
    except Exception:  # of whatever kind: it is the text of a user that matplotlib cannot read
        return False
    return max(width, height) < WIDEST


def in_units(snap: Snapshot, dimension: str) -> tuple[float, str]:
    """The factor from code units to those of the axes, and their name in brackets."""
    plain = Field("particles", "", np.asarray, dimension, "")
    unit = plain.shown_unit(snap.units)
    return plain.factor(snap.units), f" [{WRITTEN.get(unit, unit)}]" if unit else ""


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes with their lower left corner at a place of the figure; all in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.ticklabel_format(useOffset=False, scilimits=(-3, 4))  # never wider than there is room
    return axes


def norm_of(pictures: Iterable[Picture]) -> Normalize:
    """The colours that pictures of one field share: of its mass, of all but half a per cent at each end, or about 0."""
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
    # What is nearly the same everywhere has a range too.
    room = max(0.05 * abs(high), 1e-300) if high - low < 0.05 * abs(high) else 0.0
    return Normalize(low - room, high + room, clip=True)


Mark = tuple[float, float, bool]  # x, y in the units of axes, and whether it is the star


@dataclass(frozen=True)
class Picture:
    """Values [y, x] of a field between edges of x and of y, in the units of axes; with what else is drawn there.

    marks: places of star and companions. scale: of a map, how many units of x are an au (or a code unit); None for
    any other, whose axes need not have the same scale.
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
        """What the colours show."""
        return self.field.text(self.snap.units)


def map_picture(binned: Binned, name: str, window: Window, sky: float | None = None) -> Picture:
    """A field on the pixels of a window."""
    snap, field = binned.snap, FIELDS[name]
    length, unit = in_units(snap, "length")
    length, unit = (length, unit) if sky is None else (length * sky, " [arcsec]")
    values = field.factor(snap.units) * binned[name].T
    x, y = (length * np.array([low, high]) for low, high in zip(*window, strict=True))
    at = sky or 1.0
    marks = [(at * mx, at * my, star) for mx, my, star in bodies(snap)]
    inside = [mark for mark in marks if x[0] <= mark[0] <= x[1] and y[0] <= mark[1] <= y[1]]
    return Picture(snap, name, values, x, y, (f"x{unit}", f"y{unit}"), inside, at)


def draw(axes: Axes, picture: Picture, norm: Normalize, colours: str | None = None, bar: str | None = None) -> None:
    """A picture and its colour bar, with the text `bar` in place of what the field says of itself."""
    values, x, y = picture.values, picture.x, picture.y
    if isinstance(norm, LogNorm) and picture.field.kind == "density" and bar is None:
        values = np.maximum(values, 1e-300)  # nothing has the colour of little
    style: dict[str, Any] = {"norm": norm, "cmap": colours or picture.field.colours}
    if len(x) == len(y) == 2:
        extent = (x[0], x[1], y[0], y[1])
        equal: Any = "equal" if picture.scale is not None else "auto"
        shown: Any = axes.imshow(values, origin="lower", extent=extent, aspect=equal, interpolation="bilinear", **style)
    else:
        shown = axes.pcolormesh(x, y, values, rasterized=True, **style)
    axes.set_facecolor("0.85")  # where there is nothing of which a mean could be taken
    axes.set(xlabel=picture.labels[0], ylabel=picture.labels[1])
    for mark_x, mark_y, star in picture.marks:
        mark, size = ("*", 11) if star else ("o", 6)
        axes.plot(mark_x, mark_y, marker=mark, color="white", markeredgecolor="black", markersize=size)
    colour_bar(axes, shown, picture.text if bar is None else bar)


def bodies(snap: Snapshot) -> list[Mark]:
    """Places of the star and its companions in the units of axes, and whether it is the star."""
    if not has_centre(snap):
        return []
    places = np.zeros((1, 2)) if snap.bodies is None else snap.bodies.pos
    return [(float(x), float(y), number == 0) for number, (x, y) in enumerate(in_units(snap, "length")[0] * places)]


def scale_bar(axes: Axes, picture: Picture) -> None:
    """A length of a round number, at most a quarter of the window, in the lower left corner of a map that is drawn."""
    left, right = picture.x
    side, unit = float(right - left), in_units(picture.snap, "length")[1].strip(" []")
    bar = round_number(0.25 * side / (picture.scale or 1.0))  # of the disc, also where axes are angles
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
    """The greatest of 1, 2, 5, 10 ... that is at most this."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(n for n in (1.0, 2.0, 5.0) if n * power <= most * (1.0 + 1e-9)))


def colour_bar(axes: Axes, image: Any, label: str) -> None:
    """Beside the axes of an image."""
    beside = axes.inset_axes((1.0 + BAR[0] / MAP, 0.0, BAR[1] / MAP, 1.0))
    figure = axes.figure
    assert isinstance(figure, Figure)
    figure.colorbar(image, cax=beside, label=label)
    if isinstance(image.norm, LogNorm):
        log_ticks(beside.yaxis, image.norm.vmin, image.norm.vmax)


def log_ticks(axis: Axis, low: float | None, high: float | None) -> None:
    """Plain numbers on a logarithmic axis: of two decades or less, where powers of ten are too few, 1, 2 and 5 of each.

    Powers that matplotlib typesets take longer than the lines that they are beside.
    """
    if not low or not high or not (high <= 100.0 * low or PLAIN[0] <= low < high < PLAIN[1]):
        return
    if high > 100.0 * low:
        axis.set_minor_locator(LogLocator(subs=[2.0, 5.0]))
        axis.set_minor_formatter(NullFormatter())
    else:
        axis.set_major_locator(
            LogLocator(subs=[1.0, 2.0, 5.0]) if high > 4.0 * low else MaxNLocator(6, steps=[1, 2, 5, 10])
        )
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, place: plain(value)))


def plain(value: float) -> str:
    """A number as short as it can be, in mathtext where it needs a power of ten."""
    if PLAIN[0] <= abs(value) < PLAIN[1] or value == 0:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    power = int(np.floor(np.log10(abs(value))))
    return rf"${value / 10.0**power:.3g}\times10^{{{power}}}$"


def points(snap: Snapshot, name: str) -> tuple[Array, Array]:
    """Places and values of a field of one dimension, in the units of axes: of particles, or between them.

    A density is the stored one, or the mass between fourth neighbours over their distance.
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
