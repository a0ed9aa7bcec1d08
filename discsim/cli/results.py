"""Commands that show the results of a run, finished or not: `report`, `plot` and `movie`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import app, exit_on_fault, fail, show

WindowOption = Annotated[
    str | None,
    typer.Option(
        metavar="R",
        help='Region to show: outer radius "50 au"; radii "10 au,50 au"; on a map centre and half width "X,Y,R".',
    ),
]
RangeOption = Annotated[
    str | None, typer.Option("--range", metavar="LOW,HIGH", help="Range of the colour bar, or of the axis of profiles.")
]
PolarOption = Annotated[bool, typer.Option("--polar", help="Draw maps in angle and radius.")]
DistanceOption = Annotated[
    str | None,
    typer.Option(metavar="D", help='Distance of the disc, like "140 pc"; axes are then in arcsec, fluxes in mJy.'),
]
WavelengthOption = Annotated[
    str | None, typer.Option(metavar="L", help="Wavelength of the fields emission and optical_depth [1.3 mm].")
]
OpacityOption = Annotated[
    str | None, typer.Option(metavar="K", help='Opacity per gram of dust, like "2 cm2/g" [10 cm2/g (nu / THz)].')
]
PopulationOption = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Dust population to draw, by dust.name or number; may be repeated [all dust]."),
]
CmapOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help='Colour map of matplotlib, or of cmasher like "cmr.rainforest" [by field].'),
]
StyleOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Sizes and colours for a purpose: paper, slide or dark.")
]
DpiOption = Annotated[int | None, typer.Option(metavar="N", help="Pixels per inch, 30 to 1200.")]
LogRadiusOption = Annotated[bool, typer.Option("--log-radius", help="Draw the radius on a logarithmic axis.")]
ContoursOption = Annotated[
    str | None,
    typer.Option(
        metavar="FIELD[=LEVELS]", help='Contour lines of a field, like "toomre_q=1,2", in the unit of the field.'
    ),
]
StreamlinesOption = Annotated[
    str | None,
    typer.Option(
        metavar="FRAME",
        help="Streamlines of the velocity: scene, kepler (minus circular orbits), companion or companion.2 (rotating "
        "with it).",
    ),
]

MarkOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME,...",
        help="Marks: bodies, companions, damping, gap, hill, initial; or none [those that there are, except gap].",
    ),
]


@app.command()
def report(
    directory: Annotated[Path, typer.Argument(help="Directory of a run.", metavar="DIR")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="HTML file [DIR/report.html].")
    ] = None,
) -> None:
    """Write an HTML page about a run, to view or print. It has pictures, conservation, cost, effects and the scene."""
    from discsim.report.page import write_report

    path = output or directory / "report.html"
    with exit_on_fault("read or written", path):
        write_report(directory, path)
    show(f"{path}: report of the run in {directory}")


@app.command()
def plot(
    sources: Annotated[
        list[Path] | None, typer.Argument(metavar="DIR|FILE...", help="Directories of runs, or snapshots.")
    ] = None,
    field: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Fields, like toomre_q or dust.v_r [surface_density].")
    ] = None,
    fields: Annotated[bool, typer.Option("--fields", help="List the fields with units and equations.")] = False,
    population: PopulationOption = None,
    profile: Annotated[bool, typer.Option("--profile", help="Draw radial profiles instead of maps.")] = False,
    polar: PolarOption = False,
    time: Annotated[bool, typer.Option("--time", help="Draw maps in radius and time, from all snapshots.")] = False,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Draw particles: this field, like radius, along x, the field of --field along y."
        ),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T",
            help='Time of the snapshot, like "700 yr" or "40 orbits"; the nearest snapshot is drawn [the last].',
        ),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR|FILE",
            help="Second run: draw also its ratio to the single first one, or the difference. For maps, --polar and "
            "--time; to compare profiles, give DIR DIR --profile.",
        ),
    ] = None,
    window: WindowOption = None,
    limits: RangeOption = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    mark: MarkOption = None,
    cmap: CmapOption = None,
    log_radius: LogRadiusOption = False,
    contours: ContoursOption = None,
    streamlines: StreamlinesOption = None,
    style: StyleOption = None,
    dpi: DpiOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Figure: png, pdf or svg [DIR/plots/...png].")
    ] = None,
) -> None:
    """Draw a run or snapshots: maps, profiles, fields in time."""
    if fields:
        from discsim.output.fields.names import field_table

        show(field_table())
        return
    kinds = {"--profile": profile, "--polar": polar, "--time": time, "--against": against is not None}
    given = [name for name, there in kinds.items() if there]
    if not sources:
        fail("no run to draw; give the directory of a run, or a snapshot")
    if len(given) > 1:
        fail(f"{' and '.join(given)} cannot be combined; keep one of these options")
    from discsim.output.fields.display import display_options
    from discsim.output.style import use_style
    from discsim.plot.request import Request, default_path, save

    kind = "phase" if against else given[0].removeprefix("--") if given else None
    with exit_on_fault("written", "the figure"), use_style(style, "--"):
        request = Request(
            [*sources, *([compare] if compare else [])],
            field.split(",") if field else (),
            kind,
            at or (),
            against,
            compare is not None,
            population or (),
            display_options(
                window, limits, distance, wavelength, opacity, mark=mark, prefix="--", cmap=cmap, log_radius=log_radius,
                contours=contours, streamlines=streamlines,
            ),
        )  # fmt: skip
        path = output or default_path(request)
        save(request.figure, path, dpi)
    show(path)


@app.command()
def movie(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a run.")],
    field: Annotated[str | None, typer.Option(metavar="NAME,...", help="Fields [surface_density].")] = None,
    population: PopulationOption = None,
    polar: PolarOption = False,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Snapshots per second.")] = 10.0,
    window: WindowOption = None,
    limits: RangeOption = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    mark: MarkOption = None,
    cmap: CmapOption = None,
    log_radius: LogRadiusOption = False,
    contours: ContoursOption = None,
    streamlines: StreamlinesOption = None,
    style: StyleOption = None,
    dpi: DpiOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Film: mp4 or gif [mp4; gif without the extra movie]."),
    ] = None,
) -> None:
    """Make a film of a run, with one frame for each snapshot."""
    from discsim.output.fields.display import display_options
    from discsim.output.style import use_style
    from discsim.plot.film import Film, default_path, mp4_obstacle

    with exit_on_fault("written", "the figure"), use_style(style, "--"):
        display = display_options(
            window, limits, distance, wavelength, opacity, mark=mark, prefix="--", cmap=cmap, log_radius=log_radius,
            contours=contours, streamlines=streamlines,
        )  # fmt: skip
        kind = "polar" if polar else "map"
        film = Film(source, field.split(",") if field else (), kind, rate, display, population or (), dpi)
        path = output or default_path(film)
        film.save(path, _progress_reporter())
    show(path)
    if output is None and path.suffix == ".gif":
        print(f"the film is a gif: {mp4_obstacle()}", file=sys.stderr)


def _progress_reporter() -> Callable[[int, int], None]:
    """Return a function that reports on standard error how many frames of a film are finished.

    On a terminal it rewrites one line after each frame; otherwise it prints a line every LINE_EVERY seconds.
    """
    from discsim.run.progress import LINE_EVERY

    next_report = time.monotonic()

    def report_frame(done: int, of: int) -> None:
        nonlocal next_report
        if sys.stderr.isatty():
            print(f"\rframe {done} of {of}", end="\n" if done == of else "", file=sys.stderr, flush=True)
        elif time.monotonic() >= next_report or done == of:
            next_report = time.monotonic() + LINE_EVERY
            print(f"frame {done} of {of}", file=sys.stderr, flush=True)

    return report_frame
