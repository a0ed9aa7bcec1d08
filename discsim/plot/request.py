"""Figures of the command `discsim plot`: snapshots, fields and kind of a figure, and the writing of its file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from discsim.output import style
from discsim.output.drawing import figure_text
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.fields.names import split_population
from discsim.output.files import refuse_special, replace_atomically
from discsim.output.snapshot import snapshot_files
from discsim.output.sources import (
    NamedSnapshot,
    read_for_fields,
    region_of_profiles,
    region_of_runs,
    run_directory,
    run_name,
    select_snapshots,
    times_and_units,
)
from discsim.plot import compose, marks, overlays, pictures
from discsim.plot.compose import PanelFigure
from discsim.scene.orbits import stated_orbit
from discsim.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from discsim.output.snapshot import Snapshot

KINDS = ("map", "polar", "profile", "time", "phase")
FORMATS = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class Request:
    """A request for a figure.

    `sources` are directories of runs, or snapshots. `words` are names of fields with or without species. `kind` is one
    of KINDS; None stands for a map, or in 1D for a profile. `at` are times as texts. `against` is the field on the x
    axis of a phase plot. `compare` adds the ratio of the second source to the first, or their difference.
    `populations` are names or numbers of dust populations, of which the fields of dust are drawn.
    """

    sources: Sequence[Path]
    words: Sequence[str] = ()
    kind: str | None = None
    at: Sequence[str] = ()
    against: str | None = None
    compare: bool = False
    populations: Sequence[str] = ()
    display: DisplayOptions = field(default_factory=DisplayOptions)

    def figure(self) -> Figure:
        """Return the matplotlib figure. Raises PlotError, FieldError, SnapshotError."""
        self._refuse_unused_options()
        return (self._panels_against_time() if self.kind == "time" else self._panels_of_snapshots()).figure()

    def _refuse_unused_options(self) -> None:
        """Raise PlotError for an option that this kind of figure does not use."""
        if self.at and self.kind == "time":
            raise PlotError("--at: --time uses all snapshots; remove --at or --time")
        if self.display.distance is not None and self.kind not in (None, "map"):
            raise PlotError("--distance: used only for maps in x and y; remove --distance")
        if self.display.window is not None and self.kind == "phase":
            raise PlotError("--window: not used with --against; remove --window or --against")
        if self.display.marks is not None and self.kind == "phase":
            raise PlotError("--mark: not used with --against; remove --mark or --against")
        if self.display.optics is not None and not any(
            split_population(word)[1] in ("emission", "optical_depth") for word in self.words
        ):
            raise PlotError(
                "--wavelength and --opacity: used only by the fields emission and optical_depth; add --field with one "
                "of these fields"
            )

    def _panels_of_snapshots(self) -> PanelFigure:
        """Return the panels of a figure of single snapshots. Raises PlotError."""
        found = select_snapshots(self.sources, self.at)
        if self.compare and len(found) != 2:
            raise PlotError(
                "--compare: compares a single snapshot with another; give one DIR or FILE, and at most one --at"
            )
        names, snaps = self._read_snapshots([each.path for each in found])
        kind = self.kind or ("map" if snaps[0].dimensions == 2 else "profile")
        head, titles = compose.titles_of(snaps, found, short=kind == "profile")
        self.display.used_for(kind)
        if self.compare and kind in ("profile", "phase"):
            raise PlotError(
                "--compare: used only for maps, --polar and --time; remove --compare, and give the two runs as DIR DIR"
            )
        fields = compose.unique_names(names)
        if kind == "phase":
            rows = compose.phase_panels(snaps, fields, self.against or "radius", titles, self.display)
            return PanelFigure(head, rows, has_titles=any(titles), extra_space=0.4)
        if kind == "profile":
            display = region_of_profiles(self.display, [each.path for each in found], snaps)
        else:
            display = self.display.common_to(snaps, kind)
        starts = self._first_snapshots(found, snaps, fields, kind)
        notes = marks.gap_notes(starts, snaps) if "gap" in (display.marks or ()) else []
        if kind == "profile":
            times = compose.TimeColours.of_run(found, snaps)
            rows = compose.profile_panels(snaps, names, titles, display, starts[0], times)
            notes, labels = [*compose.note_lines(fields, display), *notes], marks.has_labels(snaps, display)
            return PanelFigure(head, rows, compose.PROFILE_WIDTH, notes, labels, has_bars=times is not None)
        made = [
            marks.annotated(pictures.PICTURE_MAKERS[kind](snap, fields, display), kind, display, start)
            for snap, start in zip(snaps, starts, strict=True)
        ]
        rows = compose.picture_panels(made, titles, display, compare=self.compare)
        notes = [*compose.note_lines(fields, display, made), *notes]
        return PanelFigure(head, rows, notes=notes, has_titles=any(titles))

    def _first_snapshots(
        self, found: Sequence[NamedSnapshot], snaps: Sequence[Snapshot], fields: Sequence[str], kind: str
    ) -> list[Snapshot | None]:
        """Return for each snapshot the first one of its run, if marks need it, else None. Raises PlotError."""
        if kind == "profile" and len(snaps) > 1:
            if needed := marks.FROM_START & (self.display.marks or frozenset()):
                wanted = "expected a single snapshot in a profile; give one DIR or FILE, and at most one --at"
                raise PlotError(f"--mark: {', '.join(sorted(needed))}: {wanted}")
            return [None] * len(snaps)
        each = zip(found, snaps, strict=True)
        return [marks.start_snapshot(one.path, snap, fields, kind, self.display) for one, snap in each]

    def _panels_against_time(self) -> PanelFigure:
        """Return the panels of a figure against time. Raises PlotError."""
        self.display.used_for("time")
        runs = [(snapshot_files(source), run_name(source)) for source in self.sources]
        if min(len(files) for files, _ in runs) < 2:
            raise PlotError(
                "--time: needs at least two snapshots of each run; give directories of runs with two or more snapshots"
            )
        names, snaps = self._read_snapshots([files[0] for files, _ in runs])
        fields = compose.unique_names(names)
        display = region_of_runs(self.display, [files for files, _ in runs], "time")
        orbits = [stated_orbit(snap.scene_text, snap.units) for snap in snaps]
        in_orbits = len({orbit and orbit.words for orbit in orbits}) == 1  # else years, which all runs have
        made = [pictures.time_pictures(files, fields, display, in_orbits) for files, _ in runs]
        titles = [figure_text(name) for _, name in runs] if len(runs) > 1 else [""]
        head = figure_text(snaps[0].title) if len(runs) == 1 else ""
        rows = compose.picture_panels(made, titles, display, compare=self.compare)
        return PanelFigure(head, rows, notes=compose.note_lines(fields, display), has_titles=any(titles))

    def _read_snapshots(self, paths: Sequence[Path]) -> tuple[list[list[str]], list[Snapshot]]:
        """Return the names of fields for each of the words, and the snapshots with the columns that these fields need.

        Names that only some of the snapshots have are left out. Raises PlotError, FieldError, SnapshotError.
        """
        units = [times_and_units([path])[1] for path in paths]
        if any(vars(each) != vars(units[0]) for each in units):
            raise PlotError("the runs have different dimensions or units; draw each of them in its own figure")
        words = list(self.words) or compose.default_words(units[0].dimensions)
        wanted = compose.matching_names(words, self.populations)
        wanted += compose.matching_names([self.against or "radius"]) if self.kind == "phase" else []
        wanted += overlays.needed_fields(self.display)
        snaps = [read_for_fields(path, wanted) for path in paths]
        return compose.available_names(words, snaps, self.populations), snaps


def default_path(request: Request, ending: str = ".png") -> Path:
    """Return the default path of a figure: in the folder "plots" of the first run, or next to a file outside a run."""
    first = request.sources[0]
    directory = run_directory(first)
    name = file_stem(request.words, request.populations, request.kind or "", "compared" if request.compare else "")
    if directory is None:
        return first.with_name(f"{first.stem}-{name}{ending}")
    number = f"-{first.stem}" if first.is_file() else ""
    return directory / "plots" / f"{name}{number}{ending}"


def file_stem(words: Sequence[str], populations: Sequence[str], *more: str) -> str:
    """Return the default name of a file, without its suffix: fields, populations, and `more` words."""
    return "-".join(part for part in (*(words or ["surface_density"]), *populations, *more) if part).replace("/", "_")


def save(make: Callable[[], Figure], path: Path, dpi: int | None = None) -> None:
    """Write the figure that `make` returns to `path`. The file appears when it is complete.

    `dpi` are the pixels per inch, by default those of the figure. Raises PlotError for an unknown format, before `make`
    is called, or for too many pixels, and OSError.
    """
    if path.suffix.lower() not in FORMATS:
        raise PlotError(f"{path}: unknown figure format; expected a name that ends in {', '.join(FORMATS)}")
    refuse_special(path)
    style.checked_dpi(dpi, "--")
    figure = make()
    style.check_pixels(figure.get_size_inches(), dpi or figure.dpi)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replace_atomically(path, path.suffix) as temporary:
        software = {".png": "Software", ".pdf": "Creator", ".svg": "Creator"}[path.suffix.lower()]
        figure.savefig(temporary, dpi=dpi or figure.dpi, metadata={software: f"discsim {__version__}"})
