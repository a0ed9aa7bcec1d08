"""Discs with one-way and two-way drag with both methods of the gas: profiles, radii of the dust, errors and CPU time.

    python analysis/methods.py [-o OUT] [--setups NAME,...] [--levels N]

The setups are ring_oneway, ring_twoway, twin_oneway and twin_twoway. Lines of a setup:

    SPH, idic      SPH gas, drag of the scheme `idic`: cells with one velocity
    SPH, tsc       SPH gas, drag of the scheme `tsc`, the default
    grid, emsi     gas on a polar grid with open edges (15 and 120 au) or, in the rings, closed edges with zones that
                   hold the surface density; drag of the scheme `emsi`

Each line has four resolutions: an eighth, a quarter, a half and all of the particles of the setup. A grid has 0.4 times
as many cells, and as many grains as SPH has. The error is the fraction of the mass at wrong radii, as in
`discsim cost`: in another of 24 rings than in the reference, the mean of the finest runs of the lines "SPH, tsc" and
"grid, emsi". Half of the difference between these two is the smallest error that can be measured. r10, r50 and r90
contain these parts of the dust. CPU time is that of the steps, without compilation.

Prints a table, and writes methods.csv, methods.md and methods.png. Runs are stored in OUT/methods.jsonl, and are not
repeated if they are there.
"""

from __future__ import annotations

import argparse
import json
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from script_helpers import BLUE, GREEN, RED, some_of, warm_up, write_csv

from discsim import Simulation, load_scene
from discsim.output.drawing import set_log_ticks
from discsim.scene import Scene
from discsim.shipped import setup as shipped
from discsim.study.errors import RINGS, binned_masses, profile_errors
from discsim.study.outcomes import quantile_radii

LINES = {
    "SPH, idic": ("sph", "idic", RED),
    "SPH, tsc": ("sph", "tsc", GREEN),
    "grid, emsi": ("grid", "emsi", BLUE),
}
FINEST = ("SPH, tsc", "grid, emsi")  # lines whose finest runs are the reference
SETUPS = ("ring_oneway", "ring_twoway", "twin_oneway", "twin_twoway")
PARTS = (8, 4, 2, 1)  # particles of a setup over those of a run
CELLS = 0.4  # cells of a grid over particles of SPH gas
COLUMNS = ("setup", "line", "gas", "grains", "cpu", "error of dust", "error of gas", "r10", "r50", "r90")


def scene_of(setup: str, line: str, part: int) -> Scene:
    """Return the scene of a setup with the method and the scheme of a line, and 1 / `part` of its particles."""
    tables = tomllib.loads(shipped(setup).path.read_text())
    method, scheme, _ = LINES[line]
    gas, number = tables["gas"], tables["gas"]["particles"] // part
    tables["drag"]["scheme"], tables["dust"]["particles"] = scheme, number
    tables["run"] = {"until": tables["run"]["until"]}
    if method == "sph":
        gas["particles"] = number
        return load_scene(tables)
    grid: dict[str, Any] = {"inner": "15 au", "outer": "120 au"}
    if "damping" in tables:
        grid = {"edges": "closed"}
        tables["damping"] |= {"surface_density": True, "time": 0.02}
    tables["drag"].pop("cell", None)  # the drag cells of `emsi` are the cells of the gas
    tables["gas"] = {"method": "grid", "particles": round(CELLS * number), "grid": grid, "eos": gas["eos"]}
    return load_scene(tables)


def measured(setup: str, line: str, part: int) -> dict[str, Any]:
    """Make a run, and return its numbers of elements, CPU time, radii of the dust and masses in rings."""
    scene = scene_of(setup, line, part)
    warm_up(Simulation(scene))
    sim = Simulation(scene)
    begun = time.process_time()
    sim.run()
    cpu = time.process_time() - begun
    with sim.synchronised():
        dust = sim.dust
        radii = quantile_radii(np.hypot(*dust.pos.T), dust.mass)
        found = {"gas": sim.gas.count, "grains": dust.count, "cpu": cpu, "masses": binned_masses(sim)}
    half = 0.5 * min(scene.space.size)
    return (
        {"setup": setup, "line": line, "part": part, "half": half}
        | found
        | dict(zip(("r10", "r50", "r90"), radii, strict=True))
    )


def all_runs(setups: Sequence[str], parts: Sequence[int], store: Path, say: Console) -> list[dict[str, Any]]:
    """Return the runs of the setups, those that are not in the file `store` after making them."""
    runs = [json.loads(line) for line in store.read_text().splitlines()] if store.exists() else []
    done = {(run["setup"], run["line"], run["part"]): run for run in runs}
    for part in parts:
        for setup in setups:
            for line in LINES:
                if (setup, line, part) not in done:
                    run = done[setup, line, part] = measured(setup, line, part)
                    with store.open("a") as stream:
                        stream.write(json.dumps(run) + "\n")
                    say.print(f"{setup}, {line}: {run['gas']} in the gas, {run['cpu']:.0f} s, r50 = {run['r50']:.3f}")
    return [done[setup, line, part] for setup in setups for line in LINES for part in parts]


