"""Compare the dust of two or more runs in radius and time, such as one-way and two-way drag.

    discsim analyse oneway-twoway DIR1 DIR2 [DIR ...] [-o OUT] [--within R,...] [--smooth W] [--times]
    python analysis/oneway_twoway.py ...                         the same, from a copy of this script

The script prints these quantities at the end of the runs, with --times for each snapshot. Lengths are in au, or in
code units. All dust populations of a run are taken together.

    r10, r50, r90   radii that contain a tenth, a half and nine tenths of the remaining dust
    M(<R)           dust within R, with the dust that the star has accreted; --within sets the radii (default: r10, r50
                    and r90 at the start of the first run)
    peak            radius, height, width and contrast of the highest peak of the surface density, smoothed by a
                    Gaussian of standard deviation W (--smooth; default: two rings of 80). The width is that at half of
                    the height above the higher foot of the peak, the contrast is the height over this foot

It writes two files into OUT or the present directory: oneway_twoway.csv with all times, and oneway_twoway.png with
log Sigma_dust in radius and time, the radius of the peak, and r50 of all runs in one panel. The runs must have
the same units. If their times differ, the first run is followed to the end of the shortest.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.signal import peak_prominences, peak_widths

from discsim.output.bins import density_range
from discsim.output.drawing import LINES, figure_text, set_log_ticks
from discsim.output.populations import populations_of
from discsim.output.results import (
    CODE_UNITS,
    display_unit,
    positive_number,
    print_fault,
    print_table,
    script_parser,
    write_table,
)
from discsim.output.snapshot import Snapshot, read_snapshot, snapshot_files
from discsim.plot.compose import RUN_COLOURS
from discsim.plot.request import save
from discsim.printable import UserError
from discsim.study.outcomes import QUANTILES, RINGS, SMOOTHING_RINGS, quantile_radii, smoothed

HALF, PEAK = 2, -4  # columns r50 and peak of the quantities of a run
FINE = 4  # smallest number of rings in a given width of the smoothing
MAX_RINGS = 100_000


class InputError(UserError):
    """A run or an option that does not suit the comparison; the message has the reason."""


def snapshots(directory: Path) -> list[Snapshot]:
    """Return positions and masses in the snapshots of a run, relative to the centre of the disc.

    Raises SnapshotError, and InputError without dust in two dimensions.
    """
    found = [read_snapshot(file, ()).about_centre() for file in snapshot_files(directory)]
    if found[0].dimensions != 2 or found[0].dust is None or found[0].dust.count == 0:
        raise InputError(f"{directory}: no dust in two dimensions here; expected the run of a dusty disc")
    return found


def ring(edges: np.ndarray, sigma: np.ndarray, rings: float) -> list[float]:
    """Return radius, height, width and contrast of the highest peak of a profile, smoothed over so many rings."""
    profile, side = smoothed(sigma, rings), edges[1] - edges[0]
    k = int(profile.argmax())
    around = np.concatenate([[0.0], profile, [0.0]])  # so that a maximum at an edge counts as a peak
    if profile[k] <= 0.0:
        return [float("nan")] * 4
    prominences = peak_prominences(around, [k + 1])
    foot = profile[k] - float(prominences[0][0])
    width = float(peak_widths(around, [k + 1], 0.5, prominences)[0][0]) * side
    return [float(edges[k] + 0.5 * side), float(profile[k]), width, float(profile[k] / foot) if foot > 0 else np.inf]


def rows_of(run: list[Snapshot], edges: np.ndarray, radii: np.ndarray, rings: float) -> list[list[float]]:
    """Return time, r10, r50, r90, masses within `radii`, and the peak, for each snapshot, in code units."""
    rows = []
    for snap in run:
        radius, mass = snap.dust.radius, snap.dust.mass
        taken = max(0.0, float(run[0].dust.mass.sum() - mass.sum()))
        within = [taken + float(mass[radius < r].sum()) for r in radii]
        found = ring(edges, snap.dust.radial_profile(edges), rings)
        rows.append([snap.time, *quantile_radii(radius, mass), *within, *found])
    return rows


def common(runs: list[list[Snapshot]]) -> list[list[Snapshot]]:
    """Return the snapshots of the first run up to the shortest end, and of the others those nearest in time.

    Raises InputError for different units.
    """
    first = runs[0]
    if any(vars(run[0].units) != vars(first[0].units) for run in runs):
        raise InputError("the runs have different units; expected runs with the same [units]")
    end = min(run[-1].time for run in runs) * (1 + 1e-9)
    chosen = [[snap for snap in first if snap.time <= end]]
    for run in runs[1:]:
        times = np.array([snap.time for snap in run])
        chosen.append([run[int(np.abs(times - snap.time).argmin())] for snap in chosen[0]])
    return chosen


def draw(
    names: list[str],
    times: np.ndarray,
    edges: np.ndarray,
    profiles: list[np.ndarray],
    rows: list[np.ndarray],
    labels: list[str],
) -> Figure:
    """Return the figure, to be read from afar: Sigma_dust of each run in radius and time, and r50 of all.

    `rows` (times, columns) are the quantities of each run, as in `Comparison`.
    """
    with rc_context({"font.size": 16, "axes.titlesize": 17, "axes.linewidth": 1.2}):
        figure = Figure(figsize=(5.2 * (len(names) + 1), 5.4), layout="constrained")
        *maps, last = figure.subplots(1, len(names) + 1, sharey=True)
        norm = LogNorm(*density_range(np.concatenate(profiles)), clip=True)
        between = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
        if len(times) == 1:
            between[1] += 1.0  # a single snapshot needs some extent in time
        for ax, name, sigma, values in zip(maps, names, profiles, rows, strict=True):
            sigma = np.maximum(sigma, norm.vmin)
            image = ax.pcolormesh(edges, between, sigma, norm=norm, cmap="inferno", rasterized=True)
            ax.plot(values[:, PEAK], times, color="black", lw=2.5, ls=":")
            ax.set_title(figure_text(name))
        maps[0].annotate(
            "peak", (rows[0][-1, PEAK], times[-1]), (8, -8), textcoords="offset points", va="top", color="black"
        )
        bar = figure.colorbar(image, ax=maps[-1], label=labels[2])
        set_log_ticks(bar.ax.yaxis, norm.vmin, norm.vmax)
        draw_half(last, names, times, rows)
        for ax in (*maps, last):
            ax.set_xlabel(labels[0])
            ax.locator_params(nbins=5)
        maps[0].set_ylabel(labels[1])
    return figure


def draw_half(ax: Axes, names: list[str], times: np.ndarray, rows: list[np.ndarray]) -> None:
    """Draw the radius that contains half of the dust of each run against time."""
    for number, (name, values) in enumerate(zip(names, rows, strict=True)):
        colour, line = RUN_COLOURS[number % len(RUN_COLOURS)], LINES[number % len(LINES)]
        ax.plot(values[:, HALF], times, color=colour, ls=line, lw=4, label=figure_text(name))
    ax.margins(x=0.15)
    ax.set_title("half of the dust is within")
    ax.grid(alpha=0.3)
    ax.legend(loc="best", labelcolor="linecolor", frameon=False, handlelength=1.6)


class Comparison(NamedTuple):
    """Quantities of all runs: `names` of runs, `columns` (name, unit), and `rows` (times, columns) of each run."""

    names: list[str]
    columns: list[tuple[str, str]]
    rows: list[np.ndarray]
    populations: int


def compare(directories: list[Path], out: Path, within: list[float], width: float | None) -> Comparison:
    """Write figure and table of the runs, and return the comparison. `within` and `width` are in au, or code units.

    Raises InputError, SnapshotError, OSError.
    """
    if len(directories) < 2:
        raise InputError(f"{directories[0]}: only one run; expected two or more directories of runs to compare")
    runs = common([snapshots(directory) for directory in directories])
    one, names = runs[0], [directory.resolve().name for directory in directories]
    (length, au), (time, yr), (density, g_cm2), (mass, earth) = (
        display_unit(one[0].units, dimension, unit)
        for dimension, unit in
        (("length", "au"), ("time", "yr"), ("surface_density", "g/cm2"), ("mass", "Mearth"))
    )  # fmt: skip
    start = one[0].dust.radius
    radii = np.array(within) / length if within else np.array(quantile_radii(start, one[0].dust.mass))
    reach = 1.1 * float(np.quantile(start, 0.999))
    number = RINGS if width is None else max(RINGS, int(np.ceil(FINE * reach * length / width)))
    if number > MAX_RINGS:
        raise InputError(f"--smooth {width:g}: expected at least {FINE * reach * length / MAX_RINGS:.3g}")
    edges = np.linspace(0, reach, number + 1)
    rings = SMOOTHING_RINGS if width is None else width / length / (edges[1] - edges[0])
    scale = np.array([time, *[length] * 3, *[mass] * len(radii), length, density, length, 1.0])
    columns = [("time", yr), *((f"r{100 * q:.0f}", au) for q in QUANTILES)]
    columns += [(f"M(<{length * r:.3g})", earth) for r in radii]
    columns += [("peak at", au), ("peak", g_cm2), ("width", au), ("contrast", "")]
    found = [scale * np.array(rows_of(run, edges, radii, rings)) for run in runs]
    made = Comparison(names, columns, found, len(populations_of(one[0].tables)))
    lines = ((name, *(f"{v:.5g}" for v in row)) for rows in zip(*found, strict=True)
             for name, row in zip(names, rows, strict=True))  # fmt: skip
    write_table(out / "oneway_twoway.csv", ["run", *headings(columns)], lines)
    profiles = [density * smoothed(np.array([s.dust.radial_profile(edges) for s in run]), rings) for run in runs]
    labels = ["r", "t", r"$\Sigma_d$"] if au == CODE_UNITS else ["r [au]", "t [yr]", r"$\Sigma_d$ [g cm$^{-2}$]"]
    times = time * np.array([snap.time for snap in one])
    save(partial(draw, names, times, length * edges, profiles, found, labels), out / "oneway_twoway.png")
    return made


def headings(columns: list[tuple[str, str]]) -> list[str]:
    """Return the heads of columns: names, with units unless these are code units."""
    return [f"{name} [{unit}]" if unit not in ("", CODE_UNITS) else name for name, unit in columns]


def show(made: Comparison) -> None:
    """Print one line for each quantity at the end of the runs, with the start of the first run, and ratios of two."""
    first, last = made.rows[0][0], [rows[-1] for rows in made.rows]
    together = f", all {made.populations} populations together" if made.populations > 1 else ""
    unit = made.columns[0][1]
    title = f"Dust at {last[0][0]:.4g} {unit}{together}"
    au = dict(made.columns)["r50"]
    head = ["quantity", "unit", f"start of {made.names[0]}", *made.names]
    head += [f"{made.names[1]} / {made.names[0]}"] if len(made.names) == 2 else []
    rows: list[list[object]] = []
    for k, (name, unit) in enumerate(made.columns):
        values = [float(first[k]), *(float(row[k]) for row in last)]
        ratio = [values[2] / values[1] if values[1] and np.isfinite(values[1:]).all() else None]
        text = f"{name[:-1]} {au})" if name.startswith("M(") and au != CODE_UNITS else name
        rows.append([text, unit, *values, *(ratio if len(made.names) == 2 else [])])
    print_table(title, head, rows[1:])


def show_times(made: Comparison) -> None:
    """Print one line for each run and snapshot."""
    rows: list[list[object]] = []
    for lines in zip(*made.rows, strict=True):
        rows += [[name, *map(float, line)] for name, line in zip(made.names, lines, strict=True)]
    print_table("Dust in time", ["run", *headings(made.columns)], rows)


def lengths(text: str) -> list[float]:
    """Return positive numbers, separated by commas, from the command line."""
    return [positive_number(part) for part in text.split(",")]


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("runs", type=Path, nargs="+", metavar="DIR", help="directories of two or more runs")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="OUT", help="directory of the files (default: the present)"
    )
    parser.add_argument("--within", type=lengths, default=[], metavar="R,...", help="radii in au of the masses shown")
    parser.add_argument("--smooth", type=positive_number, metavar="W", help="standard deviation of the smoothing in au")
    parser.add_argument("--times", action="store_true", help="print the quantities of each snapshot")
    given = parser.parse_args(arguments)
    try:
        made = compare(given.runs, given.output, given.within, given.smooth)
    except (UserError, OSError) as error:
        return print_fault("oneway_twoway", error)
    (show_times if given.times else show)(made)
    print(f"{given.output / 'oneway_twoway.csv'}\n{given.output / 'oneway_twoway.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
