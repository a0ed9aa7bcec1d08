"""Measure the stress of a self-gravitating disc in units of its pressure: the alpha of turbulence and of spiral arms.

    discsim analyse stress DIR [-o OUT] [--inner R] [--outer R] [--orbits TIME] [--times]
    python analysis/stress.py ...                                 the same, from a copy of this script

DIR is the directory of a run with [self_gravity]. In rings of each snapshot, relative to the mean velocities of the
ring and with the adiabatic sound speed:

    Reynolds    T = Sigma <dv_r dv_phi>
    gravity     T = -(torque of the gravity of the disc on the gas within r) / (2 pi r^2)

alpha = sum T A / (3/2 sum Sigma c_s^2 A) over the areas A of the rings between two radii (default: those that contain
the middle three fifths of the gas at the start), and over the snapshots of the last orbits at the radius between the
two (--orbits, default 20). The error is the scatter of four parts of that time. In a disc that heats itself as fast as
it cools

    alpha = 4 / (9 gamma (gamma - 1) beta)                                  (Gammie 2001, ApJ 553, 174, eq. 20)

times the fraction of u above the energy to which the gas cools. The script prints the means, with --times also alpha
for each snapshot. It writes stress.csv (by radius and time, with units in the heads of columns) and stress.png into OUT
or DIR. Radii are lengths like "30 au"; a plain number is in au, for runs in code units in code units. --orbits is a
number of these orbits, or a time like "500 yr".
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from discsim import Simulation, open_run
from discsim.output.results import (
    display_unit,
    length_in_code,
    orbits_of,
    positive_text,
    print_fault,
    print_table,
    script_parser,
    with_unit,
    write_table,
)
from discsim.output.run import Run
from discsim.output.snapshot import Snapshot
from discsim.physics.centre import kepler_omega
from discsim.physics.cooling import target_energy
from discsim.plot.request import save
from discsim.printable import UserError
from discsim.scene import Scene
from discsim.scene.units import Units

RINGS = 24
BLOCKS = 4
COLUMNS = ("time", "radius", "sigma", "pressure", "reynolds", "gravity", "excess")


class InputError(UserError):
    """A run or an option that does not suit the measurement; the message has the reason."""


class Rings(NamedTuple):
    """Rings (RINGS,) of a snapshot: mass and sum of m c_s^2 over area, two stresses, and m (u - u_eq) over m u."""

    time: float
    sigma: np.ndarray
    pressure: np.ndarray
    reynolds: np.ndarray
    gravity: np.ndarray
    excess: np.ndarray


def torques(snap: Snapshot) -> tuple[np.ndarray, Scene]:
    """Return the torque (n,) of self-gravity on each gas particle, and the scene."""
    given: dict[str, dict[str, Any]] = {}
    for name, p in snap.species.items():
        given[name] = {"pos": p.pos, "vel": p.vel, "mass": p.mass}
        given[name] |= {"species": p.species} if name == "dust" else {"u": p.u}
    sim = Simulation(snap.tables, particles=given)
    acc, _ = sim.acceleration("self_gravity")
    gas = sim.gas
    return gas.mass * (gas.pos[:, 0] * acc[:, 1] - gas.pos[:, 1] * acc[:, 0]), sim.scene


def rings_of(snap: Snapshot, edges: np.ndarray) -> Rings:
    """Return the stresses in the rings between `edges` (RINGS + 1,)."""
    gas = snap.gas
    r = gas.radius
    torque, scene = torques(snap)
    radial = (gas.pos * gas.vel).sum(axis=1) / r
    azimuthal = (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]) / r
    ring = np.digitize(r, edges)  # 0 within the first, RINGS + 1 beyond the last

    def total(weights: np.ndarray) -> np.ndarray:
        return np.bincount(ring, weights, RINGS + 2)

    mass = np.maximum(total(gas.mass), 1e-300)
    # Means are interpolated to the radius of each particle: relative to the mean of a ring, its shear would remain.
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = slice(1, -1)
    dv = [v - np.interp(r, middle, (total(gas.mass * v) / mass)[inside]) for v in (radial, azimuthal)]
    area = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)
    within = np.cumsum(total(torque))[:-1]  # at each edge
    flux = -within / (2.0 * np.pi * edges**2)
    energy = np.ones(gas.count) if gas.u is None else gas.u
    least = np.zeros(gas.count) if scene.cooling is None else target_energy(scene, r)
    return Rings(
        snap.time,
        mass[inside] / area,
        total(gas.mass * gas.sound_speed**2)[inside] / area,
        total(gas.mass * dv[0] * dv[1])[inside] / area,
        0.5 * (flux[1:] + flux[:-1]),
        (total(gas.mass * (energy - least)) / np.maximum(total(gas.mass * energy), 1e-300))[inside],
    )


def alphas(found: list[Rings], edges: np.ndarray) -> np.ndarray:
    """Return the Reynolds alpha and the gravitational alpha (2,), over rings and snapshots."""
    area = edges[1:] ** 2 - edges[:-1] ** 2
    pressure = sum(float((each.pressure * area).sum()) for each in found)
    return np.array([sum(float((t * area).sum()) for t in (getattr(each, kind) for each in found))
                     for kind in ("reynolds", "gravity")]) / (1.5 * pressure)  # fmt: skip


def expected(scene: Scene) -> float | None:
    """Return 4 / (9 gamma (gamma - 1) beta); None if the disc does not cool by a constant beta."""
    if scene.cooling is None or scene.cooling.kind != "beta":
        return None
    gamma = scene.gas.eos.gamma
    return 4.0 / (9.0 * gamma * (gamma - 1.0) * scene.cooling.beta)


def figure(found: list[Rings], edges: np.ndarray, wanted: float | None, units: Units) -> Figure:
    """Return the figure of alpha in time and in radius."""
    (time, yr), (length, au) = (display_unit(units, *each) for each in (("time", "yr"), ("length", "au")))
    drawn = Figure(figsize=(11, 4.2), layout="constrained")
    in_time, in_radius = drawn.subplots(1, 2)
    by_time, times = np.array([alphas([each], edges) for each in found]), [time * each.time for each in found]
    middle = 0.5 * (edges[1:] + edges[:-1])
    pressure = 1.5 * np.mean([each.pressure for each in found], axis=0)
    pressure[pressure == 0.0] = np.nan  # rings without gas
    for k, kind in enumerate(("reynolds", "gravity")):
        in_time.plot(times, by_time[:, k], label=kind)
        in_radius.plot(length * middle, np.mean([getattr(each, kind) for each in found], axis=0) / pressure, label=kind)
    in_time.plot(times, by_time.sum(axis=1), color="black", label="sum")
    total = np.mean([each.reynolds + each.gravity for each in found], axis=0) / pressure
    in_radius.plot(length * middle, total, color="black", label="sum")
    in_time.set_title(f"mean over r = {length * edges[0]:.3g} to {length * edges[-1]:.3g} {au}")
    in_radius.set_title(f"mean over t = {times[0]:.4g} to {times[-1]:.4g} {yr}")
    for axes, name, unit in ((in_time, "t", yr), (in_radius, "r", au)):
        if wanted is not None:
            axes.axhline(
                wanted, color="black", linestyle=":", label=r"thermal balance, $4 / (9 \gamma (\gamma - 1) \beta)$"
            )
        axes.set(xlabel=f"{name} [{unit}]", ylabel=r"$\alpha$")
        axes.margins(x=0.0)
    handles, texts = in_time.get_legend_handles_labels()
    drawn.legend(handles, texts, loc="outside lower center", ncols=len(texts), frameon=False)
    return drawn


def open_disc(directory: Path) -> Run:
    """Return a run of self-gravitating gas. Raises InputError, SnapshotError, SceneError."""
    run = open_run(directory)
    if run.scene.gas is None or run.scene.space.dimensions != 2 or run.scene.table("self_gravity") is None:
        raise InputError(f"{directory}: no self-gravitating gas in two dimensions; expected a disc with [self_gravity]")
    if run.scene.star is None:
        raise InputError(f"{directory}: no star to orbit; expected a disc with [star]")
    return run


def edges_of(first: Snapshot, inner: str | None, outer: str | None) -> np.ndarray:
    """Return the edges (RINGS + 1,) of the rings. Raises InputError if there is no gas between the two radii."""
    radius, units = first.gas.radius, first.units
    usual, given = np.quantile(radius, (0.2, 0.8)), {"--inner": inner, "--outer": outer}
    low, high = (
        float(usual[k]) if text is None else length_in_code(text, units, name)
        for k, (name, text) in enumerate(given.items())
    )
    shown = " to ".join(units.show(r, "length") for r in (low, high))
    if not 0.0 < low < high < np.inf:
        raise InputError(f"--inner, --outer: radii from {shown}; expected 0 < inner < outer")
    if not ((radius > low) & (radius < high)).any():
        limits = " to ".join(units.show(float(r), "length") for r in (radius.min(), radius.max()))
        raise InputError(f"--inner, --outer: no gas from {shown}; expected radii within {limits}")
    return np.linspace(low, high, RINGS + 1)


def write(into: Path, found: list[Rings], edges: np.ndarray, balance: float | None, units: Units) -> list[Path]:
    """Write the table by radius and time and the figure, and return their paths."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    (time, yr), (length, au), (density, g_cm2), (pressure, g_s2) = (
        display_unit(units, *each)
        for each in (("time", "yr"), ("length", "au"), ("surface_density", "g/cm2"), ("pressure", "g/s2"))
    )
    factors = np.array([time, length, density, *[pressure] * 3, 1.0])
    heads = [with_unit(*head) for head in zip(COLUMNS, (yr, au, g_cm2, *[g_s2] * 3, ""), strict=True)]
    rows = (factors * [each.time, r, *values] for each in found for r, *values in zip(middle, *each[1:], strict=True))
    paths = [into / "stress.csv", into / "stress.png"]
    write_table(paths[0], heads, rows)
    save(partial(figure, found, edges, balance, units), paths[1])
    return paths


