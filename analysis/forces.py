"""Self-gravity against exact discs: rms error of the force over the rms force, by number of cells.

    python analysis/forces.py [--cells N,...] [-o OUT]

Four discs of mass on an open grid, off its nodes: an exponential and a Kuzmin disc that end at r = 1 (the rings
beyond are taken off the exact field), a finite Mestel disc of radius 1, and two Maclaurin discs beside each other. The
mass is a golden-angle spiral of 36 particles a cell with the exact mass between radii; the force is that of a run, at
4000 points along the radius of each disc, weighted by area, that are two softenings or more from its edge, and from the
cusp of the Mestel disc.

For each kernel (the thickness H in place of the softening) there are two lengths: .03, where errors fall with the
square of the cell, and two cells. Exact is the field of the kernel: at the height of the softening, or the mean over
the height of a disc with H. Beside it stands the error against the razor-thin disc: what the softening takes away.

Writes forces.csv and forces.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from script_helpers import whole_numbers, write_csv

from discsim import Simulation
from discsim.exact import exponential, kuzmin, maclaurin, mestel, stratified

Array = np.ndarray
SIDE, LENGTH, CELLS_WIDE = 2.6, 0.03, 2
PER_CELL, POINTS = 36, 4000
KERNELS = {"plummer": "softening", "thin-disc": "thickness"}
COLUMNS = ("disc", "kernel", "length", "cells", "length_in_cells", "error", "order", "razor_thin_error")


class Disc(NamedTuple):
    """A disc that ends at `radius`: mass within a radius, and pull at a radius and height."""

    enclosed: Callable[[Array], Array]
    pull: Callable[..., Array]
    radius: float = 1.0
    centre: tuple[float, float] = (0.013, -0.007)
    cusp: bool = False

    def spiral(self, count: int) -> tuple[Array, Array]:
        """Places (count, 2), even in area, and their masses (count,)."""
        edges = self.radius * np.sqrt(np.arange(count + 1) / count)
        radius = self.radius * np.sqrt((np.arange(count) + 0.5) / count)
        places = self.centre + radius[:, None] * _directions(count)
        return places, np.diff(self.enclosed(edges))

    def points(self, length: float) -> Array:
        """Places (n, 2), even in radius, that are two lengths or more from the edge, and from a cusp."""
        radius = self.radius * (np.arange(POINTS) + 0.5) / POINTS
        places = self.centre + radius[:, None] * _directions(POINTS)
        return places[(radius < self.radius - 2 * length) & (radius > 2 * length * self.cusp)]

    def field(self, places: Array, kernel: str, length: float) -> Array:
        """Exact acceleration (n, 2) at `places`; razor-thin with length 0."""
        away = places - self.centre
        radius = np.hypot(*away.T)
        if kernel == "thin-disc" and length:
            pull = stratified.mean_over_height(partial(self.pull, radius), length)
        else:
            pull = self.pull(radius, length)
        return (pull / radius)[:, None] * away


def _directions(count: int) -> Array:
    """Unit vectors (count, 2), each turned from the last by the golden angle."""
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _disc(exact, scale: float, mass: float = 1.0, cut: float | None = None, **place) -> Disc:
    def pull(radius: Array, height: float) -> Array:
        return exact.radial_acceleration(radius, scale, mass, height, **({"cut": cut} if cut else {}))

    return Disc(lambda r: exact.enclosed_mass(r, scale, mass), pull, cut or scale, **place)


DISCS = {
    "exponential": [_disc(exponential, 0.2, cut=1.0)],
    "Mestel": [_disc(mestel, 1.0, cusp=True)],
    "Kuzmin": [_disc(kuzmin, 0.3, cut=1.0)],
    "two Maclaurin": [
        _disc(maclaurin, 0.55, centre=(-0.61, 0.23)),
        _disc(maclaurin, 0.4, mass=0.4, centre=(0.52, -0.48)),
    ],
}


@cache
def points(name: str, length: float) -> Array:
    """Places (n, 2) in a disc, or two, that are two lengths or more from edges."""
    return np.concatenate([disc.points(length) for disc in DISCS[name]])


@cache
def exact_field(name: str, kernel: str, length: float, away: float) -> Array:
    """Field of a disc, or two, at the points that are two lengths `away` from edges."""
    return sum(disc.field(points(name, away), kernel, length) for disc in DISCS[name])


def forces(name: str, cells: int, kernel: str, length: float, per_cell: int = PER_CELL) -> Array:
    """Acceleration (n, 2) at the points of a disc, or two, as a run has it."""
    area = (SIDE / cells) ** 2 / per_cell
    spirals = [disc.spiral(round(np.pi * disc.radius**2 / area)) for disc in DISCS[name]]
    probes = points(name, length)
    pos = np.concatenate([*(places for places, _ in spirals), probes])
    mass = np.concatenate([*(mass for _, mass in spirals), np.full(len(probes), 1e-30)])
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": SIDE, "cells": cells},
        "dust": {"particles": len(pos), "ratio": 1.0},
        "self_gravity": {"kernel": kernel, KERNELS[kernel]: length},
    }
    sim = Simulation(scene, particles={"dust": {"pos": pos, "vel": np.zeros_like(pos), "mass": mass}})
    return sim.acceleration("self_gravity")[1][-len(probes) :]


def rms_error(name: str, kernel: str, length: float, found: Array, razor_thin: bool = False) -> float:
    """rms over the area of `found` minus exact, over the rms of the exact force; against that without a length."""
    exact = exact_field(name, kernel, 0.0 if razor_thin else length, length)
    area = np.concatenate([np.hypot(*(disc.points(length) - disc.centre).T) for disc in DISCS[name]])
    return float(np.sqrt((area @ (found - exact) ** 2).sum() / (area @ exact**2).sum()))


def rows(cells: list[int]) -> Iterator[dict]:
    """Errors by disc, kernel, length and cells; `order` is that against the cells before."""
    for name in DISCS:
        for kernel in KERNELS:
            for label in ("fixed", f"{CELLS_WIDE} cells"):
                before = None
                for count in cells:
                    length = LENGTH if label == "fixed" else CELLS_WIDE * SIDE / count
                    found = forces(name, count, kernel, length)
                    error = rms_error(name, kernel, length, found)
                    order = np.log(before[1] / error) / np.log(count / before[0]) if before else np.nan
                    before = count, error
                    thin = rms_error(name, kernel, length, found, razor_thin=True)
                    in_cells = length * count / SIDE
                    yield dict(zip(COLUMNS, (name, kernel, label, count, in_cells, error, order, thin), strict=True))


def figure_of(found: list[dict]) -> Figure:
    """Left the error at a fixed length, right with a length of two cells and against the razor-thin disc."""
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    styles = {"plummer": "o-", "thin-disc": "s--"}
    for index, name in enumerate(DISCS):
        for kernel, style in styles.items():
            for axes, label in ((left, "fixed"), (right, f"{CELLS_WIDE} cells")):
                mine = [r for r in found if (r["disc"], r["kernel"], r["length"]) == (name, kernel, label)]
                cells = [r["cells"] for r in mine]
                axes.plot(cells, [r["error"] for r in mine], style, color=f"C{index}", label=f"{name}, {kernel}", ms=4)
                if axes is right:
                    axes.plot(cells, [r["razor_thin_error"] for r in mine], style[1:], color=f"C{index}", alpha=0.3)
    cells = np.array(sorted({r["cells"] for r in found}))
    for axes in (left, right):
        axes.axhline(0.01, color="k", lw=0.8, ls=":")
        axes.set(xscale="log", yscale="log", xlabel="cells along a side")
        axes.set_xticks(cells, [str(count) for count in cells], minor=False)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    left.plot(cells, 0.02 * (cells / cells[0]) ** -2.0, color="0.5", lw=3, alpha=0.5, label="second order")
    left.set(ylabel="rms error / rms force", title=f"softening or thickness {LENGTH}")
    right.set(title=f"softening or thickness {CELLS_WIDE} cells; pale: against the razor-thin disc")
    left.legend(frameon=False, fontsize=8, loc="lower left")
    return figure


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = "64,128,256,512,1024"
    parser.add_argument("--cells", type=whole_numbers(32), default=default, help="numbers of cells along a side")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, default=Path("forces"), help="where to write")
    options = parser.parse_args(arguments)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        print(f"{'disc':<14} {'kernel':<10} {'length':<8} {'cells':>5} {'error':>9} {'order':>6} {'razor-thin':>11}")
        found = []
        for row in rows(options.cells):
            found.append(row)
            print(
                f"{row['disc']:<14} {row['kernel']:<10} {row['length']:<8} {row['cells']:>5} {row['error']:>9.2e} "
                f"{row['order']:>6.2f} {row['razor_thin_error']:>11.2e}",
                flush=True,
            )
        write_csv(found, COLUMNS, options.output / "forces.csv")
        figure = figure_of(found)
        FigureCanvasAgg(figure)
        figure.savefig(options.output / "forces.png", dpi=130)
    except OSError as error:
        print(f"forces: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
