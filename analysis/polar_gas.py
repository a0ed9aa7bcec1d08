"""Gas on a polar grid and SPH gas in the same problems: errors, their order, and CPU time.

    python analysis/polar_gas.py [-o OUT] [--problems NAME,...] [--levels N]

    sod         Sod's shock tube: across a ring of the radius 1e4, and SPH along a line; mean error of the density
    isothermal  an isothermal shock tube with a density ratio of 10, in the same way; mean error of the density
    wave        one period of sound: a standing wave (m = 3) between closed edges at 1 and 2, exact with Bessel
                functions, and SPH in a periodic square; mean error of the velocity, over its largest
    sedov       Sedov's blast about (1, 0) and in a square; mean error of the density within 0.45, over that at rest
    gresho      Gresho's vortex about (1, 0) and in a square, at t = 1; mean error of the velocity about its centre
    gravity     gravity of a disc of gas on itself; rms error over the largest acceleration
    stable      axisymmetric waves in a self-gravitating disc that rotates as a solid body, omega^2 = 0.7 kappa^2; rms
    unstable    error of their velocity over its rms; and in a disc where they grow, omega^2 = -0.4 kappa^2

Keys have their defaults; SPH has those of the setups `sedov` and `gresho` for blast and vortex. A problem has three
resolutions: `n` cells or particles in a length of 1, or in a wavelength. CPU time is that of the steps, without
compilation. `needed` is the fraction of the gas that the problem needs: one of 8 azimuths of a tube, the square about
a blast or a vortex, or a squared wavelength. Prints a table, and writes polar_gas.csv, polar_gas.md and polar_gas.png.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from scipy.integrate import trapezoid
from scipy.optimize import brentq, least_squares
from scipy.special import j1, jv, jvp, yv, yvp
from script_helpers import BLUE, RED, some_of, warm_up, write_csv

from discsim import Simulation
from discsim.exact import gresho, riemann, ring, sedov, sheet
from discsim.initial.blast import shock_radius
from discsim.numerics.polar import PolarCells
from discsim.physics import profile

Array = np.ndarray
METHODS = ("grid", "sph")
COLUMNS = ("problem", "method", "n", "count", "error", "order", "cpu", "needed", "detail")
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4}
FAR, AZIMUTHS = 1e4, 8  # radius of the tubes, and their cells in a ring
MODE, EDGES = 3, (1.0, 2.0)  # of the standing wave
WEAK = 1e-6  # amplitude of waves, whose steepening is then negligible
BLAST, HEATED = 0.35, 0.03  # radius of the shock at the end, and of the heated gas at the start
START = 0.1  # velocity of the packets at the start, over c_s
VORTEX = {"kernel": "wendland-c4", "eta": 3.0, "viscosity": {"alpha": 0.3}}


class Case(NamedTuple):
    """A run: simulation, its end, its error with words about it, and the fraction of the gas that the problem needs.

    look(sim): called after each step.
    """

    sim: Simulation
    until: float
    error: Callable[[Simulation], tuple[float, str]]
    needed: float = 1.0
    look: Callable[[Simulation], None] | None = None


class Disc(NamedTuple):
    """A self-gravitating disc with a wave: c_s, surface density, softening, wavenumber, and end of the run."""

    sound: float
    density: float
    softening: float
    k: float
    until: float


DISCS = {"stable": Disc(0.1, 0.06, 0.03, 15.0, 5.0), "unstable": Disc(0.1, 0.15, 0.03, 15.0, 1.5)}


def scene_of(until: float, size: float, gas: dict[str, Any], **tables: Any) -> dict[str, Any]:
    """Return a scene in code units."""
    return {"units": {"system": "code"}, "run": {"until": until}, "space": {"size": size}, "gas": gas, **tables}


def grid_of(cells: PolarCells, eos: dict[str, Any]) -> dict[str, Any]:
    """Return the table [gas] of own arrays in `cells`, between closed edges."""
    sides = cells.geometry.sides
    grid = {"inner": float(sides[0]), "outer": float(sides[-1]), "rings": cells.rings, "edges": "closed"}
    return {"method": "grid", "particles": len(cells.pos), "grid": grid, "eos": eos}


def square_cells(n: int, inner: float, outer: float, radius: float) -> PolarCells:
    """Return nearly square cells between closed edges, with `n` in a length of 1 at the radius `radius`."""
    rings = round(np.log(outer / inner) * radius * n)
    return PolarCells(rings, round(2.0 * np.pi * radius * n), inner, outer, True)


def square_lattice(count: int, size: float = 1.0) -> Array:
    """Return the positions (count^2, 2) of a square lattice in a square from 0 to `size`."""
    x = (np.arange(count) + 0.5) * size / count
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)


def in_cells(
    cells: PolarCells,
    until: float,
    eos: dict[str, Any],
    density: Array,
    vel: Array,
    u: Array | None = None,
    **tables: Any,
) -> Simulation:
    """Return a simulation of gas in `cells` with the surface density, velocity and energy of their centroids."""
    arrays = {"pos": cells.pos, "vel": vel, "mass": density * cells.area} | ({} if u is None else {"u": u})
    scene = scene_of(until, 2.0 * float(cells.geometry.sides[-1]), grid_of(cells, eos), **tables)
    return Simulation(scene, particles={"gas": arrays})


# Shock tubes


def tube(method: str, n: int, isothermal: bool) -> Case:
    """Return a shock tube of the length 1."""
    left, right, until = (1.0, 1.0, 0.0), (0.1 if isothermal else 0.125, 0.1, 0.0), 0.2
    eos = {"kind": "isothermal", "sound_speed": 1.0} if isothermal else ADIABATIC
    needed = 1.0
    if method == "sph":
        gas = {"particles": n, "eos": eos, "viscosity": {}}
        scene = scene_of(until, 1.0, gas, initial={"kind": "shock", "right": right})
        scene["space"]["dimensions"] = 1
        sim = Simulation(scene)
    else:
        cells = PolarCells(n, AZIMUTHS, FAR - 0.5, FAR + 0.5, True)
        is_left = np.hypot(*cells.pos.T) < FAR
        density, pressure = (np.where(is_left, left[k], right[k]) for k in range(2))
        u = None if isothermal else pressure / density / (eos["gamma"] - 1.0)
        sim, needed = in_cells(cells, until, eos, density, np.zeros_like(cells.pos), u), 1.0 / AZIMUTHS

    def error(sim: Simulation) -> tuple[float, str]:
        x = sim.gas.pos[:, 0] if method == "sph" else np.hypot(*sim.gas.pos.T) - FAR
        if isothermal:
            exact = riemann.isothermal_solution(x, sim.time, left[::2], right[::2])
        else:
            exact = riemann.solution(x, sim.time, left, right)
        weights = np.where(np.abs(x) < 0.5, sim.gas.mass / sim.gas.density, 0.0)
        return float(np.average(np.abs(sim.gas.density - exact.density), weights=weights)), ""

    return Case(sim, until, error, needed)


# Sound


def standing_wavenumber(edges: tuple[float, float], m: int) -> float:
    """Return k of the standing wave with one radial wavelength between closed edges, v_r = 0 there."""
    inner, outer = edges

    def at_edge(k: float) -> float:
        return jvp(m, k * inner) * yvp(m, k * outer) - jvp(m, k * outer) * yvp(m, k * inner)

    estimate = float(np.hypot(2.0 * np.pi / (outer - inner), 2.0 * m / (inner + outer)))
    return float(brentq(at_edge, 0.95 * estimate, 1.05 * estimate))


def standing_velocity(cells: PolarCells, k: float, edges: tuple[float, float], m: int) -> Array:
    """Return velocities (n, 2) of the standing wave at t = 0, with a largest of 1."""
    r, phi = np.hypot(*cells.pos.T), np.arctan2(cells.pos[:, 1], cells.pos[:, 0])
    a, b = yvp(m, k * edges[0]), -jvp(m, k * edges[0])
    radial = (a * jvp(m, k * r) + b * yvp(m, k * r)) * np.cos(m * phi)
    around = -(a * jv(m, k * r) + b * yv(m, k * r)) * m / (k * r) * np.sin(m * phi)
    out = cells.pos / r[:, None]
    vel = radial[:, None] * out + around[:, None] * out[:, ::-1] * [-1.0, 1.0]
    return vel / np.abs(vel).max()


def wave(method: str, n: int) -> Case:
    """Return a sound wave over one period, with `n` cells or particles in a wavelength."""
    eos = {"kind": "isothermal", "sound_speed": 1.0}
    if method == "sph":
        period = needed = 1.0
        space = {"size": 1.0, "boundary": "periodic"}
        start = {"kind": "wave", "amplitude": WEAK}
        sim = Simulation(scene_of(period, 1.0, {"particles": n * n, "eos": eos}, initial=start) | {"space": space})
    else:
        k = standing_wavenumber(EDGES, MODE)
        period = 2.0 * np.pi / k
        cells = square_cells(round(n / period), *EDGES, float(np.sqrt(EDGES[0] * EDGES[1])))
        start = WEAK * standing_velocity(cells, k, EDGES, MODE)
        sim = in_cells(cells, period, eos, np.ones(len(cells.pos)), start)
        needed = period**2 / float(cells.area.sum())

    def error(sim: Simulation) -> tuple[float, str]:
        exact = WEAK * np.sin(2.0 * np.pi * sim.gas.pos) * [1.0, 0.0] if method == "sph" else start
        wrong = np.hypot(*(sim.gas.vel - exact).T)
        kept = (sim.gas.vel * exact).sum() / (exact * exact).sum()
        return float(np.average(wrong, weights=sim.gas.mass)) / WEAK, f"amplitude {kept:.4f}"

    return Case(sim, period, error, needed)


# Blast and vortex


def blast(method: str, n: int) -> Case:
    """Return Sedov's blast with the energy 1 in gas of the density 1, until the shock is at BLAST."""
    until = sedov.arrival_time(BLAST)
    heated = max(HEATED, 4.0 / n)
    if method == "sph":
        gas = {"particles": n * n, "kernel": "quintic", "viscosity": {}, "eos": ADIABATIC | {"sound_speed": 0.01}}
        sim, needed = Simulation(scene_of(until, 1.0, gas, initial={"kind": "blast", "radius": heated})), 1.0
    else:
        cells = square_cells(n, 0.5, 1.5, 1.0)
        d2 = ((cells.pos - [1.0, 0.0]) ** 2).sum(axis=1)
        weight = np.maximum(0.0, 1.0 - d2 / heated**2) ** 2
        u = 0.01**2 / (1.4 * 0.4) + weight / (cells.area * weight).sum()
        sim = in_cells(cells, until, ADIABATIC, np.ones(len(u)), np.zeros_like(cells.pos), u)
        needed = 1.0 / float(cells.area.sum())

    def error(sim: Simulation) -> tuple[float, str]:
        pos = sim.gas.pos - ([1.0, 0.0] if method == "grid" else [0.0, 0.0])
        d = np.hypot(*pos.T)
        near = d < 0.45
        wrong = np.abs(sim.gas.density - sedov.solution(d, sim.time).density)[near]
        front = shock_radius(pos[np.abs(pos).max(axis=1) < 0.5], sim.gas.mass[np.abs(pos).max(axis=1) < 0.5], 1.0 / n)
        volume = (sim.gas.mass / sim.gas.density)[near]
        return float(np.average(wrong, weights=volume)), f"shock at {front / BLAST:.3f} of the exact radius"

    return Case(sim, until, error, needed)


