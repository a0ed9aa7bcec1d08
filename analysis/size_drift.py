"""Drift of grains of many sizes in gas that has a pressure of its own, over that of theory.

    python analysis/size_drift.py [-o OUT] [--bins N,...] [--schemes NAME,...] [--particles N] [--dust N]

A ring of SPH gas from .5 to 1.7 about a star, Sigma ~ 1/r between tapers, H/r = .1, and half as much dust that pushes
it, in sizes of Stokes numbers from .04 to 1.2 at r = 1, as much of n(s) ~ s^-3.5 in each bin. Means over orbits .5 to
2.5 at r = 1, |r - 1| < .15: radial velocity of each size less that of the gas, over that of Nakagawa et al. (1986) for
all sizes at once (Benitez-Llambay et al. 2019; `discsim/exact/nsh.py`), and the headwind that there is over that of
the start. Prints a table and writes size_drift.csv and size_drift.png.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from script_helpers import some_of, write_csv

from discsim import Simulation
from discsim.exact import nsh

ASPECT, SIGMA, RATIO, WINDOW, ORBITS = 0.1, 1e-4, 0.5, 0.15, (0.5, 2.5)
SMALLEST, LARGEST = 0.04, 1.2  # Stokes numbers at r = 1: neighbours among eight are classes of their own
OF_STOKES = SIGMA / (0.5 * np.pi)  # St = (pi/2) s rho_s / Sigma
LOOK = 0.2  # time between looks
COLUMNS = ("scheme", "bins", "stokes", "drift", "theory", "ratio", "headwind")


class Drifts(NamedTuple):
    """Of each size (bins,): Stokes number at r = 1, radial velocity less that of the gas and that of theory, over v_K;
    and the headwind over that of the start.
    """

    stokes: np.ndarray
    found: np.ndarray
    theory: np.ndarray
    headwind: float


def ring(bins: int, scheme: str = "tsc", gas: int = 16_000, dust: int = 2_000) -> Simulation:
    """The ring, with `dust` particles of each size."""
    sizes = {"smallest": SMALLEST * OF_STOKES, "largest": LARGEST * OF_STOKES, "bins": bins}
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1e9},
            "space": {"size": 5.0, "cells": 512},
            "initial": {
                "kind": "disc",
                "surface_density": SIGMA,
                "inner": 0.5,
                "outer": 1.7,
                "inner_taper": 0.2,
                "outer_taper": 0.3,
            },
            "gas": {
                "particles": gas,
                "kernel": "wendland-c4",
                "eta": 1.6,
                "viscosity": {"alpha": 0.3, "beta": 0.5},
                "eos": {"kind": "locally-isothermal", "aspect_ratio": ASPECT, "temperature_index": 1.0},
            },
            "dust": {"particles": dust * bins, "ratio": RATIO, "grain_size": sizes, "grain_density": 1.0},
            "star": {"mass": 1.0, "accretion_radius": 0.3},
            "drag": {"law": "epstein", "scheme": scheme},
        }
    )


def measure(sim: Simulation) -> Drifts:
    """Run the ring and measure its drifts."""
    sizes, of = np.unique(sim.dust.size, return_inverse=True)
    shares = np.bincount(of, sim.dust.mass) / sim.dust.mass.sum()
    found, theory, headwind, next_look = [], [], [], 2.0 * np.pi * ORBITS[0]

    def look() -> bool:
        nonlocal next_look
        if sim.time < next_look:
            return False
        next_look += LOOK
        with sim.synchronised():
            gas, dust = sim.gas, sim.dust
            r = np.sqrt((gas.pos**2).sum(axis=1))
            near = np.abs(r - 1.0) < WINDOW
            of_gas = ((gas.pos * gas.vel).sum(axis=1) / np.sqrt(r))[near].mean()  # v_r / v_K
            push = (sim.state.acc_unshared["gas"] * gas.pos).sum(axis=1)[near] / r[near]
            headwind.append(push.sum() / (2.0 * ASPECT**2 / r[near] ** 2).sum())
            r = np.sqrt((dust.pos**2).sum(axis=1))
            near = np.abs(r - 1.0) < WINDOW
            speed = (dust.pos * dust.vel).sum(axis=1) / np.sqrt(r)
            kind = np.unique(dust.size, return_inverse=True)[1]
            found.append([speed[near & (kind == k)].mean() - of_gas for k in range(len(sizes))])
            stokes = sizes[:, None] / OF_STOKES * r[near]  # Sigma ~ 1/r
            loads = np.repeat(RATIO * shares[:, None], stokes.shape[1], axis=1)
            scale = np.full(stokes.shape[1], ASPECT**2)  # eta = (p + q) h^2 / 2
            exact = nsh.velocities_of_populations(stokes, loads, scale)
            theory.append((exact.dust_radial - exact.gas_radial).mean(axis=1))
        return False

    sim.evolve(2.0 * np.pi * ORBITS[1], look)
    means = (np.mean(values, axis=0) for values in (found, theory))
    return Drifts(sizes / OF_STOKES, *means, float(np.mean(headwind)))


def draw(runs: dict[tuple[str, int], Drifts], file: Path) -> None:
    """Drift over theory against the Stokes number; dotted is the headwind that there is."""
    figure = Figure(figsize=(6.5, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for number, ((scheme, bins), drifts) in enumerate(runs.items()):
        style, label = {"color": f"C{number}"}, f"{scheme}, {bins} sizes"
        axes.plot(drifts.stokes, drifts.found / drifts.theory, "os^v"[number % 4], ms=6, label=label, **style)
        axes.axhline(drifts.headwind, ls=":", lw=0.8, **style)
    axes.axhline(1.0, color="black", lw=0.8)
    axes.set(xscale="log", ylim=(0.9, 1.1), xlabel="Stokes number at r = 1", ylabel="drift past the gas, over theory")
    axes.legend(frameon=False, loc="lower left", ncols=2)
    figure.savefig(file, dpi=120)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path())
    parser.add_argument("--bins", default="3,8", help="numbers of sizes, separated by commas; default: 3,8")
    parser.add_argument("--schemes", type=some_of(["tsc", "idic-linear"], "scheme"), default="tsc,idic-linear")
    parser.add_argument("--particles", type=int, default=16_000, help="of gas")
    parser.add_argument("--dust", type=int, default=2_000, help="particles of each size")
    given = parser.parse_args(arguments)
    table, rows, runs = Table(*COLUMNS), [], {}
    for scheme in given.schemes:
        for bins in map(int, given.bins.split(",")):
            drifts = runs[scheme, bins] = measure(ring(bins, scheme, given.particles, given.dust))
            for stokes, found, theory in zip(drifts.stokes, drifts.found, drifts.theory, strict=True):
                values = (scheme, bins, stokes, found, theory, found / theory, drifts.headwind)
                rows.append(dict(zip(COLUMNS, values, strict=True)))
                table.add_row(*(value if isinstance(value, str) else f"{value:.4g}" for value in values))
    given.out.mkdir(parents=True, exist_ok=True)
    write_csv(rows, COLUMNS, given.out / "size_drift.csv")
    draw(runs, given.out / "size_drift.png")
    Console(width=120).print(table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
