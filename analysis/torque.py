"""Measure the torque of the disc on a companion, with its error, and compare it with linear theory.

    discsim analyse torque DIR... [--from TIME]
    python analysis/torque.py ...                    the same, from a copy of this script

Each DIR is the directory of a run with one companion on a circular orbit in isothermal or locally isothermal gas.
Further companions of less than a thousandth of its mass are probes. The torque on a probe, scaled to the mass of the
companion, is what particle noise alone causes (setups/planet_torque.toml has seven). The script prints for each run,
in units of Gamma_0 = (q r / H)^2 Sigma_0 r^4 Omega^2:

    torque    mean torque by the gas over whole orbits after the time --from; a negative one moves the companion inwards
    error     of this mean: from the scatter of the means over single orbits, and from the scatter between probes
    rows      scatter of single rows of companions.csv
    theory    Paardekooper et al. (2010, MNRAS 401, 1950), eqs. 14, 17: Lindblad torque and corotation torque in locally
              isothermal gas, with Sigma ~ r^-p, T ~ r^-q_T, a softening of b H, s = 0.4 / b:
              -(2.5 + 1.7 q_T - 0.1 p) s^0.71 + C + 2.2 q_T s^0.71 - 1.4 q_T s^1.26
              unsaturated horseshoe drag: C = 1.1 (1.5 - p) s, for s = 1 eq. 49, -(0.85 + p + 0.9 q_T);
              linear corotation torque, of the first orbits: C = 0.7 (1.5 - p) s^1.26. For p = 1.5 both agree
    thermal   mass over the thermal mass, q (H/r)^-3. Above about 1 the theory, which is linear, does not hold
    needed    number of gas particles or cells for which the error by probes (without probes the error by orbits) would
              be a tenth of the theory, if the error is inversely proportional to this number

--from is a number of orbits of the companion, or a time like "500 yr".
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from discsim import load_scene
from discsim.output.companions import read_companions
from discsim.output.results import number_text, orbits_of, print_fault, print_table, script_parser
from discsim.parts import STARTS
from discsim.physics import profile
from discsim.physics.centre import kepler_omega
from discsim.physics.companions import scale_height, softening
from discsim.physics.eos import eos_of
from discsim.printable import UserError, printable
from discsim.scene import Scene

COLUMNS = ("number", "time", "torque_gas", "mass", "semi_major_axis")
TIME, TORQUE, MASS, AXIS = range(1, 5)
PROBE = 1e-3  # of the planet's mass, below which a companion is a probe
SLOPE = 1e-3  # of the orbit, over which the slope of Sigma is taken


class InputError(UserError):
    """A run or an option that does not suit the measurement; the message has the reason."""


class Torque(NamedTuple):
    """Torque of a run in units of Gamma_0: mean, errors, scatter of single rows, two theories; and whole orbits."""

    mean: float
    error: float
    probes: float  # NaN without probes
    row: float
    horseshoe: float
    linear: float
    orbits: int
    thermal: float  # mass over the thermal mass
    start: float  # orbits left out

    @property
    def noise(self) -> float:
        """Error of the mean by probes, without probes by orbits."""
        return self.error if np.isnan(self.probes) else self.probes


def theory(p: float, index: float, softening: float) -> tuple[float, float]:
    """Return the torques with horseshoe drag and with linear corotation torque, for Sigma ~ r^-p and T ~ r^-index.

    softening: softening of the companion over H.
    """
    s = 0.4 / softening
    wave = -(2.5 + 1.7 * index - 0.1 * p) * s**0.71  # eq. (14)
    temperature = 2.2 * index * s**0.71 - 1.4 * index * s**1.26  # eq. (17), gamma = 1
    return wave + temperature + 1.1 * (1.5 - p) * s, wave + temperature + 0.7 * (1.5 - p) * s**1.26


def refuse_other_runs(directory: Path, scene: Scene) -> None:
    """Raise InputError unless the run has a disc of (locally) isothermal gas and a companion."""
    if scene.gas is None or scene.table("companion") is None or scene.star is None:
        raise InputError(f"{directory}: no gas or no companion; expected a run with [gas], [star] and [companion]")
    if scene.gas.eos.kind not in ("isothermal", "locally-isothermal"):
        wrong = f"gas.eos.kind is {scene.gas.eos.kind}"
        raise InputError(f"{directory}: {wrong}; expected isothermal or locally-isothermal, as in the theory")
    if scene.initial is None or STARTS[scene.initial.kind].radial is None:
        raise InputError(f"{directory}: the start has no Sigma(r), which Gamma_0 needs; expected the start of a disc")


def torque(directory: Path, given_start: str | float) -> Torque:
    """Return the torque by the gas after a time like "2 orbits". Raises UserError, OSError."""
    path = directory / "companions.csv"
    columns = read_companions(directory, COLUMNS)
    scene = load_scene(directory / "scene.toml")
    refuse_other_runs(directory, scene)
    table = np.stack([columns[name] for name in COLUMNS], axis=1)
    of_each = [table[table[:, 0] == number] for number in np.unique(table[:, 0])]
    masses = np.array([own[-1, MASS] for own in of_each])
    planet = int(masses.argmax())
    if np.any(np.delete(masses, planet) > PROBE * masses[planet]):
        raise InputError(f"{path}: several companions; expected one, and others of less than {PROBE:g} of its mass")
    a, q = of_each[planet][0, AXIS], masses[planet] / scene.star.mass
    omega = float(kepler_omega(scene, a))
    sigma = profile.radial(scene).surface_density(a * np.array([1.0 - SLOPE, 1.0, 1.0 + SLOPE]))
    if not sigma.min() > 0.0:
        raise InputError(f"{directory}: no gas at the orbit of the companion at the start; expected a planet in a disc")
    aspect = float(scale_height(scene, a)) / a
    unit = (q / aspect) ** 2 * sigma[1] * a**4 * omega**2
    start = orbits_of(given_start, 2.0 * np.pi / omega, scene, "--from")
    made = float(of_each[planet][-1, TIME]) * omega / (2.0 * np.pi)
    if made + 1e-6 < np.ceil(start) + 2.0:
        raise InputError(
            f"--from {given_start}: {directory} has {made:.4g} orbits of the companion; expected at least two whole "
            f"orbits after --from"
        )
    found = [_means(own, omega, unit * mass / masses[planet], start) for own, mass in zip(of_each, masses, strict=True)]
    means, row = found[planet]
    probes = [own.mean() for k, (own, _) in enumerate(found) if k != planet]
    depth = softening(scene, scene.table("companion")[planet], a) / (aspect * a)
    slope = float((sigma[0] - sigma[2]) / (2.0 * SLOPE * sigma[1]))
    return Torque(
        float(means.mean()),
        float(means.std(ddof=1) / np.sqrt(len(means))),
        float(np.sqrt(np.mean(np.square(probes)))) if probes else float("nan"),  # the expected mean is 0
        row,
        *theory(slope, eos_of(scene).temperature_slope(scene.gas.eos), depth),
        len(means),
        q / aspect**3,
        start,
    )


def _means(rows: np.ndarray, omega: float, unit: float, start: float) -> tuple[np.ndarray, float]:
    """Return the means (orbits,) of a companion's torque over whole orbits from the orbit `start` on.

    The second result is the scatter of single rows.
    """
    orbit, value = rows[:, TIME] * omega / (2 * np.pi), rows[:, TORQUE] / unit
    whole = range(int(np.ceil(start)), int(np.floor(orbit[-1] + 1e-6)))
    # Intervals between rows differ, so this is a mean over time.
    return np.array([_mean(orbit, value, k, k + 1) for k in whole]), float(np.std(value[orbit >= start]))


def _mean(x: np.ndarray, y: np.ndarray, first: float, last: float) -> float:
    inside = (x > first) & (x < last)
    grid = np.concatenate([[first], x[inside], [last]])
    return float(np.trapezoid(np.interp(grid, x, y), grid) / (last - first))


def show(names: list[str], scenes: list[Scene], found: list[Torque]) -> None:
    """Print one line for each quantity, and one column for each run; then what limits the comparison."""
    particles = [scene.gas.particles for scene in scenes]
    words = " or ".join(sorted({scene.model.elements for scene in scenes}, reverse=True))  # "particles or cells"
    needed = [
        int(float(f"{count * each.noise / (0.1 * abs(each.horseshoe)):.2g}"))
        for count, each in zip(particles, found, strict=True)
    ]
    texts = ["mean torque", "error by orbits", "error by probes", "scatter of single rows", "theory, horseshoe drag"]
    rows: list[list[object]] = [[f"gas {words}", "", *particles], ["whole orbits", "", *(t.orbits for t in found)]]
    for k, text in enumerate([*texts, "theory, linear"]):
        rows.append([text, "Gamma_0", *(each[k] for each in found)])
    rows += [["mass over the thermal mass, q (H/r)^-3", "", *(each.thermal for each in found)]]
    rows += [[f"gas {words} for an error of 10%", "", *needed]]
    starts = ", ".join(dict.fromkeys(f"{each.start:.4g}" for each in found))
    title = f"Torque by the gas on the companion from orbit {starts} on, Gamma_0 = (q r / H)^2 Sigma_0 r^4 Omega^2"
    print_table(title, ["quantity", "unit", *names], rows)
    print("a negative torque moves the companion inwards")
    for name, scene, each in zip(names, scenes, found, strict=True):
        if each.noise > abs(each.mean) / 3.0:
            remedy = f"use more {scene.model.elements}, or more orbits"
            print(f"{printable(name)}: the error is above a third of the torque; {remedy}")
        if each.thermal > 1.0:
            print(f"{printable(name)}: the companion is above the thermal mass, for which the theory does not hold")


def main(arguments: list[str] | None = None, prog: str | None = None) -> int:
    """Run the command line, and return the exit status."""
    parser = script_parser(__doc__, prog, __file__)
    parser.add_argument("directories", type=Path, nargs="+", metavar="DIR", help="directories of runs")
    parser.add_argument(
        "--from",
        dest="start",
        type=number_text,
        default="2 orbits",
        metavar="TIME",
        help='time left out, like "2 orbits" of the companion, 2 or "500 yr" (default "2 orbits")',
    )
    given = parser.parse_args(arguments)
    try:
        found = [torque(directory, given.start) for directory in given.directories]
        scenes = [load_scene(directory / "scene.toml") for directory in given.directories]
    except (UserError, OSError) as error:
        return print_fault("torque", error)
    show([directory.resolve().name for directory in given.directories], scenes, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
