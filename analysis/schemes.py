"""All drag schemes side by side: errors of waves and shocks, what they conserve, and CPU seconds.

    python analysis/schemes.py [-o OUT] [--schemes NAME,...] [--parts wave,shock,blast]

wave: DustyWave, eps = 1, 2 x 600 particles with h = .01 (or 600 cells), K from .005 to 1e6, at rest and on a velocity
of 1, KDK at a Courant number of .3 (cells .5), to t = .5:
    L2          of the dust's SPH interpolant (arXiv:1811.06506, eq. 38); the interpolant's own is about .0005
    particles   rms of the velocity over particles, the worse of gas and dust
    amplitude   of the velocity's first Fourier component, the worse of the two
    momentum    change of the total over the sum of |m v| at the most, divided by the number of steps
shock: DustyShock, K = 500, eps = 1, 2 x 990 particles with h = .01, to t = .2, against the limit of strong drag:
    L2, particles   with friction lost, as the paper has it
    heated          L2 with friction heating the gas
    energy          change of the total energy over the total, friction heating the gas
blast: CPU seconds of the explicit `mk` over those of the implicit schemes against t_stop, for a dusty blast in two
dimensions of 30^2 gas and 30^2 dust particles, eps = 1 (after Loren-Aguilar & Bate 2014, arXiv:1406.3250).

Errors of velocities are over the largest exact velocity. CPU seconds are without compilation; a run that would take
more than 20,000 steps is not made, and its seconds are those of 100 of its steps times their number (marked ~).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from measures import amplitude_error, particle_error, run_of, smoothed_error
from rich.console import Console
from rich.progress import track
from rich.table import Table
from script_helpers import some_of, warm_up, write_csv

from discsim import Simulation
from discsim.exact import sedov

SCHEMES = ("mk", "esph", "isph", "lab14", "reconstructed", "idic", "idic-linear", "tsc", "sios-ppm", "emsi-ppm")
PARTS = ("wave", "shock", "blast")
COEFFICIENTS = (0.005, 0.5, 500.0, 5000.0, 1e6)
H, MOST_STEPS = 0.01, 20_000
STOPPING_TIMES = (1.0, 0.1, 0.01, 0.001)  # of the blast, in its own time
WAVE = ("scheme", "K", "boost", "steps", "L2", "particles", "amplitude", "momentum", "seconds")
SHOCK = ("scheme", "steps", "L2", "particles", "heated", "energy", "seconds")


def totals(sim: Simulation) -> tuple[float, float]:
    """Momentum, and energy where the gas has one."""
    both = sim.state.species.values()
    momentum = sum(float((p.mass * p.vel[:, 0]).sum()) for p in both)
    energy = sum(float((p.mass * (p.vel**2).sum(axis=1)).sum()) / 2 for p in both)
    return momentum, energy + (float((sim.gas.mass * sim.gas.u).sum()) if sim.gas.u is not None else 0.0)


def wave(scheme: str, coefficient: float, boost: float) -> dict:
    courant = {"courant": 0.5} if scheme.endswith("-ppm") else {}
    sim = run_of(scheme, "wave", coefficient, H, (600, 600), boost=boost, run=courant)
    scale = sum(float((p.mass * np.abs(p.vel[:, 0])).sum()) for p in sim.state.species.values())
    row = {"scheme": scheme, "K": coefficient, "boost": boost}
    before = totals(sim)[0]
    clock, step = time.process_time(), sim.step()
    if sim.scene.run.until / step > MOST_STEPS:
        for _ in range(99):
            sim.step()
        steps = sim.scene.run.until / (sim.time / 100)
        return row | {"steps": int(steps), "seconds": (time.process_time() - clock) / 100 * steps, "estimated": True}
    sim.run()
    row |= {"steps": sim.state.step, "seconds": time.process_time() - clock}
    row["momentum"] = abs(totals(sim)[0] - before) / scale / sim.state.step
    row["particles"] = max(particle_error(sim, kind) for kind in ("gas", "dust"))
    row["amplitude"] = max(amplitude_error(sim, kind) for kind in ("gas", "dust"))
    return row if scheme.endswith("-ppm") else row | {"L2": smoothed_error(sim, "dust", H, "cubic")}


def shock(scheme: str) -> dict:
    grid = scheme.endswith("-ppm")
    row: dict = {"scheme": scheme}
    for heating in (False, True):
        sim = run_of(
            scheme, "shock", 500.0, H, (990, 990), run={"courant": 0.5} if grid else {}, drag={"heating": heating}
        )
        before, clock = totals(sim)[1], time.process_time()
        sim.run()
        row |= {"steps": sim.state.step, "seconds": time.process_time() - clock}
        if heating:
            row["energy"] = abs(totals(sim)[1] / before - 1)
        else:
            row["particles"] = particle_error(sim, "dust")
        if not grid:
            row["heated" if heating else "L2"] = smoothed_error(sim, "dust", H, "cubic")
    return row


def blast(scheme: str, stopping_time: float, side: int = 30) -> Simulation:
    """As much dust as gas about a blast; warm gas around, at a Mach number of ten. t_stop in times of the run."""
    end = sedov.arrival_time(0.3, 1.0, 2.0)
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": end},
            "space": {"size": 1.0, "cells": side},
            "initial": {"kind": "blast", "radius": 2.5 / side},
            "gas": {
                "particles": side**2,
                "kernel": "quintic",
                "viscosity": {},
                "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.1},
            },
            "dust": {"particles": side**2, "ratio": 1.0},
            "drag": {"law": "stopping-time", "t_stop": stopping_time * end, "scheme": scheme},
        }
    )


def blasts(schemes: list[str]) -> list[dict]:
    """CPU seconds for each stopping time, and those of mk over each."""
    rows = []
    implicit = [name for name in schemes if name not in ("mk", "esph") and not name.endswith("-ppm")]
    for stopping_time in track(STOPPING_TIMES, "blast", console=Console(stderr=True)):
        row: dict = {"t_stop": stopping_time}
        for scheme in ("mk", *implicit):
            warm_up(blast(scheme, stopping_time))
            sim, clock = blast(scheme, stopping_time), time.process_time()
            sim.run()
            seconds = time.process_time() - clock
            row[scheme] = seconds if scheme == "mk" else row["mk"] / seconds
        rows.append(row)
    return rows


def show(rows: list[dict], columns: tuple[str, ...], title: str) -> None:
    table = Table(*columns, title=title)
    for row in rows:
        cells = []
        for key in columns:
            value = row.get(key)
            text = "" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)
            cells.append("~" + text if key in ("steps", "seconds") and row.get("estimated") else text)
        table.add_row(*cells)
    Console(width=140).print(table)


def draw(rows: list[dict], file: Path) -> None:
    """Error of the particles against K for each scheme, and against CPU seconds at K = 500."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for i, scheme in enumerate(dict.fromkeys(row["scheme"] for row in rows)):
        style = {"color": f"C{i}", "marker": "os^vD"[i % 5], "ms": 4}
        mine = [row for row in rows if row["scheme"] == scheme and row["boost"] == 0 and "particles" in row]
        left.plot([row["K"] for row in mine], [row["particles"] for row in mine], label=scheme, **style)
        cost = [row for row in mine if row["K"] == 500]
        right.plot([row["seconds"] for row in cost], [row["particles"] for row in cost], ls="", label=scheme, **style)
    left.set(xscale="log", yscale="log", xlabel="K", ylabel="rms error over particles / max |u|")
    right.set(xscale="log", yscale="log", xlabel="CPU seconds, K = 500")
    right.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    right.xaxis.set_major_formatter("{x:g}")
    right.xaxis.set_minor_formatter(NullFormatter())
    left.legend(fontsize=7, ncol=2)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(file, dpi=120)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("schemes"))
    parser.add_argument("--schemes", type=some_of(SCHEMES, "scheme"), default=",".join(SCHEMES))
    parser.add_argument("--parts", type=some_of(PARTS, "part"), default=",".join(PARTS))
    given = parser.parse_args(arguments)
    schemes, parts = given.schemes, given.parts
    given.out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    if "wave" in parts:
        rows = []
        for scheme in track(schemes, "waves", console=console):
            warm_up(run_of(scheme, "wave", 1.0, H, (600, 600)))
            rows += [wave(scheme, k, boost) for k in COEFFICIENTS for boost in (0.0, 1.0)]
        show(rows, WAVE, "DustyWave, eps = 1, h = .01")
        write_csv(rows, WAVE, given.out / "schemes_wave.csv")
        draw(rows, given.out / "schemes.png")
    if "shock" in parts:
        rows = []
        for scheme in track(schemes, "shocks", console=console):
            warm_up(run_of(scheme, "shock", 1.0, H, (990, 990)))
            rows.append(shock(scheme))
        show(rows, SHOCK, "DustyShock, K = 500, eps = 1, h = .01")
        write_csv(rows, SHOCK, given.out / "schemes_shock.csv")
    if "blast" in parts:
        rows = blasts(schemes)
        columns = tuple(rows[0])
        show(rows, columns, "CPU seconds of mk over those of each; mk: its own seconds")
        write_csv(rows, columns, given.out / "schemes_blast.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