def vortex(method: str, n: int) -> Case:
    """Return Gresho's vortex of the speed 1 at the distance 0.2 from its centre, until t = 1."""
    if method == "sph":
        start = {"kind": "vortex"}
        space = {"size": 1.0, "boundary": "periodic"}
        gas = {"particles": n * n, "eos": ADIABATIC} | VORTEX
        sim, needed = Simulation(scene_of(1.0, 1.0, gas, initial=start) | {"space": space}), 1.0
    else:
        cells = square_cells(n, 0.5, 1.5, 1.0)
        pos = cells.pos - [1.0, 0.0]
        d = np.maximum(np.hypot(*pos.T), 1e-300)
        vel = (gresho.speed(d) / d)[:, None] * pos[:, ::-1] * [-1.0, 1.0]
        sim = in_cells(cells, 1.0, ADIABATIC, np.ones(len(d)), vel, gresho.pressure(d) / 0.4)
        needed = 1.0 / float(cells.area.sum())

    def error(sim: Simulation) -> tuple[float, str]:
        pos = sim.gas.pos - ([1.0, 0.0] if method == "grid" else [0.5, 0.5])
        d = np.hypot(*pos.T)
        found = (pos[:, 0] * sim.gas.vel[:, 1] - pos[:, 1] * sim.gas.vel[:, 0]) / d
        near = d < 0.4
        wrong = np.abs(found - gresho.speed(d))[near]
        return float(np.average(wrong, weights=(sim.gas.mass / sim.gas.density)[near])), ""

    return Case(sim, 1.0, error, needed)


