"""The figure of a sweep: each result against a varied key, with one line per combination of the other settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discsim.output.drawing import figure_text
from discsim.study.points import Point, number_in, points_by_line, short_names
from discsim.version import __version__

if TYPE_CHECKING:
    from discsim.study.outcomes import Outcome
    from discsim.study.sweep import Sweep

LOG_AXIS_RATIO = 10.0  # ratio of the largest to the smallest value above which an axis is logarithmic


def sweep_figure(sweep: Sweep, path: Path) -> None:
    """Draw one panel for each kind of result, and write the PNG file `path`."""
    figure = Figure(figsize=(4.6 * len(sweep.measures), 3.8), layout="constrained")
    panels = figure.subplots(1, len(sweep.measures), squeeze=False)[0]
    for axes, measure in zip(panels, sweep.measures, strict=True):
        _draw_panel(axes, sweep, measure)
    if panels[0].get_legend_handles_labels()[1] != ["all"]:
        panels[0].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=150, metadata={"Software": f"discsim {__version__}"})


def _draw_panel(axes: Axes, sweep: Sweep, measure: Outcome) -> None:
    """Draw one kind of result against the varied key; values that are no numbers of one unit are equally spaced."""
    axis = sweep.axis or max(sweep.varied, key=lambda each: len(each.values))
    units = {unit_in(axis.settings(value)[axis.keys[0]]) for value in axis.values}
    numeric = axis.numbers is not None and len(units) == 1
    first = [axis.settings(value)[axis.keys[0]] for value in axis.values]

    def position(point: Point) -> float:
        value = point.settings[axis.keys[0]]
        return float(number_in(value) or 0.0) if numeric else float(first.index(value))

    done = [point for point in sweep.points if point.done]
    for number, (name, points) in enumerate(points_by_line(done, axis).items()):
        along = sorted(points, key=position)
        values = [point.runs[0][measure.name] for point in along]
        axes.plot([position(point) for point in along], values, "osD^v"[number % 5] + "-", label=figure_text(name))
    unit = next(iter(units)) if numeric else ""
    axes.set(xlabel=figure_text(short_names(axis.keys)[0] + (f" [{unit}]" if unit else "")), ylabel=measure.head)
    if not numeric:
        axes.set_xticks(range(len(first)), [figure_text(each) for each in first])
    elif min(axis.numbers) > 0.0 and max(axis.numbers) > LOG_AXIS_RATIO * min(axis.numbers):
        axes.set_xscale("log")
    axes.grid(alpha=0.3)


def unit_in(text: str) -> str:
    """Return the unit in a value such as "10 au"; "" for a plain number."""
    return text.strip("\"'").partition(" ")[2].strip()
