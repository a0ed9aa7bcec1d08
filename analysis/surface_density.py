"""Surface density of runs: radial profiles at several times, the last map, and log Sigma in radius and time.

    python analysis/surface_density.py DIR... [-o OUT] [--smooth W | --rings N]

Each DIR is the output directory of a run. For each run it writes, into OUT or into the run's own directory,
NAME-profiles.png, NAME-map.png, NAME-radius-time.png and NAME-profiles.csv (Sigma by time and radius),
where NAME is the directory's name.

Profiles are those of `discsim plot --profile`: each particle is spread in radius by a Gaussian. By default its standard
deviation is 0.6 of the mean distance between particles at that radius, which hides the rings in which particles start;
--smooth W sets it everywhere, to a length like "2 au" (a plain number is in au, for runs in code units in code units).
With --rings N, Sigma is the mass in each of N rings over the area of the ring, without smoothing, so that the rings in
which particles start show as waves.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from discsim import open_run
from discsim.output.bins import density_range, smallest_width
from discsim.output.fields.values import smooth_profile
from discsim.output.results import length_in_code, positive_text, print_fault, script_parser, write_table
from discsim.output.snapshot import Snapshot
from discsim.plot.request import save
from discsim.printable import UserError

COLOURS = {"gas": "viridis", "dust": "inferno"}
CURVES = 5  # times in the figure of profiles
PIXELS = 480


class InputError(UserError):
    """A run that has no surface density; the message has the reason."""


class Run:
    """The snapshots of one run and its radial profiles, in the units of the figures.

    smooth: standard deviation of the smoothing as text, by default that of `discsim plot --profile`. rings: number of
    rings without smoothing.
    """

    def __init__(self, directory: Path, smooth: str | None, rings: int | None) -> None:
        snapshots = list(open_run(directory))
        self.name, self.last = directory.resolve().name, snapshots[-1]
        if self.last.dimensions != 2:
            raise InputError(f"{directory}: a run in one dimension has no surface density")
        ends = 0.0, _reach(snapshots[0])
        width = None if smooth is None else length_in_code(smooth, self.last.units, "--smooth")
        self.kinds = list(self.last.species)
        self.physical = self.last.units.system != "code"
        self.length = self._factor("length", "au")
        self.density = self._factor("surface_density", "g/cm2")
        self.times = self._factor("time", "yr") * np.array([snap.time for snap in snapshots])
        if width is not None and not smallest_width(ends) <= width <= ends[1]:
            low, high = (self.last.units.show(limit, "length") for limit in (smallest_width(ends), ends[1]))
            raise InputError(f"--smooth {smooth}: expected {low} to {high} for {directory}")
        self.edges = np.empty(0)
        self.profiles = {
            kind: self.density * self._profiles(snapshots, kind, ends, width, rings) for kind in self.kinds
        }

    def _profiles(
        self, snapshots: list[Snapshot], kind: str, ends: tuple[float, float], width: float | None, rings: int | None
    ) -> np.ndarray:
        """Return the profiles (times, rings) of a species in code units, and set the edges of the rings."""
        if rings is not None:
            self.edges = np.linspace(*ends, rings + 1)
            return np.array([snap.species[kind].radial_profile(self.edges) for snap in snapshots])
        found = [smooth_profile(snap, ends, width=width) for snap in snapshots]
        self.edges = found[0][0]
        return np.array([binned[f"{kind}.surface_density"] for _, binned in found])

    def _factor(self, dimension: str, unit: str) -> float:
        """From code units to those of the figures."""
        return float(self.last.units.quantity(1.0, dimension).to_value(unit)) if self.physical else 1.0

    @property
    def radius(self) -> np.ndarray:
        return self.length * (self.edges[1:] + self.edges[:-1]) / 2

    def label(self, name: str, unit: str) -> str:
        return f"{name} [{unit}]" if self.physical else name

    def time_text(self, time: float) -> str:
        return f"t = {time:.4g} yr" if self.physical else f"t = {time:.4g}"


def _reach(snap: Snapshot) -> float:
    """The radius that holds all but half a per cent of the particles, and a little more for what spreads."""
    radii = [particles.radius for particles in snap.species.values() if particles.count]
    if not radii:
        raise InputError("the first snapshot holds no particles")
    return 1.15 * max(float(np.quantile(radius, 0.995)) for radius in radii)


def profiles_figure(run: Run) -> Figure:
    """Sigma(r) at a few times, one panel a species."""
    figure = Figure(figsize=(6.2 * len(run.kinds), 4.6), layout="constrained")
    shown = np.unique(np.linspace(0, len(run.times) - 1, CURVES).round().astype(int))
    for axes, kind in zip(np.atleast_1d(figure.subplots(1, len(run.kinds))), run.kinds, strict=True):
        shades = _shades(kind, len(shown))
        for shade, index in zip(shades, shown, strict=True):
            sigma = run.profiles[kind][index]
            curve = np.where(sigma > 0, sigma, np.nan)
            axes.plot(run.radius, curve, color=shade, label=run.time_text(run.times[index]))
        peak = run.profiles[kind].max()
        if peak > 0:
            axes.set(yscale="log", ylim=(peak * 10**-4.5, peak * 2))
        axes.set(title=kind, xlabel=run.label("r", "au"), xlim=(0, run.radius[-1]))
        axes.set_ylabel(run.label(rf"$\langle\Sigma_\mathrm{{{kind}}}\rangle$", "g cm$^{-2}$"))
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    return figure


def _shades(kind: str, count: int) -> list:
    return list(matplotlib.colormaps[COLOURS[kind]](np.linspace(0.1, 0.8, count)))


def map_figure(run: Run) -> Figure:
    """The last surface density, one panel a species."""
    figure = Figure(figsize=(6 * len(run.kinds), 5), layout="constrained")
    half = run.edges[-1]
    side = half * run.length
    for axes, kind in zip(np.atleast_1d(figure.subplots(1, len(run.kinds))), run.kinds, strict=True):
        window = np.full(2, -half), np.full(2, half)
        sigma = run.density * run.last.species[kind].surface_density_map(*window, PIXELS).T
        norm = LogNorm(*density_range(sigma), clip=True)
        extent = (-side, side, -side, side)
        shown = np.maximum(sigma, norm.vmin)
        image = axes.imshow(shown, origin="lower", extent=extent, norm=norm, cmap=COLOURS[kind])
        axes.set(title=kind, xlabel=run.label("x", "au"), ylabel=run.label("y", "au"))
        label = run.label(rf"$\Sigma_\mathrm{{{kind}}}$", "g cm$^{-2}$")
        figure.colorbar(image, ax=axes, label=label, pad=0.02)
    figure.suptitle(run.time_text(run.times[-1]))
    return figure


def radius_time_figure(run: Run) -> Figure:
    """Angle-averaged log Sigma in radius and time, one panel a species."""
    figure = Figure(figsize=(6.2 * len(run.kinds), 4.8), layout="constrained")
    for axes, kind in zip(np.atleast_1d(figure.subplots(1, len(run.kinds))), run.kinds, strict=True):
        sigma = run.profiles[kind]
        norm = LogNorm(*density_range(sigma), clip=True)
        shown = np.maximum(sigma, norm.vmin)
        edges = run.length * run.edges
        image = axes.pcolormesh(edges, _between(run.times), shown, norm=norm, cmap=COLOURS[kind], rasterized=True)
        axes.set(title=kind, xlabel=run.label("r", "au"), ylabel=run.label("t", "yr"))
        label = run.label(rf"$\langle\Sigma_\mathrm{{{kind}}}\rangle$", "g cm$^{-2}$")
        figure.colorbar(image, ax=axes, label=label, pad=0.02)
    return figure


def _between(times: np.ndarray) -> np.ndarray:
    """Edges of the time bins about `times`; one snapshot alone is given a width."""
    if len(times) == 1:
        return times[0] + np.array([-0.5, 0.5])
    middle = (times[1:] + times[:-1]) / 2
    return np.concatenate([times[:1], middle, times[-1:]])


def write_csv(run: Run, path: Path) -> None:
    """One row a ring and time: time, r, and Sigma of each species."""
    units = ("_yr", "_au", "_g_cm2") if run.physical else ("", "", "")
    head = [f"time{units[0]}", f"radius{units[1]}", *(f"sigma_{kind}{units[2]}" for kind in run.kinds)]
    rows = (
        [f"{time:.8g}", f"{radius:.6g}", *(f"{run.profiles[kind][index, ring]:.6g}" for kind in run.kinds)]
        for index, time in enumerate(run.times)
        for ring, radius in enumerate(run.radius)
    )
    write_table(path, head, rows)


FIGURES: dict[str, Callable[[Run], Figure]] = {
    "profiles": profiles_figure,
    "map": map_figure,
    "radius-time": radius_time_figure,
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = script_parser(__doc__, None, __file__)
    parser.add_argument("directories", metavar="DIR", nargs="+", type=Path, help="output directory of a run")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, help="where to write; default: into each DIR")
    profiles = parser.add_mutually_exclusive_group()
    profiles.add_argument(
        "--smooth",
        type=positive_text,
        metavar="W",
        help='standard deviation of the smoothing of profiles, like "2 au"; default: 0.6 of the distance of particles',
    )
    profiles.add_argument("--rings", type=int, metavar="N", help="profiles in N rings, without smoothing")
    options = parser.parse_args(arguments)
    if options.rings is not None and options.rings < 1:
        parser.error("--rings: expected 1 or more")
    try:
        for directory in options.directories:
            run = Run(directory, options.smooth, options.rings)
            into = options.output or directory
            write_csv(run, into / f"{run.name}-profiles.csv")
            for name, draw in FIGURES.items():
                save(partial(draw, run), into / f"{run.name}-{name}.png", dpi=130)
            print(f"{directory}: {len(run.times)} snapshots -> {into}/{run.name}-*.png, {run.name}-profiles.csv")
    except (UserError, OSError) as error:
        return print_fault("surface_density", error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