# Self-gravity


def gravity(method: str, n: int) -> Case:
    """Return a tapered disc of gas from 0.6 to 1.6 whose own gravity is measured at the start."""
    inner, outer, softening = 0.5, 1.7, 0.03
    count = round(np.pi * (outer**2 - inner**2) * n * n)
    gas = {"particles": count, "eos": {"kind": "isothermal", "sound_speed": 0.05}}
    gas |= {"method": "grid"} if method == "grid" else {}
    start = {"kind": "disc", "surface_density": 1e-4, "inner": inner, "outer": outer}
    start |= {"inner_taper": 0.3, "outer_taper": 0.4}
    scene = scene_of(1.0, 4.0, gas, initial=start, star={"mass": 1.0}, self_gravity={"softening": softening})
    scene["space"]["cells"] = 4 * n
    sim = Simulation(scene)

    def error(sim: Simulation) -> tuple[float, str]:
        found = sim.acceleration("self_gravity")[0]
        radii = np.linspace(inner, outer, 1201)[1:-1]
        ring_mass = 2.0 * np.pi * radii * profile.radial(sim.scene).surface_density(radii) * (radii[1] - radii[0])
        at = np.linspace(0.9 * inner, 1.1 * outer, 400)
        exact = ring.radial_acceleration(at[:, None], radii, softening) @ ring_mass
        r = np.hypot(*sim.gas.pos.T)
        wrong = found - np.interp(r, at, exact)[:, None] * sim.gas.pos / r[:, None]
        rms = np.sqrt(np.average((wrong**2).sum(axis=1), weights=sim.gas.mass))
        return float(rms / np.abs(exact).max()), ""

    return Case(sim, 0.0, error)