def reference(runs: Sequence[dict[str, Any]], setup: str) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Return the masses in rings of the reference of a setup, and half of the difference of its two runs."""
    ends = [
        min((run for run in runs if (run["setup"], run["line"]) == (setup, line)), key=lambda run: run["part"])
        for line in FINEST
    ]
    masses = [run["masses"] for run in ends]
    mean = {kind: [0.5 * (a + b) for a, b in zip(masses[0][kind], masses[1][kind], strict=True)] for kind in masses[0]}
    return mean, profile_errors(masses[0], mean)


def add_errors(runs: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Add the errors of gas and dust to the runs; return half of the difference of the finest runs by setup."""
    floors = {}
    for setup in dict.fromkeys(run["setup"] for run in runs):
        mean, floors[setup] = reference(runs, setup)
        for run in runs:
            if run["setup"] == setup:
                found = profile_errors(run["masses"], mean)
                run.update({f"error of {kind}": found[kind] for kind in ("dust", "gas")})
    return floors


def draw_setup(panels: Sequence[Axes], runs: Sequence[dict[str, Any]], floor: dict[str, float]) -> None:
    """Draw surface densities of the finest runs of a setup, and errors of dust and gas against CPU time."""
    for line, (_, _, colour) in LINES.items():
        of_line = [run for run in runs if run["line"] == line]
        finest = min(of_line, key=lambda run: run["part"])
        edges = np.linspace(0.0, finest["half"], RINGS + 1)
        for axes, kind in zip(panels, ("gas", "dust"), strict=False):
            axes.stairs(finest["masses"][kind] / (np.pi * np.diff(edges**2)), edges, color=colour, label=line)
        for axes, kind in zip(panels[2:], ("gas", "dust"), strict=True):
            errors = [run[f"error of {kind}"] for run in of_line]
            axes.loglog([run["cpu"] for run in of_line], errors, "o-", color=colour)
    for axes, kind in zip(panels, ("gas", "dust"), strict=False):
        axes.set(ylabel=rf"$\Sigma_{{\rm {kind}}}$", xlabel="r")
    for axes, kind in zip(panels[2:], ("gas", "dust"), strict=True):
        axes.axhline(floor[kind], color="0.6", ls=":")
        axes.set(ylabel=f"{kind} at wrong radii", xlabel="CPU time [s]")
        for axis in (axes.xaxis, axes.yaxis):
            set_log_ticks(axis, *axis.get_view_interval(), most=4)
        axes.grid(alpha=0.3)


def draw(runs: Sequence[dict[str, Any]], floors: dict[str, dict[str, float]], file: Path) -> None:
    """Draw a column of panels for each setup."""
    figure = Figure(figsize=(3.1 * len(floors) + 0.4, 9.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(4, len(floors), squeeze=False)
    for column, (setup, floor) in enumerate(floors.items()):
        draw_setup(panels[:, column], [run for run in runs if run["setup"] == setup], floor)
        panels[0, column].set_title(setup)
    panels[0, 0].legend(frameon=False, fontsize="small")
    figure.savefig(file, dpi=110)


def texts(run: dict[str, Any]) -> list[str]:
    """Return a run as texts, in the order of COLUMNS."""
    errors = {name: f"{100.0 * run[name]:.2g}%" for name in ("error of dust", "error of gas")}
    radii = {name: f"{run[name]:.4g}" for name in ("r10", "r50", "r90")}
    shown = run | errors | radii | {"cpu": f"{run['cpu']:.2g}"}
    return [str(shown[name]) for name in COLUMNS]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    parser.add_argument("--setups", type=some_of(SETUPS, "setup"), default=",".join(SETUPS))
    parser.add_argument("--levels", type=int, choices=(1, 2, 3, 4), default=4, help="resolutions, from the lowest")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    console = Console(width=120)
    runs = all_runs(options.setups, PARTS[: options.levels], options.output / "methods.jsonl", console)
    floors = add_errors(runs)
    write_csv(runs, COLUMNS, options.output / "methods.csv")
    lines = [" | ".join(COLUMNS), " | ".join("-" for _ in COLUMNS), *(" | ".join(texts(run)) for run in runs)]
    (options.output / "methods.md").write_text("".join(f"| {line} |\n" for line in lines))
    draw(runs, floors, options.output / "methods.png")
    table = Table(*COLUMNS)
    for run in runs:
        table.add_row(*texts(run))
    console.print(table)
    for setup, floor in floors.items():
        console.print(f"{setup}: smallest error that can be measured: dust {floor['dust']:.2%}, gas {floor['gas']:.2%}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
