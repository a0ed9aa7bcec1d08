"""Arms and clumps of a self-gravitating disc: amplitudes of its modes in time, and what its clumps hold at the end.

    python analysis/clumps.py DIR [-o OUT]

A_m of a species is the largest over rings of |sum m exp(i m phi)| / sum m, each ring with its median Poisson noise
taken off in squares. A clump is a peak of the gas's surface density, on a map of 2 grid cells a pixel, that is
THRESHOLD times the azimuthal median at its radius at the start; its members are the particles within three
softenings. It is bound where these attract each other by more than they move about their centre of mass, and hold as
heat: where "bound", |W| / (K + U), is above 1. Prints both tables and writes clumps.csv into OUT or DIR.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.ndimage import maximum_filter

from discsim.output.snapshot import Snapshot, SnapshotError, SnapshotParticles, read_snapshot

MODES = range(1, 7)
RINGS = 12
THRESHOLD = 10.0


class InputError(Exception):
    """Something the user can put right; the message says what."""


def amplitudes(pos: np.ndarray, mass: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """A_m for MODES: the largest over the rings between `edges`, less what random angles give."""
    radius, angle = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
    ring = np.digitize(radius, edges) - 1
    found = np.zeros((len(edges) - 1, len(MODES)))
    for k in range(len(edges) - 1):
        m, phi = mass[ring == k], angle[ring == k]
        if len(m) < 100:
            continue
        power = [abs((m * np.exp(1j * n * phi)).sum()) ** 2 for n in MODES]
        found[k] = np.sqrt(np.maximum(np.array(power) - (m**2).sum(), 0)) / m.sum()
    return found.max(axis=0)


def clumps(snap: Snapshot, first: Snapshot, size: float) -> list[dict[str, float]]:
    """Place, peak over the start and masses of each clump, the heaviest first; `size` is the radius of one."""
    reach = float(np.quantile(first.gas.radius, 0.999)) * 1.3
    pixels = int(np.ceil(2 * reach / size))
    corner = np.full(2, -reach), np.full(2, reach)
    sigma = snap.gas.surface_density_map(*corner, pixels)
    edges = np.linspace(0, reach, 60)
    start = np.interp(np.linspace(0, reach, 59), 0.5 * (edges[1:] + edges[:-1]), first.gas.radial_profile(edges))
    x = (np.arange(pixels) + 0.5) * 2 * reach / pixels - reach
    radius = np.hypot(x[:, None], x)
    background = np.interp(radius, np.linspace(0, reach, 59), start)
    peaks = (sigma == maximum_filter(sigma, 5)) & (sigma > THRESHOLD * np.maximum(background, start.max() * 1e-2))
    found = []
    for i, j in zip(*np.nonzero(peaks), strict=True):
        place = np.array([x[i], x[j]])
        inside = {k: np.hypot(*(p.pos - place).T) < 3 * size for k, p in snap.species.items()}
        gas = float(snap.gas.mass[inside["gas"]].sum())
        dust = float(snap.dust.mass[inside["dust"]].sum()) if snap.dust is not None else 0.0
        over = float(sigma[i, j] / max(background[i, j], start.max() * 1e-2))
        bound = boundness([(p, inside[k]) for k, p in snap.species.items()], size)
        found.append(
            {"x": place[0], "y": place[1], "over": over, "gas": gas, "dust": dust, "ratio": dust / gas}
            | {"bound": bound}
        )
    return sorted(found, key=lambda clump: -clump["gas"])


def boundness(parts: list[tuple[SnapshotParticles, np.ndarray]], size: float) -> float:
    """|W| / (K + U) of particles, whose attraction is softened by `size`; heat of gas that keeps none is m c_s^2."""
    pos, vel, mass = (
        np.concatenate([getattr(p, name)[inside] for p, inside in parts]) for name in ("pos", "vel", "mass")
    )
    heat = 0.0
    for p, inside in parts:
        if p.sound_speed is not None:
            heat += float((p.mass * (p.u if p.u is not None else p.sound_speed**2))[inside].sum())
    vel = vel - mass @ vel / mass.sum()
    kinetic = 0.5 * float(mass @ (vel**2).sum(axis=1))
    pull = -0.5 * float((mass**2).sum()) / size  # of each on itself
    for at, m in zip(pos, mass, strict=True):
        pull += 0.5 * m * float((mass / np.sqrt(((pos - at) ** 2).sum(axis=1) + size**2)).sum())
    return pull / (kinetic + heat)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="output directory of a run")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help="where to write; default: DIR")
    parser.add_argument("--size", type=float, default=1.0, help="radius of a clump in code units, the softening say")
    given = parser.parse_args(arguments)
    try:
        files = sorted((given.directory / "snapshots").glob("*.h5"))
        if not files:
            raise InputError(f"{given.directory}: no snapshots found; expected the output directory of a run")
        run = [read_snapshot(file) for file in files]
        if run[0].dimensions != 2 or run[0].gas is None:
            raise InputError(f"{given.directory}: no gas in two dimensions here; expected the run of a disc")
        console = Console(width=130)
        edges = np.quantile(run[0].gas.radius, np.linspace(0.02, 0.98, RINGS + 1))
        table = Table("time", *(f"{kind} A{m}" for kind in run[0].species for m in MODES))
        for snap in run:
            found = [f"{a:.3f}" for p in snap.species.values() for a in amplitudes(p.pos, p.mass, edges)]
            table.add_row(f"{snap.time:.4g}", *found)
        console.print(table)
        found = clumps(run[-1], run[0], given.size)
        into = given.output or given.directory
        into.mkdir(parents=True, exist_ok=True)
        with (into / "clumps.csv").open("w", newline="") as stream:
            writer = csv.DictWriter(stream, ["x", "y", "over", "gas", "dust", "ratio", "bound"])
            writer.writeheader()
            writer.writerows(found)
        table = Table("x", "y", "Sigma over the start's", "gas", "dust", "dust / gas", "bound")
        for clump in found:
            table.add_row(*(f"{value:.4g}" for value in clump.values()))
        console.print(f"{len(found)} clumps at t = {run[-1].time:.4g} (code units)", table)
    except (InputError, SnapshotError, OSError) as error:
        print(f"clumps: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
