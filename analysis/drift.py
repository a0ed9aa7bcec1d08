"""Radial drift of dust and gas in a Keplerian disc over that of Nakagawa, Sekiya & Hayashi (1986).

    python analysis/drift.py [-o OUT] [--gas sph|background] [--cases eps:St,...] [--schemes NAME,...] [--seeds N]

sph: a ring of gas from .5 to 1.55 (`--outer`) about a star, Sigma ~ 1/r between tapers of .2 (sharp edges send waves
through it, and what viscosity makes of a taper must not reach the middle), H/r = .05, and as many dust as gas
particles, evenly placed, both starting at the NSH velocities; means over orbits 2 to 12 at r = 1, |r - 1| < .12. For
each case, scheme and seed it keeps one file in OUT, so that a stopped study goes on, and prints and writes (drift.csv,
drift.png):

    relative     radial velocity of dust minus that of gas at the same place, over NSH; what the drag alone answers for
    headwind     the gas's own acceleration over -(1/Sigma) dP/dr of the start: what SPH's noise and viscosity and the
                 ring's spreading leave of it; "of_headwind" is "relative" over it, the drag's own error
    means        mean over all dust minus mean over all gas in the window, over NSH: the same with the gas's own noise
    dust         over its own NSH drift
    gas          over its own NSH drift, from the angular momentum L of the gas that began within .2 of r = 1, as
                 2 r dlnL/dt: the mean radial velocity sways by far more than it drifts
    control      the same of gas alone, its acceleration by pressure divided by 1 + eps (H/r = .05/sqrt(1 + eps)):
                 what of its drift is SPH's own; "gas - control" is the rest
    error        standard error, from the means of ten batches
    alpha        Sigma <v_r dv_phi> of both over 1.5 Sigma_g c_s^2
    dL/L         change of the total angular momentum

background: the gas is given ([background]), H/r = .05 at its inner edge, drag is one-way, at default steps (.3/Omega of
the innermost grain); drift at the inner edge, the middle and the outer edge over NSH, for St from 1e-6 to 1e6, and for
grains of 1 um to 1 km with law "epstein-stokes", whose stopping time depends on the slip.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from script_helpers import some_of, write_csv

from discsim import Simulation
from discsim.exact import nsh
from discsim.parts import SCHEMES

ASPECT, SIGMA, INNER, OUTER, TAPER, WINDOW, BATCHES = 0.05, 1e-4, 0.5, 1.55, 0.2, 0.12, 10
FOLLOWED = 0.2  # from r = 1, within which gas begins whose angular momentum tells its drift
CASES = "0.01:0.1,0.01:0.01,1:0.1,1:0.01,0.01:0.001,0.01:1,1:0.001,1:1"
STOKES = (1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4, 1e6)
SIZES = ("1 um", "1 mm", "10 cm", "1 m", "3 m", "10 m", "100 m", "1 km")
PLACES = ("inner", "middle", "outer")
OF_PARTICLES = [name for name, scheme in SCHEMES.items() if not scheme.on_grid]
COLUMNS = (
    "eps",
    "stokes",
    "scheme",
    "seed",
    "relative",
    "error",
    "headwind",
    "of_headwind",
    "means",
    "means_error",
    "dust",
    "gas",
    "gas_less_control",
    "alpha",
    "spin",
)


def ring(
    ratio: float, stokes: float, scheme: str, seed: int, particles: int, dust: int, gas_keys: dict, outer: float = OUTER
) -> Simulation:
    """The ring, to the radius `outer`; a scheme "control" has no dust, and its gas 1/(1 + eps) of the pressure."""
    control = scheme == "control"
    aspect = ASPECT / np.sqrt(1 + ratio) if control else ASPECT
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e9, "seed": seed},
        "space": {"size": 2.0 * outer + 0.9, "cells": 1024},
        "initial": {
            "kind": "disc",
            "surface_density": SIGMA,
            "inner": INNER,
            "outer": outer,
            "inner_taper": TAPER,
            "outer_taper": TAPER,
        },
        "gas": gas_keys
        | {
            "particles": particles,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0},
        },
        "star": {"mass": 1.0, "accretion_radius": 0.4},
    }
    if not control:
        scene["dust"] = {"particles": dust, "ratio": ratio}
        scene["drag"] = {"law": "stokes-number", "stokes": stokes, "scheme": scheme}
    return Simulation(scene)


def cloud_sums(pos: np.ndarray, values: np.ndarray, cell: float) -> tuple[np.ndarray, tuple]:
    """Sums of `values` (n, k) over triangular-shaped clouds on a lattice (side, side, k), and how to gather back."""
    low = -1.0 - 3 * WINDOW
    side = int(-2 * low / cell) + 4
    x = (pos - low) / cell
    home = np.clip(np.floor(x).astype(int), 0, side - 3)
    x = x - home - 0.5
    weights = (0.5 * (0.5 - x) ** 2, 0.75 - x**2, 0.5 * (0.5 + x) ** 2)
    out = np.zeros((values.shape[1], side * side))
    stencil = []
    for i in range(3):
        for j in range(3):
            node = (home[:, 0] + i) * side + home[:, 1] + j
            stencil.append((node, weights[i][:, 0] * weights[j][:, 1]))
            for k, total in enumerate(out):
                total += np.bincount(node, stencil[-1][1] * values[:, k], side * side)
    return out, tuple(stencil)


def usual_cell(sim: Simulation) -> float:
    """Return the side of most drag cells; twice the mean h of an even gas for a scheme without cells."""
    if SCHEMES[sim.scene.drag.scheme].cells is None:
        return float(2 * sim.scene.gas.eta * np.sqrt(sim.gas.mass[0] / SIGMA))
    layout = sim.effects["drag"].engine.layout(sim.state)
    return float(layout.lattice.side * 2.0 ** int(np.bincount(layout.merged.level).argmax()))


def local_slip(sim: Simulation) -> float:
    """Return the radial velocity of dust minus that of gas at the same place, over the headwind.

    Both are means over clouds, averaged over the dust of the window; the gas's motions, which the dust shares, cancel.
    Clouds are as wide as drag cells, between whose means drag acts. Wider ones count dust that crowds within them as
    drift: 1.25 over clouds of 2 h (2 H) where the drift past tracers is 1.02 (`drift_cells.py`).
    """
    sums, cell = {}, usual_cell(sim)
    for name, p in sim.state.species.items():
        r = np.sqrt((p.pos**2).sum(axis=1))
        near = np.abs(r - 1) < 2 * WINDOW
        pos, radial = p.pos[near], ((p.pos * p.vel).sum(axis=1) / r)[near]
        values = np.stack([p.mass[near], p.mass[near] * radial], axis=1)
        sums[name], stencil = cloud_sums(pos, values, cell)
    (gas, gas_push), (dust, dust_push) = sums["gas"], sums["dust"]
    both = (gas > 0) & (dust > 0)
    slip = np.where(both, dust_push / np.where(both, dust, 1) - gas_push / np.where(both, gas, 1), 0.0)
    r = np.sqrt((pos**2).sum(axis=1))
    inside = np.abs(r - 1) < WINDOW
    felt = sum(weight[inside] * slip[node[inside]] for node, weight in stencil)
    return float(felt.sum() / (ASPECT**2 * r[inside] ** -0.5).sum())


def look(sim: Simulation) -> dict[str, float]:
    """Mean radial velocities in units of the headwind, the headwind, and the Reynolds stress, in the window now."""
    found = {"stress": 0.0}
    for name, p in sim.state.species.items():
        r = np.sqrt((p.pos**2).sum(axis=1))
        inside = np.abs(r - 1) < WINDOW
        radial = ((p.pos * p.vel).sum(axis=1) / r)[inside]
        azimuthal = ((p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]) / r - r**-0.5)[inside]
        unit = ASPECT**2 * r[inside] ** -0.5  # eta v_K
        found[name] = float(radial.sum() / unit.sum())
        found["stress"] += float((p.mass[inside] * radial * (azimuthal - azimuthal.mean())).sum())
    gas = sim.gas
    r = np.sqrt((gas.pos**2).sum(axis=1))
    inside = np.abs(r - 1) < WINDOW
    found["stress"] /= 1.5 * float((gas.mass * gas.sound_speed**2)[inside].sum())
    if sim.dust is not None:
        push = (sim.state.acc_unshared["gas"] * gas.pos)[inside].sum(axis=1) / r[inside]
        found["headwind"] = float(push.sum() / (2 * ASPECT**2 / r[inside] ** 2).sum())
        found["slip"] = local_slip(sim)
    return found


def spin(sim: Simulation) -> float:
    parts = (p.mass * (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]) for p in sim.state.species.values())
    return float(sum(part.sum() for part in parts)) + sim.state.ledger.accreted_angular_momentum


def angular_momentum(sim: Simulation, ids: np.ndarray) -> float:
    """Return the mean specific angular momentum of the gas with these ids."""
    gas = sim.gas
    chosen = np.isin(gas.ids, ids)
    pos, vel = gas.pos[chosen], gas.vel[chosen]
    return float((pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]).mean())


def measure(sim: Simulation, orbits: tuple[float, float], show) -> dict:
    """What is seen five times a radian of the middle's orbit, and what the run changed."""
    start, end = (2 * np.pi * n for n in orbits)
    before = spin(sim)
    samples, next_look, followed = [], start, np.array([], int)

    def after_step() -> bool:
        nonlocal next_look, followed
        if sim.time >= next_look:
            next_look = sim.time + 0.2
            with sim.synchronised():
                if not samples:
                    r = np.sqrt((sim.gas.pos**2).sum(axis=1))
                    followed = sim.gas.ids[np.abs(r - 1.0) < FOLLOWED]
                samples.append(look(sim) | {"time": sim.time, "momentum": angular_momentum(sim, followed)})
        show(sim.time / end)
        return False

    sim.evolve(end, after_step)
    sim.run(until=sim.time)
    out = {"steps": sim.state.step, "spin": spin(sim) / before - 1}
    return out | {"series": {key: [s[key] for s in samples] for key in samples[0]}}


