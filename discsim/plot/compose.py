"""Figures with panels for several fields, runs or times; all panels of one field have the same colour range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from discsim.output import style
from discsim.output.drawing import (
    BAR_BELOW,
    BELOW,
    COLOURS,
    COLUMN,
    EDGE,
    LEFT,
    LINES,
    MAP,
    MIN_SIDE,
    RIGHT,
    STYLES,
    TOTAL_COLOUR,
    Picture,
    axes_at,
    broken,
    common_norm,
    draw_colour_bar,
    draw_picture,
    draw_scale_bar,
    figure_text,
    fit_labels,
    population_style,
)  # fmt: skip
from discsim.output.fields.base import PlotError
from discsim.output.fields.binned import Optics
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.names import (
    available_fields,
    field_named,
    is_of_dust,
    matching_fields,
    of_population,
    species_text,
    split_population,
    with_populations,
)
from discsim.output.ink import line_colour, shade, text_scale
from discsim.output.populations import population_of
from discsim.output.snapshot import Snapshot
from discsim.output.sources import NamedSnapshot
from discsim.plot import curves, marks, overlays, pictures
from discsim.scene.orbits import show_plain_time

MAX_PANELS_PER_ROW = 3  # in a figure of one run
PROFILE_WIDTH = 1.25  # width of a profile in units of the width of a map
# Colours of Okabe & Ito (2008).
RUN_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MAX_TIMES = 6  # largest number of times of a run that a legend of profiles lists
LIGHTEST_TIME = 0.9  # of viridis, whose end is faint on white
Norms = Mapping[str, Normalize]
Panel = Callable[[Axes, bool], None]  # draws on axes, with True for a colour bar below them


@dataclass
class PanelFigure:
    """A figure with rows of panels. A panel is a function that draws on the axes that it gets.

    `notes` are lines of text below the title. A figure with one panel, and one in a style with a width, has the colour
    bar below the axes, so that a phone shows it with legible text.
    """

    title: str
    rows: list[list[Panel]]
    width: float = 1.0  # width of a panel in units of the width of a map
    notes: list[str] = field(default_factory=list)
    has_titles: bool = False  # whether panels have titles
    extra_space: float = 0.0  # additional space between panels, in inches
    has_bars: bool = False  # whether profiles have colour bars

    @property
    def is_single(self) -> bool:
        """True if the figure has one panel."""
        return len(self.rows) == 1 and len(self.rows[0]) == 1

    def figure(self, dpi: int | None = None, room: float = 0.0) -> Figure:
        """Return the figure, with a canvas that does not depend on pyplot; by default `dpi` is that of the style.

        `room` is the height in inches of legends below axes; if they need more, the figure is drawn again.
        """
        look, text = style.current(), text_scale()
        below = self.is_single or look.several is not None
        is_profile = self.width == PROFILE_WIDTH
        has_bar = below and (self.has_bars or not is_profile)
        most, down = max(len(panels) for panels in self.rows), len(self.rows)
        left = (LEFT - 0.1 if below else LEFT) * text
        right = (0.15 if below else COLUMN - MAP - LEFT + self.extra_space) * text
        close = (BELOW + (BAR_BELOW[2] if has_bar else 0.0)) * text
        under = close + room
        between = (0.5 if self.has_titles else 0.25) * text  # above the axes of a row
        end = 0.1 if below else RIGHT - 0.9 if is_profile and not self.has_bars else 0.2
        total = (look.one if self.is_single else look.several) or 0.0
        lines = self._lines(total if below else most * (left + MAP * self.width + right) + end)
        top = (0.2 + look.line * len(lines) + (0.25 if self.has_titles else 0.0)) * text
        side = MAP
        if below:
            side = ((total - end * text) / most - left - right) / self.width
            lower = (look.height - top - between * (down - 1)) / down - under
            side = max(min(side, max(lower, MIN_SIDE * text)), 0.5)
        pitch, row = left + side * self.width + right, side + under + between
        size = (pitch * most + end * text, row * (down - 1) + side + under + top)
        figure = Figure(figsize=size, dpi=dpi or look.resolution(self.is_single))
        FigureCanvasAgg(figure)
        for number, panels in enumerate(self.rows):
            bottom = under + row * (down - 1 - number)
            for across, panel in enumerate(panels):
                panel(axes_at(figure, left + pitch * across, bottom, side * self.width, side), below)
        if is_profile:
            fit_labels(figure.axes, left - EDGE * text)
        needed = max(curves.legend_height(axes, close) for axes in figure.axes)
        if needed > room:
            return self.figure(dpi, needed + 0.1 * text)
        figure.suptitle("\n".join(lines), y=1.0 - 0.12 * text / size[1], va="top", fontsize=12 * text)
        return figure

    def _lines(self, width: float) -> list[str]:
        """Return the lines of title and notes, broken where they are longer than a width in inches."""
        lines = [line for text in (self.title, *self.notes) for line in text.split("\n") if line]
        size = 12 * text_scale()
        # The line with the time stays whole, so that all frames of a film have the same size.
        return [part for line in lines for part in ([line] if line.startswith("t = ") else broken(line, width, size))]


def available_names(
    words: Sequence[str], snaps: Sequence[Snapshot], populations: Sequence[str] = ()
) -> list[list[str]]:
    """Return for each word the names of the fields that match it and that all snapshots have. Raises FieldError.

    If no such field is in all snapshots, the names of the matching fields in the first snapshot are returned. Fields
    of all dust are replaced by those of the `populations`, if there are any.
    """
    found = []
    for word in words:
        of_each = [with_populations(available_fields(word, snap), populations) for snap in snaps]
        for names, snap in zip(of_each, snaps, strict=True):
            for name in names:
                of_population(name, snap)  # raises FieldError for an unknown population
        found.append([name for name in of_each[0] if all(name in names for names in of_each)] or of_each[0])
    return found


def unique_names(names: Sequence[Sequence[str]]) -> list[str]:
    """Return the names in nested sequences as one list in the same order, without repetitions."""
    return list(dict.fromkeys(name for several in names for name in several))


def default_words(dimensions: int) -> list[str]:
    """Return the fields that a figure of a run in 1D or 2D shows by default."""
    return ["surface_density"] if dimensions == 2 else ["surface_density", "v_x"]


def matching_names(words: Sequence[str], populations: Sequence[str] = ()) -> list[str]:
    """Return all field names that match the words, even if no snapshot has these fields. Raises FieldError.

    Fields of all dust are replaced by those of the `populations`, if there are any. Raises PlotError if these have no
    effect.
    """
    plain = unique_names([matching_fields(word) for word in words])
    found = with_populations(plain, populations)
    if populations and found == plain:
        raise PlotError(f"--population: none of {', '.join(plain)} is a field of all dust; leave it out")
    return found


def joined_populations(names: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the names of panels; panels with one field of dust each, of several populations, are joined to one."""
    found: dict[object, list[str]] = {}
    for number, several in enumerate(names):
        base = split_population(several[0])[1]
        alone = len(several) == 1 and is_of_dust(field_named(base))
        found.setdefault(base if alone else number, []).extend(several)
    return [list(dict.fromkeys(several)) for several in found.values()]


