"""How quiet the gas of a Keplerian disc is: noise, balance and spurious viscosity by kernel, viscosity and start.

    python analysis/noise.py [-o OUT] [--choices 'NAME;...'] [--orbits N] [--resolution h/H]

A ring of gas from .5 to 1.55 about a star, Sigma ~ 1/r between tapers of .2 (a sharp edge sends waves through it),
H/r = .05, no drag and no gravity of its own, turns for 10 orbits at its middle, r = 1. For each choice it prints and
writes (noise.csv, noise.png, and one file a choice, so that a stopped study goes on):

    neighbours     within the kernel's support
    bias, scatter  of the pressure force against -(1/Sigma) dP/dr: mean over the last half of the orbits, in which the
                   ring breathes, and rms over all particles at the end, over it
    v_r            rms radial velocity over c_s, less its mean in rings of H; the headwind is .05 of c_s
    disorder       rms of ln(r Sigma) of the particles, of the density that their pressure is of
    Sigma          largest deviation of the azimuthal mean from the start, |r - 1| < .15, rings of H
    alpha flux     angular-momentum flux through r = 1 +- .15 over 1.5 Sigma c_s^2: of velocities, Sigma <v_r dv_phi>,
                   and of the torque that the gas inside r feels from that outside
    alpha shear    nu / (c_s H) from the decay of a shear wave in a periodic box of the same h/H, about as strongly
                   sheared as a disc
    dL/L           change of the total angular momentum, with what fell in
    ms, steps      CPU milliseconds a step, and steps
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from script_helpers import some_of, write_csv

from discsim import Simulation
from discsim.formulas.smoothing import SMOOTHING
from discsim.kernels.sph.smoothing import KERNELS, SUPPORT

ASPECT, INNER, OUTER, TAPER, WINDOW = 0.05, 0.5, 1.55, 0.2, 0.15
PLAIN: dict = {}  # the default viscosity
APPROACHING = {"pairs": "approaching"}
LOW = {"alpha": 0.1, "beta": 0.5, "pairs": "all"}
WEAK = {"alpha": 0.3, "beta": 0.5}
C2, C4 = {"kernel": "wendland-c2"}, {"kernel": "wendland-c4"}
CHOICES = {
    "default": C2 | {"viscosity": PLAIN},
    "cubic": {"kernel": "cubic", "viscosity": PLAIN},
    "quintic": {"kernel": "quintic", "viscosity": PLAIN},
    "wendland-c4": C4 | {"viscosity": PLAIN},
    "eta 2.5": C2 | {"eta": 2.5, "viscosity": PLAIN},
    "weak": C2 | {"viscosity": WEAK},
    "wendland-c4, eta 2.5, weak": C4 | {"eta": 2.5, "viscosity": WEAK},
    "quiet": C4 | {"quiet": True},
    "quiet, wendland-c2": C2 | {"quiet": True},
    "quiet, eta 2.5": C4 | {"eta": 2.5, "quiet": True},
    "quintic, approaching": {"kernel": "quintic", "viscosity": APPROACHING},
    "quintic, balsara": {"kernel": "quintic", "viscosity": {"switch": "balsara"}},
    "quintic, all pairs": {"kernel": "quintic", "viscosity": {"pairs": "all"}},
    "quintic, low": {"kernel": "quintic", "viscosity": LOW},
    "wendland-c4, eta 2.5, low": C4 | {"eta": 2.5, "viscosity": LOW | {"alpha": 0.05}},
    "cubic, single": {"kernel": "cubic", "viscosity": PLAIN, "precision": "single"},
}
COLUMNS = {
    "particles": "{:.0f}", "neighbours": "{:.0f}", "bias": "{:+.3f}", "scatter": "{:.2f}", "v_r": "{:.4f}",
    "disorder": "{:.3f}", "sigma": "{:.3f}", "alpha_flux": "{:+.4f}", "alpha_shear": "{:.4f}",
    "spin": "{:.1e}", "ms": "{:.0f}", "steps": "{:.0f}",
}  # fmt: skip


def eta_of(gas: dict) -> float:
    return gas.get("eta", SMOOTHING[gas["kernel"]].eta[1])


def ring(gas: dict, resolution: float) -> Simulation:
    """The ring with h = `resolution` H at r = 1."""
    start = {
        "kind": "disc",
        "surface_density": 1e-4,
        "inner": INNER,
        "outer": OUTER,
        "inner_taper": TAPER,
        "outer_taper": TAPER,
    }
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e9},
        "space": {"size": 4.0},
        "initial": start,
        "gas": gas
        | {
            "particles": 1000,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": ASPECT, "temperature_index": 1.0},
        },
        "star": {"mass": 1.0, "accretion_radius": 0.4},  # takes the odd particle that an edge throws in
    }
    mass = float(Simulation(scene).gas.mass.sum())
    spacing = resolution * ASPECT / eta_of(gas)
    scene["gas"]["particles"] = round(mass / 1e-4 / spacing**2)
    return Simulation(scene)


def polar(gas):
    r = np.sqrt((gas.pos**2).sum(axis=1))
    radial = (gas.pos * gas.vel).sum(axis=1) / r
    azimuthal = (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]) / r
    return r, radial, azimuthal


def density_ratio(gas, edges):
    """Mass over the volume that SPH gives it, over that of the start, Sigma ~ 1/r, in rings (counts would show the
    particles' own rings).
    """
    r = np.sqrt((gas.pos**2).sum(axis=1))
    mass, _ = np.histogram(r, edges, weights=gas.mass)
    volume, _ = np.histogram(r, edges, weights=gas.mass / (gas.density * r / 1e-4))
    return mass / volume


def flux(sim, acc) -> float:
    """Flux of angular momentum through the window over 1.5 Sigma c_s^2, from velocities and from torques."""
    gas = sim.gas
    r, radial, azimuthal = polar(gas)
    inside = np.abs(r - 1) < WINDOW
    balance = np.sqrt(1 - 2 * ASPECT**2) / np.sqrt(r)
    area = np.pi * ((1 + WINDOW) ** 2 - (1 - WINDOW) ** 2)
    pressure = gas.mass * gas.sound_speed**2
    reynolds = (gas.mass * radial * (azimuthal - balance))[inside].sum() / area
    torque = gas.mass * (gas.pos[:, 0] * acc[:, 1] - gas.pos[:, 1] * acc[:, 0])
    order = np.argsort(r)
    within, place = np.cumsum(torque[order]), r[order]
    through = -within[np.searchsorted(place, np.linspace(1 - WINDOW, 1 + WINDOW, 61))]
    stress = (through / (2 * np.pi * np.linspace(1 - WINDOW, 1 + WINDOW, 61) ** 2)).mean()
    return (reynolds + stress) / (1.5 * pressure[inside].sum() / area)


def push(sim, acc):
    """The pressure's pull on the particles of the window over that of the smooth disc."""
    r = np.sqrt((sim.gas.pos**2).sum(axis=1))
    return ((acc * sim.gas.pos).sum(axis=1) / r / (2 * ASPECT**2 / r**2))[np.abs(r - 1) < WINDOW]


def without_means(r, values):
    """Values less the mean in each ring of H."""
    ring = np.floor(r / ASPECT).astype(int)
    number = np.bincount(ring)
    return values - (np.bincount(ring, values) / np.maximum(number, 1))[ring]


def measure_disc(gas: dict, resolution: float, orbits: float, show) -> dict[str, float]:
    sim = ring(gas, resolution)
    edges = np.arange(1 - WINDOW, 1 + WINDOW + 1e-9, ASPECT)
    spin = (sim.gas.mass * polar(sim.gas)[2] * polar(sim.gas)[0]).sum()
    until, found, pulls, densities = 2 * np.pi * orbits, [], [], []
    count, cpu = 0, time.process_time()
    while sim.time < until:
        sim.evolve(min(until, sim.time + 0.25 * 2 * np.pi))
        count = sim.state.step
        show(sim.time / until)
        with sim.synchronised():
            if sim.time > 0.5 * until:
                acc, _ = sim.acceleration("gas")
                found.append(flux(sim, acc))
                pulls.append(push(sim, acc).mean())
                densities.append(density_ratio(sim.gas, edges))
    cpu = time.process_time() - cpu
    sim.run(until=sim.time)
    ledger = sim.state.ledger
    r, radial, azimuthal = polar(sim.gas)
    inside = np.abs(r - 1) < WINDOW
    scatter = push(sim, sim.acceleration("gas")[0]).std()
    kernel = KERNELS[sim.scene.gas.kernel]
    spacing2 = (sim.gas.mass / sim.gas.density)[inside]
    neighbours = np.pi * (SUPPORT[kernel] * sim.gas.h[inside]) ** 2 / spacing2
    return {
        "particles": sim.gas.count,
        "neighbours": float(neighbours.mean()),
        "h_over_H": float((sim.gas.h / (ASPECT * r))[inside].mean()),
        "bias": float(np.mean(pulls) - 1),
        "scatter": float(scatter),
        "v_r": float(np.sqrt((without_means(r, radial / sim.gas.sound_speed)[inside] ** 2).mean())),
        "disorder": float(np.log(sim.gas.density * r)[inside].std()),
        "sigma": float(np.abs(np.mean(densities, axis=0) - 1).max()),
        "alpha_flux": float(np.mean(found)),
        "alpha_error": float(np.std(found) / np.sqrt(len(found))),
        "spin": float(((sim.gas.mass * azimuthal * r).sum() + ledger.accreted_angular_momentum) / spin - 1),
        "ms": 1e3 * cpu / count,
        "steps": count,
    }


def measure_shear(gas: dict, resolution: float, waves: float = 8.0, mach: float = 1.4, until: float = 40.0) -> float:
    """nu / (c_s H) from the decay of v_y = A sin(k x) in a periodic box (units: H = c_s = 1).

    A wave 8 H long with A = 1.4 c_s has at most 1.1 c_s/H of shear, of a disc's 1.5: a slower one would measure the
    strength of the particles' lattice instead. The box is half as wide as long; a square one would let the wave break
    up into eddies. The first 5 H/c_s, in which the lattice dissolves, are left out.
    """
    rows = round(0.5 * waves * eta_of(gas) / resolution)
    spacing = 0.5 * waves / rows
    rng = np.random.default_rng(1)
    axes = [(np.arange(n) + 0.5) * spacing for n in (2 * rows, rows)]
    pos = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    pos = (pos + 0.3 * spacing * rng.uniform(-1, 1, pos.shape)) % [waves, 0.5 * waves]
    k = 2 * np.pi / waves
    scene = {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"size": [waves, 0.5 * waves], "boundary": "periodic", "cells": 2 * rows},
        "gas": gas | {"particles": len(pos), "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    }
    vel = np.stack([np.zeros(len(pos)), mach * np.sin(k * pos[:, 0])], axis=1)
    mass = np.full(len(pos), spacing**2)
    sim = Simulation(scene, particles={"gas": {"pos": pos, "vel": vel, "mass": mass}})
    times, amplitudes = np.linspace(5.0, until, 36), []
    for moment in times:
        sim.run(until=moment)
        amplitudes.append((sim.gas.vel[:, 1] * np.sin(k * sim.gas.pos[:, 0])).mean())
    return float(-np.polyfit(times, np.log(amplitudes), 1)[0] / k**2)


def study(out: Path, names: list[str], resolution: float, orbits: float) -> dict[str, dict[str, float]]:
    out.mkdir(parents=True, exist_ok=True)
    results = {}
    with Progress(console=Console(stderr=True)) as progress:
        for name in names:
            file = out / f"noise-{name.replace(', ', '-').replace(' ', '_')}-{resolution:g}-{orbits:g}.json"
            if not file.exists():
                task = progress.add_task(name, total=1.0)
                found = measure_disc(
                    CHOICES[name], resolution, orbits, lambda share, task=task: progress.update(task, completed=share)
                )
                found["alpha_shear"] = measure_shear(CHOICES[name], resolution)
                file.write_text(json.dumps(found))
            results[name] = json.loads(file.read_text())
    return results


def show_table(results: dict) -> None:
    table = Table("choice", *COLUMNS)
    for name, found in results.items():
        table.add_row(name, *(form.format(found[key]) for key, form in COLUMNS.items()))
    Console(width=150).print(table)


def draw(results: dict, file: Path) -> None:
    """Noise of v_r and alpha of each choice against the CPU time of its run."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, key, label in zip(
        figure.subplots(1, 2), ("v_r", "alpha_flux"), ("rms v_r / c_s", "alpha (flux)"), strict=True
    ):
        for name, found in results.items():
            at = 1e-3 * found["ms"] * found["steps"], abs(found[key])
            axes.plot(*at, "o", color="C0", ms=4)
            axes.annotate(name, at, (5, -3), textcoords="offset points", fontsize=8)
        axes.set(xlabel="CPU time [s]", ylabel=label, yscale="log")
        axes.margins(x=0.3)
    figure.savefig(file, dpi=110)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("noise"))
    choices = some_of(CHOICES, "choice", ";")
    parser.add_argument("--choices", type=choices, default=";".join(CHOICES), help="names separated by semicolons")
    parser.add_argument("--orbits", type=float, default=10.0)
    parser.add_argument("--resolution", type=float, default=0.34, help="h/H at the middle")
    given = parser.parse_args(arguments)
    results = study(given.out, given.choices, given.resolution, given.orbits)
    show_table(results)
    rows = [{"choice": name} | found for name, found in results.items()]
    write_csv(rows, tuple(rows[0]), given.out / "noise.csv")
    draw(results, given.out / "noise.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
