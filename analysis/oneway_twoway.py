"""One-way against two-way drag: the dust of two or more runs side by side in radius and time.

    python analysis/oneway_twoway.py DIR1 DIR2 [DIR ...] [-o OUT] [--within R,...] [--smooth W]

Writes, into OUT or the present directory, oneway_twoway.png (log Sigma_dust of all runs in radius and time, with the
track of the ring, and of two runs their ratio) and oneway_twoway.csv, and prints of all in time: the radii r10, r50
and r90 that hold a tenth, a half and nine tenths of the dust that is left; its mass within some radii, with what the
star has taken (`--within`; else the three at the start of the first run); and the ring: place, height, width and
contrast of the highest peak of its surface density, smoothed with a Gaussian of standard deviation W (`--smooth`; else
two rings of 80). Width is that at half of the peak's height over the higher of its two feet, contrast the peak over
that foot. Lengths are in au, or in code units. The runs must have the same units; where their times differ the first is
followed up to the end of the shortest.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from scipy.signal import peak_prominences, peak_widths

from discsim.output.bins import density_range
from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot
from discsim.study.outcomes import QUANTILES, RINGS, SMOOTHING_RINGS, quantile_radii, smoothed

FINE = 4  # rings in a given width of the smoothing, least


class InputError(Exception):
    """Something the user can put right; the message says what."""


def snapshots(directory: Path) -> list[Snapshot]:
    """The snapshots of a run, all with dust in two dimensions. Raises InputError."""
    files = sorted((directory / "snapshots").glob("*.h5"))
    if not files:
        raise InputError(f"{directory}: no snapshots found; expected the output directory of a run")
    found = [read_snapshot(file) for file in files]
    if found[0].dimensions != 2 or found[0].dust is None:
        raise InputError(f"{directory}: no dust in two dimensions here; expected the run of a dusty disc")
    return found


def ring(edges: np.ndarray, sigma: np.ndarray, rings: float) -> list[float]:
    """Place, height, width and contrast of the highest peak of a profile, smoothed over so many rings."""
    profile, side = smoothed(sigma, rings), edges[1] - edges[0]
    k = int(profile.argmax())
    around = np.concatenate([[0.0], profile, [0.0]])  # a peak at the edge is one
    if profile[k] <= 0.0:
        return [float("nan")] * 4
    prominences = peak_prominences(around, [k + 1])
    foot = profile[k] - float(prominences[0][0])
    width = float(peak_widths(around, [k + 1], 0.5, prominences)[0][0]) * side
    return [float(edges[k] + 0.5 * side), float(profile[k]), width, float(profile[k] / foot) if foot > 0 else np.inf]


def rows_of(run: list[Snapshot], edges: np.ndarray, radii: np.ndarray, rings: float) -> list[list[float]]:
    """time, r10, r50, r90, masses within `radii`, and the ring, of each snapshot, in code units."""
    rows = []
    for snap in run:
        radius, mass = snap.dust.radius, snap.dust.mass
        taken = max(0.0, float(run[0].dust.mass.sum() - mass.sum()))
        within = [taken + float(mass[radius < r].sum()) for r in radii]
        found = ring(edges, snap.dust.radial_profile(edges), rings)
        rows.append([snap.time, *quantile_radii(radius, mass), *within, *found])
    return rows


def common(runs: list[list[Snapshot]]) -> list[list[Snapshot]]:
    """The snapshots of all up to the shortest's end; those nearest in time to the first's. Raises InputError."""
    first = runs[0]
    if any(vars(run[0].units) != vars(first[0].units) for run in runs):
        raise InputError("the runs have different units; expected the same in all")
    end = min(run[-1].time for run in runs) * (1 + 1e-9)
    chosen = [[snap for snap in first if snap.time <= end]]
    for run in runs[1:]:
        times = np.array([snap.time for snap in run])
        chosen.append([run[int(np.abs(times - snap.time).argmin())] for snap in chosen[0]])
    return chosen


def draw(names, times, edges, profiles, tracks, labels) -> Figure:
    """Sigma_dust of all runs in radius and time, and of two the second over the first."""
    ratio = len(names) == 2
    figure = Figure(figsize=(5 * (len(names) + ratio), 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(names) + ratio, sharey=True, squeeze=False)[0]
    norm = LogNorm(*density_range(np.concatenate(profiles)), clip=True)
    between = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
    for ax, name, sigma, track in zip(axes, names, profiles, tracks, strict=False):
        image = ax.pcolormesh(edges, between, np.maximum(sigma, norm.vmin), norm=norm, cmap="inferno", rasterized=True)
        ax.plot(track, times, color="c", lw=0.8, ls=":")
        ax.set_title(name)
    figure.colorbar(image, ax=axes[len(names) - 1], label=labels[2])
    if ratio:
        with np.errstate(divide="ignore", invalid="ignore"):
            there = np.minimum(*profiles) > 1e-3 * np.max(profiles[0])
            over = np.where(there, profiles[1] / profiles[0], np.nan)
        norm = LogNorm(0.5, 2, clip=True)
        image = axes[2].pcolormesh(edges, between, over, norm=norm, cmap="RdBu_r", rasterized=True)
        axes[2].set_title(f"{names[1]} / {names[0]}")
        figure.colorbar(image, ax=axes[2])
    for ax in axes:
        ax.set_xlabel(labels[0])
    axes[0].set_ylabel(labels[1])
    return figure


def compare(directories: list[Path], out: Path, within: list[float], width: float | None) -> Table:
    """Write figure and table of the runs; returns the table. `within` and `width` in au, or code units."""
    runs = common([snapshots(directory) for directory in directories])
    one, names = runs[0], [directory.resolve().name for directory in directories]
    physical = one[0].units.system != "code"
    quantity = one[0].units.quantity

    def factor(dimension: str, unit: str) -> float:
        return float(quantity(1.0, dimension).to_value(unit)) if physical else 1.0

    length, time, density = factor("length", "au"), factor("time", "yr"), factor("surface_density", "g/cm2")
    mass = factor("mass", "Mearth")
    start = one[0].dust.radius
    radii = np.array(within) / length if within else np.array(quantile_radii(start, one[0].dust.mass))
    reach = 1.1 * float(np.quantile(start, 0.999))
    number = RINGS if width is None else max(RINGS, int(np.ceil(FINE * reach * length / width)))
    edges = np.linspace(0, reach, number + 1)
    rings = SMOOTHING_RINGS if width is None else width / length / (edges[1] - edges[0])
    scale = np.array([time, *[length] * 3, *[mass] * len(radii), length, density, length, 1.0])
    unit = {"t": " [yr]", "r": " [au]", "M": " [Mearth]", "S": " [g/cm2]"} if physical else dict.fromkeys("trMS", "")
    columns = [f"time{unit['t']}"]
    columns += [f"r{100 * q:.0f}{unit['r']}" for q in QUANTILES]
    columns += [f"M(<{length * r:.3g}){unit['M']}" for r in radii]
    columns += [f"peak at{unit['r']}", f"peak{unit['S']}", f"width{unit['r']}", "contrast"]
    out.mkdir(parents=True, exist_ok=True)
    table = Table("run", *columns)
    found = [[scale * np.array(row) for row in rows_of(run, edges, radii, rings)] for run in runs]
    with (out / "oneway_twoway.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["run", *columns])
        for rows in zip(*found, strict=True):
            for name, row in zip(names, rows, strict=True):
                values = [f"{value:.5g}" for value in row]
                writer.writerow([name, *values])
                table.add_row(name, *values)
    profiles = [density * smoothed(np.array([s.dust.radial_profile(edges) for s in run]), rings) for run in runs]
    times = time * np.array([snap.time for snap in one])
    labels = ["r [au]", "t [yr]", r"$\Sigma_d$ [g cm$^{-2}$]"] if physical else ["r", "t", r"$\Sigma_d$"]
    tracks = [np.array(rows)[:, columns.index(f"peak at{unit['r']}")] for rows in found]
    draw(names, times, length * edges, profiles, tracks, labels).savefig(out / "oneway_twoway.png", dpi=110)
    return table


def lengths(text: str) -> list[float]:
    """Positive numbers between commas."""
    found = [float(part) for part in text.split(",")]
    if not all(0.0 < value < np.inf for value in found):
        raise argparse.ArgumentTypeError(f"{text}: expected lengths above 0")
    return found


def length(text: str) -> float:
    return lengths(text)[0]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", metavar="DIR", help="output directories of runs, two or more")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="OUT", help="where to write; default: here"
    )
    parser.add_argument("--within", type=lengths, default=[], metavar="R,...", help="radii whose masses are shown")
    parser.add_argument("--smooth", type=length, metavar="W", help="standard deviation of the profiles' smoothing")
    given = parser.parse_args(arguments)
    try:
        table = compare(given.runs, given.output, given.within, given.smooth)
    except (InputError, SnapshotError, OSError) as error:
        print(f"oneway_twoway: {error}", file=sys.stderr)
        return 2
    Console(width=200).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
