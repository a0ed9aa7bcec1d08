"""Drift of dust past gas over that of Nakagawa et al. (1986), with its uncertainty and its CPU time.

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
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from rich.box import SIMPLE
from rich.console import Console
from rich.progress import track
from rich.table import Table
from script_helpers import BLUE, FROM_AFAR, RED, warm_up, write_csv

from discsim import Simulation
from discsim.effects import gas
from discsim.exact import nsh
from discsim.formulas.smoothing import SMOOTHING
from discsim.run.operators import Operators

LOOKS = {"tsc": (BLUE, "o", "-"), "idic-linear": (RED, "s", "--")}  # colour, marker and line of each scheme
SCHEMES = tuple(LOOKS)
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
    """Error of the drift against the width of cells where the pressure is given, and the drift where SPH makes it."""
    with rc_context(FROM_AFAR | {"xtick.labelsize": 16}):
        figure = Figure(figsize=(16.0, 6.0), layout="constrained")
        FigureCanvasAgg(figure)
        *given, sph = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.15))
        for axes, stokes in zip(given, STOKES, strict=True):
            draw_given(axes, [row for row in rows if row["gas"] == "given" and row["stokes"] == stokes])
            axes.set_title(f"pressure given, St = {stokes:g}")
        given[0].set_ylabel("drift / NSH")
        for height, (scheme, (colour, marker, _)) in zip((0.32, 0.23), LOOKS.items(), strict=True):
            given[0].plot(0.07, height, marker, color=colour, ms=13, transform=given[0].transAxes)
            given[0].text(0.13, height, scheme, color=colour, va="center", transform=given[0].transAxes)
        sizes = f"{COUNTS[0]} (thin) to {COUNTS[-1]} (thick)\nparticles of each"
        given[0].text(0.05, 0.1, sizes, va="center", fontsize="small", transform=given[0].transAxes)
        draw_sph(sph, [row for row in rows if row["gas"] != "given"])
        message = "Drift of dust: narrow drag cells have the right drift, wide cells need many particles"
        figure.suptitle(message, x=0.01, ha="left", weight="bold")
        figure.savefig(path, dpi=95)


def draw_given(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Drift against the width of cells, a line a number of particles: the more particles, the thicker."""
    axes.axhline(1.0, color="0.6", lw=1.5)
    counts = sorted({row["particles"] for row in rows})
    for scheme, (colour, marker, line) in LOOKS.items():
        for count, width in zip(counts, (1.5, 3.0, 4.5), strict=False):
            mine = [row for row in rows if (row["scheme"], row["particles"]) == (scheme, count)]
            x, y, error = ([row[key] for row in mine] for key in ("cell", "drift", "error"))
            style = {"fmt": f"{marker}{line}", "color": colour, "lw": width, "ms": 4.0 + 2.0 * width, "capsize": 4}
            axes.errorbar(x, y, error, **style)
    axes.set(xscale="log", xlabel="width of drag cells [h]", ylim=(0.45, 1.25))
    axes.set_xticks(CELLS, labels=map(str, CELLS))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.locator_params(axis="y", nbins=5)


def draw_sph(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Drift by kernel: filled as seen, open over the headwind that the noise of the gas leaves."""
    axes.axhline(1.0, color="0.6", lw=1.5)
    for side, (scheme, (colour, marker, _)) in zip((-0.12, 0.12), LOOKS.items(), strict=True):
        mine = [row for row in rows if row["scheme"] == scheme]
        x = [list(KERNELS).index(row["gas"]) + side for row in mine]
        y, error, over = ([row[key] for row in mine] for key in ("drift", "error", "of_headwind"))
        axes.errorbar(x, y, error, fmt=marker, color=colour, ms=12, lw=2.5, capsize=5)
        axes.plot(x, over, marker, color=colour, mfc="white", mew=2.5, ms=12)
    axes.set_xticks(range(len(KERNELS)), labels=[name.replace("wendland-c4", "C4") for name in KERNELS])
    axes.set(xlim=(-0.5, len(KERNELS) - 0.5), title="SPH pressure (open: its headwind)")
    axes.locator_params(axis="y", nbins=5)


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
