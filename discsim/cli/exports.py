"""Commands that write files for other codes: `export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import app, exit_on_fault, show


@app.command()
def export(
    source: Annotated[Path, typer.Argument(metavar="DIR|FILE", help="Directory of a run, or a snapshot.")],
    to: Annotated[str, typer.Option(metavar="CODE", help="radmc3d or mcfost.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="New folder for the files.")],
    alpha: Annotated[
        float | None, typer.Option(metavar="A", help="Turbulence that lifts the dust [that of the scene].")
    ] = None,
    sizes: Annotated[int, typer.Option(metavar="N", help="Bins for grains of many sizes.")] = 10,
    cells: Annotated[int, typer.Option(metavar="N", help="Cells in azimuth; those in radius are as wide.")] = 256,
    opacity: Annotated[
        str | None, typer.Option(metavar="K|FILE", help="As in `discsim image` [radmc3d: 10 cm2/g (nu / THz)].")
    ] = None,
    temperature: Annotated[
        str | None,
        typer.Option(
            metavar="T", help='Write temperatures of the dust: "gas", or as in `discsim image`; radmc3d only.'
        ),
    ] = None,
    star_radius: Annotated[str, typer.Option(metavar="R", help="Radius of the star.")] = "2 Rsun",
    star_temperature: Annotated[str, typer.Option(metavar="T", help="Temperature of the star.")] = "4000 K",
    at: Annotated[
        str | None, typer.Option(metavar="T", help='Time of the snapshot, like "700 yr"; the nearest [the last].')
    ] = None,
) -> None:
    """Write the disc as input of RADMC-3D or MCFOST."""
    from discsim.export.options import ExportOptions
    from discsim.export.products import write_export
    from discsim.output.snapshot import read_snapshot
    from discsim.output.sources import select_snapshots

    given = {name: value for name, value in locals().items() if name in ExportOptions.__dataclass_fields__}
    with exit_on_fault("written", output):
        path = select_snapshots([source], [at] if at else [])[0].path
        show(write_export(read_snapshot(path), to, output, ExportOptions(**given, prefix="--")))
