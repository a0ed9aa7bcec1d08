"""What accuracy costs in time: the studies behind the figures, each made as `discsim cost` makes one.

    python analysis/cost_of_accuracy.py [-o OUT] [--studies wave,shock,oblique,sheet,courant,drift]

    wave     DustyWaves, eps = 1, K = .5, 500 and 5000: every scheme against the number of particles, or of cells
    shock    DustyShock, K = 500, the same, and K = 5e5 but for the explicit ones. The error is that of the width of
             the fronts, so of order 1/2, against the limit of strong drag: at K = 500 what is below .03 is in part
             the limit's own
    oblique  a DustyWave across a square, K = 500: the explicit `mk` against the default
    sheet    growth of a Jeans-unstable sheet over five growth times, against particles and cells
    courant  change of angular momentum and energy of a disc over three orbits, against the Courant factor: of gas
             alone, with dust and drag, and with self-gravity too
    drift    drift of dust past gas over that of Nakagawa et al., against particles per drag cell with the pressure
             given, and against the SPH kernel with the gas's own (drift_cost.py)

A study in OUT that is there already is not made again; each leaves its figure in OUT. For waves and shock it prints
what schemes pay in particle updates for an error of 1%, and how many times what `tsc` pays; of those out of reach it is
fitted to the last two runs. The study of SPH noise against kernel and neighbours is `analysis/noise.py`: noise of the
gas against CPU time. Drift at full size, over orbits and seeds, is `analysis/drift.py`. All take twenty minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Any

import drift_cost
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from script_helpers import BLUE, FROM_AFAR, GREEN, PURPLE, RED, name_ends, some_of

from discsim import load_scene
from discsim.study.cost import Study
from discsim.study.findings import cost_of_error
from discsim.study.points import Varied

STUDIES = ("wave", "shock", "oblique", "sheet", "courant", "drift")
GOAL = 0.01
IMPLICIT = "lab14,reconstructed,isph,idic,idic-linear,tsc"
EXPLICIT = "mk,esph"
ON_GRID = "emsi-ppm,sios-ppm"
SCHEMES = f"{IMPLICIT},{EXPLICIT},{ON_GRID}".split(",")
WAVE_K, SHOCK_K, STIFF = (0.5, 500.0, 5000.0), (500.0, 5e5), 5000.0  # explicit schemes up to STIFF
WAVES, FINER_WAVES, SHOCKS = (24, 48, 96, 192, 384, 768), (192, 384, 768, 1536), (100, 200, 400, 800)  # particles
SQUARES, FINER_SQUARES = (8, 16, 32, 64), (16, 32, 64)  # a side
CELLS, SHEETS = (16, 32, 64, 128, 256), (400, 900, 1024, 3600)
COURANTS, DISC, ORBITS = (0.075, 0.15, 0.3, 0.6), 6000, 3
# The default scheme and its closest rival stand out; other schemes have the look of their kind.
LOOKS = {scheme: {"color": "0.45", "ls": "-", "lw": 2.0} for scheme in IMPLICIT.split(",")}
LOOKS |= {scheme: {"color": GREEN, "ls": "--", "lw": 2.0} for scheme in ON_GRID.split(",")}
LOOKS |= {scheme: {"color": PURPLE, "ls": "-.", "lw": 2.5} for scheme in EXPLICIT.split(",")}
LOOKS |= {"tsc": {"color": BLUE, "ls": "-", "lw": 5.0}, "idic-linear": {"color": RED, "ls": "-", "lw": 4.0}}
ROUNDING = 1e-16  # what is exact is drawn there
ROOT = Path(__file__).parents[1]


def wave(coefficient: float, dimensions: int = 1) -> dict[str, Any]:
    """A wave so weak that its own steepening is below any error here; at 1e-4 that is 1e-4."""
    oblique = {"direction": [1, 1]} if dimensions == 2 else {}
    kernel = "quintic" if oblique else "cubic"
    return {
        "title": f"DustyWave, K = {coefficient:g}" + (", across a square" if oblique else ""),
        "units": {"system": "code"},
        "run": {"until": 0.5 if dimensions == 1 else 0.1},
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "wave", "amplitude": 1e-6, **oblique},
        "gas": {"particles": 100, "kernel": kernel, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": 100, "ratio": 1.0},
        "drag": {"law": "constant", "K": coefficient},
    }


def shock(coefficient: float) -> dict[str, Any]:
    return {
        "title": f"DustyShock, K = {coefficient:g}",
        "units": {"system": "code"},
        "run": {"until": 0.2},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "open"},
        "initial": {"kind": "shock"},
        "gas": {"particles": 100, "eos": {"kind": "adiabatic", "gamma": 1.4}, "viscosity": {}},
        "dust": {"particles": 100, "ratio": 1.0},
        "drag": {"law": "constant", "K": coefficient, "heating": False},
    }


def on_grid(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene for schemes on a fixed grid: without what is SPH's."""
    own = ("kernel", "viscosity")
    return scene | {"gas": {key: value for key, value in scene["gas"].items() if key not in own}}


