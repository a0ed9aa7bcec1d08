"""The gap that a companion opens: its depth in the gas against Kanagawa et al. (2015), and where the dust gathers.

    python analysis/gap.py DIR [-o OUT] [--last ORBITS] [--over DIR]

DIR is the output directory of a run with one companion and [alpha_viscosity]. Writes, into OUT or the present
directory, NAME-gap.png (Sigma over that of the first snapshot, of gas and of each population of dust, and the pressure)
and NAME-gap.csv, and prints what follows. Sigma_0 is the first snapshot's, or with `over` that of another run at the
same time: of the disc without a companion, whose edges let it spread as they do in DIR.

    depth     least Sigma / Sigma_0 of the gas about the orbit, mean of the snapshots of the `last` orbits; without the
              angles within two Hill radii of the companion, whose own disc is no part of the gap
    theory    1 / (1 + 0.04 K), K = q^2 (H/r)^-5 / alpha (Kanagawa et al. 2015, MNRAS 448, 994, eqs. 14, 17)
    inside    the share of the mass there that is left, within a scale height or two Hill radii of the orbit; below it,
              of a planet of .0001 to .005, that of the grid codes of Fung, Shi & Chiang (2014, ApJ 782, 88),
              .14 (q / .001)^-2.16 (alpha / .01)^1.41 (H/r / .05)^6.61, where it is below one half
    ring      for each population of dust, the place of its largest surface density beyond the orbit, beside that of
              the largest pressure there; and its least Sigma / Sigma_0 in the gap
    history   the depth in the gas by spans of `last` orbits, which says whether it is steady
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from scipy.ndimage import gaussian_filter1d

from discsim import SceneError, load_scene
from discsim.output.history import MAX_BYTES
from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot
from discsim.physics.centre import kepler_omega
from discsim.physics.companions import scale_height
from discsim.physics.viscosity import diffusivity
from discsim.userfiles import read_text

RINGS = 160  # of a profile, between half and twice the orbit
STRIPES = 6.0  # rings over which the profile of the start is smoothed, which shows those of its particles
HILLS = 2.0  # Hill radii about the companion that a gap's depth leaves out
SHALLOW = 0.5  # share of the mass inside, above which a gap is no power law of q, alpha and H/r
EDGE = 0.02  # of the largest Sigma of the start, below which a ring is beyond the disc's edge


class InputError(Exception):
    """Something the user can put right; the message says what."""


def snapshots_of(directory: Path) -> list[Path]:
    """Snapshots of a run, in order. Raises InputError."""
    files = sorted((directory / "snapshots").glob("*.h5"))
    if not files:
        raise InputError(f"{directory}: no snapshots found; expected the output directory of a run")
    return files


def companion_at(directory: Path, times: list[float]) -> tuple[np.ndarray, float, float]:
    """Return positions (times, 2) of the only companion relative to the star, its mass and semi-major axis.

    Raises InputError.
    """
    path = directory / "companions.csv"
    if not path.exists():
        raise InputError(f"{path}: not there; expected the output directory of a run with a companion")
    rows = list(csv.DictReader(read_text(path, most=MAX_BYTES).splitlines()))
    if {row["number"] for row in rows} != {rows[0]["number"]}:
        raise InputError(f"{path}: several companions; expected one")
    columns = ("time", "x", "y", "mass", "semi_major_axis")
    when, x, y, mass, axis = (np.array([float(row[key]) for row in rows]) for key in columns)
    # The nearest row, and a linear step between two: rows are a small part of an orbit apart.
    places = np.stack([np.interp(times, when, x), np.interp(times, when, y)], axis=1)
    return places, float(mass[-1]), float(axis[-1])


def profile(particles: Any, edges: np.ndarray, place: np.ndarray, hill: float) -> np.ndarray:
    """Surface density (rings,) of the angles that are not within HILLS Hill radii of the companion."""
    angle = np.arctan2(particles.pos[:, 1], particles.pos[:, 0]) - np.arctan2(place[1], place[0])
    angle = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    middle = 0.5 * (edges[1:] + edges[:-1])
    a = np.hypot(*place)
    # Half the angle of each ring that is left out: where the ring cuts the circle about the companion.
    cosine = (middle**2 + a**2 - (HILLS * hill) ** 2) / (2 * middle * a)
    out = np.arccos(np.clip(cosine, -1.0, 1.0))
    ring = np.clip(np.searchsorted(edges, particles.radius) - 1, 0, len(middle) - 1)
    kept = (angle > out[ring]) & (particles.radius > edges[0]) & (particles.radius < edges[-1])
    mass = np.bincount(ring[kept], particles.mass[kept], len(middle))
    return mass / ((np.pi - out) * np.diff(np.square(edges)))


class Gap:
    """Profiles of a run, means over its last orbits, in units of the first snapshot's."""

    def __init__(self, directory: Path, orbits: float, over: Path | None = None) -> None:
        files = snapshots_of(directory)
        self.first, last = read_snapshot(files[0]), read_snapshot(files[-1])
        if last.gas is None:
            raise InputError(f"{directory}: no gas, which a gap is in")
        self.scene = load_scene(directory / "scene.toml")
        if self.scene.table("alpha_viscosity") is None:
            raise InputError(f"{directory}: no [alpha_viscosity], on which the depth of a gap depends")
        _, self.mass, self.axis = companion_at(directory, [last.time])
        self.ratio = self.mass / self.scene.star.mass
        period = 2 * np.pi * np.sqrt(self.axis**3 / (self.scene.star.mass + self.mass))
        self.hill = self.axis * (self.ratio / 3) ** (1 / 3)
        self.edges = np.geomspace(0.5 * self.axis, 2.0 * self.axis, RINGS + 1)
        self.radius = np.sqrt(self.edges[1:] * self.edges[:-1])
        wide = max(self.aspect_ratio * self.axis, HILLS * self.hill)
        self.near = np.abs(self.radius - self.axis) < wide  # rings of the gap
        self.kinds = self._kinds(last)
        self.orbits = np.array([read_snapshot(file).time / period for file in files])
        self.each = self._profiles(directory, files, self.orbits * period)
        self.span = orbits
        self.profiles = {name: self.mean(name, self.orbits[-1] - orbits) for name in self.each}
        self.over = None if over is None else self._alone(over, period)

    def _profiles(self, directory: Path, files: list[Path], times: np.ndarray) -> dict[str, np.ndarray]:
        """Surface densities (snapshots, rings) of each kind."""
        places, _, _ = companion_at(directory, list(times))
        found: dict[str, list[np.ndarray]] = {name: [] for name, _ in self.kinds}
        for file, place in zip(files, places, strict=True):
            snap = read_snapshot(file)
            for name, population in self.kinds:
                particles = snap.gas if population is None else only(snap.dust, population)
                found[name].append(profile(particles, self.edges, place, self.hill))
        return {name: np.array(own) for name, own in found.items()}

    def _alone(self, directory: Path, period: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Orbits (snapshots,) and surface densities (snapshots, rings) of a run without a companion."""
        snaps = [read_snapshot(file) for file in snapshots_of(directory)]
        found = {}
        for name, population in self.kinds:
            if name == "gas" or snaps[0].dust is not None:
                species = [snap.gas if population is None else only(snap.dust, population) for snap in snaps]
                found[name] = np.array([profile(p, self.edges, np.array([self.axis, 0.0]), 0.0) for p in species])
        return np.array([snap.time / period for snap in snaps]), found

    @staticmethod
    def _between(orbits: np.ndarray, first: float, last: float) -> np.ndarray:
        """Which snapshots (n,) are of these orbits; the start never is."""
        return (np.arange(len(orbits)) > 0) & (orbits > first + 1e-6) & (orbits <= last + 1e-6)

    def unperturbed(self, name: str, first: float, last: float) -> np.ndarray:
        """Sigma_0 (rings,): of the start, or of the other run the mean between two orbits, after its end the last."""
        if self.over is None or name not in self.over[1]:
            return gaussian(self.each[name][0], STRIPES)
        orbits, each = self.over
        chosen = self._between(orbits, first, last)
        return gaussian(each[name][chosen if chosen.any() else [-1]].mean(axis=0), STRIPES)

    def mean(self, name: str, first: float, last: float = np.inf) -> np.ndarray:
        """Mean profile (rings,) of the snapshots after the orbit `first`, up to `last`; the start is none of them."""
        chosen = self._between(self.orbits, first, last)
        return gaussian(self.each[name][chosen].mean(axis=0))

    def history(self) -> list[tuple[float, float]]:
        """End in orbits, and depth of the gas, of each whole span before the last orbit."""
        ends = self.orbits[-1] - self.span * np.arange(int(self.orbits[-1] / self.span + 1e-6))[::-1]
        return [(end, self.depth("gas", end - self.span, end)) for end in ends]

    @staticmethod
    def _kinds(snap: Snapshot) -> list[tuple[str, int | None]]:
        """The gas, and each population of dust."""
        dust = [] if snap.dust is None else [(f"dust {k + 1}", k) for k in range(snap.dust.species.max() + 1)]
        return [("gas", None), *dust]

    @property
    def aspect_ratio(self) -> float:
        return float(scale_height(self.scene, self.axis)) / self.axis

    @property
    def alpha(self) -> float:
        height = float(scale_height(self.scene, self.axis))
        nu = float(diffusivity(self.scene, np.array([self.axis]))[0])
        return nu / (height**2 * float(kepler_omega(self.scene, self.axis)))

    @property
    def theory(self) -> float:
        return 1.0 / (1.0 + 0.04 * self.ratio**2 * self.aspect_ratio**-5 / self.alpha)

    @property
    def inside_of_grids(self) -> float:
        """What Fung, Shi & Chiang (2014) found for `inside`, by their fit; nan where it says nothing."""
        q, alpha, aspect = self.ratio / 1e-3, self.alpha / 0.01, self.aspect_ratio / 0.05
        share = 0.14 * q**-2.16 * alpha**1.41 * aspect**6.61
        return share if 0.1 <= q <= 5.0 and share < SHALLOW else float("nan")

    def left(self, name: str, first: float | None = None, last: float = np.inf) -> np.ndarray:
        """Sigma / Sigma_0 (rings,) of the orbits from `first` to `last`, by default of the last span; nan beyond the
        disc's edges, where it says nothing.
        """
        first = self.orbits[-1] - self.span if first is None else first
        over = self.unperturbed(name, first, last)
        return self.mean(name, first, last) / np.where(over > EDGE * over.max(), over, np.nan)

    def depth(self, name: str, first: float | None = None, last: float = np.inf) -> float:
        """Least of `left` within a scale height or two Hill radii of the orbit."""
        return float(self.left(name, first, last)[self.near].min())

    def inside(self, name: str) -> float:
        """Mass over that of Sigma_0 in the gap, in the last span."""
        area = np.diff(np.square(self.edges))[self.near]
        first = self.orbits[-1] - self.span
        unperturbed = self.unperturbed(name, first, np.inf)[self.near]
        return float((self.profiles[name][self.near] * area).sum() / (unperturbed * area).sum())

    @property
    def pressure(self) -> np.ndarray:
        """Sigma c_s^2 (rings,) of locally isothermal gas."""
        heights = scale_height(self.scene, self.radius)
        return self.profiles["gas"] * heights**2 / self.radius**3

    def summit(self, values: np.ndarray) -> float:
        """Where values (rings,) are largest beyond the orbit, and above those on both sides; nan for no such place."""
        k = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
        k = k[self.radius[k] > self.axis]
        return float(self.radius[k[values[k].argmax()]]) if len(k) else float("nan")


def gaussian(values: np.ndarray, rings: float = 2.0) -> np.ndarray:
    """Of a quiet start's rings of particles some profiles show stripes, which a kernel's width takes out."""
    return gaussian_filter1d(values, rings, mode="nearest")


def only(dust: Any, population: int) -> Any:
    """The particles of one population."""
    from dataclasses import replace

    kept = dust.species == population
    return replace(dust, pos=dust.pos[kept], mass=dust.mass[kept], ids=dust.ids[kept])


def draw(gap: Gap, path: Path) -> None:
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for name in gap.profiles:
        axes.plot(gap.radius / gap.axis, gap.left(name), label=name)
    pressure = gap.pressure
    axes.plot(gap.radius / gap.axis, pressure / pressure.max(), "k:", label="pressure, over its largest")
    axes.axhline(gap.theory, color="grey", lw=0.8, label="depth by Kanagawa et al. (2015)")
    axes.set(xlabel="r / a", ylabel="surface density over that of the start", yscale="log", ylim=(1e-3, None))
    axes.set_title(
        f"q = {gap.ratio:.3g}, H/r = {gap.aspect_ratio:.3g}, alpha = {gap.alpha:.3g}, {gap.orbits[-1]:.0f} orbits"
    )
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="output directory of a run")
    parser.add_argument("-o", "--output", type=Path, default=Path(), metavar="OUT", help="where to write")
    parser.add_argument("--last", type=float, default=10.0, metavar="N", help="orbits of the mean (default 10)")
    parser.add_argument("--over", type=Path, metavar="DIR", help="a run without companion, for Sigma_0")
    given = parser.parse_args(arguments)
    try:
        gap = Gap(given.directory, given.last, given.over)
        write(gap, given.output, given.directory.resolve().name)
    except (InputError, SceneError, SnapshotError, OSError) as error:
        print(f"gap: {error}", file=sys.stderr)
        return 2
    return 0


def write(gap: Gap, into: Path, name: str) -> None:
    """Print the table, and write figure and profiles."""
    into.mkdir(parents=True, exist_ok=True)
    draw(gap, into / f"{name}-gap.png")
    with (into / f"{name}-gap.csv").open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["radius", *gap.profiles, *(f"{kind} over start" for kind in gap.profiles), "pressure"])
        rows.writerows(zip(gap.radius, *gap.profiles.values(), *map(gap.left, gap.profiles), gap.pressure, strict=True))
    table = Table("", "depth", "theory", "depth / theory", "inside", "ring", "largest pressure")

    def left(kind: str) -> str:
        return f"{gap.inside(kind):.3g}"

    depth, summit = gap.depth("gas"), gap.summit(gap.pressure)
    table.add_row(
        "gas", f"{depth:.3g}", f"{gap.theory:.3g}", f"{depth / gap.theory:.3g}", left("gas"), "", f"{summit:.4g}"
    )
    if not np.isnan(gap.inside_of_grids):
        table.add_row("gas, grid codes", "", "", "", f"{gap.inside_of_grids:.3g}", "", "")
    for kind in list(gap.profiles)[1:]:
        table.add_row(kind, f"{gap.depth(kind):.3g}", "", "", left(kind), f"{gap.summit(gap.profiles[kind]):.4g}", "")
    Console(width=100).print(table)
    print("depth of the gas:", ", ".join(f"{depth:.3g} to orbit {end:.0f}" for end, depth in gap.history()))


if __name__ == "__main__":
    sys.exit(main())
