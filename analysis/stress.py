"""Stress of a self-gravitating disc, in units of its pressure, in radius and time: what turbulence and arms carry.

    python analysis/stress.py DIR [-o OUT] [--inner R] [--outer R] [--orbits N]

DIR is the output directory of a run with [self_gravity]. In rings of each snapshot, with the ring's mean velocities
taken off and the adiabatic sound speed:

    Reynolds    T = Sigma <dv_r dv_phi>
    gravity     T = -(torque of the disc's gravity on the gas within r) / (2 pi r^2)

alpha = sum T A / (3/2 sum Sigma c_s^2 A) over the rings' areas A between the two radii (code units; default: those that
held the middle three fifths of the gas at the start), and over the snapshots of the last N orbits at the radius between
(default 20). In a disc that heats itself as fast as it cools alpha = 4 / (9 gamma (gamma - 1) beta) (Gammie 2001,
ApJ 553, 174, eq. 20), times the share of u that is above the energy to which it cools. The error is the scatter of four
parts of that time. Prints it in time, and writes stress.csv (by radius and time) and stress.png into OUT or DIR.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from script_helpers import write_csv

from discsim import Simulation
from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot
from discsim.physics.centre import kepler_omega
from discsim.physics.cooling import target_energy
from discsim.scene import Scene, load_scene

RINGS = 24
BLOCKS = 4
COLUMNS = ("time", "radius", "sigma", "pressure", "reynolds", "gravity", "excess")


class InputError(Exception):
    """Something the user can put right; the message says what."""


class Rings(NamedTuple):
    """Of one snapshot, (RINGS,) each: mass and sum of m c_s^2 over area, both stresses, and m (u - u_eq) over m u."""

    time: float
    sigma: np.ndarray
    pressure: np.ndarray
    reynolds: np.ndarray
    gravity: np.ndarray
    excess: np.ndarray


def torques(snap: Snapshot) -> tuple[np.ndarray, Scene]:
    """Torque (n,) of self-gravity on each particle of gas, and the scene."""
    given: dict[str, dict[str, Any]] = {}
    for name, p in snap.species.items():
        given[name] = {"pos": p.pos, "vel": p.vel, "mass": p.mass}
        given[name] |= {"species": p.species} if name == "dust" else {"u": p.u}
    sim = Simulation(snap.tables, particles=given)
    acc, _ = sim.acceleration("self_gravity")
    gas = sim.gas
    return gas.mass * (gas.pos[:, 0] * acc[:, 1] - gas.pos[:, 1] * acc[:, 0]), sim.scene


def rings_of(snap: Snapshot, edges: np.ndarray) -> Rings:
    """Stresses in the rings between `edges` (RINGS + 1,)."""
    gas = snap.gas
    r = gas.radius
    torque, scene = torques(snap)
    radial = (gas.pos * gas.vel).sum(axis=1) / r
    azimuthal = (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]) / r
    ring = np.digitize(r, edges)  # 0 within the first, RINGS + 1 beyond the last

    def total(weights: np.ndarray) -> np.ndarray:
        return np.bincount(ring, weights, RINGS + 2)

    mass = np.maximum(total(gas.mass), 1e-300)
    # From each particle's own place between the middles of rings: a mean of the ring would leave its shear.
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
    """Reynolds and gravitational alpha (2,), over rings and snapshots."""
    area = edges[1:] ** 2 - edges[:-1] ** 2
    pressure = sum(float((each.pressure * area).sum()) for each in found)
    return np.array([sum(float((t * area).sum()) for t in (getattr(each, kind) for each in found))
                     for kind in ("reynolds", "gravity")]) / (1.5 * pressure)  # fmt: skip


def expected(snap: Snapshot) -> float | None:
    """4 / (9 gamma (gamma - 1) beta), where the disc cools by a beta."""
    cooling, eos = snap.tables.get("cooling", {}), snap.tables["gas"]["eos"]
    if cooling.get("kind") != "beta":
        return None
    return 4.0 / (9.0 * eos["gamma"] * (eos["gamma"] - 1.0) * cooling["beta"])


def figure(found: list[Rings], edges: np.ndarray, wanted: float | None) -> Figure:
    """alpha in time, and in radius."""
    drawn = Figure(figsize=(11, 4.2), layout="constrained")
    in_time, in_radius = drawn.subplots(1, 2)
    by_time = np.array([alphas([each], edges) for each in found])
    middle = 0.5 * (edges[1:] + edges[:-1])
    pressure = 1.5 * np.mean([each.pressure for each in found], axis=0)
    for k, kind in enumerate(("reynolds", "gravity")):
        in_time.plot([each.time for each in found], by_time[:, k], label=kind)
        in_radius.plot(middle, np.mean([getattr(each, kind) for each in found], axis=0) / pressure, label=kind)
    in_time.plot([each.time for each in found], by_time.sum(axis=1), color="black", label="sum")
    for axes, name in ((in_time, "time"), (in_radius, "radius")):
        if wanted is not None:
            axes.axhline(wanted, color="black", linestyle=":", label=r"$4 / (9 \gamma (\gamma - 1) \beta)$")
        axes.set(xlabel=f"{name} [code units]", ylabel=r"$\alpha$")
        axes.legend(frameon=False)
    return drawn


def read(directory: Path) -> list[Snapshot]:
    files = sorted((directory / "snapshots").glob("*.h5"))
    if not files:
        raise InputError(f"{directory}: no snapshots found; expected the output directory of a run")
    run = [read_snapshot(file) for file in files]
    if run[0].gas is None or run[0].dimensions != 2 or "self_gravity" not in run[0].tables:
        raise InputError(f"{directory}: no self-gravitating gas in two dimensions; expected a disc with [self_gravity]")
    return run


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="output directory of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help="where to write; default: DIR")
    parser.add_argument("--inner", type=float, metavar="R", help="inner radius in code units")
    parser.add_argument("--outer", type=float, metavar="R", help="outer radius in code units")
    parser.add_argument("--orbits", type=float, default=20.0, metavar="N", help="of the mean (default 20)")
    given = parser.parse_args(arguments)
    try:
        run = read(given.directory)
        usual = np.quantile(run[0].gas.radius, (0.2, 0.8))
        inner, outer = given.inner or usual[0], given.outer or usual[1]
        if not 0.0 < inner < outer:
            raise InputError(f"radii from {inner:g} to {outer:g} are no range; expected --outer above --inner")
        edges = np.linspace(inner, outer, RINGS + 1)
        scene = load_scene(run[-1].tables)
        if scene.star is None:
            raise InputError(f"{given.directory}: no star to orbit; expected a disc with [star]")
        orbit = 2.0 * np.pi / float(kepler_omega(scene, 0.5 * (inner + outer)))
        found = [rings_of(snap, edges) for snap in run if snap.time > run[-1].time - given.orbits * orbit]
        report(given.output or given.directory, found, edges, expected(run[-1]), orbit)
    except (InputError, SnapshotError, OSError) as error:
        print(f"stress: {error}", file=sys.stderr)
        return 2
    return 0


def report(into: Path, found: list[Rings], edges: np.ndarray, wanted: float | None, orbit: float) -> None:
    """Print the table and the mean, and write the files."""
    into.mkdir(parents=True, exist_ok=True)
    middle = 0.5 * (edges[1:] + edges[:-1])
    rows = [
        dict(zip(COLUMNS, (each.time, r, *values), strict=True))
        for each in found
        for r, *values in zip(middle, *each[1:], strict=True)
    ]
    write_csv(rows, COLUMNS, into / "stress.csv")
    drawn = figure(found, edges, wanted)
    FigureCanvasAgg(drawn)
    drawn.savefig(into / "stress.png", dpi=130)
    console = Console(width=100)
    table = Table("time", "Reynolds", "gravity", "sum")
    for each in found:
        kinds = alphas([each], edges)
        table.add_row(f"{each.time:.5g}", *(f"{value:+.4f}" for value in (*kinds, kinds.sum())))
    console.print(table)
    parts = [part for part in np.array_split(np.arange(len(found)), BLOCKS) if len(part)]
    blocks = [alphas([found[k] for k in part], edges).sum() for part in parts]
    mean = alphas(found, edges)
    error = float(np.std(blocks) / np.sqrt(len(blocks)))
    span = (found[-1].time - found[0].time) / orbit
    console.print(
        f"r = {edges[0]:.3g} to {edges[-1]:.3g}, {len(found)} snapshots over {span:.3g} orbits: alpha = "
        f"{mean.sum():.4f} +- {error:.4f} (Reynolds {mean[0]:.4f}, gravity {mean[1]:.4f})"
    )
    if wanted is not None:
        excess = float(np.mean([each.excess for each in found]))
        console.print(f"4 / (9 gamma (gamma - 1) beta) = {wanted:.4f}, times {excess:.3f} of u above its u_eq")


if __name__ == "__main__":
    sys.exit(main())
