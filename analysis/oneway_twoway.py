"""Compare the dust of two or more runs in radius and time, such as one-way and two-way drag.

    discsim analyse oneway-twoway DIR1 DIR2 [DIR ...] [-o OUT] [--within R,...] [--smooth W] [--times]
    python analysis/oneway_twoway.py ...                         the same, from a copy of this script

The script prints these quantities at the end of the runs, with --times for each snapshot. Lengths are in au, or in
code units. All dust populations of a run are taken together.

    r10, r50, r90   radii that contain a tenth, a half and nine tenths of the remaining dust
    M(<R)           dust within R, with the dust that the star has accreted; --within sets the radii (default: r10, r50
                    and r90 at the start of the first run)
    peak            radius, height, width and contrast of the highest peak of the surface density. The contrast is the
                    height over the density in the higher trough next to the peak; the width is that at half of the
                    height above this trough, without a trough at half of the height
    smoothing       standard deviation W of the Gaussian that smooths the profiles, the same for all runs. By default it
                    is as fine as noise permits: at the peak of each run at that time the Gaussian contains 400
                    particles or more, and W is at least 0.6 of their distance. --smooth sets W for all times
    lost            loss of height when the profile is smoothed by the same Gaussian again; the first loss is about as
                    large. A result that depends on the smoothing has a large loss
    noise           error of the height if particles are at random within the Gaussian
    h of the gas    smoothing length of SPH gas at the peak: finer structure depends on the number of particles

It writes two files into OUT or the present directory: oneway_twoway.csv with all times, and oneway_twoway.png with
log Sigma_dust in radius and time, smoothed as maps of `discsim plot` or by W, the radius of the peak, and r50 of all
runs in one panel. The runs must have the same units. If their times differ, the first run is followed to the end of the
shortest. Lengths are given like "20 au"; a plain number is in au, for runs in code units in code units.
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

from discsim.output.bins import MAX_WIDTH, SmoothRings, density_range, smallest_width
from discsim.output.drawing import LINES, figure_text, set_log_ticks
from discsim.output.fields.values import smooth_profile
from discsim.output.results import (
    CODE_UNITS,
    display_unit,
    length_in_code,
    positive_text,
    positive_texts,
    print_fault,
    print_table,
    script_parser,
    with_unit,
    write_table,
)
from discsim.output.snapshot import Snapshot, read_snapshot, snapshot_files
from discsim.plot.compose import RUN_COLOURS
from discsim.plot.request import save
from discsim.printable import UserError, printable
from discsim.scene.populations import populations_of
from discsim.study.outcomes import QUANTILES, quantile_radii

HALF, PEAK = 2, -8  # columns r50 and peak of the quantities of a run
NO_RATIO = ("smoothing", "lost", "noise", "h of the gas")
IN_GAUSSIAN = 400  # particles in the Gaussian at a peak, whose noise is 5%
SIGNIFICANT = 5.0  # noise, from its lowest to its highest values, above which the dust beyond a trough has to rise
SHARP = 1.6  # W, within which a profile falls from 3/4 to 1/4 at an edge (1.35 W) or at a peak that is not resolved


class InputError(UserError):
    """A run or an option that does not suit the comparison; the message has the reason."""


def snapshots(directory: Path) -> list[Snapshot]:
    """Return positions and masses in the snapshots of a run, relative to the centre of the disc.

    Raises SnapshotError, and InputError without dust in two dimensions.
    """
    found = [read_snapshot(file, ("gas.h",)).about_centre() for file in snapshot_files(directory)]
    if found[0].dimensions != 2 or found[0].dust is None or found[0].dust.count == 0:
        raise InputError(f"{directory}: no dust in two dimensions here; expected the run of a dusty disc")
    return found


class Peak(NamedTuple):
    """The highest peak of a profile in code units; width and contrast are NaN where there is none."""

    radius: float
    height: float
    width: float
    contrast: float
    smoothing: float
    lost: float  # per cent
    noise: float  # per cent
    gas_h: float


def profile(snap: Snapshot, ends: tuple[float, float], width: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return edges (n + 1,) and surface density (n,) of the dust, smoothed by `width`, by default as in `plot`."""
    edges, binned = smooth_profile(snap, ends, width=width)
    return edges, binned["dust.surface_density"]