def picture_panels(
    pictures_by_run: Sequence[Mapping[str, Picture]], titles: Sequence[str], display: DisplayOptions,
    norms: Norms | None = None, compare: bool = False,
) -> list[list[Panel]]:  # fmt: skip
    """Return the panels of pictures: one row per field and one column per run.

    `pictures_by_run` has for each run its pictures by field, and `titles` the titles of the columns. `norms` are
    colour ranges by field; by default they are computed from the pictures. For a single run, a row has up to
    MAX_PANELS_PER_ROW panels. `compare` adds a column with the ratio or difference of two runs.
    """
    rows = []
    pictures_by_run = overlays.with_common_levels(pictures_by_run)
    norms = norms or colour_ranges(display, pictures_by_run)
    for name in pictures_by_run[0]:
        of_runs = [each[name] for each in pictures_by_run]
        row = [
            _picture_panel(picture, norms[name], title, display.cmap)
            for picture, title in zip(of_runs, titles, strict=True)
        ]
        if compare:
            change, between, label = pictures.comparison(*of_runs)
            row.append(_picture_panel(change, between, f"{titles[1]} against {titles[0]}", "RdBu_r", label))
        rows.append(row)
    if len(pictures_by_run) == 1:
        across = math.ceil(len(rows) / math.ceil(len(rows) / MAX_PANELS_PER_ROW))  # rows of about equal length
        return _in_rows([row[0] for row in rows], across)
    return rows


