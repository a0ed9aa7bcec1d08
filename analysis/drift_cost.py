"""What the drift of dust past gas costs: drift over that of Nakagawa et al. (1986), with its uncertainty, against CPU.

Part of `analysis/cost_of_accuracy.py --studies drift`. Rings about a star with Sigma ~ 1/r, H/r = .05, as much dust as
gas, both starting at the NSH velocities; over NSH is the radial velocity of dust minus that of gas, |r - 1| < .12:

    given  the gas feels the pressure of the power law whatever its particles do, so that the drag alone errs: cells of
           1 to 8 h (1.8 to 116 particles of a species) and 1500 to 24,000 particles of each, St = .1 and .01, orbits
           .5 to 1.5
    sph    the ring of `drift.py` with 12,000 particles of each, St = .1, orbits 1 to 5, for kernels of the gas: `drift`
           is what is seen, at the same place; `of_headwind` is that over the headwind that the gas's noise leaves

`idic` is left out: it is a viscosity that spreads these rings within an orbit (alpha above 1,
tests/drag/test_shear.py).
Uncertainties are standard errors from ten batches in time. Runs that the folder holds are not made again.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import drift
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import track
from rich.table import Table
from script_helpers import warm_up, write_csv

from discsim import Simulation
from discsim.effects import gas
from discsim.exact import nsh
from discsim.formulas.smoothing import SMOOTHING
from discsim.run.operators import Operators

SCHEMES = ("tsc", "idic-linear")
STOKES, CELLS, COUNTS = (0.1, 0.01), (1, 2, 4, 8), (1500, 6000, 24_000)
WIDTH = 130  # letters that the table takes
INNER, OUTER, TIMESTEP = 0.8, 1.25, 0.04
KERNELS = {
    "cubic": {"kernel": "cubic"},
    "quintic": {"kernel": "quintic"},
    "wendland-c4": {"kernel": "wendland-c4"},
    "wendland-c4, eta 2.2": {"kernel": "wendland-c4", "eta": 2.2},
}
COLUMNS = ("gas", "stokes", "scheme", "particles", "cell", "per_cell", "drift", "error", "of_headwind", "cpu", "steps")


class Case(NamedTuple):
    """A run: the gas ("given", or one of KERNELS), the Stokes number, the scheme, particles of each, cells in h."""

    gas: str
    stokes: float
    scheme: str
    particles: int
    cell: float

    @property
    def per_cell(self) -> float:
        """Particles of a species in a drag cell."""
        keys = KERNELS.get(self.gas, KERNELS["cubic"])
        return (self.cell * keys.get("eta", SMOOTHING[keys["kernel"]].eta[1])) ** 2

    def ring(self) -> Simulation:
        if self.gas == "given":
            return given_ring(self.stokes, self.scheme, self.particles, self.cell)
        gas_keys = KERNELS[self.gas] | {"viscosity": drift.VISCOSITY}
        return drift.ring(1.0, self.stokes, self.scheme, 1, self.particles, self.particles, gas_keys)

    @property
    def orbits(self) -> tuple[float, float]:
        return (0.5, 1.5) if self.gas == "given" else (1.0, 5.0)


def cases(counts: Sequence[int] = COUNTS, cells: Sequence[float] = CELLS, sph: int = 12_000) -> list[Case]:
    given = [Case("given", *rest) for rest in itertools.product(STOKES, SCHEMES, counts, cells)]
    return given + [Case(name, 0.1, scheme, sph, 2) for scheme in SCHEMES for name in KERNELS]


class GivenGas(gas.Effect):
    """Gas with the density, sound speed and pressure force of Sigma ~ 1/r, c_s^2 ~ 1/r: no noise of SPH."""

    def accelerate(self, view: Any) -> float:
        p = view.gas
        r = np.sqrt((p.pos**2).sum(axis=1))
        p.density[:], p.sound_speed[:] = drift.SIGMA / r, drift.ASPECT / np.sqrt(r)
        p.h[:] = self.scene.gas.eta * np.sqrt(p.mass / p.density)
        acc = p.acc_unshared
        acc += (2.0 * drift.ASPECT**2 / r**3)[:, None] * p.pos
        return np.inf  # no step limit


def given_ring(stokes: float, scheme: str, particles: int, cell: float) -> Simulation:
    """The ring whose pressure is given, eps = 1; drag cells of `cell` h."""
    sim = Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1e9, "timestep": TIMESTEP},
            "space": {"size": 3.0, "cells": 256},
            "initial": {"kind": "disc", "surface_density": drift.SIGMA, "inner": INNER, "outer": OUTER},
            "gas": {
                "particles": particles,
                "kernel": "cubic",
                "eos": {"kind": "locally-isothermal", "aspect_ratio": drift.ASPECT, "temperature_index": 1.0},
            },
            "dust": {"particles": particles, "ratio": 1.0},
            "star": {"mass": 1.0},
            "drag": {"law": "stokes-number", "stokes": stokes, "scheme": scheme, "cell": cell},
        }
    )
    sim.operators = Operators(sim.state, sim.effects | {"gas": GivenGas(sim.scene, sim.state)})
    return sim


def measured(case: Case) -> dict[str, Any]:
    """What `drift.measure` sees, and the CPU seconds of the steps; kernels are compiled by two steps apart."""
    warm_up(case.ring())
    sim = case.ring()
    found = drift.measure(sim, case.orbits, lambda share: None)
    return found | {"cpu": sim.costs.total}


def row_of(case: Case, found: dict[str, Any]) -> dict[str, Any]:
    """Drift over NSH with its error, and over the headwind: of means where pressure is given, else of local slips."""
    series = {key: np.array(values) for key, values in found["series"].items()}
    expected = nsh.velocities(case.stokes, 1.0, 1.0)
    slip = series["dust"] - series["gas"] if case.gas == "given" else series["slip"]
    slip = slip / float(expected.dust_radial - expected.gas_radial)
    mean = float(slip.mean())
    seen = {"drift": mean, "error": drift.batch_error(slip), "of_headwind": mean / float(series["headwind"].mean())}
    return case._asdict() | {"per_cell": case.per_cell} | seen | {"cpu": found["cpu"], "steps": found["steps"]}


def study(out: Path, wanted: Sequence[Case]) -> list[dict[str, Any]]:
    """The rows of the table; what `out` does not hold yet is run."""
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in track(wanted, "drift", console=Console(stderr=True)):
        file = out / ("-".join(map(str, case)).replace(", ", "-").replace(" ", "_") + ".json")
        if not file.exists():
            file.write_text(json.dumps(measured(case)))
        rows.append(row_of(case, json.loads(file.read_text())))
    return rows


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """How far off the drift is against CPU seconds where the pressure is given, and the drift where SPH makes it."""
    figure = Figure(figsize=(12.5, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    *given, sph = figure.subplots(1, 3)
    for axes, stokes in zip(given, STOKES, strict=True):
        draw_given(axes, [row for row in rows if row["gas"] == "given" and row["stokes"] == stokes])
        axes.set_title(f"pressure given, St = {stokes:g} (numbers: particles in a cell)", fontsize=9)
    given[0].set_ylabel("|drift / NSH - 1|")
    for number, name in enumerate(KERNELS):
        for scheme, marker in zip(SCHEMES, "os", strict=True):
            mine = [row for row in rows if (row["gas"], row["scheme"]) == (name, scheme)]
            x, y, error = ([row[key] for row in mine] for key in ("cpu", "drift", "error"))
            sph.errorbar(x, y, error, fmt=marker, color=f"C{number}", ms=5, capsize=2, label=f"{name}, {scheme}")
            sph.plot(x, [row["of_headwind"] for row in mine], marker, color=f"C{number}", mfc="none", ms=5)
    sph.axhline(1.0, color="0.6", lw=0.8)
    sph.set_title("pressure of SPH, St = 0.1 (open: over its headwind)", fontsize=9)
    sph.set_ylabel("drift / NSH")
    for axes in (*given, sph):
        axes.set_xlabel("CPU time of the steps [s]")
        axes.grid(alpha=0.3)
        if axes.has_data():
            axes.legend(frameon=False, fontsize=7)
    figure.savefig(path, dpi=95)


def draw_given(axes: Any, rows: list[dict[str, Any]]) -> None:
    for number, scheme in enumerate(SCHEMES):
        for count, marker in zip(sorted({row["particles"] for row in rows}), "^os", strict=False):
            mine = [row for row in rows if (row["scheme"], row["particles"]) == (scheme, count)]
            x, error = [row["cpu"] for row in mine], [row["error"] for row in mine]
            off = [abs(row["drift"] - 1.0) for row in mine]
            label = f"{scheme}, {count} of each"
            axes.errorbar(x, off, error, fmt=marker + "-", color=f"C{number}", lw=0.8, ms=4, capsize=2, label=label)
            for row, at in zip(mine, off, strict=True):
                text = f"{row['per_cell']:.{int(row['per_cell'] < 10)}f}"
                axes.annotate(text, (row["cpu"], at), (4, 3), textcoords="offset points", fontsize=6)
    axes.set(xscale="log", yscale="log", ylim=(4e-4, 1.0))


def make(out: Path, console: Console, wanted: Sequence[Case] | None = None) -> list[dict[str, Any]]:
    """Run what is missing, print the table, write drift_cost.csv and cost_drift.png."""
    rows = study(out, cases() if wanted is None else wanted)
    table = Table(*COLUMNS, box=SIMPLE)
    console.width = max(console.width, WIDTH)
    for row in rows:
        table.add_row(*(f"{v:.3g}" if isinstance(v := row[key], float) else str(v) for key in COLUMNS))
    console.print(table)
    write_csv(rows, COLUMNS, out / "drift_cost.csv")
    draw(rows, out.parent / "cost_drift.png")
    return rows
