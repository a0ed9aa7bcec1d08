"""Commands that show a disc as a telescope would: `image`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import app, exit_on_fault, show
from discsim.cli.results import CmapOption, DpiOption, StyleOption


@app.command()
def image(
    source: Annotated[Path, typer.Argument(metavar="DIR|FILE", help="Directory of a run, or a snapshot.")],
    distance: Annotated[str, typer.Option(metavar="D", help='Distance of the disc, like "140 pc".')],
    wavelength: Annotated[
        list[str] | None, typer.Option(metavar="L", help='Wavelength, like "0.9 mm"; may be repeated [1.3 mm].')
    ] = None,
    quantity: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="intensity, velocity (of the gas), or residual (velocity of the gas minus Keplerian)."
        ),
    ] = "intensity",
    inclination: Annotated[str, typer.Option(metavar="ANGLE", help="Inclination; 0 deg is face-on.")] = "0 deg",
    position_angle: Annotated[
        str,
        typer.Option(
            metavar="ANGLE", help="Position angle of the receding half of the major axis, from north to east."
        ),
    ] = "-90 deg",
    azimuth: Annotated[
        str,
        typer.Option(
            metavar="ANGLE", help="Rotation of the disc in its plane, counter-clockwise, before the inclination."
        ),
    ] = "0 deg",
    beam: Annotated[
        str | None,
        typer.Option(
            metavar="WIDTH",
            help='Beam: full width "0.05 arcsec", or widths and position angle "0.06 arcsec,0.04 arcsec,30 deg".',
        ),
    ] = None,
    noise: Annotated[str | None, typer.Option(metavar="RMS", help='Rms noise, like "20 uJy/beam".')] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    opacity: Annotated[
        str | None,
        typer.Option(
            metavar="K|FILE",
            help='Opacity per gram of dust: "2 cm2/g", a list "2 cm2/g,3 cm2/g" of the populations, or the '
            "file of a table [10 cm2/g (nu / THz)].",
        ),
    ] = None,
    temperature: Annotated[
        str | None,
        typer.Option(
            metavar="T",
            help='Temperature of the dust: "20 K", a power law "150 K,1 au,0.5", or from a star of "1 Lsun" '
            "[gas temperature].",
        ),
    ] = None,
    fov: Annotated[str | None, typer.Option(metavar="ANGLE", help='Side of the image, like "2 arcsec".')] = None,
    pixels: Annotated[int, typer.Option(help="Pixels along each side.")] = 512,
    position: Annotated[
        str | None, typer.Option(metavar="RA DEC", help='Position of the centre, like "04h31m38.4s +18d13m57s".')
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="T", help='Time of the snapshot, like "700 yr"; the nearest snapshot is used [the last].'),
    ] = None,
    stretch: Annotated[str, typer.Option(help="Colour scale of intensities: linear, sqrt or log.")] = "linear",
    cmap: CmapOption = None,
    style: StyleOption = None,
    dpi: DpiOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Figure: png, pdf or svg; FITS files are written next to the figure."
        ),
    ] = None,
) -> None:
    """Make images on the sky, as a figure and FITS files."""
    from discsim.output.style import use_style
    from discsim.sky.image import ImageOptions
    from discsim.sky.products import write_products

    given = {name: value for name, value in locals().items() if name in ImageOptions.__dataclass_fields__}
    del given["wavelength"]

    with exit_on_fault("written", "the image"), use_style(style, "--"):
        options = ImageOptions(**given, prefix="--")
        paths = write_products(source, options, wavelength or ["1.3 mm"], at, output, stretch, cmap, dpi)
    show("\n".join(str(path) for path in paths))