def _in_rows(panels: Sequence[Panel], across: int) -> list[list[Panel]]:
    """Return the panels in rows of `across` panels each; the last row may be shorter."""
    return [list(panels[k : k + across]) for k in range(0, len(panels), across)]


def colour_ranges(display: DisplayOptions, pictures_by_run: Sequence[Mapping[str, Picture]]) -> dict[str, Normalize]:
    """Return the colour range of each field in pictures of several runs.

    All populations of a field have one range, which contains the ranges of all, so that colours can be compared.
    """
    groups: dict[str, list[list[Picture]]] = {}
    for name in pictures_by_run[0]:
        groups.setdefault(split_population(name)[1], []).append([each[name] for each in pictures_by_run])
    ranges = {name: _common_range(display, group) for name, group in groups.items()}
    return {name: ranges[split_population(name)[1]] for name in pictures_by_run[0]}


def _common_range(display: DisplayOptions, groups: Sequence[Sequence[Picture]]) -> Normalize:
    """Return one colour range for the pictures of several populations."""
    found = [colour_range(display, group) for group in groups]
    if len(found) == 1 or len({type(norm) for norm in found}) > 1:
        return colour_range(display, [picture for group in groups for picture in group])
    low, high = min(float(norm.vmin or 0.0) for norm in found), max(float(norm.vmax or 0.0) for norm in found)
    if isinstance(found[0], LogNorm):
        return LogNorm(max(low, high * 10**-curves.MAX_DECADES), high, clip=True)
    return Normalize(low, high, clip=True)


def colour_range(display: DisplayOptions, of_field: Sequence[Picture]) -> Normalize:
    """Return the colour range for pictures of one field: `display.limits`, or without limits that of `common_norm`."""
    if display.limits is None:
        return common_norm(of_field)
    low, high = display.limits
    is_log = of_field[0].field.scale == "log" and low > 0
    return LogNorm(low, high, clip=True) if is_log else Normalize(low, high, clip=True)


def _picture_panel(picture: Picture, norm: Normalize, title: str, colours: Any = None, bar: str | None = None) -> Panel:
    """Return a panel that draws a picture; `colours` and `bar` replace the colour map and the label of the field."""

    def panel(axes: Axes, below: bool) -> None:
        draw_picture(axes, picture, norm, colours, bar, below)
        if picture.scale is not None and bar is None:
            draw_scale_bar(axes, picture)
        axes.set_title(title, fontsize=10 * text_scale())

    return panel


