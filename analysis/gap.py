"""Measure the gap that a companion opens: its depth in the gas, and where the dust gathers.

    discsim analyse gap DIR [-o OUT] [--last TIME] [--over DIR]
    python analysis/gap.py ...                                       the same, from a copy of this script

DIR is the directory of a run with one companion and [alpha_viscosity]. The script prints the quantities below, and
writes two files into OUT or the present directory. NAME-gap.png shows Sigma over Sigma_0 of the gas and each dust
population, the pressure, and the edges of the gap; NAME-gap.csv has these profiles, in columns like dust.0 or dust.NAME
of a population, with units in the heads of columns. --last is a number of orbits of the companion, or a time like
"500 yr".

Sigma_0 is the surface density in the first snapshot. With --over DIR it is that of another run at the same time: of
the same disc without a companion, which spreads at its edges as the disc in DIR does.

    depth     smallest Sigma / Sigma_0 of the gas around the orbit, mean of the snapshots of the last orbits; without
              the angles within two Hill radii of the companion, whose own disc is not part of the gap
    formula   1 / (1 + 0.04 K), K = q^2 (H/r)^-5 / alpha (Kanagawa et al. 2015, MNRAS 448, 994, eqs. 14, 17)
    mass left fraction of the mass that remains within a scale height or two Hill radii of the orbit. For q from 1e-4
              to 5e-3 also the result of grid codes (Fung, Shi & Chiang 2014, ApJ 782, 88), where it is below one half:
              0.14 (q / 0.001)^-2.16 (alpha / 0.01)^1.41 (H/r / 0.05)^6.61
    edges     radii at which Sigma = Sigma_0 / 2, inside and outside the orbit; their distance over a, and the formula
              0.41 q^(1/2) (H/r)^(-3/4) alpha^(-1/4) (Kanagawa et al. 2016, PASJ 68, 43)
    radii     outside the orbit: of the largest surface density of each dust population, and of the largest pressure
    history   depth in the gas for each span of --last, which shows whether it is steady. The formulas are for a steady
              gap: a run that is shorter than a gap needs to open is shallower
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from discsim import open_run
from discsim.formulas.companions import gap_width, hill_radius
from discsim.output.companions import read_companions
from discsim.output.drawing import COLOURS, figure_text, population_style, set_log_ticks
from discsim.output.gaps import AT_EDGE, HILLS, START_WIDTH, gap_edges, ring_density, ring_edges, smoothed, within_disc
from discsim.output.results import (
    CODE_UNITS,
    display_unit,
    orbits_of,
    positive_text,
    print_fault,
    print_table,
    script_parser,
    with_unit,
    write_table,
)
from discsim.output.snapshot import Snapshot, read_snapshot, snapshot_files
from discsim.output.sources import times_and_units
from discsim.physics.centre import kepler_omega
from discsim.physics.companions import scale_height
from discsim.physics.viscosity import diffusivity
from discsim.plot.request import save
from discsim.printable import UserError
from discsim.scene.populations import populations_of

SHALLOW = 0.5  # share of the mass inside, above which a gap is no power law of q, alpha and H/r


class InputError(UserError):
    """A run or an option that does not suit the measurement; the message has the reason."""


def read(file: Path) -> Snapshot:
    """Return a snapshot with positions, masses and populations, relative to the centre of the disc."""
    return read_snapshot(file, ("dust.species",)).about_centre()


def companion_at(directory: Path, times: list[float]) -> tuple[np.ndarray, float, float]:
    """Return positions (times, 2) of the only companion relative to the star, its mass and semi-major axis.

    Raises InputError, HistoryError.
    """
    rows = read_companions(directory, ("number", "time", "x", "y", "mass", "semi_major_axis"))
    if np.ptp(rows["number"]) > 0:
        raise InputError(f"{directory / 'companions.csv'}: several companions; expected one")
    # Rows are a small part of an orbit apart, so a linear step between two of them is enough.
    places = np.stack([np.interp(times, rows["time"], rows[axis]) for axis in "xy"], axis=1)
    return places, float(rows["mass"][-1]), float(rows["semi_major_axis"][-1])


class Gap:
    """Profiles of a run, means over its last orbits, in units of the first snapshot's."""

    def __init__(self, directory: Path, last: str | float, over: Path | None = None) -> None:
        run = open_run(directory)
        self.scene, files = run.scene, run.files
        self.first, end = read(files[0]), read(files[-1])
        self._refuse_other_runs(directory, len(files))
        times, self.units = times_and_units(files)
        _, self.mass, self.axis = companion_at(directory, [end.time])
        self.ratio = self.mass / self.scene.star.mass
        period = 2 * np.pi * np.sqrt(self.axis**3 / (self.scene.star.mass + self.mass))
        self.hill = hill_radius(self.axis, self.ratio)
        self.edges = ring_edges(self.axis)
        self.radius = np.sqrt(self.edges[1:] * self.edges[:-1])
        wide = max(self.aspect_ratio * self.axis, HILLS * self.hill)
        self.near = np.abs(self.radius - self.axis) < wide  # rings of the gap
        self.kinds = self._kinds(end)
        self.orbits = np.array(times) / period
        self.each = self._profiles(directory, files, self.orbits * period)
        start = within_disc(smoothed(self.each["gas"][0], START_WIDTH))
        if np.isnan(start[self.near]).any():
            raise InputError(
                f"{directory}: no gas at the orbit of the companion at the start; expected a gap in a disc"
            )
        self.span = orbits_of(last, period, self.scene, "--last")
        self.profiles = {name: self.mean(name, self.orbits[-1] - self.span) for name in self.each}
        self.over = None if over is None else self._alone(over, period)

    def _refuse_other_runs(self, directory: Path, snapshots: int) -> None:
        """Raise InputError unless the run has a two-dimensional viscous disc of gas with a known H."""
        scene = self.scene
        if scene.gas is None or self.first.gas is None or self.first.dimensions != 2:
            raise InputError(f"{directory}: no gas in two dimensions; expected a run with [gas] and one [companion]")
        if scene.table("companion") is None:
            raise InputError(f"{directory}: no [companion]; expected a run with one companion")
        if scene.table("alpha_viscosity") is None:
            raise InputError(f"{directory}: no [alpha_viscosity], on which the depth of a gap depends")
        if scene.gas.eos.kind == "polytropic":
            raise InputError(f"{directory}: gas.eos is polytropic, without a given H/r; expected another kind")
        if snapshots < 2:
            raise InputError(f"{directory}: one snapshot; expected the start and at least one later snapshot")

    def _profiles(self, directory: Path, files: list[Path], times: np.ndarray) -> dict[str, np.ndarray]:
        """Return surface densities (snapshots, rings) of each kind."""
        places, _, _ = companion_at(directory, list(times))
        found: dict[str, list[np.ndarray]] = {name: [] for name, _ in self.kinds}
        for file, place in zip(files, places, strict=True):
            snap = read(file)
            for name, population in self.kinds:
                particles = snap.gas if population is None else only(snap.dust, population)
                found[name].append(ring_density(particles, self.edges, place, self.hill))
        return {name: np.array(own) for name, own in found.items()}

    def _alone(self, directory: Path, period: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return orbits (snapshots,) and surface densities (snapshots, rings) of a run without a companion."""
        snaps = [read(file) for file in snapshot_files(directory)]
        if snaps[0].gas is None or snaps[0].units != self.units:
            raise InputError(f"--over {directory}: no gas, or other units; expected the same disc without a companion")
        found = {}
        for name, population in self.kinds:
            if name == "gas" or snaps[0].dust is not None:
                species = [snap.gas if population is None else only(snap.dust, population) for snap in snaps]
                found[name] = np.array([ring_density(p, self.edges, np.array([self.axis, 0.0]), 0.0) for p in species])
        return np.array([snap.time / period for snap in snaps]), found

    @staticmethod
    def _between(orbits: np.ndarray, first: float, last: float) -> np.ndarray:
        """Return a mask (n,) of the snapshots of these orbits, without the start."""
        return (np.arange(len(orbits)) > 0) & (orbits > first + 1e-6) & (orbits <= last + 1e-6)

    def unperturbed(self, name: str, first: float, last: float) -> np.ndarray:
        """Return Sigma_0 (rings,): of the start, or the mean of the other run between two orbits (at least its end)."""
        if self.over is None or name not in self.over[1]:
            return smoothed(self.each[name][0], START_WIDTH)
        orbits, each = self.over
        chosen = self._between(orbits, first, last)
        return smoothed(each[name][chosen if chosen.any() else [-1]].mean(axis=0), START_WIDTH)

    def mean(self, name: str, first: float, last: float = np.inf) -> np.ndarray:
        """Return the mean profile (rings,) of the snapshots after the orbit `first`, up to `last`."""
        chosen = self._between(self.orbits, first, last)
        return smoothed(self.each[name][chosen].mean(axis=0))

    def history(self) -> list[tuple[float, float]]:
        """Return the end in orbits and the depth of the gas for each whole span before the last orbit."""
        ends = self.orbits[-1] - self.span * np.arange(int(self.orbits[-1] / self.span + 1e-6))[::-1]
        with_snapshots = [end for end in ends if self._between(self.orbits, end - self.span, end).any()]
        return [(end, self.depth("gas", end - self.span, end)) for end in with_snapshots]

    @staticmethod
    def _kinds(snap: Snapshot) -> list[tuple[str, int | None]]:
        """Return name and population of the gas (None) and of each dust population, like dust.0 in fields."""
        dust = [] if snap.dust is None else [(f"dust.{p.name}", p.number) for p in populations_of(snap.tables)]
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
    def gap(self) -> tuple[float, float]:
        """Radii of the edges of the gap in the gas, in the last span; NaN if it is shallower than one half."""
        return gap_edges(self.radius, self.left("gas"), self.axis, HILLS * self.hill)

    @property
    def inside_of_grids(self) -> float:
        """The fit of Fung, Shi & Chiang (2014) to `inside`; NaN outside its range."""
        q, alpha, aspect = self.ratio / 1e-3, self.alpha / 0.01, self.aspect_ratio / 0.05
        share = 0.14 * q**-2.16 * alpha**1.41 * aspect**6.61
        return share if 0.1 <= q <= 5.0 and share < SHALLOW else float("nan")

    def left(self, name: str, first: float | None = None, last: float = np.inf) -> np.ndarray:
        """Return Sigma / Sigma_0 (rings,) of the orbits from `first` to `last`, by default of the last span.

        The ratio is NaN beyond the edges of the disc.
        """
        first = self.orbits[-1] - self.span if first is None else first
        over = self.unperturbed(name, first, last)
        return self.mean(name, first, last) / within_disc(over)

    def depth(self, name: str, first: float | None = None, last: float = np.inf) -> float:
        """Return the smallest `left` within a scale height or two Hill radii of the orbit."""
        return float(self.left(name, first, last)[self.near].min())

    def inside(self, name: str) -> float:
        """Return the mass in the gap over that of Sigma_0, in the last span; NaN if Sigma_0 is 0 there."""
        area = np.diff(np.square(self.edges))[self.near]
        first = self.orbits[-1] - self.span
        unperturbed = self.unperturbed(name, first, np.inf)[self.near]
        start = float((unperturbed * area).sum())
        return float((self.profiles[name][self.near] * area).sum()) / start if start > 0.0 else np.nan

    @property
    def pressure(self) -> np.ndarray:
        """Sigma c_s^2 (rings,) of locally isothermal gas, with c_s = H Omega."""
        sound = scale_height(self.scene, self.radius) * kepler_omega(self.scene, self.radius)
        return self.profiles["gas"] * sound**2

    def summit(self, values: np.ndarray) -> float:
        """Return the radius of the highest maximum of `values` (rings,) outside the orbit; NaN without a maximum."""
        k = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
        k = k[self.radius[k] > self.axis]
        return float(self.radius[k[values[k].argmax()]]) if len(k) else float("nan")


def only(dust: Any, population: int) -> Any:
    """Return the particles of one population."""
    kept = dust.species == population
    return replace(dust, pos=dust.pos[kept], mass=dust.mass[kept], species=dust.species[kept])


def labels(gap: Gap) -> list[str]:
    """Return the texts for the gas and for the dust populations, as in the legends of `discsim plot`."""
    texts = {f"dust.{each.name}": each.legend for each in populations_of(gap.first.tables)}
    return [texts.get(name, name) for name in gap.profiles]


def draw(gap: Gap) -> Figure:
    """Return the figure of the profiles."""
    factor, unit = display_unit(gap.units, "length", "au")
    figure = Figure(figsize=(7, 5.4), layout="constrained")
    axes = figure.subplots()
    radius, pressure = factor * gap.radius, gap.pressure
    styles = [{"color": COLOURS["gas"]}, *(population_style(k) for k in range(len(gap.profiles) - 1))]
    for name, label, style in zip(gap.profiles, labels(gap), styles, strict=True):
        axes.plot(radius, gap.left(name), label=figure_text(label), lw=2, **style)
    axes.plot(radius, pressure / pressure.max(), "k:", label="pressure over its maximum")
    axes.axhline(gap.theory, color="grey", lw=1, ls="--", label="depth of a steady gap, Kanagawa et al. (2015)")
    edges = [factor * edge for edge in gap.gap if not np.isnan(edge)]
    for k, edge in enumerate(edges):
        axes.axvline(edge, color="0.5", lw=1, label="_" if k else r"edges of the gap, $\Sigma = \Sigma_0 / 2$")
    axes.axvline(factor * gap.axis, color="black", lw=1, ls="-.", label="orbit of the companion")
    values = np.concatenate([gap.left(name) for name in gap.profiles])
    seen = values[np.isfinite(values) & (values > 0.0)]
    low = max(1e-3, 0.7 * min(float(seen.min()), gap.theory))
    axes.set(xlabel="r" if unit == CODE_UNITS else f"r [{unit}]", ylabel=r"$\Sigma / \Sigma_0$", yscale="log")
    axes.set(xlim=(radius[0], radius[-1]), ylim=(low, 1.5 * float(seen.max())))
    set_log_ticks(axes.yaxis, *axes.get_ylim())
    scale = factor * gap.axis
    over = axes.secondary_xaxis("top", functions=(lambda r: r / scale, lambda r: r * scale))
    over.set_xlabel("r / a")
    first = max(gap.orbits[-1] - gap.span, 0.0)
    figure.suptitle(
        f"Mean of orbits {first:.4g} to {gap.orbits[-1]:.4g}: q = {gap.ratio:.3g}, H/r = {gap.aspect_ratio:.3g}, "
        f"alpha = {gap.alpha:.3g}",
        fontsize="medium",
    )
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    return figure


def write(gap: Gap, into: Path, name: str) -> list[Path]:
    """Write the profiles and the figure, and return their paths."""
    table, picture = into / f"{name}-gap.csv", into / f"{name}-gap.png"
    (length, au), (density, g_cm2), (pressure, g_s2) = (
        display_unit(gap.units, *each)
        for each in (("length", "au"), ("surface_density", "g/cm2"), ("pressure", "g/s2"))
    )
    heads = [("radius", au), *((kind, g_cm2) for kind in gap.profiles)]
    heads += [*((f"{kind} over start", "") for kind in gap.profiles), ("pressure", g_s2)]
    columns = [length * gap.radius, *(density * values for values in gap.profiles.values())]
    columns += [*map(gap.left, gap.profiles), pressure * gap.pressure]
    write_table(table, [with_unit(*head) for head in heads], zip(*columns, strict=True))
    save(partial(draw, gap), picture, dpi=150)
    return [table, picture]


def missing_edges(gap: Gap) -> list[str]:
    """Return a line for each edge that there is not, with the reason."""
    factor, unit = display_unit(gap.units, "length", "au")
    left, edges = gap.left("gas"), dict(zip(("inner", "outer"), gap.gap, strict=True))
    if not (left[np.abs(gap.radius - gap.axis) < HILLS * gap.hill] < AT_EDGE).any():
        return [f"no edges: Sigma stays above half of Sigma_0, with {gap.depth('gas'):.3g} as the smallest value"]
    lines = []
    known = gap.radius[np.isfinite(left)]
    for side, end in (("inner", known[0]), ("outer", known[-1])):
        if np.isnan(edges[side]):
            reach = f"{factor * end:.3g} {unit}".removesuffix(f" {CODE_UNITS}")
            lines.append(
                f"no {side} edge: Sigma stays below half of Sigma_0 to r = {reach}, the end of the disc or profile"
            )
    return lines


def show(gap: Gap, name: str) -> None:
    """Print one line for each quantity."""
    factor, unit = display_unit(gap.units, "length", "au")
    kinds, depth = list(gap.profiles), gap.depth("gas")
    none = [None] * (len(kinds) - 1)
    rows: list[list[object]] = [
        ["smallest Sigma / Sigma_0 in the gap", "", *map(gap.depth, kinds)],
        ["formula of Kanagawa et al. (2015)", "", gap.theory, *none],
        ["depth over this formula", "", depth / gap.theory, *none],
        ["mass left in the gap, M / M_0", "", *map(gap.inside, kinds)],
    ]
    if not np.isnan(gap.inside_of_grids):
        rows += [["mass left in grid codes, Fung et al. (2014)", "", gap.inside_of_grids, *none]]
    inner, outer = gap.gap
    rows += [
        ["inner edge of the gap, Sigma = Sigma_0 / 2", unit, factor * inner, *none],
        ["outer edge of the gap, Sigma = Sigma_0 / 2", unit, factor * outer, *none],
        ["width of the gap over a", "", (outer - inner) / gap.axis, *none],
        ["formula of Kanagawa et al. (2016)", "", gap_width(gap.ratio, gap.aspect_ratio, gap.alpha), *none],
    ]
    peaks = [factor * gap.summit(gap.profiles[kind]) for kind in kinds[1:]]
    rows += [["radius of the largest Sigma outside the orbit", unit, None, *peaks]] if peaks else []
    rows += [["radius of the largest pressure outside the orbit", unit, factor * gap.summit(gap.pressure), *none]]
    first = max(gap.orbits[-1] - gap.span, 0.0)
    accreted = " with what it has accreted" if gap.scene.table("companion")[0].accretion_radius > 0.0 else ""
    planet = f"q = {gap.ratio:.3g}{accreted}, a = {factor * gap.axis:.4g} {unit}"
    title = f"{name}: {planet}, H/r = {gap.aspect_ratio:.3g}, alpha = {gap.alpha:.3g}"
    orbits = f"mean of orbits {first:.4g} to {gap.orbits[-1]:.4g}"
    print_table(f"{title}\n{orbits}", ["quantity", "unit", *labels(gap)], rows)
    print("\n".join([*missing_edges(gap), steadiness(gap)]))
    history = ", ".join(f"{depth:.3g} to orbit {end:.0f}" for end, depth in gap.history())
    if history:
        print(f"depth of the gas: {history}")


def steadiness(gap: Gap) -> str:
    """Return a line with the orbits that were run, and the viscous time over the width of the gap, for the formulas."""
    width = gap_width(gap.ratio, gap.aspect_ratio, gap.alpha) * gap.axis
    nu = gap.alpha * gap.aspect_ratio**2  # in units of a^2 Omega
    viscous = (0.5 * width / gap.axis) ** 2 / nu / (2.0 * np.pi)
    run = f"the formulas are for a steady gap; this run has {gap.orbits[-1]:.4g} orbits"
    return f"{run}, and viscosity spreads over half of the width of the gap in {float(f'{viscous:.2g}'):g} orbits"


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("directory", type=Path, metavar="DIR", help="directory of a run")
    parser.add_argument("-o", "--output", type=Path, default=Path(), metavar="OUT", help="directory of the files")
    parser.add_argument(
        "--last",
        type=positive_text,
        default="10 orbits",
        metavar="TIME",
        help='time of the mean, like "3 orbits" of the companion, 3 or "500 yr" (default "10 orbits")',
    )
    parser.add_argument("--over", type=Path, metavar="DIR", help="a run without companion, for Sigma_0")
    given = parser.parse_args(arguments)
    name = given.directory.resolve().name
    try:
        gap = Gap(given.directory, given.last, given.over)
        written = write(gap, given.output, name)
    except (UserError, OSError) as error:
        return print_fault("gap", error)
    show(gap, name)
    print("\n".join(str(path) for path in written))
    return 0


if __name__ == "__main__":
    sys.exit(main())
