"""The figure of a cost study: error against CPU seconds, with a line through runs that differ only in one key."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from discsim.output.drawing import figure_text
from discsim.study.points import ALL, label_of
from discsim.version import __version__

if TYPE_CHECKING:
    from discsim.study.cost import Study


def cost_figure(study: Study, path: Path) -> None:
    """Draw the runs in lines, the Pareto front (circles), and slopes of -1 and -2, and write the PNG file `path`."""
    figure = Figure(figsize=(7.5, 5.5), layout="constrained")
    axes = figure.add_subplot()
    for number, (name, points) in enumerate(study.lines().items()):
        marker = "osD^vP*X<>"[number % 10]
        cpu, errors = [point.cpu for point in points], [point.error for point in points]
        label = figure_text(name if name != ALL else "runs")
        axes.plot(cpu, errors, marker + "-", color=f"C{number % 10}", label=label)
    front = study.front()
    if front:
        label = "Pareto-optimal"
        best = [point.cpu for point in front], [point.error for point in front]
        axes.plot(*best, "o:", color="black", lw=0.8, ms=13, mfc="none", label=label)
        known = [point.cpu for point in study.points if point.error]
        ends, start = np.array([min(known), max(known)]), front[0]
        for power, style in ((1, "--"), (2, "-.")):
            slope = (start.error or 0.0) * (ends / start.cpu) ** -power
            axes.plot(ends, slope, style, color="0.7", lw=0.8, zorder=0, label=f"CPU$^{{-{power}}}$")
    errors = [point.error for point in study.points if point.error]
    if errors:
        axes.set(xscale="log", yscale="log", ylim=(0.5 * min(errors), 2.0 * max(errors)))
    axes.margins(x=0.08)
    if study.axis:
        _write_values(study, axes)
    axes.set(xlabel="CPU time of the steps [s]", title=figure_text(study.title))
    axes.set_ylabel(f"error: {_words_of_error(study)}", wrap=True)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    note = f"numbers at the points: {figure_text(study.axis.keys[0])}" if study.axis else None
    axes.legend(frameon=False, fontsize=8, title=note, title_fontsize=8)
    figure.savefig(path, dpi=150, metadata={"Software": f"discsim {__version__}"})


def _write_values(study: Study, axes: Axes) -> None:
    """Write the value of the first key of `study.axis` at both ends of each line, inside the frame."""
    assert study.axis is not None
    known = [point.cpu for point in study.points if point.error]
    for points in study.lines().values():
        for point in {id(point): point for point in (points[0], points[-1])}.values():
            text = figure_text(point.settings[study.axis.keys[0]])
            is_left = point.cpu**2 <= min(known) * max(known)  # in the left half of the figure
            offset, side = ((5, 5), "left") if is_left else ((-5, 5), "right")
            place = (point.cpu, point.error or 0.0)
            axes.annotate(text, place, offset, ha=side, textcoords="offset points", fontsize=8)


def _words_of_error(study: Study) -> str:
    """Return how the error is defined."""
    if study.exact_error or study.reference is None:
        return figure_text(study.exact_error or "not known")
    return f"mass displaced relative to the run with {figure_text(label_of(study.reference.settings, whole=True))}"