def effective_number(snap: Snapshot, ends: tuple[float, float]) -> tuple[float, float]:
    """Return radius and number of particles per area at the highest peak, (sum m)^2 / sum m^2; NaN without dust."""
    dust = snap.dust
    rings = SmoothRings(dust.radius, ends, 2)
    mass, squares = rings.sum(dust.mass), rings.sum(dust.mass**2)
    k = int((mass / rings.measure).argmax())
    if mass[k] <= 0.0:
        return np.nan, np.nan
    return float(0.5 * (rings.edges[k] + rings.edges[k + 1])), float(mass[k] ** 2 / (squares[k] * rings.measure[k]))


def finest_width(snaps: list[Snapshot], ends: tuple[float, float]) -> float:
    """Return the finest smoothing that the noise permits at the peaks of some snapshots, in code units."""
    widths = []
    for snap in snaps:
        radius, number = effective_number(snap, ends)
        # A Gaussian in radius is as wide as 2 pi^(1/2) W, for the noise of the mean under it.
        widths.append(max(IN_GAUSSIAN / (4.0 * np.pi**1.5 * radius * number), 0.6 / np.sqrt(number)))
    found = [width for width in widths if np.isfinite(width)]
    return float(np.clip(max(found, default=np.inf), smallest_width(ends), MAX_WIDTH * (ends[1] - ends[0])))


def trough(side: np.ndarray, noise: float) -> float:
    """Return the lowest density between a peak and more dust on one of its sides; NaN if the density only falls.

    side (n,): the profile from the peak outwards. noise: noise of the peak as a fraction of its height.
    """
    low = np.minimum.accumulate(side)
    k = int((side - low).argmax())
    needed = max(SIGNIFICANT * noise * float(np.sqrt(side[k] * side[0])), 0.01 * side[0])
    return float(low[k]) if side[k] - low[k] > needed else np.nan


def fall(side: np.ndarray, level: float) -> float:
    """Return the distance from a peak, in rings, at which its profile falls to `level`; NaN if it does not."""
    below = np.flatnonzero(side < level)
    if not len(below):
        return np.nan
    k = int(below[0])
    return k - float((level - side[k]) / (side[k - 1] - side[k]))


def find_peak(snap: Snapshot, ends: tuple[float, float], width: float) -> Peak:
    """Return the highest peak of the dust in a profile smoothed by `width`."""
    edges, sigma = profile(snap, ends, width)
    k, step = int(sigma.argmax()), float(edges[1] - edges[0])
    height, radius = float(sigma[k]), float(edges[k] + 0.5 * step)
    if height <= 0.0:
        return Peak(*[np.nan] * 4, width, *[np.nan] * 3)
    at, number = effective_number(snap, ends)
    noise = float((4.0 * np.pi**1.5 * width * at * number) ** -0.5)
    again = float(profile(snap, ends, 2.0**0.5 * width)[1].max())
    sides = sigma[k::-1], sigma[k:]
    feet = [foot for foot in (trough(side, noise) for side in sides) if not np.isnan(foot)]
    foot = max(feet, default=0.0)
    high, half, low = (
        [step * fall(side, foot + part * (height - foot)) for side in sides] for part in (0.75, 0.5, 0.25)
    )
    is_peak = all(out - top > SHARP * width for top, out in zip(high, low, strict=True))  # False for NaN
    contrast = height / foot if foot > 1e-3 * height else np.nan
    lost = 100.0 * (1.0 - again / height)
    wide = sum(half) if is_peak else np.nan
    return Peak(radius, height, wide, contrast, width, lost, 100.0 * noise, gas_smoothing_length(snap, radius))


