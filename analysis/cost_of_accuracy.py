"""What accuracy costs in time: the studies behind the figures, each made as `discsim cost` makes one.

    python analysis/cost_of_accuracy.py [-o OUT] [--studies wave,shock,oblique,sheet,courant]

    wave     DustyWaves, eps = 1, K = .5, 500 and 5000: every scheme against the number of particles
    shock    DustyShock, K = 500, the same; the error is that of the front's width
    oblique  a DustyWave across a square, K = 500: the explicit `mk` against the default
    sheet    growth of a Jeans-unstable sheet against particles and cells
    courant  angular momentum and energy of a small disc of gas over three orbits, against the Courant factor

A study in OUT that is there already is not made again. For waves and shock it prints what schemes pay in particle
updates for an error of 1%, and how many times what `tsc` pays; of `mk` out of reach it is fitted to its last two runs.
What quieter gas costs is `analysis/noise.py`, what drift costs `analysis/drift.py`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from discsim import load_scene
from discsim.cost import Study, Varied, price

GOAL = 0.01
IMPLICIT = "lab14,reconstructed,isph,idic,idic-linear,tsc"


def wave(coefficient: float, dimensions: int = 1) -> dict[str, Any]:
    oblique = {"direction": [1, 1]} if dimensions == 2 else {}
    kernel = "quintic" if oblique else "cubic"
    return {
        "title": f"DustyWave, K = {coefficient:g}" + (", across a square" if oblique else ""),
        "units": {"system": "code"},
        "run": {"until": 0.5 if dimensions == 1 else 0.1},
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "wave", **oblique},
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


def disc() -> dict[str, Any]:
    return {
        "title": "A disc of gas over three orbits at its middle",
        "units": {"system": "code"},
        "run": {"until": 110.0},
        "space": {"size": 10.0},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 3.0, "inner_taper": 0.3, "outer_taper": 0.3},
        "gas": {"particles": 4000, "eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.1}, "viscosity": {}},
        "star": {"mass": 1.0, "softening": 0.3},  # nothing leaves the disc: its energy is to stay,
    }


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


def squares(*sides: int) -> str:
    """The same of n x n particles, and h of 1.4 spacings."""
    values = ",".join(f"{n * n}:{n * n}:{1.4 / n:.6g}" for n in sides)
    return f"gas.particles,dust.particles,gas.smoothing_length={values}"


def show_prices(studies: dict[str, list[Study]], console: Console) -> None:
    """Updates for an error of GOAL by line, over those of tsc."""
    table = Table("problem", "scheme", f"updates to {GOAL:.0%}", "over tsc's", box=SIMPLE)
    for name, parts in studies.items():
        lines = {scheme: points for study in parts for scheme, points in study.lines().items()}
        best = price(lines["scheme = tsc"], GOAL, updates)
        for scheme, points in lines.items():
            paid = price(points, GOAL, updates)
            if paid is None or best is None:
                table.add_row(name, scheme, "never", "")
            else:
                fitted = "~" if paid[1] else ""
                table.add_row(name, scheme, f"{fitted}{paid[0]:.2g}", f"{fitted}{paid[0] / best[0]:.3g}")
    console.print(table)


def updates(point: Any) -> float:
    return float(point.runs[0]["updates"])


def draw_drifts(study: Study, path: Path) -> None:
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name in ("angular_momentum", "energy"):
        drift = [point.runs[0]["drifts"][name] for point in study.points]
        axes.plot([point.cpu for point in study.points], drift, "o-", label=name.replace("_", " "))
    for point in study.points:
        at = (point.cpu, point.runs[0]["drifts"]["energy"])
        axes.annotate(point.settings["run.courant"], at, (4, 4), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="CPU time of the steps [s]", ylabel="change over three orbits")
    axes.set_title("by the Courant factor", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("cost"))
    parser.add_argument("--studies", default="wave,shock,oblique,sheet,courant")
    options = parser.parse_args()
    out, wanted = options.output, options.studies.split(",")
    console, prices = Console(), {}
    if "wave" in wanted:
        for k in (0.5, 500.0, 5000.0):
            all_of = [f"drag.scheme={IMPLICIT}", particles(24, 48, 96, 192, 384, 768)]
            finer = ["drag.scheme=mk,esph", particles(192, 384, 768, 1536) if k < 5000 else particles(192, 384)]
            prices[f"wave, K = {k:g}"] = [
                made(wave(k), all_of, out / f"wave-{k:g}"), made(wave(k), finer, out / f"wave-{k:g}-explicit"),
            ]  # fmt: skip
    if "shock" in wanted:
        vary = [f"drag.scheme=mk,{IMPLICIT}", particles(100, 200, 400, 800)]
        made(shock(500.0), vary, out / "shock")
    if "oblique" in wanted:
        prices["oblique, K = 500"] = [
            made(wave(500.0, 2), ["drag.scheme=tsc,idic-linear", squares(8, 16, 32, 64)], out / "oblique"),
            made(wave(500.0, 2), ["drag.scheme=mk", squares(16, 32, 64)], out / "oblique-explicit"),
        ]
    if "sheet" in wanted:
        vary = ["space.cells=16,32,64,128", "gas.particles=256,1024,4096"]
        made(Path(__file__).parents[1] / "setups" / "sheet.toml", vary, out / "sheet")
    if "courant" in wanted:
        study = made(disc(), ["run.courant=0.1,0.2,0.4,0.6,0.8"], out / "courant")
        draw_drifts(study, out / "courant" / "drifts.png")
    if prices:
        show_prices(prices, console)


if __name__ == "__main__":
    main()
