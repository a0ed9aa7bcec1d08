"""Lines and points of figures: profiles, and phase plots of one field of the particles against another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.transforms import ScaledTranslation

from discsim.output.drawing import axis_unit, draw_colour_bar, points_1d, set_log_ticks
from discsim.output.fields.base import Field, PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.names import field_label, field_named, of_population, species_text, split_population
from discsim.output.fields.values import smooth_profile
from discsim.output.ink import line_colour, line_scale, text_scale

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
MAX_CELLS = 160  # largest number of cells of a phase plot along each axis
MAX_INSIDE = 4  # largest number of curves or entries with which a legend is inside the axes of a figure
MAX_COLUMNS = 4  # largest number of columns of a legend below axes
MAX_DECADES = 4.5  # largest number of decades on the axis of a density


def profile_curves(snap: Snapshot, names: Sequence[str], display: DisplayOptions) -> dict[str, tuple[Array, Array]]:
    """Return for each field a curve (radii, values), or in 1D (x, values) of the particles, in the units of axes."""
    if snap.dimensions == 1:
        return {name: points_1d(snap, name) for name in names}
    edges, binned = smooth_profile(snap, display.radii(snap), display.optics, display.log_radius)
    radius = axis_unit(snap, "length")[0] * 0.5 * (edges[1:] + edges[:-1])
    return {name: (radius, field_named(name).factor(snap.units) * binned[name]) for name in names}


def draw_curve(axes: Axes, snap: Snapshot, curve: tuple[Array, Array], field: Field, **style: Any) -> None:
    """Draw a curve as a line, or in 1D as points; zeros of a field with a logarithmic scale are omitted."""
    x, values = curve
    if field.scale == "log":
        values = np.where(values > 0, values, np.nan)
    if snap.dimensions == 1:
        style = {**style, "ls": "none", "marker": ".", "ms": 3}
    if "color" in style:
        style["color"] = line_colour(style["color"])
    axes.plot(x, values, **style)


def finish_profile(axes: Axes, snap: Snapshot, names: Sequence[str], display: DisplayOptions) -> None:
    """Set labels and scale of axes after their curves are drawn, and draw a legend inside."""
    field, (length, unit) = field_named(names[0]), axis_unit(snap, "length")
    low, high = display.radii(snap)
    axes.set(xlabel=f"{'r' if snap.dimensions == 2 else 'x'}{unit}", xlim=(length * low, length * high))
    of_all = len(set(axes.get_legend_handles_labels()[1])) > 1 and len(names) > 1
    if display.log_radius:
        axes.set_xscale("log")
        set_log_ticks(axes.xaxis, length * low, length * high)
    label = field_label(names[0], snap, of_all, of_each=snap.dimensions == 1)
    if axes.get_ylabel() not in ("", label):  # axes with curves of another species or population
        label = field_label(names[0], snap, of_all=True)
    axes.set_ylabel(label)
    lines = [line for line in axes.lines if line.get_transform().contains_branch_seperately(axes.transData)[1]]
    shown = [y[np.isfinite(y)] for y in (np.asarray(line.get_ydata(), dtype=float) for line in lines)]
    peaks = [y.max() for y in shown if y.size]
    if field.scale == "log" and peaks and _decades_spanned(shown) > 0.3:
        axes.set_yscale("log")
        if field.kind == "density":  # a lone particle, or a faint tail, must not determine the scale or its margin
            bottom, top = axes.get_ylim()
            axes.set_ylim(max(bottom, min(peaks) * 10**-MAX_DECADES), min(top, 2.0 * max(peaks)), auto=None)
    if display.limits is not None:
        axes.set_ylim(*display.limits)
    if axes.get_yscale() == "log":
        set_log_ticks(axes.yaxis, *axes.get_ylim())
    if field.scale == "signed":
        axes.axhline(0.0, color="0.5", lw=0.8 * line_scale(), zorder=0)
    axes.grid(alpha=0.3)
    if len(handles := axes.get_legend_handles_labels()[0]) > 1:
        draw_legend(axes, handles)


def draw_legend(axes: Axes, handles: Sequence[Any], under: float | None = None) -> None:
    """Draw a legend of several artists in the axes; with `under` below them, at this distance in inches."""
    if (legend := axes.get_legend()) is not None:
        legend.remove()
    style: dict[str, Any] = {"framealpha": 0.85, "edgecolor": "none", "fontsize": 9 * text_scale()}
    if not handles:
        return
    if under is None:
        axes.legend(handles=handles, **style)  # it may lie over marks
        return
    figure: Any = axes.figure
    place = axes.transAxes + ScaledTranslation(0.0, -under, figure.dpi_scale_trans)
    for columns in range(MAX_COLUMNS, 0, -1):
        legend = axes.legend(
            handles=handles, ncols=columns, loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=place,
            borderaxespad=0.0, **style,
        )  # fmt: skip
        if legend.get_window_extent().width <= axes.get_window_extent().width:
            return


def legend_height(axes: Axes, under: float) -> float:
    """Return the height in inches that the legend of axes needs below the distance `under` from them; 0 if inside."""
    legend = axes.get_legend()
    if legend is None:
        return 0.0
    bottom = legend.get_window_extent().y0
    return max(0.0, (axes.get_window_extent().y0 - bottom) / axes.figure.dpi - under)


def _decades_spanned(shown: Sequence[Array]) -> float:
    """Return log10 of the largest over the smallest value; 0 if some value is not positive."""
    values = np.concatenate(shown)
    return float(np.log10(values.max() / values.min())) if values.size and values.min() > 0 else 0.0


def draw_phase(
    axes: Axes, snap: Snapshot, name: str, against: str, display: DisplayOptions, below: bool = False
) -> None:
    """Draw the distribution of particle mass over the fields `against` (x) and `name` (y). Raises PlotError.

    An axis is logarithmic if its field has a logarithmic scale and spans more than a factor of 3. The colour bar is to
    the right of the axes, or with `below` below them.
    """
    fields = field_named(against), field_named(name)
    for each, field in zip((against, name), fields, strict=True):
        same = field.species == fields[1].species and split_population(each)[0] == split_population(name)[0]
        if field.kind != "particles" or not same:
            of = fields[1].species or "one species"
            raise PlotError(
                f"{each}: not a particle field of {of}; choose particle fields of one species, like "
                f"dust.v_r, for the two axes"
            )
    whole, snap = snap, of_population(name, snap)[0]
    values = [field.factor(snap.units) * field.values(snap) for field in fields]
    cells = int(np.clip(0.7 * len(values[0]) ** 0.5, 20, MAX_CELLS))
    edges = [_bin_edges(field, array, cells) for field, array in zip(fields, values, strict=True)]
    if display.limits is not None:
        edges[1] = _axis_edges(fields[1], *display.limits, cells)
    mass = snap.species[fields[1].species].mass
    total, _, _ = np.histogram2d(values[0], values[1], (edges[0], edges[1]), weights=mass / max(mass.sum(), 1e-300))
    fraction = np.where(total > 0, total, np.nan)
    seen = fraction[np.isfinite(fraction)]
    norm = LogNorm(max(seen.min(), 1e-5 * seen.max()), seen.max(), clip=True) if seen.size else LogNorm(0.1, 1.0)
    image = axes.pcolormesh(*edges, fraction.T, norm=norm, cmap=display.cmap or "viridis", rasterized=True)
    for axis, field, ends in ((axes.xaxis, fields[0], edges[0]), (axes.yaxis, fields[1], edges[1])):
        if _is_log(field, ends):
            getattr(axes, f"set_{axis.axis_name}scale")("log")
            set_log_ticks(axis, ends[0], ends[-1])
    axes.set(xlabel=fields[0].text(snap.units), ylabel=field_label(name, whole, of_each=True))
    draw_colour_bar(axes, image, f"mass fraction of {species_text(name, whole, of_each=True)}", below)


def _is_log(field: Field, edges: Array) -> bool:
    """Return whether the axis of a field with bins `edges` is logarithmic."""
    return field.scale == "log" and edges[0] > 0 and edges[-1] > 3 * edges[0]


def _bin_edges(field: Field, values: Array, cells: int) -> Array:
    """Return edges (cells + 1,) that span 99.8% of the values and a margin."""
    values = values[np.isfinite(values) & ((values > 0) | (field.scale != "log"))]
    if not values.size:
        return np.linspace(0.0, 1.0, cells + 1)
    low, high = (float(each) for each in np.quantile(values, (0.001, 0.999)))
    room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    if field.scale == "log":
        return _axis_edges(field, low / 1.1, high * 1.1, cells)
    return _axis_edges(field, low - room, high + room, cells)


def _axis_edges(field: Field, low: float, high: float, cells: int) -> Array:
    """Return edges (cells + 1,) from `low` to `high`, equally spaced on the axis of the field."""
    even = field.scale != "log" or low <= 0 or high <= 3 * low
    return np.linspace(low, high, cells + 1) if even else np.geomspace(low, high, cells + 1)
