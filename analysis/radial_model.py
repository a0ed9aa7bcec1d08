"""Gas and dust of a disc in radius alone, beside the runs of it.

    python analysis/radial_model.py DIR [DIR ...] [-o OUT] [--within R,...] [--smooth W] [--cells N]

    d(r Sigma)/dt + d(r Sigma v)/dr = 0  of gas and of dust                                          (1)
    v_gas  = [(1 + eps + St^2) v_nu + 2 eps St eta v_K] / N,   N = (1 + eps)^2 + St^2                (2)
    v_dust = [(1 + eps) v_nu - 2 St eta v_K] / N                                                     (3)

with eps = Sigma_dust / Sigma_gas (0 where drag is one-way), v_nu the flow that viscosity alone drives, and eta v_K the
headwind of the pressure (Nakagawa et al. 1986, with viscosity Kanagawa et al. 2017, ApJ 844, 142): right to H / r.
Cells are even in radius, between the edges of the start; gas enters and leaves by the flow of the start, dust leaves.
Fluxes are upwind with van Leer's limiter, of second order in the middle of a profile and of first at its edges.

The model is of the scene of each DIR (one population, a start with a profile, gas of a given temperature); it prints of
both, in the middle and at the end, the radii of a tenth, a half and nine tenths of the dust that is left, the share of
all within some radii (`--within`), with what the star has taken, and the peak of Sigma_dust smoothed by a Gaussian of
standard deviation W (`--smooth`), and draws the smoothed profiles (radial_model.png). Lengths are in code units.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from oneway_twoway import InputError, quantile_radii, snapshots
from rich.console import Console
from rich.table import Table

from discsim import SceneError, load_scene
from discsim.exact import nsh
from discsim.output.results import OptionError, length_in_code, positive_text, positive_texts
from discsim.output.snapshot import SnapshotError
from discsim.physics import profile, viscosity
from discsim.physics.centre import kepler_omega
from discsim.physics.laws import SceneLaw
from discsim.scene import Scene
from discsim.study.outcomes import smoothed

Array = np.ndarray
CELLS, COURANT, DIFFUSION = 260, 0.4, 0.2  # cells; shares of a cell that is crossed and of dr^2 / (3 nu) in a step
LEAST = 1e-8  # of the gas's surface density at the start, in cells that it has left


class Model:
    """The disc of `scene` at `time`: `edges` (cells + 1,), `gas` and `dust` (cells,) surface densities in code units,
    `taken` the mass of dust that has left over the inner edge.
    """

    def __init__(self, scene: Scene, cells: int = CELLS) -> None:
        disc, dust = profile.radial(scene), scene.dust[0]
        self.scene, self.law, self.two_way = scene, SceneLaw(scene), scene.drag.direction == "two-way"
        self.edges = np.linspace(disc.inner, disc.outer, cells + 1)
        self.radius = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.area = np.pi * np.diff(self.edges**2)
        self.gas = disc.surface_density(self.radius)
        low, high = (
            value if value is not None else end for value, end in ((dust.inner, disc.inner), (dust.outer, disc.outer))
        )
        inside = np.clip((np.minimum(self.edges[1:], high) - np.maximum(self.edges[:-1], low)), 0.0, None)
        self.dust = dust.ratio * self.gas * inside / np.diff(self.edges)
        self.least = LEAST * self.gas.max()
        ends = self.edges[[0, -1]]
        inflow: Any = disc.inflow
        self.flow = inflow(ends) if inflow else viscosity.radial_flow(scene, ends, disc.surface_density)
        self.fed = disc.surface_density(ends[1:])[0]
        self.flow[0] *= disc.surface_density(ends[:1])[0] / self.gas[0]  # of the gas in the middle of the first cell
        self.time, self.taken = 0.0, 0.0
        faces = self.edges[1:-1]
        self.omega = kepler_omega(scene, faces)
        self.sound = profile.sound_speed(scene, faces, np.ones_like(faces))
        self.temperature = profile.sound_speed(scene, self.radius, self.gas) ** 2
        self.nu = viscosity.diffusivity(scene, self.radius)

    def velocities(self) -> tuple[Array, Array]:
        """Radial velocities of gas and dust at the faces between cells."""
        faces, apart = self.edges[1:-1], np.diff(self.radius)
        sigma = np.sqrt(self.gas[1:] * self.gas[:-1])
        pull = -np.diff(self.gas * self.temperature) / (apart * sigma)
        torque = self.nu * self.gas * np.sqrt(self.radius)
        viscous = -3.0 * np.diff(torque) / (apart * sigma * np.sqrt(faces))
        ratio = 0.5 * (self.dust[1:] + self.dust[:-1]) / sigma
        time = self.law.stopping_time(0, sigma, self.sound, self.omega, self.scene.dust[0].ratio)
        stokes, eps = time * self.omega, ratio if self.two_way else np.zeros_like(ratio)
        drift = nsh.velocities(stokes, eps, 0.5 * pull / self.omega)
        slower = viscous / ((1.0 + eps) ** 2 + stokes**2)
        return drift.gas_radial + (1.0 + eps + stokes**2) * slower, drift.dust_radial + (1.0 + eps) * slower  # (2), (3)

    def advance(self, until: float) -> None:
        """On to the time `until`."""
        side = self.edges[1] - self.edges[0]
        calm = DIFFUSION * side**2 / (3.0 * self.nu.max())
        while self.time < until * (1.0 - 1e-12):
            gas, dust = self.velocities()
            fastest = max(np.abs(gas).max(), np.abs(dust).max(), 1e-300)
            dt = min(COURANT * side / fastest, calm, until - self.time)
            ends = np.array([self.gas[0], self.fed if self.flow[1] < 0.0 else self.gas[-1]])
            left = self._move("gas", gas, ends * self.flow, dt)
            ends = np.array([self.dust[0] * min(dust[0], 0.0), self.dust[-1] * max(dust[-1], 0.0)])
            left = self._move("dust", dust, ends, dt)
            self.gas = np.maximum(self.gas, self.least)
            self.taken += left
            self.time += dt

    def _move(self, name: str, speed: Array, ends: Array, dt: float) -> float:
        """Eq. (1) over dt, with Sigma v of both ends; returns the mass that has left over the inner one."""
        sigma = getattr(self, name)
        rise = np.diff(sigma)
        product = rise[1:] * rise[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.pad(np.where(product > 0.0, product / (rise[1:] + rise[:-1]), 0.0), 1)  # half of van Leer's
        upwind = np.where(speed > 0.0, (sigma + slope)[:-1], (sigma - slope)[1:])
        flux = 2.0 * np.pi * self.edges * np.concatenate([ends[:1], upwind * speed, ends[1:]])
        setattr(self, name, sigma - dt * np.diff(flux) / self.area)
        return float(-flux[0] * dt)


def row(
    edges: Array, sigma: Array, radius: Array, mass: Array, taken: float, radii: Array, width: float
) -> list[float]:
    """r10, r50, r90, shares within `radii`, and the place of the peak."""
    all_of_it = taken + mass.sum()
    within = [(taken + mass[radius < r].sum()) / all_of_it for r in radii]
    return [*quantile_radii(radius, mass), *within, peak_radius(edges, sigma, width)]


def peak_radius(edges: Array, sigma: Array, width: float) -> float:
    """Radius of the largest surface density, smoothed by a Gaussian of this standard deviation."""
    k = int(smoothed(sigma, width / (edges[1] - edges[0])).argmax())
    return float(0.5 * (edges[k] + edges[k + 1]))


def compare(directories: list[Path], out: Path, radii: list[float], width: float, cells: int) -> Table:
    """Write the figure of the runs and their models; returns the table. Raises InputError."""
    table = Table("", "time", "r10", "r50", "r90", *(f"within {r:.3g}" for r in radii), "peak at")
    figure = Figure(figsize=(5 * len(directories), 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(directories), sharey=True, squeeze=False)[0]
    for directory, ax in zip(directories, panels, strict=True):
        run, scene = snapshots(directory), load_scene(directory / "scene.toml")
        if not scene.drag or scene.initial.kind not in ("steady", "disc") or len(scene.dust) != 1:
            raise InputError(
                f'{directory}: no model of this; expected a "disc" or "steady" start with drag and one population'
            )
        model, start = Model(scene, cells), run[0].dust.mass.sum()
        for number, snap in enumerate((run[len(run) // 2], run[-1])):
            model.advance(snap.time)
            dust, edges = snap.dust, model.edges
            sigma, taken = dust.radial_profile(edges), max(0.0, start - dust.mass.sum())
            # Masses of a cell lie at its middle.
            of_model = row(
                edges, model.dust, model.radius, model.dust * model.area, model.taken, np.array(radii), width
            )
            of_run = row(edges, sigma, dust.radius, dust.mass, taken, np.array(radii), width)
            for name, values in ((directory.resolve().name, of_run), ("model", of_model)):
                table.add_row(name, f"{snap.time:.4g}", *(f"{value:.3f}" for value in values))
            rings, color = width / (edges[1] - edges[0]), f"C{number}"
            ax.plot(model.radius, smoothed(sigma, rings), color=color, label=f"t = {snap.time:.4g}")
            ax.plot(model.radius, smoothed(model.dust, rings), color=color, ls="--", label="the model")
        ax.set(xlabel="r", title=directory.resolve().name, xlim=(edges[0], 1.1 * float(run[0].dust.radius.max())))
    panels[0].set_ylabel(r"$\Sigma_d$")
    panels[0].legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "radial_model.png", dpi=110)
    return table


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", metavar="DIR", help="output directories of runs")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path(), metavar="OUT", help="where to write; default: here"
    )
    parser.add_argument(
        "--within", type=positive_texts, default=[], metavar="R,...", help="radii whose shares are shown"
    )
    parser.add_argument(
        "--smooth", type=positive_text, default="0.1", metavar="W", help="standard deviation; default: 0.1"
    )
    parser.add_argument("--cells", type=int, default=CELLS, help=f"of the model; default: {CELLS}")
    given = parser.parse_args(arguments)
    try:
        units = load_scene(given.runs[0] / "scene.toml").units
        within = [length_in_code(text, units, "--within") for text in given.within]
        smooth = length_in_code(given.smooth, units, "--smooth")
        table = compare(given.runs, given.output, within, smooth, given.cells)
    except (InputError, OptionError, SceneError, SnapshotError, OSError) as error:
        print(f"radial_model: {error}", file=sys.stderr)
        return 2
    Console(width=200).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
