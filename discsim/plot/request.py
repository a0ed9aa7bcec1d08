"""Figures of the command `discsim plot`: choice of snapshots, fields and kind of figure, and the file written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from discsim.output.drawing import figure_text
from discsim.output.fields.base import PlotError
from discsim.output.fields.look import Look
from discsim.output.files import refuse_special, replace_atomically
from discsim.output.snapshot import files_of
from discsim.plot import compose, pictures
from discsim.plot.compose import PanelFigure
from discsim.plot.sources import read_for_fields, run_directory, run_name, select_snapshots, times_of
from discsim.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from discsim.output.snapshot import Snapshot

KINDS = ("map", "polar", "profile", "time", "phase")
FORMATS = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class Request:
    """A request for a figure.

    `sources` are directories of runs or snapshots, `words` names of fields with or without species. `kind` is one of
    KINDS; None is a map, or a profile in 1D. `at` are times as texts. `against` is the field on the x axis of a
    phase plot. `compare` adds the ratio (or difference) of the second source and the first.
    """

    sources: Sequence[Path]
    words: Sequence[str] = ()
    kind: str | None = None
    at: Sequence[str] = ()
    against: str | None = None
    compare: bool = False
    look: Look = field(default_factory=Look)

    def figure(self) -> Figure:
        """Return the figure. Raises PlotError, FieldError, SnapshotError."""
        self._refuse_unused_options()
        return (self._panels_against_time() if self.kind == "time" else self._panels_of_snapshots()).figure()

    def _refuse_unused_options(self) -> None:
        """Raise PlotError for an option that this kind of figure does not use."""
        if self.at and self.kind == "time":
            raise PlotError("--at: --time uses all snapshots; expected only one of the two")
        if self.look.distance is not None and self.kind not in (None, "map"):
            raise PlotError("--distance: used only for maps; expected a map, or no --distance")
        if self.look.window is not None and self.kind == "phase":
            raise PlotError("--window: not used with --against; expected only one of the two")
        if self.look.optics is not None and not {"emission", "optical_depth"} & set(self.words):
            raise PlotError(
                "--wavelength and --opacity: used only by emission and optical_depth; expected --field with one "
                "of these"
            )

    def _panels_of_snapshots(self) -> PanelFigure:
        """Return the panels of a figure of single snapshots. Raises PlotError."""
        found = select_snapshots(self.sources, self.at)
        if self.compare and len(found) != 2:
            raise PlotError("--compare: compares two snapshots; expected one DIR or FILE, and at most one --at")
        names, snaps = self._read_snapshots([each.path for each in found])
        head, titles = compose.titles_of(snaps, found)
        kind = self.kind or ("map" if snaps[0].dimensions == 2 else "profile")
        if self.compare and kind in ("profile", "phase"):
            raise PlotError("--compare: used only for maps, --polar and --time; expected the two runs as DIR DIR")
        fields = compose.unique_names(names)
        if kind == "phase":
            return PanelFigure(
                head,
                compose.phase_panels(snaps, fields, self.against or "radius", titles, self.look),
                has_titles=any(titles),
                extra_space=0.4,
            )
        look = self.look.shared(snaps, kind)
        if kind == "profile":
            rows = compose.profile_panels(snaps, names, titles, look)
            return PanelFigure(head, rows, compose.PROFILE_WIDTH, compose.notes_of(fields, look))
        make: pictures.MakePictures = {"map": pictures.map_pictures, "polar": pictures.polar_pictures}[kind]
        made = [make(snap, fields, look) for snap in snaps]
        rows = compose.picture_panels(made, titles, look, compare=self.compare)
        return PanelFigure(head, rows, notes=compose.notes_of(fields, look, made), has_titles=any(titles))

    def _panels_against_time(self) -> PanelFigure:
        """Return the panels of a figure against time. Raises PlotError."""
        runs = [(files_of(source), run_name(source)) for source in self.sources]
        if min(len(files) for files, _ in runs) < 2:
            raise PlotError("--time: needs all snapshots of a run; expected the directory of the run")
        names, snaps = self._read_snapshots([files[0] for files, _ in runs])
        fields, look = compose.unique_names(names), self.look.shared(snaps, "time")
        made = [pictures.time_pictures(files, fields, look) for files, _ in runs]
        titles = [figure_text(name) for _, name in runs] if len(runs) > 1 else [""]
        head = figure_text(snaps[0].title) if len(runs) == 1 else ""
        rows = compose.picture_panels(made, titles, look, compare=self.compare)
        return PanelFigure(head, rows, notes=compose.notes_of(fields, look), has_titles=any(titles))

    def _read_snapshots(self, paths: Sequence[Path]) -> tuple[list[list[str]], list[Snapshot]]:
        """Return the names of fields for each of the words, and the snapshots with the columns that these need.

        Names that only some of the snapshots have are left out. Raises PlotError.
        """
        every = [times_of([path])[1] for path in paths]
        if any(vars(units) != vars(every[0]) for units in every):
            raise PlotError("the runs have different dimensions or units; expected the same for all runs")
        words = list(self.words) or compose.default_words(every[0].dimensions)
        wanted = compose.matching_names([*words, *([self.against or "radius"] if self.kind == "phase" else [])])
        snaps = [read_for_fields(path, wanted) for path in paths]
        return compose.words_to_names(words, snaps), snaps


def default_path(request: Request, ending: str = ".png") -> Path:
    """Return the default path of a figure: in the folder "plots" of the first run, or next to a single snapshot."""
    first = request.sources[0]
    directory = run_directory(first)
    words = "-".join(request.words) or "surface_density"
    name = "-".join(part for part in (words, request.kind or "", "compared" if request.compare else "") if part)
    if directory is None:
        return first.with_name(f"{first.stem}-{name}{ending}")
    number = f"-{first.stem}" if first.is_file() else ""
    return directory / "plots" / f"{name}{number}{ending}"


def save(make: Callable[[], Figure], path: Path) -> None:
    """Create a figure and write it; the file appears when it is complete.

    Raises PlotError for an unknown format, OSError.
    """
    if path.suffix.lower() not in FORMATS:
        raise PlotError(f"{path}: unknown figure format; expected a name that ends in {', '.join(FORMATS)}")
    refuse_special(path)
    figure = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    with replace_atomically(path, path.suffix) as temporary:
        software = {".png": "Software", ".pdf": "Creator", ".svg": "Creator"}[path.suffix.lower()]
        figure.savefig(temporary, dpi=130, metadata={software: f"discsim {__version__}"})