def disc(members: str) -> dict[str, Any]:
    """A disc of gas, and of what else `members` names, about a softened star, so that nothing leaves it."""
    scene = {
        "title": f"A disc of {members}, {ORBITS} orbits at its middle",
        "units": {"system": "code"},
        "run": {"until": 2.0 * pi * 2.0**1.5 * ORBITS},
        "space": {"size": 10.0, "cells": 128},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 3.0, "inner_taper": 0.3, "outer_taper": 0.3},
        "gas": {
            "particles": DISC,
            "eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.05},
            "viscosity": {"alpha": 0.3, "beta": 0.5},  # heat swells the disc, and there is no cooling
        },
        "star": {"mass": 1.0, "softening": 0.3},
    }
    if "dust" in members:
        drag = {"law": "stokes-number", "stokes": 0.1}
        scene |= {"dust": {"particles": DISC, "ratio": 0.1}, "drag": drag}
    if "gravity" in members:
        scene["self_gravity"] = {"softening": 0.1}
    return scene


def made(scene: dict[str, Any] | Path, vary: list[str], folder: Path) -> Study:
    """The study in `folder`, as `discsim cost` makes it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = scene
    if isinstance(scene, dict):
        path = folder / "scene.toml"
        path.write_text(load_scene(scene).text)
    study = Study(Path(path), [Varied.from_text(text) for text in vary], 1, folder)
    study.make(str(scene.get("title")) if isinstance(scene, dict) else str(scene), 1)
    return study


def particles(*counts: int) -> str:
    """Numbers of both species, and h of six spacings.

    With one h for all, as in the papers, the gas's own error is of fourth order in kh, and what is left is the drag's.
    """
    return "gas.particles,dust.particles,gas.smoothing_length=" + ",".join(f"{n}:{n}:{6.0 / n:.6g}" for n in counts)


def cells(*counts: int) -> str:
    """Numbers of cells of both fluids on a fixed grid."""
    return "gas.particles,dust.particles=" + ",".join(map(str, counts))


def squares(*sides: int) -> str:
    """The same of n x n particles, and h of 1.4 spacings."""
    values = ",".join(f"{n * n}:{n * n}:{1.4 / n:.6g}" for n in sides)
    return f"gas.particles,dust.particles,gas.smoothing_length={values}"


def wave_studies(k: float, out: Path) -> list[Study]:
    finer = FINER_WAVES if k < STIFF else FINER_WAVES[:2]
    return [
        made(wave(k), [f"drag.scheme={IMPLICIT}", particles(*WAVES)], out / f"wave-{k:g}"),
        made(wave(k), [f"drag.scheme={EXPLICIT}", particles(*finer)], out / f"wave-{k:g}-explicit"),
        made(on_grid(wave(k)), [f"drag.scheme={ON_GRID}", cells(*WAVES)], out / f"wave-{k:g}-grid"),
    ]


def shock_studies(k: float, out: Path) -> list[Study]:
    schemes = IMPLICIT if k > STIFF else f"{IMPLICIT},{EXPLICIT}"
    return [
        made(shock(k), [f"drag.scheme={schemes}", particles(*SHOCKS)], out / f"shock-{k:g}"),
        made(on_grid(shock(k)), [f"drag.scheme={ON_GRID}", cells(*SHOCKS)], out / f"shock-{k:g}-grid"),
    ]


def oblique_studies(k: float, out: Path) -> list[Study]:
    return [
        made(wave(k, 2), ["drag.scheme=tsc,idic-linear", squares(*SQUARES)], out / "oblique"),
        made(wave(k, 2), ["drag.scheme=mk", squares(*FINER_SQUARES)], out / "oblique-explicit"),
    ]


def sheet_study(out: Path) -> Study:
    vary = [f"space.cells={','.join(map(str, CELLS))}", f"gas.particles={','.join(map(str, SHEETS))}"]
    return made(ROOT / "setups" / "sheet.toml", vary, out / "sheet")


def courant_studies(out: Path) -> dict[str, Study]:
    vary = [f"run.courant={','.join(map(str, COURANTS))}"]
    return {
        members: made(disc(members), vary, out / f"courant-{members.replace(', ', '-').replace(' and ', '-')}")
        for members in ("gas", "gas, dust and drag", "gas, dust, drag and self-gravity")
    }


def draw_lines(problems: dict[str, list[Study]], message: str, path: Path) -> None:
    """Error against CPU seconds, a panel a problem and a line a scheme, with its name at the end."""
    with rc_context(FROM_AFAR):
        wide = 5.0 * len(problems) + 1.0
        figure = Figure(figsize=(wide, 6.0))
        FigureCanvasAgg(figure)
        panels = figure.subplots(1, len(problems), sharey=True, squeeze=False)[0]
        figure.subplots_adjust(1.1 / wide, 0.14, 1.0 - 1.65 / wide, 0.83, wspace=0.6)
        ends = []
        for axes, (title, studies) in zip(panels, problems.items(), strict=True):
            ends.append([])
            for points in (points for study in studies for points in study.lines().values()):
                cpu, errors = [point.cpu for point in points], [point.error or 0.0 for point in points]
                scheme = points[0].settings["drag.scheme"]
                axes.plot(cpu, errors, **LOOKS[scheme])
                ends[-1].append((scheme, cpu[-1], errors[-1], LOOKS[scheme]["color"]))
            axes.set(xscale="log", yscale="log", xlabel="CPU time [s]", title=title)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(numticks=5))
                axis.set_minor_locator(NullLocator())
            axes.grid(alpha=0.3)
        for axes, each in zip(panels, ends, strict=True):  # once the limits are those of all panels
            name_ends(axes, each)
        panels[0].set_ylabel("error of the velocities")
        figure.suptitle(message, x=0.02, ha="left", weight="bold")
        figure.savefig(path, dpi=95)


def show_prices(studies: dict[str, list[Study]], console: Console) -> None:
    """Updates for an error of GOAL by line, over those of tsc."""
    table = Table("problem", "scheme", f"updates to {GOAL:.0%}", "over tsc's", box=SIMPLE)
    for name, parts in studies.items():
        lines = {points[0].settings["drag.scheme"]: points for study in parts for points in study.lines().values()}
        best = cost_of_error(lines["tsc"], GOAL, updates)
        for scheme, points in lines.items():
            paid = cost_of_error(points, GOAL, updates)
            if paid is None or best is None:
                table.add_row(name, scheme, "never", "")
            else:
                fitted = "~" if paid[1] else ""
                table.add_row(name, scheme, f"{fitted}{paid[0]:.2g}", f"{fitted}{paid[0] / best[0]:.3g}")
    console.print(table)


def updates(point: Any) -> float:
    return float(point.runs[0]["updates"])


def draw_conservation(studies: dict[str, Study], path: Path) -> None:
    """Changes over three orbits against CPU seconds, the Courant factor at each point."""
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, name in zip(figure.subplots(1, 2), ("energy", "angular_momentum"), strict=True):
        for title, study in studies.items():
            changes = [max(point.runs[0]["drifts"][name], ROUNDING) for point in study.points]
            axes.plot([point.cpu for point in study.points], changes, "o-", label=title)
            for point, change in zip(study.points, changes, strict=True):
                at = (point.cpu, change)
                axes.annotate(point.settings["run.courant"], at, (4, 4), textcoords="offset points", fontsize=7)
        axes.set(yscale="log", xlabel="CPU time of the steps [s]")
        axes.set_ylabel(f"change of {name.replace('_', ' ')} over {ORBITS} orbits")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def show_conservation(studies: dict[str, Study], console: Console) -> None:
    table = Table("disc of", "Courant factor", "CPU s", "steps", "energy", "angular momentum", box=SIMPLE)
    for title, study in studies.items():
        for point in study.points:
            run = point.runs[0]
            changes = (f"{run['drifts'][name]:.1e}" for name in ("energy", "angular_momentum"))
            table.add_row(title, point.settings["run.courant"], f"{point.cpu:.3g}", str(run["steps"]), *changes)
    console.print(table)


def draw_sheet(study: Study, path: Path) -> None:
    """The error against what the cells are and what they cost, a line a number of particles."""
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, sharey=True)
    for label, points in study.lines().items():
        errors = [point.error for point in points]
        left.plot([int(point.settings["space.cells"]) for point in points], errors, "o-", ms=4, label=label)
        right.plot([point.cpu for point in points], errors, "o-", ms=4)
    left.set(xscale="log", yscale="log", xlabel="cells a side", ylabel="error of the amplitude, grown by 74")
    left.set_xticks(CELLS, labels=map(str, CELLS), minor=False)
    left.set_xticks([], minor=True)
    right.set(xscale="log", xlabel="CPU time of the steps [s]")
    right.xaxis.set_minor_formatter(NullFormatter())
    left.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("cost"))
    parser.add_argument("--studies", type=some_of(STUDIES, "study"), default=",".join(STUDIES))
    options = parser.parse_args(arguments)
    out, wanted = options.output, options.studies
    console = Console()
    prices: dict[str, list[Study]] = {}
    if "wave" in wanted:
        waves = {f"wave, K = {k:g}": wave_studies(k, out) for k in WAVE_K}
        prices |= waves
        draw_lines(waves, "Waves: tsc and idic-linear cost least at any strength of drag", out / "cost_wave.png")
    if "shock" in wanted:
        shocks = {f"shock, K = {k:g}": shock_studies(k, out) for k in SHOCK_K}
        prices |= shocks
        draw_lines(shocks, "Shocks: of the particle schemes tsc has the smallest error", out / "cost_shock.png")
    if "oblique" in wanted:
        oblique = {"oblique, K = 500": oblique_studies(500.0, out)}
        prices |= oblique
        draw_lines(oblique, "tsc needs a tiny part of the time of mk", out / "cost_oblique.png")
    if "sheet" in wanted:
        draw_sheet(sheet_study(out), out / "cost_sheet.png")
    if "courant" in wanted:
        kept = courant_studies(out)
        show_conservation(kept, console)
        draw_conservation(kept, out / "cost_courant.png")
    if "drift" in wanted:
        drift_cost.make(out / "drift", console)
    if prices:
        show_prices(prices, console)
    return 0


if __name__ == "__main__":
    sys.exit(main())