def summary(found: dict, control: dict, ratio: float, stokes: float) -> dict[str, float]:
    """A row of the table from what two runs have seen."""
    expected = nsh.velocities(stokes, ratio, 1.0)
    series = {key: np.array(values) for key, values in found["series"].items()}
    relative = float(expected.dust_radial - expected.gas_radial)
    gas = drift_of_gas(series) / float(expected.gas_radial)
    headwind = float(series["headwind"].mean())
    slip = series["slip"] / relative
    return {
        "relative": float(slip.mean()),
        "error": batch_error(slip),
        "headwind": headwind,
        "of_headwind": float(slip.mean()) / headwind,
        "means": float((series["dust"] - series["gas"]).mean() / relative),
        "means_error": batch_error((series["dust"] - series["gas"]) / relative),
        "dust": float(series["dust"].mean() / expected.dust_radial),
        "gas": gas,
        "gas_less_control": gas - drift_of_gas(control["series"]) / float(expected.gas_radial),
        "alpha": float(series["stress"].mean()),
        "spin": found["spin"],
    }


def drift_of_gas(series: dict[str, Any]) -> float:
    """Return the radial velocity of the gas, from its angular momentum, over the headwind at r = 1."""
    return 2.0 * float(np.polyfit(series["time"], np.log(series["momentum"]), 1)[0]) / ASPECT**2


