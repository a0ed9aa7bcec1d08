"""Figures of maps on the sky: axes in arcsec, beam, scale bar, north and east."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output import style
from discsim.output.bins import density_range
from discsim.output.drawing import BAR_BELOW, MIN_SIDE, axes_at, broken, draw_colour_bar, figure_text, round_number
from discsim.output.fields.base import PlotError
from discsim.output.ink import checked_colour_map, contrast, line_scale, shade, text_scale
from discsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from discsim.sky.image import SkyMap

Array = np.ndarray
STRETCHES = ("linear", "sqrt", "log")
COLOURS = {"intensity": "inferno", "velocity": "RdBu_r", "residual": "RdBu_r", "spectral index": "viridis"}
LABELS = {
    "velocity": r"$v_\mathrm{los}$ [km s$^{-1}$]",
    "residual": r"$v_\mathrm{los} - v_\mathrm{Kepler}$ [km s$^{-1}$]",
    "spectral index": r"spectral index $\alpha$",
}
SIDE, LEFT, RIGHT, BOTTOM, TOP = 4.6, 0.85, 1.35, 1.15, 0.8  # inches: side of a map, and space around it


def draw_map(
    sky: SkyMap, ax: Axes | None = None, limits: tuple[float, float] | None = None, stretch: str = "linear",
    cmap: Any = None, below: bool = False,
) -> Axes:  # fmt: skip
    """Draw a map on axes, new ones by default, with wavelength and time as title. Raises PlotError.

    `limits` are in the unit of the colour bar. `cmap` is a colour map of matplotlib. The colour bar is to the right of
    the map, or with `below` below it.
    """
    colours = COLOURS[sky.quantity] if cmap is None else checked_colour_map(cmap)
    if stretch not in STRETCHES:
        raise PlotError(f'stretch: "{stretch}"; expected one of {", ".join(STRETCHES)}')
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots()[1]
    factor, label = _unit_of(sky)
    values = factor * sky.values
    half_x, _, _, half_y = sky.extent
    image = ax.imshow(
        values,
        origin="lower",
        extent=sky.extent,
        norm=_norm_of(sky.quantity, values, limits, stretch),
        cmap=colours,
        interpolation="nearest",
    )
    ax.set_facecolor(shade(0.15))  # grey where the values are NaN
    ax.set(xlabel=r"$\Delta$RA [arcsec]", ylabel=r"$\Delta$Dec [arcsec]")
    ax.set_title(_short_title(sky), fontsize=10 * text_scale())
    edge = max(1, len(values) // 6)  # the rows below and above, where the marks are
    ink = contrast(image, np.concatenate([values[:edge], values[-edge:]]))[0]
    _draw_beam(ax, sky, ink, (half_x, half_y))
    _draw_scale_bar(ax, sky, ink, (half_x, half_y))
    _draw_directions(ax, ink, (half_x, half_y))
    draw_colour_bar(ax, image, label, below)
    return ax


def figure_of(maps: Sequence[SkyMap], **options: Any) -> Figure:
    """Return a figure with the maps in a row, a title, and a text about how the maps were made. Raises PlotError.

    A single map, and maps in a style with a width, have the colour bar below them.
    """
    from matplotlib.figure import Figure

    look, text, count = style.current(), text_scale(), len(maps)
    below = count == 1 or look.several is not None
    left, right = (LEFT * text, (0.15 if below else RIGHT) * text)
    total = (look.one if count == 1 else look.several) or 0.0
    width = total / count - left - right if below else SIDE
    titles = ["\n".join(broken(_panel_title(sky), width, 10 * text)) for sky in maps]
    notes = ["\n".join(_notes(sky, width)) for sky in maps]
    heads = broken(figure_text(maps[0].title), total or count * (left + SIDE + right) - left, 11 * text)
    above = (look.line * (max(title.count("\n") for title in titles) + len(heads) - 1) + TOP) * text
    bar = BAR_BELOW[2] * text if below else 0.0
    bottom = bar + (BOTTOM + (0.13 * max(0, max(note.count("\n") for note in notes) - 2))) * text
    side = max(min(width, max(look.height - above - bottom, MIN_SIDE * text)), 0.5)
    pitch, height = left + side + right, bottom + side + above
    figure = Figure(figsize=(pitch * count, height), dpi=look.resolution(count == 1))
    for number, (sky, title, note) in enumerate(zip(maps, titles, notes, strict=True)):
        ax = axes_at(figure, number * pitch + left, bottom, side, side)
        draw_map(sky, ax, below=below, **options)
        ax.set_title(title, fontsize=10 * text)
        where = -(0.55 * text + bar) / side
        ax.text(0.0, where, note, transform=ax.transAxes, fontsize=7.5 * text, va="top", color=shade(0.65))
    across = pitch * count
    figure.text(left / across, 1 - 0.17 * text / height, "\n".join(heads), fontsize=11 * text, va="top")
    version = f"discsim {__version__}"
    figure.text(1 - 0.1 / across, 0.1 / height, version, fontsize=6 * text, ha="right", color=shade(0.5))
    return figure


def _notes(sky: SkyMap, width: float) -> list[str]:
    """Return the lines about how a map was made, at most `width` inches wide."""
    return [part for line in sky.description for part in broken(figure_text(line), width, 7.5 * text_scale())]


def _panel_title(sky: SkyMap) -> str:
    angles = np.degrees([sky.orientation.inclination, sky.orientation.position_angle])
    seen = "face-on" if angles[0] == 0.0 else f"i = {angles[0]:.3g}$\\degree$, PA = {angles[1]:.3g}$\\degree$"
    return f"{_short_title(sky)}, {sky.distance:g} pc, {seen}"


def _short_title(sky: SkyMap) -> str:
    """Return the wavelength, or the quantity of a map without one, and the time."""
    what = f"{sky.wavelength:g}" if sky.wavelength is not None else sky.quantity
    return f"{what}, {figure_text(sky.time)}"


def _unit_of(sky: SkyMap) -> tuple[float, str]:
    """Return the factor from the unit of a map to that of its colour bar, and the label of the bar."""
    if sky.quantity != "intensity":
        return 1.0, LABELS[sky.quantity]
    top = float(np.nanmax(np.abs(sky.values), initial=0.0))
    prefix, factor = next(
        ((name, size) for name, size in (("", 1.0), ("m", 1e3), (r"$\mu$", 1e6)) if top * size >= 0.5), ("n", 1e9)
    )
    return factor, rf"$I_\nu$ [{prefix}{sky.unit}]"


def _norm_of(quantity: str, values: Array, limits: tuple[float, float] | None, stretch: str) -> Normalize:
    from matplotlib.colors import LogNorm, Normalize, PowerNorm

    if quantity == "intensity":
        if stretch == "log":
            low, high = limits or density_range(values)
            return LogNorm(low, high, clip=True)
        low, high = limits or (min(0.0, float(values.min(initial=0.0))), float(values.max(initial=0.0)) or 1.0)
        return PowerNorm(0.5, low, high, clip=True) if stretch == "sqrt" else Normalize(low, high, clip=True)
    seen = values[np.isfinite(values)]
    if limits is None and quantity == "spectral index":
        limits = (float(seen.min(initial=4.0)), float(seen.max(initial=0.0))) if seen.size else (0.0, 4.0)
    if limits is None:
        most = float(np.quantile(np.abs(seen), 0.995)) if seen.size else 1.0
        limits = (-(most or 1.0), most or 1.0)
    return Normalize(*limits, clip=True)


def _draw_beam(ax: Axes, sky: SkyMap, ink: str, half: tuple[float, float]) -> None:
    """Draw the beam's half-maximum ellipse in the lower left corner."""
    if sky.beam is None:
        return
    from matplotlib.patches import Ellipse

    major, minor = (float(width.to_value("arcsec")) for width in (sky.beam.major, sky.beam.minor))
    # matplotlib measures angles in data coordinates, whose x is the offset to the east.
    turned = 90.0 - float(sky.beam.pa.to_value("deg"))
    place = (half[0] - 0.06 * half[0] - 0.5 * major, -half[1] + 0.06 * half[1] + 0.5 * major)
    ax.add_patch(Ellipse(place, major, minor, angle=turned, facecolor=ink, edgecolor="none", alpha=0.9))


