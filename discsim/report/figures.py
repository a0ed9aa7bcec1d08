"""Figures of the page as PNG data: snapshots as in `last_state.png`, and columns of history.csv."""

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
from discsim.report.totals import Totals
from discsim.scene import Scene

LEAST = 1e-17  # smallest change on the axis, below floating-point precision


class Picture(NamedTuple):
    """A figure: a PNG in base64, its text alternative, and its caption."""

    data: str
    alt: str
    caption: str


def of_snapshot(path: Path) -> Picture:
    """Return the figure of a snapshot."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        last_state_figure(path, file)
        data = io.BytesIO()
        Image.open(file).save(data, format="png")  # full compression
    snap = read_snapshot(path)
    when = snap.units.show_time(snap.time)
    kinds = " and ".join(snap.species)
    return Picture(_text(data.getvalue()), f"{kinds} at t = {when}", f"Snapshot {path.stem}, t = {when}.")


def of_history(scene: Scene, rows: list[dict[str, str]], found: list[Totals]) -> list[Picture]:
    """Return the figures of changes of conserved quantities and of step lengths against time."""
    time, dt = (np.array([float(row[name]) for row in rows]) for name in ("time", "dt"))
    unit = ""
    if scene.units.system != "code":
        year = float(scene.units.quantity(1.0, "time").to_value("yr"))
        time, dt, unit = year * time, year * dt, " [yr]"
    changes, first = _axes(f"t{unit}", "change, over its size")
    for each in found:
        first.plot(time, np.maximum(np.abs(each.change), LEAST), label=each.name)
    first.set(yscale="log", ylim=(0.5 * LEAST, None))
    first.legend(frameon=False, fontsize=8)
    steps, second = _axes(f"t{unit}", f"step{unit}")
    made = dt > 0.0
    second.plot(time[made], dt[made], ".-", ms=3, lw=0.8, color="tab:gray")
    second.set(ylim=(0.0, None))
    return [
        Picture(_png(changes), "changes of totals against time", "Changes of totals."),
        Picture(_png(steps), "time steps against time", "Time steps; steps that end at a snapshot are shorter."),
    ]


def _axes(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(4.8, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    return figure, axes


def _png(figure: Figure) -> str:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=130)
    return _text(out.getvalue())


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