def packet(r: Array, k: float) -> Array:
    """Return the radial velocity of a wave packet about r = 2: a Bessel function in a window."""
    return j1(k * r) * np.exp(-(((r - 2.0) / 0.25) ** 2))


def exact_amplitude(times: Array, disc: Disc, kappa2: float) -> Array:
    """Return the velocity of the packet at `times`, projected on that at t = 0.

    The waves v_r ~ J_1(k r) of a wide uniform disc that rotates as a solid body are independent, with exactly the
    omega^2 = kappa^2 + c_s^2 k^2 - 2 pi Sigma k exp(-k softening) of tightly wound waves.
    """
    k, r = np.linspace(0.01, 2.0 * disc.k, 601), np.linspace(1.0, 3.0, 2001)
    power = k * trapezoid(j1(k[:, None] * r) * packet(r, disc.k) * r, r, axis=1) ** 2
    squares = kappa2 + sheet.omega_squared(k, disc.density, disc.sound, disc.softening)
    return np.cos(np.sqrt(squares.astype(complex)) * times[:, None]).real @ power / power.sum()


def solid_disc(method: str, n: int, name: str) -> Case:
    """Return a wave packet of the disc `name` with `n` cells or particles in a wavelength; a force makes Omega = 1."""
    disc = DISCS[name]
    per_length = n * disc.k / (2.0 * np.pi)
    cells = square_cells(round(per_length), 1.0, 3.0, 2.0)
    eos = {"kind": "isothermal", "sound_speed": disc.sound}
    gas = grid_of(cells, eos) if method == "grid" else {"particles": len(cells.pos), "eos": eos}
    scene = scene_of(disc.until, 6.4, gas, self_gravity={"softening": disc.softening})
    scene["space"]["cells"] = round(2.0 * 6.4 * per_length)  # smooth gravity of cells
    arrays = {"pos": cells.pos, "vel": np.zeros_like(cells.pos), "mass": disc.density * cells.area}
    sim = Simulation(scene, particles={"gas": arrays})
    sim.add_force(lambda particles, time: -particles.pos, on="gas", name="rotation", limit=1.0)
    # Rotation in balance: the means over rings of all forces.
    pos, radius = sim.gas.pos, cells.geometry.radius
    r = np.hypot(*pos.T)
    pull = -sum((sim.acceleration(effect)[0] * pos).sum(axis=1) for effect in ("gas", "self_gravity", "rotation")) / r
    of_ring = np.searchsorted(cells.geometry.sides[1:-1], r)
    inward = np.bincount(of_ring, pull) / np.bincount(of_ring)
    around = np.sqrt(radius * np.maximum(inward, 0.0))
    kappa2 = np.gradient((radius * around) ** 2, radius) / radius**3
    kappa2 = float(np.average(kappa2, weights=radius**2 * packet(radius, disc.k) ** 2))
    start = packet(r, disc.k)
    sim.gas.vel[:] = (around[of_ring] / r)[:, None] * pos[:, ::-1] * [-1.0, 1.0]
    sim.gas.vel += (START * disc.sound * start / r)[:, None] * pos
    begun = START * disc.sound * float((start * start) @ sim.gas.mass)
    seen: list[tuple[float, float]] = []

    def look(sim: Simulation) -> None:
        r = np.hypot(*sim.gas.pos.T)
        shape = packet(r, disc.k) * sim.gas.mass
        seen.append((sim.time, float((shape / r) @ (sim.gas.pos * sim.gas.vel).sum(axis=1))))

    def error(_: Simulation) -> tuple[float, str]:
        times, found = np.array(seen).T
        found = found / begun
        exact = exact_amplitude(times, disc, kappa2)
        shift = least_squares(lambda more: exact_amplitude(times, disc, kappa2 + more[0]) - found, [0.0]).x[0]
        off = 0.5 * shift / squared_frequency(disc, kappa2)
        wrong = np.sqrt(np.mean((found - exact) ** 2) / np.mean(exact**2))
        return float(wrong), f"{'frequency' if name == 'stable' else 'growth rate'} {off:+.1%}"

    return Case(sim, disc.until, error, look=look)