def batch_error(values: np.ndarray) -> float:
    batches = [part.mean() for part in np.array_split(values, min(BATCHES, len(values)))]
    return float(np.std(batches, ddof=1) / np.sqrt(len(batches)))


def study(given, cases: list[tuple[float, float]]) -> list[dict]:
    """Measure what OUT does not hold yet; the rows of the table."""
    rows = []
    keys = json.loads(given.gas_keys)
    with Progress(console=Console(stderr=True)) as progress:

        def run(ratio: float, stokes: float, scheme: str, seed: int) -> dict:
            name = f"{scheme}-eps{ratio:g}" + ("" if scheme == "control" else f"-St{stokes:g}")
            name += f"-outer{given.outer:g}" if given.outer != OUTER else ""
            file = given.out / f"drift-{name}-seed{seed}.json"
            if not file.exists():
                task = progress.add_task(file.stem, total=1.0)
                sim = ring(ratio, stokes, scheme, seed, given.particles, given.dust, keys, given.outer)
                found = measure(sim, given.orbits, lambda share: progress.update(task, completed=share))
                file.write_text(json.dumps(found))
            return json.loads(file.read_text())

        for seed in range(1, given.seeds + 1):
            for ratio, stokes in cases:
                control = run(ratio, stokes, "control", seed)  # one for all Stokes numbers
                for scheme in given.schemes:
                    row = {"eps": ratio, "stokes": stokes, "scheme": scheme, "seed": seed}
                    rows.append(row | summary(run(ratio, stokes, scheme, seed), control, ratio, stokes))
    return rows


