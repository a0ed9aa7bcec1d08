"""Figures of the report, as PNG data in text: snapshots drawn as in `last_state.png`, and columns of history.csv."""

from __future__ import annotations

import base64
import io
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from discsim.output.figure import last_state_figure
from discsim.output.snapshot import read_snapshot
from discsim.report.conservation import ConservedQuantity
from discsim.scene import Scene
from discsim.scene.orbits import stated_orbit

MIN_CHANGE = 1e-17  # smaller relative changes are drawn at this value, which is below floating-point precision


class Picture(NamedTuple):
    """A figure of the page. `data` is a PNG in base64, and `alt` the text that replaces it for screen readers."""

    data: str
    alt: str
    caption: str


def snapshot_figure(path: Path) -> Picture:
    """Return the figure `last_state.png` for the snapshot in the file `path`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        last_state_figure(path, file)
        data = io.BytesIO()
        Image.open(file).save(data, format="png")  # full compression
    snap = read_snapshot(path)
    when = snap.time_text
    kinds = " and ".join(snap.species)
    return Picture(_base64_text(data.getvalue()), f"{kinds} at t = {when}", f"Snapshot {path.stem}, t = {when}.")


def history_figures(scene: Scene, rows: list[dict[str, str]], found: list[ConservedQuantity]) -> list[Picture]:
    """Return two figures against time: relative changes of the conserved quantities `found`, and the time step.

    rows: rows of history.csv by column.
    """
    time, dt = (np.array([float(row[name]) for row in rows]) for name in ("time", "dt"))
    unit = ""
    if scene.units.system != "code":
        year = float(scene.units.quantity(1.0, "time").to_value("yr"))
        time, dt, unit = year * time, year * dt, " [yr]"
    of_time = unit
    if orbit := stated_orbit(scene.text, scene.units):
        time, of_time = np.array([float(row["time"]) for row in rows]) / orbit.period, f" [{orbit.unit}]"
    changes, first = _new_axes(f"t{of_time}", "relative change")
    for each in found:
        first.plot(time, np.maximum(np.abs(each.change), MIN_CHANGE), label=each.name)
    first.set(yscale="log", ylim=(0.5 * MIN_CHANGE, None))
    first.legend(frameon=False, fontsize=8)
    steps, second = _new_axes(f"t{of_time}", f"step{unit}")
    after_step = dt > 0.0
    second.plot(time[after_step], dt[after_step], ".-", ms=3, lw=0.8, color="tab:gray")
    second.set(ylim=(0.0, None))
    return [
        Picture(_png_text(changes), "changes of totals against time", "Changes of totals."),
        Picture(_png_text(steps), "time steps against time", "Time steps; steps that end at a snapshot are shorter."),
    ]


def _new_axes(x: str, y: str) -> tuple[Figure, Axes]:
    """Return a new figure and its axes, with the labels `x` and `y`."""
    figure = Figure(figsize=(4.8, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    return figure, axes


def _png_text(figure: Figure) -> str:
    """Return a figure as a PNG in base64."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=130)
    return _base64_text(out.getvalue())


def _base64_text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