def show(last: Snapshot, found: list[Rings], edges: np.ndarray, balance: float | None, orbit: float) -> None:
    """Print one line for each quantity."""
    parts = [part for part in np.array_split(np.arange(len(found)), BLOCKS) if len(part)]
    blocks = [alphas([found[k] for k in part], edges).sum() for part in parts]
    mean = alphas(found, edges)
    error = float(np.std(blocks) / np.sqrt(len(blocks))) if len(blocks) > 1 else np.nan
    rows: list[list[object]] = [
        ["alpha, Reynolds stress", float(mean[0])],
        ["alpha, gravitational stress", float(mean[1])],
        ["alpha, sum", float(mean.sum())],
        ["error of the sum", error],
    ]
    if balance is not None:
        rows += [["alpha of thermal balance, 4 / (9 gamma (gamma - 1) beta)", balance]]
        rows += [["fraction of u above its equilibrium", float(np.mean([each.excess for each in found]))]]
    factor, unit = display_unit(last.units, "length", "au")
    span = (found[-1].time - found[0].time) / orbit
    radii = f"r = {factor * edges[0]:.3g} to {factor * edges[-1]:.3g} {unit}"
    print_table(f"{radii}, {len(found)} snapshots over {span:.3g} orbits", ["quantity", "value"], rows)