def profile_panels(
    snaps: Sequence[Snapshot], names: Sequence[Sequence[str]], titles: Sequence[str], display: DisplayOptions,
    start: Snapshot | None = None, times: TimeColours | None = None,
) -> list[list[Panel]]:  # fmt: skip
    """Return the panels of profiles. Each panel has the curves of all runs for the fields in one entry of `names`.

    `titles` are the names of the runs for the legend. `start` is the first snapshot of the run, for marks of a single
    snapshot. With `times` a colour bar shows the times of the snapshots.
    """
    names = joined_populations(names)
    found = [curves.profile_curves(snap, unique_names(names), display) for snap in snaps]

    def panel(several: Sequence[str]) -> Panel:
        def draw_all(axes: Axes, below: bool) -> None:
            for number, (snap, curve, title) in enumerate(zip(snaps, found, titles, strict=True)):
                for name in several:
                    style = _line_style(name, snap, number, several, title, len(snaps))
                    style |= {} if times is None else {"color": times.colour(snap.time)}
                    curves.draw_curve(axes, snap, curve[name], field_named(name), **style)
            of_curves = len(axes.get_legend_handles_labels()[0])
            marks.draw_on_profile(axes, snaps, several, display, start)
            curves.finish_profile(axes, snaps[0], several, display)
            handles, distance = axes.get_legend_handles_labels()[0], BELOW
            is_crowded = max(of_curves, len(handles)) > curves.MAX_INSIDE
            if is_crowded and (times is not None or len(snaps) > 1 < len(several)):
                runs = [] if times else titles
                handles[:of_curves] = _legend_keys(runs, [species_text(name, snaps[0]) for name in several])
            if times is not None:
                draw_colour_bar(axes, times.mappable, times.label, below)
                distance += BAR_BELOW[2] if below else 0.0
            if is_crowded:
                curves.draw_legend(axes, handles, distance * text_scale())

        return draw_all

    return _in_rows([panel(several) for several in names], 2)


@dataclass(frozen=True)
class TimeColours:
    """Colours of curves at many times, and their colour bar; `times` are those of `snap`s of one run in code units."""

    snap: Snapshot
    times: Sequence[float]

    @classmethod
    def of_run(cls, found: Sequence[NamedSnapshot], snaps: Sequence[Snapshot]) -> TimeColours | None:
        """Return the colours for more than MAX_TIMES snapshots of one run, else None."""
        times = {snap.time for snap in snaps}
        one_run = len({each.path.resolve().parent for each in found}) == 1
        return cls(snaps[0], sorted(times)) if one_run and len(times) > MAX_TIMES else None

    def colour(self, time: float) -> Any:
        """Return the colour of a time in code units, for a light background."""
        low, high = min(self.times), max(self.times)
        return colormaps["viridis"](LIGHTEST_TIME * (time - low) / (high - low))[:3]

    @property
    def label(self) -> str:
        """Label of the colour bar."""
        return f"t{pictures.time_axis(self.snap)[1]}"

    @property
    def mappable(self) -> ScalarMappable:
        """The colours from the first to the last time, in the unit of the label."""
        factor, ends = pictures.time_axis(self.snap)[0], (min(self.times), max(self.times))
        shades = ListedColormap([line_colour(self.colour(time)) for time in np.linspace(*ends, 256)])
        return ScalarMappable(Normalize(factor * ends[0], factor * ends[1]), shades)


def _legend_keys(runs: Sequence[str], fields: Sequence[str]) -> list[Line2D]:
    """Return artists for a legend of colours, which show runs, and of line styles, which show fields."""
    colours = [line_colour(colour) for colour in RUN_COLOURS]
    of_runs = [Line2D([], [], color=colours[k % len(colours)], label=run) for k, run in enumerate(runs)]
    styles = [Line2D([], [], color=shade(1.0), ls=LINES[k % len(LINES)], label=name) for k, name in enumerate(fields)]
    return [*of_runs, *(styles if len(fields) > 1 else [])]


def _line_style(
    name: str, snap: Snapshot, number: int, several: Sequence[str], title: str, runs: int
) -> dict[str, Any]:
    """Return colour, line style and label of the curve of field `name` and run `number`, out of `runs` runs.

    With one run, the colour shows the species or population. With several runs, the colour shows the run, and the line
    style shows the species or population. `several` are all fields in the panel, `title` is the name of the run.
    """
    species, (population, plain) = species_text(name, snap, of_each=snap.dimensions == 1), split_population(name)
    if runs == 1:
        if population is not None:
            return population_style(population_of(snap, population).number) | {"label": species}
        key = plain.partition(".")[0]
        colour = COLOURS.get(key, "black")
        if key == "dust" and any(split_population(each)[0] is not None for each in several):
            colour = TOTAL_COLOUR
        return {"color": colour, "ls": STYLES.get(key, "-"), "label": species}
    label = title if len(several) == 1 else f"{title}, {species}"
    colour, line = RUN_COLOURS[number % len(RUN_COLOURS)], LINES[several.index(name) % len(LINES)]
    return {"color": colour, "ls": line, "label": label}


