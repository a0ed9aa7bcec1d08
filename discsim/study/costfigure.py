"""The figure of a cost study: error against CPU seconds, with a line through runs that differ only in one key."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from discsim.output.drawing import figure_text
from discsim.study.points import label_of
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
        axes.plot(cpu, errors, marker + "-", color=f"C{number % 10}", label=figure_text(name))
        if study.axis:
            for point in (points[0], points[-1]):
                text = figure_text(point.settings[study.axis.keys[0]])
                axes.annotate(text, (point.cpu, point.error or 0.0), (4, 4), textcoords="offset points", fontsize=7)
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
    axes.set(xlabel="CPU time of the steps [s]", ylabel="error")
    if study.exact_error:
        axes.set_title(study.exact_error, fontsize=9)
    elif study.reference is not None:
        axes.set_title(f"compared with {figure_text(label_of(study.reference.settings))}", fontsize=9)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=150, metadata={"Software": f"discsim {__version__}"})
