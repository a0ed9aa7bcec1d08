"""Where drag schemes are stable and right: DustyWaves of any K and dust-to-gas ratio.

    python analysis/stability_map.py [-o OUT] [--schemes tsc,idic-linear,idic] [--particles 600]

DustyWaves at the resolution of `setups/dusty_wave.toml` (600 particles of each, h = .01 of the box, to t = .5), K from
1e-6 to 1e12, ratios eps from 1e-6 to 1e6, steps that sound alone sets. Colour: the error of the worse species, rms over
particles of velocity minus exact over the largest exact velocity; crosses: no finite end, or more than ten times the
velocity of the start. Lines: the step over the stopping time (of the slip, which both species share). Hatched: the slip
between the species, a small difference of the two velocities, is off by more than a tenth of the largest exact slip; it
does not matter to either species where it is far below the velocities.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from measures import particle_error, run_of
from rich.console import Console
from rich.progress import track
from rich.table import Table
from script_helpers import some_of

from discsim.exact import dustywave
from discsim.parts import SCHEMES
from discsim.run.simulation import PhysicsError

COEFFICIENTS = tuple(10.0 ** np.arange(-6, 13, 2))
RATIOS = tuple(10.0 ** np.arange(-6, 7, 2))
AMPLITUDE, END, H_TIMES_N = 1e-4, 0.5, 6.0


def run(scheme: str, coefficient: float, ratio: float, particles: int) -> dict:
    """Errors of velocity and slip, and the step over the stopping time; the error is infinite where the run blew up."""
    keys = {"ratio": ratio, "amplitude": AMPLITUDE}
    sim = run_of(scheme, "wave", coefficient, H_TIMES_N / particles, (particles, particles), **keys)
    row = {"scheme": scheme, "K": coefficient, "ratio": ratio}
    try:
        sim.run()
    except PhysicsError:
        return row | {"error": np.inf, "slip": np.inf, "stiffness": np.inf}
    rate = coefficient * (1.0 + 1.0 / ratio)
    row["stiffness"] = END / sim.state.step * rate
    if max(np.abs(p.vel).max() for p in sim.state.species.values()) > 10 * AMPLITUDE:
        return row | {"error": np.inf, "slip": np.inf}
    error = max(particle_error(sim, kind) for kind in ("gas", "dust"))
    x, order = sim.dust.pos[:, 0], np.argsort(sim.gas.pos[:, 0])
    gas = np.interp(x, sim.gas.pos[order, 0], sim.gas.vel[order, 0], period=1.0)
    exact = dustywave.solution(x, END, coefficient, ratio, 1.0, AMPLITUDE)
    slip = exact.dust_velocity - exact.gas_velocity
    off = sim.dust.vel[:, 0] - gas - slip
    return row | {"error": error, "slip": float(np.sqrt((off**2).mean()) / np.abs(slip).max())}


def draw(rows: list[dict], schemes: list[str], path: Path) -> None:
    figure = Figure(figsize=(4.6 * len(schemes) + 1.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.atleast_1d(figure.subplots(1, len(schemes), sharey=True))
    image = None
    for axes, scheme in zip(panels, schemes, strict=True):
        found = {(row["K"], row["ratio"]): row for row in rows if row["scheme"] == scheme}

        def field(name: str, found: dict = found) -> np.ndarray:
            return np.array([[found[k, ratio][name] for k in COEFFICIENTS] for ratio in RATIOS])

        error = field("error")
        extent = np.log10(COEFFICIENTS), np.log10(RATIOS)
        image = axes.pcolormesh(*extent, np.minimum(error, 1e3), norm=LogNorm(1e-5, 1.0), cmap="viridis_r")
        bad = np.argwhere(~np.isfinite(error))
        axes.plot(extent[0][bad[:, 1]], extent[1][bad[:, 0]], "rx", ms=10)
        lost = np.argwhere(field("slip") > 0.1)
        for row, column in lost:
            axes.fill_between(
                extent[0][column] + np.array([-1, 1]), *(extent[1][row] + np.array([-1, 1])),
                facecolor="none", edgecolor="white", hatch="///", lw=0.0, alpha=0.6,
            )  # fmt: skip
        lines = axes.contour(*extent, np.log10(field("stiffness")), levels=[0, 3, 6, 9], colors="black", linewidths=0.8)
        axes.clabel(
            lines, fmt=lambda level: f"dt = $10^{{{level:.0f}}}$ t_stop" if level else "dt = t_stop", fontsize=7
        )
        axes.set(title=f"{scheme}: largest error {error.max():.2g}", xlabel="log$_{10}$ K")
    panels[0].set_ylabel("log$_{10}$ eps")
    figure.colorbar(image, ax=panels, label="error of the velocities")
    figure.savefig(path, dpi=140)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("stability"))
    parser.add_argument("--schemes", type=some_of(list(SCHEMES), "scheme"), default="tsc,idic-linear,idic")
    parser.add_argument("--particles", type=int, default=600)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    cases = [(scheme, k, ratio) for scheme in options.schemes for k in COEFFICIENTS for ratio in RATIOS]
    rows = [run(*case, options.particles) for case in track(cases, "waves", console=Console(stderr=True))]
    (options.output / "stability.json").write_text(json.dumps(rows, indent=1) + "\n")
    draw(rows, options.schemes, options.output / "stability.png")
    table = Table("scheme", "blow-ups", "largest error", "at K", "at eps", "above 1%", "slip off by a tenth")
    for scheme in options.schemes:
        mine = [row for row in rows if row["scheme"] == scheme]
        worst = max(mine, key=lambda row: row["error"])
        table.add_row(
            scheme, str(sum(not np.isfinite(row["error"]) for row in mine)), f"{worst['error']:.2g}",
            f"{worst['K']:.0e}", f"{worst['ratio']:.0e}", str(sum(row["error"] > 0.01 for row in mine)),
            f"{sum(row['slip'] > 0.1 for row in mine)} of {len(mine)}",
        )  # fmt: skip
    Console().print(table)
    print(f"figure {options.output / 'stability.png'}", file=sys.stderr)


if __name__ == "__main__":
    main()