def phase_panels(
    snaps: Sequence[Snapshot], names: Sequence[str], against: str, titles: Sequence[str], display: DisplayOptions
) -> list[list[Panel]]:
    """Return the panels of phase plots of the fields `names` against the field `against`: one row per field.

    A row has one column per run. For a single run, a row has up to MAX_PANELS_PER_ROW panels.
    """

    def panel(snap: Snapshot, name: str, title: str) -> Panel:
        def draw_one(axes: Axes, below: bool) -> None:
            curves.draw_phase(axes, snap, name, _name_for_species(against, name), display, below)
            axes.set_title(title, fontsize=10 * text_scale())

        return draw_one

    rows = [[panel(snap, name, title) for snap, title in zip(snaps, titles, strict=True)] for name in names]
    return rows if len(snaps) > 1 else _in_rows([row[0] for row in rows], MAX_PANELS_PER_ROW)


def _name_for_species(word: str, name: str) -> str:
    """Return the full name of the field `word`, if possible for the species of `name`. Raises FieldError.

    For example "radius" and "gas.v_r" give "gas.radius", and with "dust.0.v_r" they give "dust.0.radius".
    """
    names, (population, plain) = matching_fields(word), split_population(name)
    found = next((each for each in names if each.partition(".")[0] == plain.partition(".")[0]), names[0])
    return with_populations([found], [population] if population is not None else [])[0]


def titles_of(snaps: Sequence[Snapshot], found: Sequence[NamedSnapshot], short: bool = False) -> tuple[str, list[str]]:
    """Return the title of the figure and the titles of its columns.

    With `short` times in titles of columns have no orbits, as legends of profiles have little space.

    The figure's title has the title of the scene if all snapshots are of one run, and the time if it is the same in
    all. Otherwise the names of runs and the times are in the titles of the columns.
    """
    times, plain = (
        [snap.time_text for snap in snaps],
        [show_plain_time(snap.time, snap.units, snap.scene_text) for snap in snaps],
    )
    if len(set(times)) > len(set(plain)) == 1:  # one time, which the scenes count in different orbits
        times = plain
    runs = [figure_text(each.name) for each in found]
    title = figure_text(snaps[0].title) if len(set(runs)) == 1 else ""
    same_time = len(set(times)) == 1
    head = "\n".join(text for text in (title, f"t = {times[0]}" if same_time else "") if text)
    several = len(set(runs)) > 1
    columns = [
        ", ".join(text for text in (run if several else "", "" if same_time else f"t = {time}") if text)
        for run, time in zip(runs, plain if short else times, strict=True)
    ]
    return head, columns


def note_lines(
    names: Sequence[str], display: DisplayOptions, pictures_by_run: Sequence[Mapping[str, Picture]] = ()
) -> list[str]:
    """Return the line below the title as a list, which is empty if there is nothing to note.

    The line has wavelength and opacity, the distance, and the flux of each picture of the field "emission". For the
    flux, `pictures_by_run` has for each run its pictures by field.
    """
    notes = []
    if any(split_population(name)[1] in ("emission", "optical_depth") for name in names):
        notes.append((display.optics or Optics.default()).text)
    if display.distance is not None:
        notes.append(f"at {display.distance:g}")
        for each in pictures_by_run:
            for name in each:
                if split_population(name)[1] != "emission":
                    continue
                shown = each[name]
                (left, right), (low, high) = shown.x, shown.y
                pixel = (right - left) * (high - low) / shown.values.size
                flux = float(shown.values.sum() * pixel)
                notes[-1] += f", F = {flux:.3g} mJy" + (f" ({species_text(name, shown.snap)})" if len(each) > 1 else "")
    return [", ".join(notes)] if notes else []
