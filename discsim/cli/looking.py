"""Commands that show the results of a run, finished or not: `report`, `plot` and `movie`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from discsim.cli.base import INTERRUPTED, NOT_WRITTEN, app, fail, show
from discsim.userfiles import system_message

WindowOption = Annotated[
    str | None, typer.Option(metavar="R", help='Region to show: "50 au", "10 au,50 au" in radius, "X,Y,R" on a map.')
]
DistanceOption = Annotated[
    str | None, typer.Option(metavar="D", help='Distance of the disc, for angles in arcsec and fluxes, like "140 pc".')
]
WavelengthOption = Annotated[
    str | None, typer.Option(metavar="L", help="Wavelength for emission and optical_depth [1.3 mm].")
]
OpacityOption = Annotated[
    str | None, typer.Option(metavar="K", help='Opacity per gram of dust, like "2 cm2/g" [10 cm2/g (nu / THz)].')
]


@app.command()
def report(
    directory: Annotated[Path, typer.Argument(help="Directory of a run.", metavar="DIR")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="HTML file [DIR/report.html].")
    ] = None,
) -> None:
    """Write a page of a run, for a browser or for paper. It has pictures, conservation, cost, effects and the scene."""
    from discsim.output.snapshot import SnapshotError
    from discsim.report.page import ReportError, write_report
    from discsim.scene import SceneError
    from discsim.study.points import StudyError

    path = output or directory / "report.html"
    try:
        write_report(directory, path)
    except (ReportError, SceneError, SnapshotError, StudyError) as wrong:
        fail(str(wrong))
    except OSError as error:
        fail(system_message(error, "read or written", path), NOT_WRITTEN)
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
    profile: Annotated[bool, typer.Option("--profile", help="Draw radial profiles instead of maps.")] = False,
    polar: Annotated[bool, typer.Option("--polar", help="Draw in angle and radius.")] = False,
    time: Annotated[bool, typer.Option("--time", help="Draw in radius and time, from all snapshots.")] = False,
    against: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Draw particles in the plane of this field, like radius, and --field."),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="T", help='Time of the snapshot, like "700 yr"; the nearest is drawn [the last].'),
    ] = None,
    compare: Annotated[
        Path | None, typer.Option(metavar="DIR|FILE", help="Draw ratio or difference of this run to the first.")
    ] = None,
    window: WindowOption = None,
    limits: Annotated[str | None, typer.Option("--range", metavar="LOW,HIGH", help="Range of colours or axis.")] = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Figure: png, pdf or svg [DIR/plots/...png].")
    ] = None,
) -> None:
    """Draw a run or snapshots: maps, profiles, fields in time."""
    if fields:
        from discsim.output.fields.names import table

        show(table())
        return
    kinds = {"--profile": profile, "--polar": polar, "--time": time, "--against": against is not None}
    given = [name for name, there in kinds.items() if there]
    if not sources or len(given) > 1:
        fail(
            "no run to draw; expected DIR or FILE"
            if not sources
            else f"{' and '.join(given)}: expected only one of them"
        )
    from discsim.output.fields.look import look_of
    from discsim.plot.request import Request, default_path, save

    kind = "phase" if against else given[0].removeprefix("--") if given else None

    def make() -> Path:
        request = Request(
            [*sources, *([compare] if compare else [])],
            field.split(",") if field else (),
            kind,
            at or (),
            against,
            compare is not None,
            look_of(window, limits, distance, wavelength, opacity, prefix="--"),
        )
        where = output or default_path(request)
        save(request.figure, where)
        return where

    show(_draw_or_exit(make))


@app.command()
def movie(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a run.")],
    field: Annotated[str | None, typer.Option(metavar="NAME,...", help="Fields [surface_density].")] = None,
    polar: Annotated[bool, typer.Option("--polar", help="Draw in angle and radius.")] = False,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Snapshots per second.")] = 10.0,
    window: WindowOption = None,
    limits: Annotated[str | None, typer.Option("--range", metavar="LOW,HIGH", help="Range of colours.")] = None,
    distance: DistanceOption = None,
    wavelength: WavelengthOption = None,
    opacity: OpacityOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Film: mp4 or gif [DIR/plots/...].")
    ] = None,
) -> None:
    """Make a film of a run, a frame a snapshot."""
    from discsim.output.fields.look import look_of
    from discsim.plot.film import Film, default_path

    def make() -> Path:
        look = look_of(window, limits, distance, wavelength, opacity, prefix="--")
        film = Film(source, field.split(",") if field else (), "polar" if polar else "map", rate, look)
        where = output or default_path(film)
        film.save(where, _progress_reporter())
        return where

    show(_draw_or_exit(make))


def _progress_reporter() -> Callable[[int, int], None]:
    """Return a function that reports the progress of a film on standard error.

    On a terminal it rewrites one line per frame; otherwise it prints a line every LINE_EVERY seconds.
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


def _draw_or_exit(make: Callable[[], Path]) -> Path:
    """Call `make`, which writes a figure or film, and return the path. On an error, print a message and exit."""
    from discsim.output.fields.base import FieldError, PlotError
    from discsim.output.snapshot import SnapshotError

    try:
        return make()
    except (FieldError, PlotError, SnapshotError) as wrong:
        fail(str(wrong))
    except OSError as error:
        fail(system_message(error, "written", "the figure"), NOT_WRITTEN)
    except KeyboardInterrupt:
        fail("interrupted; no file was written", INTERRUPTED)
