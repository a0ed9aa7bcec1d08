"""One-way against two-way drag: the dust of two runs side by side in radius and time.

    python analysis/oneway_twoway.py DIR1 DIR2 [-o OUT]

Writes, into OUT or the present directory, oneway_twoway.png (log Sigma_dust of both runs in radius and time, and
their ratio) and oneway_twoway.csv, and prints of both runs in time: the radii r10, r50 and r90 that hold a tenth, a
half and nine tenths of the dust, its mass within three radii, and the place and height of the peak of its
smoothed surface density. The two runs must have the same units; where their times differ the first is followed
up to the end of the shorter.
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
from scipy.ndimage import gaussian_filter1d

from discsim.output.snapshot import Snapshot, SnapshotError, range_of_mass, read_snapshot

QUANTILES = (0.1, 0.5, 0.9)
RINGS, SMOOTHED = 80, 2.0  # rings of a profile; width of the smoothing, in rings


class Fault(Exception):
    """Something the user can put right; the message says what."""


def snapshots(directory: Path) -> list[Snapshot]:
    """The snapshots of a run, all with dust in two dimensions. Raises Fault."""
    files = sorted((directory / "snapshots").glob("*.h5"))
    if not files:
        raise Fault(f"{directory}: no snapshots here; expected the output directory of a run")
    found = [read_snapshot(file) for file in files]
    if found[0].dimensions != 2 or found[0].dust is None:
        raise Fault(f"{directory}: no dust in two dimensions here; expected the run of a dusty disc")
    return found


def quantile_radii(radius: np.ndarray, mass: np.ndarray) -> list[float]:
    """The radii within which QUANTILES of the mass lie."""
    order = np.argsort(radius)
    within = np.cumsum(mass[order])
    return [float(radius[order][np.searchsorted(within, q * within[-1])]) for q in QUANTILES]


def peak(edges: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Radius and height of the largest smoothed surface density."""
    k = int(smoothed(sigma).argmax())
    return float(0.5 * (edges[k] + edges[k + 1])), float(smoothed(sigma)[k])


def smoothed(sigma: np.ndarray) -> np.ndarray:
    """Profiles (..., rings) over neighbouring rings: the particles of a quiet start lie on rings of their own."""
    return gaussian_filter1d(sigma, SMOOTHED, mode="nearest", axis=-1)


def rows_of(run: list[Snapshot], edges: np.ndarray, radii: np.ndarray) -> list[list[float]]:
    """time, r10, r50, r90, masses within `radii`, peak radius, peak height of each snapshot, in code units."""
    rows = []
    for snap in run:
        radius, mass = snap.dust.radius, snap.dust.mass
        within = [float(mass[radius < r].sum()) for r in radii]
        rows.append([snap.time, *quantile_radii(radius, mass), *within, *peak(edges, snap.dust.radial_profile(edges))])
    return rows


def common(one: list[Snapshot], two: list[Snapshot]) -> tuple[list[Snapshot], list[Snapshot]]:
    """The snapshots of both up to the shorter's end; of the second those nearest in time. Raises Fault."""
    if vars(one[0].units) != vars(two[0].units):
        raise Fault("the runs have different units; expected the same in both")
    end = min(one[-1].time, two[-1].time) * (1 + 1e-9)
    first = [snap for snap in one if snap.time <= end]
    times = np.array([snap.time for snap in two])
    return first, [two[int(np.abs(times - snap.time).argmin())] for snap in first]


def draw(names, times, edges, profiles, labels) -> Figure:
    """Sigma_dust of both runs in radius and time, and the second over the first."""
    figure = Figure(figsize=(15, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, sharey=True)
    norm = LogNorm(*range_of_mass(np.concatenate(profiles)), clip=True)
    for ax, name, sigma in zip(axes, names, profiles, strict=False):
        image = ax.pcolormesh(edges, times, np.maximum(sigma, norm.vmin), norm=norm, cmap="inferno", rasterized=True)
        ax.set_title(name)
    figure.colorbar(image, ax=axes[1], label=labels[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        there = np.minimum(*profiles) > 1e-3 * np.max(profiles[0])
        ratio = np.where(there, profiles[1] / profiles[0], np.nan)
    image = axes[2].pcolormesh(
        edges, times, ratio, norm=LogNorm(0.5, 2, clip=True), cmap="RdBu_r", rasterized=True
    )  # fmt: skip
    axes[2].set_title(f"{names[1]} / {names[0]}")
    figure.colorbar(image, ax=axes[2])
    for ax in axes:
        ax.set_xlabel(labels[0])
    axes[0].set_ylabel(labels[1])
    return figure


def compare(first: Path, second: Path, out: Path) -> Table:
    one, two = common(snapshots(first), snapshots(second))
    names = [first.resolve().name, second.resolve().name]
    physical = one[0].units.system != "code"
    quantity = one[0].units.quantity

    def factor(dimension: str, unit: str) -> float:
        return float(quantity(1.0, dimension).to_value(unit)) if physical else 1.0

    length, time, density = factor("length", "au"), factor("time", "yr"), factor("surface_density", "g/cm2")
    mass = factor("mass", "Mearth")
    start = one[0].dust.radius
    radii = np.array(quantile_radii(start, one[0].dust.mass))
    edges = np.linspace(0, 1.1 * float(np.quantile(start, 0.999)), RINGS + 1)
    scale = np.array([time, *[length] * 3, *[mass] * 3, length, density])
    unit = {"t": " [yr]", "r": " [au]", "M": " [Mearth]", "S": " [g/cm2]"} if physical else dict.fromkeys("trMS", "")
    columns = [f"time{unit['t']}"]
    columns += [f"r{100 * q:.0f}{unit['r']}" for q in QUANTILES]
    columns += [f"M(<{length * r:.3g}){unit['M']}" for r in radii]
    columns += [f"peak at{unit['r']}", f"peak{unit['S']}"]
    out.mkdir(parents=True, exist_ok=True)
    table = Table("run", *columns)
    with (out / "oneway_twoway.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["run", *columns])
        for a, b in zip(rows_of(one, edges, radii), rows_of(two, edges, radii), strict=True):
            for name, row in zip(names, (a, b), strict=True):
                values = [f"{value:.5g}" for value in scale * np.array(row)]
                writer.writerow([name, *values])
                table.add_row(name, *values)
    profiles = [density * smoothed(np.array([s.dust.radial_profile(edges) for s in run])) for run in (one, two)]
    times = time * np.array([snap.time for snap in one])
    between = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
    labels = ["r [au]", "t [yr]", r"$\Sigma_d$ [g cm$^{-2}$]"] if physical else ["r", "t", r"$\Sigma_d$"]
    draw(names, between, length * edges, profiles, labels).savefig(out / "oneway_twoway.png", dpi=110)
    return table


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=Path, metavar="DIR1", help="output directory of a run, one-way say")
    parser.add_argument("second", type=Path, metavar="DIR2", help="of the run to hold against it")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="OUT", help="where to write; default: here"
    )
    given = parser.parse_args(arguments)
    try:
        table = compare(given.first, given.second, given.output)
    except (Fault, SnapshotError, OSError) as error:
        print(f"oneway_twoway: {error}", file=sys.stderr)
        return 2
    Console(width=170).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
