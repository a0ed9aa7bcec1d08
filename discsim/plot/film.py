"""Films of a run: one frame per snapshot; all frames have the same window and colour ranges.

mp4 needs imageio-ffmpeg; gif is written by pillow.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from PIL import Image

from discsim.output import style
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import DisplayOptions
from discsim.output.files import refuse_special, replace_atomically
from discsim.output.snapshot import snapshot_files
from discsim.output.sources import (
    NamedSnapshot,
    read_for_fields,
    region_of_runs,
    run_directory,
    run_name,
    times_and_units,
)
from discsim.parts import install_command
from discsim.plot import compose, marks, overlays, pictures
from discsim.plot.compose import PanelFigure
from discsim.plot.request import file_stem

SNAPSHOTS_FOR_RANGE = 12  # largest number of snapshots that determine the colour ranges
PIXELS_FOR_RANGE = 160  # pixels per side of the maps that determine the colour ranges
RESOLUTION = 110 / 130  # pixels per inch of a frame, relative to those of a figure
ReportFrame = Callable[[int, int], None]  # called with the number of finished frames and the number of all frames


@dataclass(frozen=True)
class Film:
    """A film of the run in the directory `source`.

    `words` are names of fields, `kind` is a key of PICTURE_MAKERS, and `rate` is in frames per second. `populations`
    are names or numbers of dust populations, of which the fields of dust are drawn. `dpi` are the pixels per inch.
    """

    source: Path
    words: Sequence[str] = ()
    kind: str = "map"
    rate: float = 10.0
    display: DisplayOptions = field(default_factory=DisplayOptions)
    populations: Sequence[str] = ()
    dpi: int | None = None

    def save(self, path: Path, report_frame: ReportFrame | None = None) -> int:
        """Write the film to `path`, and return the number of frames. The file appears when it is complete.

        `report_frame` is called after each frame. Raises PlotError, FieldError, SnapshotError, OSError.
        """
        writer, dpi = writer_of(path), style.checked_dpi(self.dpi, self.display.prefix)
        self.display.used_for(self.kind)
        if self.display.contours is not None and not self.display.contours[1]:
            word = self.display.contours[0]
            wanted = f'a film needs levels, which are the same in all frames; give "{word}=LEVEL,..."'
            raise PlotError(f"{self.display.prefix}contours: {word}: {wanted}")
        refuse_special(path)
        files = snapshot_files(self.source)
        if len(files) < 2:
            raise PlotError(
                f"{self.source}: a film needs several snapshots; give the directory of a run with at least "
                f"two snapshots"
            )
        if times_and_units(files[:1])[1].dimensions == 1:
            raise PlotError(f"{self.source}: a run in one dimension has no map to film; use `discsim plot --time`")
        frames = self._frames(files, report_frame, dpi)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_atomically(path, path.suffix) as temporary:
            writer(temporary, frames, self.rate)
        return len(files)

    def _frames(
        self, files: Sequence[Path], report_frame: ReportFrame | None, dpi: int | None
    ) -> Iterator[Image.Image]:
        """Yield the frame of each snapshot in `files`."""
        words = list(self.words) or compose.default_words(2)
        wanted = compose.matching_names(words, self.populations)
        more = overlays.needed_fields(self.display)
        last = read_for_fields(files[-1], [*wanted, *more])
        names = compose.unique_names(compose.available_names(words, [last], self.populations))
        display = region_of_runs(self.display, [files], self.kind)
        start = marks.start_snapshot(files[-1], last, names, self.kind, display)
        norms = self._colour_ranges(files, names, replace(display, contours=None, streamlines=None))
        for number, file in enumerate(files, 1):
            snap = read_for_fields(file, [*names, *more])
            head, titles = compose.titles_of([snap], [NamedSnapshot(file, run_name(self.source))])
            made = pictures.PICTURE_MAKERS[self.kind](snap, names, display)
            made = marks.annotated(made, self.kind, display, start)
            rows = compose.picture_panels([made], titles, display, norms)
            content = io.BytesIO()
            board = PanelFigure(head, rows, notes=compose.note_lines(names, display))
            figure = board.figure()
            resolution = dpi or round(figure.dpi * RESOLUTION)
            style.check_pixels(figure.get_size_inches(), resolution, is_frame=True)
            figure.savefig(content, format="png", dpi=resolution, pil_kwargs={"compress_level": 1})
            if report_frame is not None:
                report_frame(number, len(files))
            yield Image.open(content).convert("RGB")

    def _colour_ranges(
        self, files: Sequence[Path], names: Sequence[str], display: DisplayOptions
    ) -> dict[str, Normalize]:
        """Return the colour ranges by field, from at most SNAPSHOTS_FOR_RANGE snapshots spread evenly over the run."""
        chosen = np.unique(np.linspace(0, len(files) - 1, SNAPSHOTS_FOR_RANGE).round().astype(int))
        make, coarse = pictures.PICTURE_MAKERS[self.kind], replace(display, pixels=PIXELS_FOR_RANGE)
        seen = [make(read_for_fields(files[k], names), names, coarse) for k in chosen]
        return compose.colour_ranges(display, seen)


def default_path(film: Film) -> Path:
    """Return the default path of a film, in the folder "plots" of its run.

    The format is mp4, or gif if mp4 cannot be written (`mp4_obstacle`).
    """
    directory = run_directory(film.source) or film.source.parent
    ending = ".gif" if mp4_obstacle() else ".mp4"
    return directory / "plots" / f"{file_stem(film.words, film.populations, film.kind)}{ending}"


def writer_of(path: Path) -> Callable[[Path, Iterator[Image.Image], float], None]:
    """Return the function that writes frames to a file with the suffix of `path`. Raises PlotError."""
    if path.suffix.lower() == ".gif":
        return _write_gif
    if path.suffix.lower() != ".mp4":
        raise PlotError(f"{path}: unknown film format; expected a name that ends in .mp4 or .gif")
    if obstacle := mp4_obstacle():
        raise PlotError(f"{path}: {obstacle}; or use -o NAME.gif")
    return _write_mp4


def mp4_obstacle() -> str:
    """Return why no mp4 can be written, with the remedy, as text; "" if it can."""
    if not find_spec("imageio_ffmpeg"):
        return f"mp4 needs imageio-ffmpeg, which is not installed; run: {install_command('movie')}"
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError:  # no program comes with the package for this machine, and there is none in PATH
        return "mp4 needs the program ffmpeg, which is not found; install it, or set IMAGEIO_FFMPEG_EXE to its path"
    return ""


def _write_gif(path: Path, frames: Iterator[Image.Image], rate: float) -> None:
    first = next(frames)
    # One palette for all frames keeps colours constant. It covers the whole colour bar, even if the first frame has few
    # bright pixels.
    palette = first.quantize(256, Image.Quantize.MAXCOVERAGE)
    every = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in chain([first], frames))
    next(every).save(path, format="gif", save_all=True, append_images=every, duration=round(1000 / rate), loop=0)


def _write_mp4(path: Path, frames: Iterator[Image.Image], rate: float) -> None:
    import imageio_ffmpeg

    sink: Any = None
    for frame in frames:
        # The codec needs an even number of pixels.
        frame = frame.crop((0, 0, frame.width // 2 * 2, frame.height // 2 * 2))
        if sink is None:
            sink = imageio_ffmpeg.write_frames(
                str(path), frame.size, fps=rate, macro_block_size=2, quality=8, ffmpeg_log_level="error"
            )
            sink.send(None)
        sink.send(np.asarray(frame).tobytes())
    sink.close()