def show_times(last: Snapshot, found: list[Rings], edges: np.ndarray) -> None:
    """Print one line for each snapshot."""
    factor, unit = display_unit(last.units, "time", "yr")
    rows = []
    for each in found:
        kinds = alphas([each], edges)
        rows.append([factor * each.time, *map(float, kinds), float(kinds.sum())])
    print_table("alpha in time", [f"time [{unit}]", "Reynolds", "gravity", "sum"], rows)


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("directory", type=Path, metavar="DIR", help="directory of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help="directory of the files (default DIR)")
    parser.add_argument("--inner", type=positive_text, metavar="R", help='inner radius, like "30 au"')
    parser.add_argument("--outer", type=positive_text, metavar="R", help='outer radius, like "50 au"')
    parser.add_argument(
        "--orbits",
        type=positive_text,
        default="20 orbits",
        metavar="TIME",
        help='time of the mean, like "20 orbits" between the radii, 20 or "500 yr" (default "20 orbits")',
    )
    parser.add_argument("--times", action="store_true", help="print alpha for each snapshot too")
    given = parser.parse_args(arguments)
    try:
        run = open_disc(given.directory)
        last, edges = run[-1], edges_of(run[0], given.inner, given.outer)
        orbit, balance = 2.0 * np.pi / float(kepler_omega(run.scene, 0.5 * (edges[0] + edges[-1]))), expected(run.scene)
        start = last.time - orbit * orbits_of(given.orbits, orbit, run.scene, "--orbits")
        found = [rings_of(snap, edges) for snap in run if snap.time > start]
        written = write(given.output or given.directory, found, edges, balance, last.units)
    except (UserError, OSError) as error:
        return print_fault("stress", error)
    if given.times:
        show_times(last, found, edges)
    show(last, found, edges, balance, orbit)
    if start < run[0].time:
        print("the mean includes the start, as the run is shorter than --orbits; a shorter time leaves the start out")
    print("\n".join(str(path) for path in written))
    return 0


if __name__ == "__main__":
    sys.exit(main())