def squared_frequency(disc: Disc, kappa2: float) -> float:
    """Return omega^2 of the central wavenumber of the packet."""
    return kappa2 + float(sheet.omega_squared(disc.k, disc.density, disc.sound, disc.softening))


# Runs


PROBLEMS: dict[str, tuple[Callable[[str, int], Case], Sequence[int]]] = {
    "sod": (lambda method, n: tube(method, n, isothermal=False), (100, 200, 400)),
    "isothermal": (lambda method, n: tube(method, n, isothermal=True), (100, 200, 400)),
    "wave": (wave, (16, 32, 64)),
    "sedov": (blast, (40, 80, 160)),
    "gresho": (vortex, (25, 50, 100)),
    "gravity": (gravity, (20, 40, 80)),
    "stable": (lambda method, n: solid_disc(method, n, "stable"), (6, 12, 24)),
    "unstable": (lambda method, n: solid_disc(method, n, "unstable"), (6, 12, 24)),
}


def measure(problem: str, method: str, n: int) -> dict[str, Any]:
    """Run a problem, and return its row of the table."""
    case = PROBLEMS[problem][0](method, n)
    sim, cpu = case.sim, 0.0
    if case.until > 0.0:
        begun = time.process_time()
        sim.run(case.until, callback=case.look)
        cpu = time.process_time() - begun
        with sim.synchronised():
            error, detail = case.error(sim)
    else:
        error, detail = case.error(sim)
    row = {"problem": problem, "method": method, "n": n, "count": sim.gas.count, "error": error, "cpu": cpu}
    return row | {"needed": case.needed, "detail": detail, "order": None}


