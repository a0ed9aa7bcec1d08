"""Drift of small grains past coarse SPH gas over that of Nakagawa et al. (1986), against the width of drag cells in H.

    python analysis/drift_cells.py [-o OUT] [--cases KERNEL:ETA:PARTICLES:H/r,...] [--widths W,...] [--stokes St,...]

The ring of `drift.py` with one-way dust, so that the gas of all runs of a case is the same to the last bit. What is
measured is the radial velocity of grains beyond that of grains of St = 1e-4, in which the noise of the gas is common to
both, |r - 1| < .2, orbits 1 to 6; over NSH's with the headwind that the gas has there. Without a width the cells are
those by default. The formula of `discsim/drag/width.py`, .02 (s / H)^7 at St = .01, is that of the printed table, which
is in docs/accuracy.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import drift
import numpy as np
from rich.console import Console
from rich.table import Table
from script_helpers import write_csv

from discsim import Simulation
from discsim.exact import nsh

CASES, WIDTHS = "wendland-c4:2.2:12000:0.08,quintic:1.1:12000:0.08", "0,0.75,1,1.25,1.5,2"
TRACER, WINDOW = 1e-4, 0.2
COLUMNS = ("kernel", "eta", "particles", "h_over_H", "cell_over_H", "headwind", "stokes", "drift", "error")


def ring(kernel: str, eta: float, particles: int, aspect: float, stokes: float, width: float) -> Simulation:
    """The ring; drag cells of `width` H at r = 1, or 0: by default."""
    drag = {"law": "stokes-number", "stokes": stokes, "direction": "one-way"}
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1e9},
            "space": {"size": 4.0} | ({"cells": 1024} if width else {}),
            "initial": {
                "kind": "disc",
                "surface_density": drift.SIGMA,
                "inner": drift.INNER,
                "outer": drift.OUTER,
                "inner_taper": drift.TAPER,
                "outer_taper": drift.TAPER,
            },
            "gas": {
                "kernel": kernel,
                "eta": eta,
                "particles": particles,
                "viscosity": drift.VISCOSITY,
                "eos": {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0},
            },
            "star": {"mass": 1.0, "accretion_radius": 0.4},
            "dust": {"particles": particles, "ratio": 0.01},
            "drag": drag | ({"cell_length": width * aspect} if width else {}),
        }
    )


def measured(sim: Simulation, aspect: float, orbits: tuple[float, float]) -> dict[str, np.ndarray | float]:
    """Series of the dust's radial velocity and of the gas's headwind over that of the start, h and the usual cell."""
    start, end = (2.0 * np.pi * n for n in orbits)
    found: dict[str, list[float]] = {"dust": [], "headwind": [], "h": []}

    def look() -> bool:
        with sim.synchronised():
            for name, p, values, unit in (
                ("dust", sim.dust, sim.dust.vel, lambda r: aspect**2 * r**-0.5),
                ("headwind", sim.gas, sim.state.acc_unshared["gas"], lambda r: 2.0 * aspect**2 / r**2),
            ):
                r = np.hypot(*p.pos.T)
                near = np.abs(r - 1.0) < WINDOW
                found[name].append(float(((values * p.pos).sum(axis=1) / r)[near].sum() / unit(r[near]).sum()))
            found["h"].append(float(sim.gas.h[near].mean()))
        return False

    sim.evolve(start)
    sim.evolve(end, look)
    return {key: np.array(values) for key, values in found.items()} | {"cell": drift.usual_cell(sim)}


def rows_of(case: str, width: float, stokes: list[float], orbits: tuple[float, float]) -> list[dict]:
    kernel, eta, particles, aspect = case.split(":")
    given = kernel, float(eta), int(particles), float(aspect)
    light, *heavy = (measured(ring(*given, st, width), given[3], orbits) for st in (TRACER, *stokes))
    radial = [float(nsh.velocities(st, 0.0, 1.0).dust_radial) for st in (TRACER, *stokes)]
    headwind, out = float(light["headwind"].mean()), []
    for st, found, expected in zip(stokes, heavy, radial[1:], strict=True):
        drifts = (found["dust"] - light["dust"]) / (expected - radial[0]) / headwind
        row = {"kernel": kernel, "eta": given[1], "particles": given[2], "h_over_H": light["h"].mean() / given[3]}
        row |= {"cell_over_H": light["cell"] / given[3], "headwind": headwind, "stokes": st}
        out.append(row | {"drift": float(drifts.mean()), "error": drift.batch_error(drifts)})
    return out


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("drift_cells"))
    parser.add_argument("--cases", default=CASES)
    parser.add_argument("--widths", default=WIDTHS, help="of drag cells in H at r = 1; 0: as by default")
    parser.add_argument("--stokes", default="0.01")
    parser.add_argument("--orbits", type=float, nargs=2, default=(1.0, 6.0))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    table, rows, stokes = Table(*COLUMNS), [], [float(text) for text in given.stokes.split(",")]
    for case in given.cases.split(","):
        for width in map(float, given.widths.split(",")):
            rows += rows_of(case, width, stokes, given.orbits)
    for row in rows:
        table.add_row(*(f"{v:.3g}" if isinstance(v := row[key], float) else str(v) for key in COLUMNS))
    write_csv(rows, COLUMNS, given.out / "drift_cells.csv")
    Console(width=120).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
