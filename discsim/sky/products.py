"""Files of the command `discsim image`: a figure, and a FITS file for each map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from discsim.output.fields.base import PlotError
from discsim.output.ink import checked_colour_map
from discsim.output.snapshot import read_snapshot
from discsim.output.sources import run_directory, select_snapshots
from discsim.plot.request import FORMATS, save
from discsim.sky.draw import figure_of
from discsim.sky.image import ImageOptions, SkyMap, image_of

MAX_WAVELENGTHS = 6


def write_products(
    source: Path,
    options: ImageOptions,
    wavelengths: Sequence[str],
    at: str | None = None,
    output: Path | None = None,
    stretch: str = "linear",
    cmap: str | None = None,
    dpi: int | None = None,
) -> list[Path]:
    """Write a figure and FITS files of a snapshot, and return their paths, the figure first.

    Intensities get one map for each wavelength and, if there are several, the spectral index between the first two.
    `cmap` is the colour map and `dpi` the pixels per inch of the figure. Raises PlotError, SnapshotError, OSError.
    """
    colours = None if cmap is None else checked_colour_map(cmap, "--")
    if len(wavelengths) > MAX_WAVELENGTHS:
        raise PlotError(f"--wavelength: {len(wavelengths)} wavelengths; expected at most {MAX_WAVELENGTHS}")
    if output is not None and output.suffix.lower() not in FORMATS:
        raise PlotError(f"{output}: unknown figure format; expected a name that ends in {', '.join(FORMATS)}")
    path = select_snapshots([source], [at] if at else [])[0].path
    snap = read_snapshot(path)
    if options.quantity == "intensity":
        maps = [image_of(snap, replace(options, wavelength=each)) for each in wavelengths]
        maps += [maps[0].spectral_index(maps[1])] if len(maps) > 1 else []
    else:
        maps = [image_of(snap, options)]
    figure = output or _default_path(path, options.quantity)
    save(lambda: figure_of(maps, stretch=stretch, cmap=colours), figure, dpi)
    written = [figure]
    for sky in maps:
        part = f"-{_map_name(sky)}" if options.quantity == "intensity" else ""
        written.append(figure.with_name(f"{figure.stem}{part}.fits"))
        sky.write(written[-1])
    return written


def _map_name(sky: SkyMap) -> str:
    """Return the wavelength of a map, or its quantity, as a part of a file name."""
    return f"{sky.wavelength:g}".replace(" ", "") if sky.wavelength is not None else sky.quantity.replace(" ", "_")


def _default_path(snapshot: Path, quantity: str) -> Path:
    """Return the default path of the figure: in the folder "plots" of the run, or next to a snapshot outside a run."""
    directory = run_directory(snapshot)
    name = f"image-{snapshot.stem}.png" if quantity == "intensity" else f"{quantity}-{snapshot.stem}.png"
    return snapshot.with_name(name) if directory is None else directory / "plots" / name