def gas_smoothing_length(snap: Snapshot, radius: float) -> float:
    """Return the median h of the hundred gas particles nearest to a radius; NaN without SPH gas."""
    if snap.gas is None or snap.gas.h is None:
        return np.nan
    return float(np.median(snap.gas.h[np.argsort(np.abs(snap.gas.radius - radius))[:100]]))


def rows_of(
    run: list[Snapshot], ends: tuple[float, float], radii: np.ndarray, widths: list[float]
) -> list[list[float]]:
    """Return time, r10, r50, r90, masses within `radii`, and the peak, for each snapshot, in code units.

    widths: smoothing of the profile of each snapshot.
    """
    rows = []
    for snap, width in zip(run, widths, strict=True):
        radius, mass = snap.dust.radius, snap.dust.mass
        taken = max(0.0, float(run[0].dust.mass.sum() - mass.sum()))
        within = [taken + float(mass[radius < r].sum()) for r in radii]
        rows.append([snap.time, *quantile_radii(radius, mass), *within, *find_peak(snap, ends, width)])
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
        figure = Figure(figsize=(5.2 * (len(names) + 1), 6.4), layout="constrained")
        *maps, last = figure.subplots(1, len(names) + 1, sharey=True)
        norm = LogNorm(*density_range(np.concatenate(profiles)), clip=True)
        between = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
        if len(times) == 1:
            between[1] += 1.0  # a single snapshot needs some extent in time
        for ax, name, sigma, values in zip(maps, names, profiles, rows, strict=True):
            sigma = np.maximum(sigma, norm.vmin)
            image = ax.pcolormesh(edges, between, sigma, norm=norm, cmap="inferno", rasterized=True)
            ax.plot(values[:, PEAK], times, color="black", lw=4.5)
            ax.plot(values[:, PEAK], times, color="white", lw=2.0, label="peak")
            ax.set_title(figure_text(name))
        maps[0].legend(loc="upper right", labelcolor="white", facecolor="black", framealpha=0.6, edgecolor="none")
        bar = figure.colorbar(image, ax=maps, label=labels[2], location="bottom", aspect=18 * len(names), pad=0.03)
        set_log_ticks(bar.ax.xaxis, norm.vmin, norm.vmax)
        draw_half(last, names, times, rows)
        for ax in (*maps, last):
            ax.set_xlabel(labels[0])
            ax.locator_params(nbins=5)
        maps[0].set_ylabel(labels[1])
        last.tick_params(labelleft=True)
        last.set_ylabel(labels[1])
        figure.suptitle("Dust against radius and time")
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


