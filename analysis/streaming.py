"""Streaming instability in a shearing box: growth of small waves, and clumps of random dust.

    python analysis/streaming.py growth -o OUT [--cases linA,linB,lin3,lin16] [--schemes tsc,...] [--cells 8,16,32]
    python analysis/streaming.py clumps -o OUT [--cases AB,BA] [--cells 48,64]

growth: growth rate and frequency of one oblique wave, compared with the eigenvalue problem. Writes growth.csv and
growth.png, the error against the number of drag cells in a wavelength. Cases: linA and linB of Youdin & Johansen (2007,
table 1), lin3 with two sizes (Benitez-Llambay, Krapp & Pessah 2019, table 4), lin16 with 16 sizes, Omega t_stop from
0.001 to 0.1, in an MRN distribution with three times the mass of the gas, and K = 50. A cell has four particles of gas
and as many of each size. The largest density amplitude begins at 1e-4. Rates are fits to the last three quarters of a
run.

clumps: the runs AB and BA of Johansen & Youdin (2007) with random dust. Writes clumps.csv and clumps.png. Densities of
the dust are those of triangular-shaped clouds on the drag cells, over the mean density. The table has means over the
second half of a run: largest density, densities that 1% and 0.1% of the cells exceed, drift of the dust over that of
Nakagawa, Sekiya & Hayashi (1986), and rms velocities about the mean, over the headwind. A cell has two particles of gas
and four of dust.

Lengths are in eta r, velocities in eta v_K and times in 1 / Omega. Tables and figures have all runs in OUT; a run that
OUT has is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from script_helpers import BLUE, PURPLE, RED, some_of, whole_numbers, write_csv

from discsim import Simulation, load_scene
from discsim.exact import streaming
from discsim.initial.streaming import mode_amplitude

FOLDS, SAMPLES, AMPLITUDE, SOUND_SPEED = 1.0, 48, 1e-4, 5.0
# gas.eta of waves with tsc. With 1.7 the lattice of the gas resists shear, with 3.5 it is unstable after 40 / Omega.
# Other schemes have the default, as their cells are at least as wide as h.
ETA = 2.9
MRN = np.logspace(-3.0, -1.0, 16)


class Wave(NamedTuple):
    """Case of `growth`: stopping times, dust-to-gas ratios, and wave number along radius and height."""

    times: tuple[float, ...]
    ratios: tuple[float, ...]
    k: float


class Clumping(NamedTuple):
    """Case of `clumps`: stopping time, dust-to-gas ratio, side of the box, end of the run, and sound speed."""

    time: float
    ratio: float
    side: float
    until: float
    sound_speed: float


WAVES = {
    "linA": Wave((0.1,), (3.0,), 30.0),
    "linB": Wave((0.1,), (0.2,), 6.0),
    "lin3": Wave((0.0425, 0.1), (1.0, 0.5), 50.0),
    "lin16": Wave(tuple(MRN), tuple(3.0 * np.sqrt(MRN) / np.sqrt(MRN).sum()), 50.0),
}
CLUMPS = {"AB": Clumping(0.1, 1.0, 2.0, 30.0, 5.0), "BA": Clumping(1.0, 0.2, 40.0, 150.0, 20.0)}
SCHEMES = {"tsc": BLUE, "idic-linear": RED, "idic": PURPLE}
GROWTH = (
    "case",
    "scheme",
    "cells",
    "folds",
    "rate",
    "frequency",
    "exact_rate",
    "exact_frequency",
    "error",
    "steps",
    "cpu_s",
)
STATISTICS = "largest", "densest_1_percent", "densest_0.1_percent", "drift_over_nsh", "rms_gas", "rms_dust"
CLUMPING = "case", "cells", *STATISTICS, "peak", "steps", "cpu_s"


def scene_of(
    side: float, until: float, cells: int, gas: int, sound_speed: float, start: dict, dust: list[dict]
) -> dict:
    """Return a scene of a shearing box with `cells` drag cells along each side."""
    return {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"size": [side, side], "boundary": "periodic"},
        "initial": {"kind": "streaming"} | start,
        "shearing_box": {"omega": 1.0, "headwind": 1.0},
        "gas": {
            "particles": gas,
            "kernel": "wendland-c4",
            "quiet": {"share": 1.0},
            "viscosity": {"alpha": 0.0, "beta": 0.0},
            "eos": {"kind": "isothermal", "sound_speed": sound_speed},
        },
        "dust": dust,
        "drag": {"law": "stopping-time", "cell_length": side / cells},
    }


def wave_run(case: str, scheme: str, cells: int, folds: float, watch: Callable[[float], None]) -> dict[str, Any]:
    """Return the row of the table of `growth` for one run. watch: called with the fraction of the run that is done."""
    wave = WAVES[case]
    mode = streaming.fastest_mode(streaming.box(wave.times, wave.ratios, 1.0, SOUND_SPEED), wave.k, wave.k)
    exact, amplitude = mode.rate, AMPLITUDE / float(np.abs(mode.amplitudes[:, 0]).max())
    side, number, until = 2.0 * np.pi / wave.k, 4 * cells**2, folds / exact.real
    dust = [{"particles": number, "ratio": r, "t_stop": t} for t, r in zip(wave.times, wave.ratios, strict=True)]
    tables = scene_of(side, until, cells, number, SOUND_SPEED, {"amplitude": amplitude}, dust)
    tables["drag"]["scheme"] = scheme
    if scheme == "tsc":
        tables["gas"]["eta"] = ETA
    scene = load_scene(tables)
    sim, times, amplitudes, begin = Simulation(scene), [], [], time.process_time()
    for part in range(SAMPLES + 1):
        sim.evolve(until * part / SAMPLES)
        with sim.synchronised():
            times.append(sim.time)
            amplitudes.append(mode_amplitude(scene, sim))
        watch(part / SAMPLES)
    t, z = np.array(times)[SAMPLES // 4 :], np.array(amplitudes)[SAMPLES // 4 :]
    rate, frequency = np.polyfit(t, np.log(np.abs(z)), 1)[0], np.polyfit(t, np.unwrap(np.angle(z)), 1)[0]
    return {
        "case": case, "scheme": scheme, "cells": cells, "folds": folds, "rate": float(rate),
        "frequency": float(frequency), "exact_rate": exact.real, "exact_frequency": exact.imag,
        "error": float(rate / exact.real - 1.0),
        "steps": sim.state.step, "cpu_s": time.process_time() - begin,
    }  # fmt: skip


def density(pos: np.ndarray, side: float, cells: int) -> np.ndarray:
    """Return the number density of particles over its mean, (cells, cells), with triangular-shaped clouds."""
    x = pos / side * cells
    home = np.floor(x).astype(int)
    x -= home + 0.5
    weights = 0.5 * (0.5 - x) ** 2, 0.75 - x**2, 0.5 * (0.5 + x) ** 2
    out = np.zeros(cells * cells)
    for i in range(3):
        for j in range(3):
            at = (home + np.array([i - 1, j - 1])) % cells
            out += np.bincount(at[:, 0] * cells + at[:, 1], weights[i][:, 0] * weights[j][:, 1], cells * cells)
    return out.reshape(cells, cells) * cells**2 / len(pos)


def clumps_run(case: str, cells: int, watch: Callable[[float], None]) -> dict[str, Any]:
    """Return the row of the table of `clumps` for one run, with its last density and the largest density in time."""
    given = CLUMPS[case]
    dust = [{"particles": 4 * cells**2, "ratio": given.ratio, "t_stop": given.time, "placement": "random"}]
    start = {"amplitude": 0.0}
    tables = scene_of(given.side, given.until, cells, 2 * cells**2, given.sound_speed, start, dust)
    sim, begin, rows = Simulation(tables), time.process_time(), []
    nsh = streaming.drift(streaming.box(given.time, given.ratio))[1, 0]
    for part in range(1, 2 * SAMPLES + 1):
        sim.evolve(given.until * part / (2 * SAMPLES))
        with sim.synchronised():
            found = density(sim.dust.pos, given.side, cells)
            spread = [np.sqrt(p.vel.var(axis=0).sum() + p.across.var()) for p in (sim.gas, sim.dust)]
            drift = sim.dust.vel[:, 0].mean() / nsh
        rows.append([found.max(), *np.quantile(found, [0.99, 0.999]), drift, *spread])
        watch(part / (2 * SAMPLES))
    means = dict(zip(STATISTICS, np.mean(rows[SAMPLES:], axis=0).tolist(), strict=True))
    return {
        "case": case, "cells": cells, **means, "peak": float(max(row[0] for row in rows)), "steps": sim.state.step,
        "cpu_s": time.process_time() - begin, "density": found.tolist(),
    }  # fmt: skip


def make(file: Path, run: Callable[[Callable[[float], None]], dict[str, Any]], progress: Progress) -> None:
    """Make a run and write its result to `file`, unless the file exists."""
    if not file.exists():
        task = progress.add_task(file.stem, total=1.0)
        found = run(lambda share: progress.update(task, completed=share))
        file.write_text(json.dumps(found))


def draw_growth(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw the error of the growth rate against the number of cells in a wavelength, a panel for each case."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    figure = Figure(figsize=(2.9 * len(cases), 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
    sizes = sorted({row["cells"] for row in rows})
    for axes, case in zip(panels, cases, strict=True):
        for scheme in dict.fromkeys(row["scheme"] for row in rows):
            mine = sorted((r for r in rows if (r["case"], r["scheme"]) == (case, scheme)), key=lambda r: r["cells"])
            errors = [100.0 * abs(row["error"]) for row in mine]
            axes.plot([row["cells"] for row in mine], errors, "o-", color=SCHEMES[scheme], label=scheme)
        axes.plot(sizes, 4.0 * (np.array(sizes) / sizes[0]) ** -2.0, "--", color="0.5", label="second order")
        axes.set(title=case, xscale="log", yscale="log", xlabel="drag cells in a wavelength")
        axes.set_xticks(sizes, [str(n) for n in sizes])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("error of the growth rate [%]")
    panels[-1].legend(fontsize=9)
    figure.savefig(file, dpi=120)


def draw_clumps(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw the last densities of the dust, a row of panels for each case."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    columns = max(sum(row["case"] == case for row in rows) for case in cases)
    figure = Figure(figsize=(4.0 * columns + 0.8, 3.9 * len(cases)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(cases), columns, squeeze=False)
    for line, case in zip(panels, cases, strict=True):
        given = CLUMPS[case]
        mine = [row for row in rows if row["case"] == case]
        top = 10.0 if case == "AB" else 30.0
        for axes, row in zip(line, mine, strict=False):
            values = np.array(row["density"]).T
            extent = (0.0, given.side, 0.0, given.side)
            norm = LogNorm(0.1, top)
            image = axes.imshow(np.maximum(values, 0.1), origin="lower", extent=extent, norm=norm, cmap="magma")
            axes.set(title=f"{case}, {row['cells']} x {row['cells']} cells", xlabel="radius [eta r]")
        for axes in line[len(mine) :]:
            axes.set_axis_off()
        line[0].set_ylabel("height [eta r]")
        figure.colorbar(image, ax=line, label="dust density over its mean", shrink=0.9)
    figure.savefig(file, dpi=110)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    studies = parser.add_subparsers(dest="study", required=True, metavar="growth|clumps")
    growth, clumps = studies.add_parser("growth"), studies.add_parser("clumps")
    growth.add_argument("--cases", type=some_of(WAVES, "case"), default=list(WAVES))
    growth.add_argument("--schemes", type=some_of(SCHEMES, "scheme"), default=list(SCHEMES))
    growth.add_argument("--cells", type=whole_numbers(4), default=[8, 16, 32], help="in a wavelength")
    growth.add_argument("--folds", type=float, default=FOLDS, help=f"growth times in a run (default {FOLDS:g})")
    clumps.add_argument("--cases", type=some_of(CLUMPS, "case"), default=list(CLUMPS))
    clumps.add_argument("--cells", type=whole_numbers(8), default=[48, 64], help="along each side of the box")
    for command in (growth, clumps):
        command.add_argument("-o", "--out", type=Path, default=Path("streaming"))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    with Progress(console=Console(stderr=True)) as progress:
        for case in given.cases:
            for cells in given.cells:
                if given.study == "clumps":
                    run = partial(clumps_run, case, cells)
                    make(given.out / f"clumps-{case}-{cells}.json", run, progress)
                    continue
                for scheme in given.schemes:
                    run = partial(wave_run, case, scheme, cells, given.folds)
                    make(given.out / f"growth-{case}-{scheme}-{cells}-{given.folds:g}.json", run, progress)
    known, columns, draw = (WAVES, GROWTH, draw_growth) if given.study == "growth" else (CLUMPS, CLUMPING, draw_clumps)
    rows = [json.loads(file.read_text()) for file in given.out.glob(f"{given.study}-*.json")]
    schemes = list(SCHEMES)
    rows.sort(key=lambda row: (list(known).index(row["case"]), schemes.index(row.get("scheme", "tsc")), row["cells"]))
    write_csv(rows, columns, given.out / f"{given.study}.csv")
    draw(rows, given.out / f"{given.study}.png")
    table = Table(*columns)
    for row in rows:
        table.add_row(*(f"{v:.4g}" if isinstance(v := row[name], float) else str(v) for name in columns))
    Console(width=170).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