def _draw_scale_bar(ax: Axes, sky: SkyMap, ink: str, half: tuple[float, float]) -> None:
    """Draw a bar of a round number of au in the lower right corner."""
    au = round_number(0.5 * half[0] * sky.distance)
    length = au / sky.distance
    left, y = -0.94 * half[0] + length, -0.92 * half[1]
    ax.plot([left, left - length], [y, y], color=ink, lw=1.5 * line_scale(), solid_capstyle="butt")
    ax.text(
        left - 0.5 * length,
        y + 0.03 * half[1],
        f"{au:g} au",
        color=ink,
        ha="center",
        va="bottom",
        fontsize=9 * text_scale(),
    )


def _draw_directions(ax: Axes, ink: str, half: tuple[float, float]) -> None:
    """Draw arrows to the north and to the east in the upper right corner."""
    x, y, long = -0.88 * half[0], 0.72 * half[1], 0.16 * half[0]
    for dx, dy, name in ((0.0, long, "N"), (long, 0.0, "E")):
        ax.annotate(
            "", (x + dx, y + dy), (x, y), arrowprops={"arrowstyle": "-|>", "color": ink, "lw": 1.0, "shrinkA": 0}
        )
        ax.text(x + 1.3 * dx, y + 1.3 * dy, name, color=ink, fontsize=8 * text_scale(), ha="center", va="center")
