"""The torque of the disc on a companion, against the linear theory of a low-mass planet, and what noise leaves of it.

    python analysis/torque.py DIR... [--from ORBITS]

Each DIR is the output directory of a run with one companion on a circle in locally isothermal gas. Others beside it
with less than a thousandth of its mass are probes: the torque on them, scaled to its mass, is what the noise of the
particles gives a planet that the disc does not notice (setups/planet_torque.toml has seven). Prints for each run, over
Gamma_0 = (q r / H)^2 Sigma_0 r^4 Omega^2,

    torque    its mean by the gas from the orbit `from` on
    error     of this mean, from the scatter of the means over single orbits
    probes    the scatter of the same mean from probe to probe: the error that noise gives it
    row       the scatter of single rows of companions.csv
    theory    Paardekooper et al. (2010, MNRAS 401, 1950): the Lindblad torque, and the corotation torque of locally
              isothermal gas, with Sigma ~ r^-p, T ~ r^-q_T and a softening of b H, s = 0.4 / b,
              -(2.5 + 1.7 q_T - 0.1 p) s^0.71 + C + 2.2 q_T s^0.71 - 1.4 q_T s^1.26;                  (eqs. 14, 17)
              unsaturated horseshoe drag has C = 1.1 (1.5 - p) s, with s = 1 the -(0.85 + p + 0.9 q_T) of eq. (49);
              the linear one, of the first orbits, C = 0.7 (1.5 - p) s^1.26. At p = 1.5 both are the same
    needed    gas particles with which `probes`, or without them `error`, would be a tenth of the theory, if it falls as
              one over their number, as it does between the two sizes that the documentation quotes
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
from discsim.output.history import MAX_BYTES
from discsim.physics import profile
from discsim.physics.centre import kepler_omega
from discsim.physics.companions import scale_height, softening
from discsim.userfiles import read_text

COLUMNS = ("number", "time", "torque_gas", "mass", "semi_major_axis")
TIME, TORQUE, MASS, AXIS = range(1, 5)
PROBE = 1e-3  # of the planet's mass, below which a companion is a probe
SLOPE = 1e-3  # of the orbit, over which the slope of Sigma is taken


class InputError(Exception):
    """Something the user can put right; the message says what."""


class Torque(NamedTuple):
    """Over Gamma_0, all but the last: means, error bars, the scatter of single rows and the two theories."""

    mean: float
    error: float
    probes: float  # nan without probes
    row: float
    horseshoe: float
    linear: float
    orbits: int


def theory(p: float, index: float, softening: float) -> tuple[float, float]:
    """Of unsaturated horseshoe drag and of the linear corotation torque; Sigma ~ r^-p, T ~ r^-index, softening / H."""
    s = 0.4 / softening
    wave = -(2.5 + 1.7 * index - 0.1 * p) * s**0.71  # eq. (14)
    temperature = 2.2 * index * s**0.71 - 1.4 * index * s**1.26  # eq. (17), gamma = 1
    return wave + temperature + 1.1 * (1.5 - p) * s, wave + temperature + 0.7 * (1.5 - p) * s**1.26


def torque(directory: Path, start: float) -> Torque:
    """The torque by the gas from the orbit `start` on. Raises InputError."""
    path = directory / "companions.csv"
    if not path.exists():
        raise InputError(f"{path}: not there; expected the output directory of a run with a companion")
    scene = load_scene(directory / "scene.toml")
    rows = list(csv.DictReader(read_text(path, most=MAX_BYTES).splitlines()))
    table = np.array([[float(row[key]) for key in COLUMNS] for row in rows])
    of_each = [table[table[:, 0] == number] for number in np.unique(table[:, 0])]
    masses = np.array([own[-1, MASS] for own in of_each])
    planet = int(masses.argmax())
    if np.any(np.delete(masses, planet) > PROBE * masses[planet]):
        raise InputError(f"{path}: several companions; expected one, and others of less than {PROBE:g} of its mass")
    a, q = of_each[planet][0, AXIS], masses[planet] / scene.star.mass
    omega = float(kepler_omega(scene, a))
    sigma = profile.radial(scene).surface_density(a * np.array([1.0 - SLOPE, 1.0, 1.0 + SLOPE]))
    aspect = float(scale_height(scene, a)) / a
    unit = (q / aspect) ** 2 * sigma[1] * a**4 * omega**2
    found = [_means(own, omega, unit * mass / masses[planet], start) for own, mass in zip(of_each, masses, strict=True)]
    means, row = found[planet]
    if len(means) < 2:
        raise InputError(f"{directory}: {len(means)} orbits from --from {start:g} on; expected two at least")
    probes = [own.mean() for k, (own, _) in enumerate(found) if k != planet]
    depth = softening(scene, scene.table("companion")[planet], a) / (aspect * a)
    slope = float((sigma[0] - sigma[2]) / (2.0 * SLOPE * sigma[1]))
    return Torque(
        float(means.mean()),
        float(means.std(ddof=1) / np.sqrt(len(means))),
        float(np.sqrt(np.mean(np.square(probes)))) if probes else float("nan"),  # of which the mean is known, 0
        row,
        *theory(slope, scene.gas.eos.temperature_index, depth),
        len(means),
    )


def _means(rows: np.ndarray, omega: float, unit: float, start: float) -> tuple[np.ndarray, float]:
    """Means (orbits,) over whole orbits of a companion's torque from the orbit `start` on, and the scatter of rows."""
    orbit, value = rows[:, TIME] * omega / (2 * np.pi), rows[:, TORQUE] / unit
    whole = range(int(np.ceil(start)), int(np.floor(orbit[-1] + 1e-6)))
    # Rows are as far apart as steps are: a mean over time, not over rows.
    return np.array([_mean(orbit, value, k, k + 1) for k in whole]), float(np.std(value[orbit >= start]))


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
    table = Table("run", "particles", "torque", "error", "probes", "row", "horseshoe", "linear", "orbits", "needed")
    try:
        for directory in given.directories:
            found = torque(directory, given.start)
            particles = load_scene(directory / "scene.toml").gas.particles
            noise = found.error if np.isnan(found.probes) else found.probes
            needed = particles * noise / (0.1 * abs(found.horseshoe))
            numbers = [f"{value:.3g}" for value in found[:-1]]
            table.add_row(directory.resolve().name, str(particles), *numbers, str(found.orbits), f"{needed:.1g}")
    except (InputError, SceneError, OSError) as error:
        print(f"torque: {error}", file=sys.stderr)
        return 2
    Console(width=130).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