def background_errors(drag: dict, grains: dict, courant: float = 0.3, count: int = 60) -> tuple[float, list[float]]:
    """Stokes number in the middle, and drift in a given gas from 1 to 4 au over NSH's, less one, at its inner edge,
    middle and outer edge, over orbits 1 to 4 of the inner edge; stopping times are those at the slip that there is."""
    disc = {"surface_density": "1000 g/cm2", "reference_radius": "1 au"}
    eos = {"kind": "locally-isothermal", "aspect_ratio": ASPECT, "temperature_index": 0.5}
    sim = Simulation(
        {
            "run": {"until": "4 yr", "courant": courant},
            "space": {"size": "20 au"},
            "background": disc | {"eos": eos},
            "initial": disc | {"kind": "disc", "inner": "1 au", "outer": "4 au"},
            "dust": {"particles": count, "ratio": 0.01} | grains,
            "star": {"mass": "1 Msun"},
            "drag": {"direction": "one-way"} | drag,
        }
    )

    def now() -> tuple[np.ndarray, np.ndarray]:
        """Radii and Stokes numbers in the order of ids."""
        order = np.argsort(sim.dust.ids)
        r = np.sqrt((sim.dust.pos**2).sum(axis=1))
        return r[order], (sim.effects["drag"].current_stopping_times(sim.state) * r**-1.5)[order]

    sim.run(until=2 * np.pi)
    (start, _), expected = now(), np.zeros(count)
    while sim.time < sim.scene.run.until:
        before = now()
        dt = sim.step(sim.scene.run.until - sim.time)
        for r, stokes in (before, now()):
            headwind = 0.75 * ASPECT**2 * r**0.5 * r**-0.5  # (p + q)/2 (H/r)^2 v_K
            found = nsh.drift_about_circular_orbits(stokes[None], np.zeros((1, count)), headwind, r**-0.5)
            expected += 0.5 * dt * found.dust_radial[0]
    end, stokes = now()
    error = (end - start) / expected - 1
    order = np.argsort(start)
    few = max(1, count // 20)
    parts = order[:few], order[(count - few) // 2 : (count + few) // 2 + 1], order[-few:]
    return float(stokes[parts[1]].mean()), [float(error[part].mean()) for part in parts]


def background_rows() -> list[dict]:
    cases = [({"law": "stokes-number", "stokes": stokes}, {}) for stokes in STOKES]
    cases += [({"law": "epstein-stokes"}, {"grain_size": size, "grain_density": "3 g/cm3"}) for size in SIZES]
    rows = []
    for drag, grains in cases:
        stokes, errors = background_errors(drag, grains)
        rows.append({"law": drag["law"], "stokes": stokes} | dict(zip(PLACES, errors, strict=True)))
    return rows


def draw(rows: list[dict], file: Path) -> None:
    """Relative drift over NSH against the Stokes number, a colour a scheme, a symbol a ratio."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    schemes = sorted({row["scheme"] for row in rows})
    ratios = sorted({row["eps"] for row in rows})
    for i, scheme in enumerate(schemes):
        for j, ratio in enumerate(ratios):
            mine = [row for row in rows if row["scheme"] == scheme and row["eps"] == ratio]
            x = [row["stokes"] * 1.06 ** (i + 0.3 * row["seed"]) for row in mine]
            y, error = [row["relative"] for row in mine], [row["error"] for row in mine]
            axes.errorbar(x, y, error, fmt="os"[j % 2], color=f"C{i}", label=f"{scheme}, eps = {ratio:g}", ms=4)
    axes.axhline(1, color="0.6", lw=0.8)
    axes.set(xscale="log", xlabel="Stokes number", ylabel="(dust - gas) drift / NSH")
    axes.set_yscale("symlog", linthresh=2)
    axes.legend(fontsize=8)
    figure.savefig(file, dpi=120)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("drift"))
    parser.add_argument("--gas", choices=("sph", "background"), default="sph")
    parser.add_argument("--cases", default=CASES, help="eps:St, separated by commas")
    parser.add_argument("--schemes", type=some_of(OF_PARTICLES, "scheme"), default="tsc,idic-linear,idic")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--dust", type=int, default=100_000)
    parser.add_argument("--orbits", type=float, nargs=2, default=(2.0, 12.0))
    parser.add_argument("--outer", type=float, default=OUTER, metavar="R", help=f"of the ring (default {OUTER:g})")
    parser.add_argument("--gas-keys", default=json.dumps(GAS), help="table [gas] as JSON")
    given = parser.parse_args(arguments)
    console = Console(width=190)
    given.out.mkdir(parents=True, exist_ok=True)
    if given.gas == "background":
        table = Table("law", "Stokes number", *(f"drift over NSH, less 1: {place}" for place in PLACES))
        rows = background_rows()
        for row in rows:
            table.add_row(row["law"], f"{row['stokes']:.3g}", *(f"{row[place]:+.5f}" for place in PLACES))
        write_csv(rows, ("law", "stokes", *PLACES), given.out / "drift-background.csv")
    else:
        try:
            cases = [(float(a), float(b)) for a, b in (case.split(":") for case in given.cases.split(","))]
        except ValueError:
            parser.error(f"--cases: {given.cases!r}; expected pairs like 0.01:0.1,1:0.1")
        rows = study(given, cases)
        table = Table(*COLUMNS)
        for row in rows:
            table.add_row(*(f"{v:.4g}" if isinstance(v := row[key], float) else str(v) for key in COLUMNS))
        write_csv(rows, COLUMNS, given.out / "drift.csv")
        draw(rows, given.out / "drift.png")
    console.print(table)
    return 0


# Gas that hardly spreads (analysis/noise.py).
GAS = {"kernel": "wendland-c4", "quiet": True}
VISCOSITY = {"alpha": 0.3, "beta": 0.5}

if __name__ == "__main__":
    sys.exit(main())
