"""The torque of the disc on a companion, against the linear theory of a low-mass planet.

    python analysis/torque.py DIR... [--from ORBITS]

Each DIR is the output directory of a run with one companion on a circle in locally isothermal gas. Prints, for each,
the mean torque by the gas over Gamma_0 = (q r / H)^2 Sigma_0 r^4 Omega^2 from the orbit `from` on, its error bar, from
the scatter of the means over single orbits, the noise of single rows of companions.csv, and

    -(0.85 + p + 0.9 q_T)        Paardekooper et al. (2010), MNRAS 401, 1950, eq. 49, with Sigma ~ r^-p and T ~ r^-q_T,
                                 softened by 0.4 H
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from discsim import SceneError, load_scene
from discsim.physics import profile
from discsim.physics.companions import scale_height


class Fault(Exception):
    """Something the user can put right; the message says what."""


class Torque(NamedTuple):
    """Over Gamma_0: the mean, its error bar, and the scatter of single rows."""

    mean: float
    error: float
    noise: float
    theory: float
    orbits: int


def torque(directory: Path, start: float) -> Torque:
    """The torque by the gas from the orbit `start` on. Raises Fault."""
    path = directory / "companions.csv"
    if not path.exists():
        raise Fault(f"{path}: not there; expected the output directory of a run with a companion")
    scene = load_scene(directory / "scene.toml")
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    if {row["number"] for row in rows} != {rows[0]["number"]}:
        raise Fault(f"{path}: several companions; expected one")
    time, value, mass, axis = (
        np.array([float(row[key]) for row in rows]) for key in ("time", "torque_gas", "mass", "semi_major_axis")
    )
    a, q = axis[0], mass[-1] / scene.star.mass
    omega = np.sqrt(scene.star.mass / a**3)
    sigma = float(profile.radial(scene).surface_density(np.array([a]))[0])
    aspect = float(scale_height(scene, a)) / a
    unit = (q / aspect) ** 2 * sigma * a**4 * omega**2
    orbit = time * omega / (2 * np.pi)
    whole = int(np.floor(orbit[-1] + 1e-6))
    if whole - start < 2:
        raise Fault(f"{directory}: {whole} orbits; expected two more than --from {start:g} at least")
    # Rows are as far apart as steps are: a mean over time, not over rows.
    means = [_mean(orbit, value, k, k + 1) / unit for k in range(int(np.ceil(start)), whole)]
    late = orbit >= start
    p, index = scene.initial.surface_density_index, scene.gas.eos.temperature_index
    error = float(np.std(means, ddof=1) / np.sqrt(len(means)))
    return Torque(
        float(np.mean(means)), error, float(np.std(value[late]) / unit), -(0.85 + p + 0.9 * index), len(means)
    )


def _mean(x: np.ndarray, y: np.ndarray, first: float, last: float) -> float:
    inside = (x > first) & (x < last)
    grid = np.concatenate([[first], x[inside], [last]])
    return float(np.trapezoid(np.interp(grid, x, y), grid) / (last - first))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directories", type=Path, nargs="+", metavar="DIR", help="output directories of runs")
    parser.add_argument(
        "--from", dest="start", type=float, default=2.0, metavar="N", help="orbits left out (default 2)"
    )
    given = parser.parse_args(arguments)
    table = Table("run", "torque / Gamma_0", "error", "noise of a row", "theory", "orbits")
    try:
        for directory in given.directories:
            found = torque(directory, given.start)
            numbers = [f"{value:.3g}" for value in found[:-1]]
            table.add_row(directory.resolve().name, *numbers, str(found.orbits))
    except (Fault, SceneError, OSError) as error:
        print(f"torque: {error}", file=sys.stderr)
        return 2
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
