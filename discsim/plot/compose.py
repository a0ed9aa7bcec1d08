"""Figures with several panels, for several fields, runs or times; panels of one field share their colour range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from discsim.output.drawing import (
    BELOW,
    COLOURS,
    COLUMN,
    LEFT,
    MAP,
    RIGHT,
    STYLES,
    Picture,
    axes_at,
    draw,
    figure_text,
    norm_of,
    scale_bar,
)  # fmt: skip
from discsim.output.fields.binned import Optics
from discsim.output.fields.look import Look
from discsim.output.fields.names import available_fields, matching_fields
from discsim.output.snapshot import Snapshot
from discsim.parts import FIELDS
from discsim.plot import curves, pictures
from discsim.plot.sources import NamedSnapshot

MAX_PANELS_PER_ROW = 3  # largest number of panels per row for one run
PROFILE_WIDTH = 1.25  # width of a profile over that of a map
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")  # colours of Okabe & Ito (2008)
Norms = Mapping[str, Normalize]
Draw = Callable[[Axes], None]


@dataclass
class PanelFigure:
    """A figure of panels in rows. Each panel is a function that draws on axes; `notes` are lines below the title."""

    title: str
    rows: list[list[Draw]]
    width: float = 1.0  # width of a panel over that of a map
    notes: list[str] = field(default_factory=list)
    has_titles: bool = False  # whether panels have titles
    extra_space: float = 0.0  # additional space between panels, in inches

    def figure(self) -> Figure:
        """Return the figure, with a canvas that does not depend on pyplot."""
        pitch, row = (
            COLUMN + (self.width - 1.0) * MAP + self.extra_space,
            MAP + BELOW + (0.5 if self.has_titles else 0.25),
        )
        most = max(len(panels) for panels in self.rows)
        lines = self.title.count("\n") + 1 + len(self.notes) if self.title or self.notes else 0
        top = 0.2 + 0.22 * lines + (0.25 if self.has_titles else 0.0)
        width = pitch * most + (0.2 if self.width == 1.0 else RIGHT - 0.9)
        figure = Figure(figsize=(width, row * (len(self.rows) - 1) + MAP + BELOW + top))
        FigureCanvasAgg(figure)
        for down, panels in enumerate(self.rows):
            bottom = BELOW + row * (len(self.rows) - 1 - down)
            for across, panel in enumerate(panels):
                panel(axes_at(figure, LEFT + pitch * across, bottom, MAP * self.width, MAP))
        high = figure.get_size_inches()[1]
        figure.suptitle(
            "\n".join(text for text in (self.title, *self.notes) if text), y=1.0 - 0.12 / high, va="top", fontsize=12
        )
        return figure


def words_to_names(words: Sequence[str], snaps: Sequence[Snapshot]) -> list[list[str]]:
    """Return for each word the field names that match it and that all snapshots have. Raises FieldError.

    Without such a name, the names in the first snapshot are returned.
    """
    found = []
    for word in words:
        of_each = [available_fields(word, snap) for snap in snaps]
        found.append([name for name in of_each[0] if all(name in names for names in of_each)] or of_each[0])
    return found


def unique_names(names: Sequence[Sequence[str]]) -> list[str]:
    """Return the names in nested sequences as one list in the same order, without repetitions."""
    return list(dict.fromkeys(name for several in names for name in several))


def default_words(dimensions: int) -> list[str]:
    """Return the fields drawn by default."""
    return ["surface_density"] if dimensions == 2 else ["surface_density", "v_x"]


def matching_names(words: Sequence[str]) -> list[str]:
    """Return all field names that match the words, whether or not a snapshot has them. Raises FieldError."""
    return unique_names([matching_fields(word) for word in words])


def picture_panels(
    made: Sequence[Mapping[str, Picture]], titles: Sequence[str], look: Look, norms: Norms | None = None,
    compare: bool = False,
) -> list[list[Draw]]:  # fmt: skip
    """Return panels of pictures: one row per field and one column per run.

    `made` has the pictures of each run by field. `norms` has colour ranges by field; by default they are computed
    from the pictures. A single run has up to MAX_PANELS_PER_ROW panels per row. `compare` adds a column with the
    ratio or difference of two runs.
    """
    rows = []
    for name in made[0]:
        together = [each[name] for each in made]
        norm = (norms or {}).get(name) or colour_range(look, norm_of(together), together[0])
        row = [_picture_panel(picture, norm, title) for picture, title in zip(together, titles, strict=True)]
        if compare:
            change, between, label = pictures.comparison(*together)
            row.append(_picture_panel(change, between, f"{titles[1]} against {titles[0]}", "RdBu_r", label))
        rows.append(row)
    if len(made) == 1:
        panels = [row[0] for row in rows]
        across = math.ceil(len(panels) / math.ceil(len(panels) / MAX_PANELS_PER_ROW))  # rows of about equal length
        rows = [panels[k : k + across] for k in range(0, len(panels), across)]
    return rows


def colour_range(look: Look, norm: Normalize, picture: Picture) -> Normalize:
    """Return the colour range from `look.limits`; `norm` without limits."""
    if look.limits is None:
        return norm
    low, high = look.limits
    if picture.field.scale == "log" and low > 0:
        return LogNorm(low, high, clip=True)
    return Normalize(low, high, clip=True)


def _picture_panel(
    picture: Picture, norm: Normalize, title: str, colours: str | None = None, bar: str | None = None
) -> Draw:
    def panel(axes: Axes) -> None:
        draw(axes, picture, norm, colours, bar)
        if picture.scale is not None and colours is None:
            scale_bar(axes, picture)
        axes.set_title(title, fontsize=10)

    return panel


def profile_panels(
    snaps: Sequence[Snapshot], names: Sequence[Sequence[str]], titles: Sequence[str], look: Look
) -> list[list[Draw]]:
    """Return one panel per word, with one curve per run and species; `names` has the field names of each word."""
    found = [curves.profile_curves(snap, unique_names(names), look) for snap in snaps]

    def panel(several: Sequence[str]) -> Draw:
        def draw_all(axes: Axes) -> None:
            for number, (snap, curve, title) in enumerate(zip(snaps, found, titles, strict=True)):
                for name in several:
                    curves.draw_curve(axes, snap, curve[name], FIELDS[name],
                                      **_style(name, number, several, title, len(snaps)))  # fmt: skip
            curves.finish_profile(axes, snaps[0], several, look)

        return draw_all

    panels = [panel(several) for several in names]
    across = min(len(panels), 2)
    return [panels[k : k + across] for k in range(0, len(panels), across)]


def _style(name: str, number: int, several: Sequence[str], title: str, runs: int) -> dict[str, Any]:
    """Return the line style of a curve.

    With one run, the colour shows the species; with several runs, the colour shows the run and the line style the
    species.
    """
    species = name.partition(".")[0].replace("_", " ")
    if runs == 1:
        key = name.partition(".")[0]
        return {"color": COLOURS.get(key, "black"), "ls": STYLES.get(key, "-"), "label": species}
    label = title if len(several) == 1 else f"{title}, {species}"
    return {"color": CYCLE[number % len(CYCLE)], "ls": ("-", "--", ":")[several.index(name) % 3], "label": label}


def phase_panels(snaps: Sequence[Snapshot], names: Sequence[str], against: str, titles: Sequence[str],
             look: Look) -> list[list[Draw]]:  # fmt: skip
    """Return phase plots: one row per field, one column per run."""

    def panel(snap: Snapshot, name: str, title: str) -> Draw:
        def draw_one(axes: Axes) -> None:
            curves.draw_phase(axes, snap, name, _name_for_species(against, name), look)
            axes.set_title(title, fontsize=10)

        return draw_one

    rows = [[panel(snap, name, title) for snap, title in zip(snaps, titles, strict=True)] for name in names]
    return (
        rows
        if len(snaps) > 1
        else [[row[0] for row in rows][k : k + MAX_PANELS_PER_ROW] for k in range(0, len(rows), MAX_PANELS_PER_ROW)]
    )


def _name_for_species(word: str, name: str) -> str:
    """Return the full name of the field `word`, if possible for the species of the field `name`. Raises FieldError."""
    names = matching_fields(word)
    return next((each for each in names if each.partition(".")[0] == name.partition(".")[0]), names[0])


def titles_of(snaps: Sequence[Snapshot], found: Sequence[NamedSnapshot]) -> tuple[str, list[str]]:
    """Return the title of the figure and the titles of its columns.

    The figure's title has the title of the run and the time, each only if all snapshots share it.
    """
    times = [snap.units.show_time(snap.time) for snap in snaps]
    runs = [figure_text(each.name) for each in found]
    title = figure_text(snaps[0].title) if len(set(runs)) == 1 else ""
    same_time = len(set(times)) == 1
    head = "\n".join(text for text in (title, f"t = {times[0]}" if same_time else "") if text)
    several = len(set(runs)) > 1
    each = [
        ", ".join(text for text in (run if several else "", "" if same_time else f"t = {time}") if text)
        for run, time in zip(runs, times, strict=True)
    ]
    return head, each


def notes_of(names: Sequence[str], look: Look, made: Sequence[Mapping[str, Picture]] = ()) -> list[str]:
    """Return the line below the title, [] if it is empty: wavelength and opacity, distance, and flux of `emission`."""
    notes = []
    if {"emission", "optical_depth"} & set(names):
        notes.append((look.optics or Optics.usual()).text)
    if look.distance is not None:
        notes.append(f"at {look.distance:g}")
        for each in made:
            if "emission" in each:
                shown = each["emission"]
                (left, right), (low, high) = shown.x, shown.y
                pixel = (right - left) * (high - low) / shown.values.size
                notes[-1] += f", F = {float(shown.values.sum() * pixel):.3g} mJy"
    return [", ".join(notes)] if notes else []