def measured(problems: Sequence[str], levels: int) -> list[dict[str, Any]]:
    """Return the rows of problems at their first `levels` resolutions, with orders between two resolutions."""
    rows = []
    for problem in problems:
        for method in METHODS:
            make, resolutions = PROBLEMS[problem]
            first = make(method, resolutions[0])
            if first.until > 0.0:
                warm_up(first.sim)
            for n in resolutions[:levels]:
                row = measure(problem, method, n)
                if n != resolutions[0]:
                    before = rows[-1]
                    row["order"] = float(np.log(before["error"] / row["error"]) / np.log(n / before["n"]))
                rows.append(row)
    return rows


def texts(row: dict[str, Any]) -> list[str]:
    """Return a row as texts, in the order of COLUMNS."""
    order = "" if row["order"] is None else f"{row['order']:.1f}"
    cpu = f"{row['cpu']:.2g}" if row["cpu"] else ""
    shown = row | {"error": f"{row['error']:.2g}", "order": order, "cpu": cpu, "needed": f"{row['needed']:.2g}"}
    return [str(shown[column]) for column in COLUMNS]


def write_markdown(rows: Sequence[dict[str, Any]], file: Path) -> None:
    """Write the rows as a table."""
    lines = [" | ".join(COLUMNS), " | ".join("-" for _ in COLUMNS), *(" | ".join(texts(row)) for row in rows)]
    file.write_text("".join(f"| {line} |\n" for line in lines))


def draw(rows: Sequence[dict[str, Any]], file: Path) -> None:
    """Draw errors against n, a panel for each problem."""
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    columns = min(4, len(problems))
    lines = -(-len(problems) // columns)
    figure = Figure(figsize=(2.8 * columns, 2.6 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in panels[len(problems) :]:
        axes.set_visible(False)
    for axes, problem in zip(panels, problems, strict=False):
        for method, colour in zip(METHODS, (BLUE, RED), strict=True):
            points = [row for row in rows if (row["problem"], row["method"]) == (problem, method)]
            axes.plot([row["n"] for row in points], [row["error"] for row in points], "o-", color=colour, label=method)
        axes.set(xscale="log", yscale="log", title=problem, xlabel="n", ylabel="error")
        ticks = PROBLEMS[problem][1]
        axes.set_xticks(ticks, labels=map(str, ticks), minor=False)
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
    panels[0].legend(frameon=False)
    figure.savefig(file, dpi=110)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    parser.add_argument("--problems", type=some_of(PROBLEMS, "problem"), default=",".join(PROBLEMS))
    parser.add_argument(
        "--levels", type=int, choices=(1, 2, 3), default=3, help="resolutions of each problem; default 3"
    )
    options = parser.parse_args(arguments)
    rows = measured(options.problems, options.levels)
    options.output.mkdir(parents=True, exist_ok=True)
    write_csv(rows, COLUMNS, options.output / "polar_gas.csv")
    write_markdown(rows, options.output / "polar_gas.md")
    draw(rows, options.output / "polar_gas.png")
    table = Table(*COLUMNS)
    for row in rows:
        table.add_row(*texts(row))
    Console(width=120).print(table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