def compare(directories: list[Path], out: Path, within: list[str], smooth: str | None) -> Comparison:
    """Write figure and table of the runs, and return the comparison. `within` and `smooth` are lengths as text.

    Raises InputError, OptionError, SnapshotError, OSError.
    """
    if len(directories) < 2:
        raise InputError(f"{directories[0]}: only one run; expected two or more directories of runs to compare")
    runs = common([snapshots(directory) for directory in directories])
    one, names = runs[0], [directory.resolve().name for directory in directories]
    units = one[0].units
    (length, au), (time, yr), (density, g_cm2), (mass, earth) = (
        display_unit(units, dimension, unit)
        for dimension, unit in
        (("length", "au"), ("time", "yr"), ("surface_density", "g/cm2"), ("mass", "Mearth"))
    )  # fmt: skip
    start = one[0].dust.radius
    radii = np.array(
        [length_in_code(text, units, "--within") for text in within] or quantile_radii(start, one[0].dust.mass)
    )
    ends = 0.0, 1.1 * float(np.quantile(start, 0.999))
    given = None if smooth is None else length_in_code(smooth, units, "--smooth")
    if given is not None and not smallest_width(ends) <= given <= ends[1]:
        low, high = (units.show(limit, "length") for limit in (smallest_width(ends), ends[1]))
        raise InputError(f"--smooth {smooth}: expected {low} to {high}")
    widths = [finest_width(list(snaps), ends) if given is None else given for snaps in zip(*runs, strict=True)]
    scale = np.array(
        [time, *[length] * 3, *[mass] * len(radii), length, density, length, 1.0, length, 1.0, 1.0, length]
    )
    columns = [("time", yr), *((f"r{100 * q:.0f}", au) for q in QUANTILES)]
    columns += [(f"M(<{length * r:.3g})", earth) for r in radii]
    columns += [("peak at", au), ("peak", g_cm2), ("width", au), ("contrast", "")]
    columns += [("smoothing", au), ("lost", "%"), ("noise", "%"), ("h of the gas", au)]
    found = [scale * np.array(rows_of(run, ends, radii, widths)) for run in runs]
    made = Comparison(names, columns, found, len(populations_of(one[0].tables)))
    lines = ((name, *(f"{v:.5g}" for v in row)) for rows in zip(*found, strict=True)
             for name, row in zip(names, rows, strict=True))  # fmt: skip
    write_table(out / "oneway_twoway.csv", ["run", *(with_unit(*column) for column in columns)], lines)
    edges = profile(one[0], ends, given)[0]
    profiles = [density * np.array([profile(snap, ends, given)[1] for snap in run]) for run in runs]
    labels = ["r", "t", r"$\Sigma_d$"] if au == CODE_UNITS else ["r [au]", "t [yr]", r"$\Sigma_d$ [g cm$^{-2}$]"]
    labels[2] = f"surface density of the dust, {labels[2]}"
    times = time * np.array([snap.time for snap in one])
    save(partial(draw, names, times, length * edges, profiles, found, labels), out / "oneway_twoway.png")
    return made


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
        has_ratio = name not in NO_RATIO and values[1] and np.isfinite(values[1:]).all()
        ratio = [values[2] / values[1] if has_ratio else None]
        text = f"{name[:-1]} {au})" if name.startswith("M(") and au != CODE_UNITS else name
        rows.append([text, unit, *values, *(ratio if len(made.names) == 2 else [])])
    print_table(title, head, rows[1:])
    show_reasons(dict(zip(head[2:], [first, *last], strict=False)), au)


def show_reasons(shown: dict[str, np.ndarray], unit: str) -> None:
    """Print why a width or a contrast is missing, and if the smoothing is finer than the gas.

    shown: quantities of each column of the table. unit: that of lengths.
    """
    peaks = {name: Peak(*row[PEAK:]) for name, row in shown.items()}
    none = [name for name, peak in peaks.items() if np.isnan(peak.height)]
    if none:
        print(f"no peak ({printable(', '.join(none))}): there is no dust within the radii of the start")
    for quantity, reason in (
        ("width", "the peak is at a sharp edge of the dust, or is not resolved by the smoothing"),
        ("contrast", "there is no trough with dust next to the peak"),
    ):
        missing = [name for name, peak in peaks.items() if np.isnan(getattr(peak, quantity)) and name not in none]
        if missing:
            print(f"no {quantity} ({printable(', '.join(missing))}): {reason}")
    coarse = max((peak.gas_h for peak in peaks.values() if peak.smoothing < peak.gas_h), default=None)
    if coarse is not None:
        text = f"{coarse:.2g} {unit}".removesuffix(f" {CODE_UNITS}")
        print(f'the smoothing is finer than h of the gas: see whether the peaks compare alike with --smooth "{text}"')


def show_times(made: Comparison) -> None:
    """Print one line for each run and snapshot."""
    rows: list[list[object]] = []
    for lines in zip(*made.rows, strict=True):
        rows += [[name, *map(float, line)] for name, line in zip(made.names, lines, strict=True)]
    print_table("Dust in time", ["run", *(with_unit(*column) for column in made.columns)], rows)


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("runs", type=Path, nargs="+", metavar="DIR", help="directories of two or more runs")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="OUT", help="directory of the files (default: the present)"
    )
    parser.add_argument(
        "--within",
        type=positive_texts,
        default=[],
        metavar="R,...",
        help='radii of the masses shown, like "20 au,50 au"',
    )
    parser.add_argument(
        "--smooth",
        type=positive_text,
        metavar="W",
        help='standard deviation of the smoothing, like "0.5 au" (default: the finest that noise permits)',
    )
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
