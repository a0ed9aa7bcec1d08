"""The figures of the method papers, with the exact solutions.

    python analysis/paper_figures.py [-o OUT] [--figures NAME,...]

kernels     the kernels W and their slopes, and the double hump q^2 W
waves       DustyWave, K = .005, .5, 500: mk, idic and tsc (arXiv:1811.06506, figs 2 to 4)
shocks      DustyShock, K = 5, 500, 5000: idic with cells of h/2 and tsc, beside the tube of gas alone (figs 5 to 7)
schemes     DustyWave, K = 500: every scheme, h = .025, .01, and .001 with 2 x 6000 (arXiv:1811.06522, fig. 1)
box         grains of 1 mm to 10 m in gas of 1e-9 g/cm3 at 1 au (arXiv:1406.3250)
settling    grains that fall through an isothermal layer (arXiv:1406.3250)
blast       Sedov's blast with as much dust as gas, stiffly coupled (arXiv:1406.3250)
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from measures import exact_velocity, run_of
from rich.console import Console
from rich.progress import track
from schemes import SCHEMES, blast
from script_helpers import some_of

from discsim import Simulation
from discsim.exact import dustybox, riemann, sedov, settling
from discsim.kernels.drag.laws import nonlinear_drag_factor
from discsim.kernels.sph.smoothing import KERNELS, NORM, SUPPORT, shape

EULER = {"integrator": "euler"}


def page(rows: int, columns: int, size: tuple[float, float]):
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def profile(axes, sim: Simulation, kind: str, label: str, colour: str) -> None:
    """Velocity of a species against x."""
    p = getattr(sim, kind)
    order = np.argsort(p.pos[:, 0])
    axes.plot(p.pos[order, 0], p.vel[order, 0], ".", ms=2, color=colour, label=label)


def exact_line(axes, sim: Simulation, kinds: dict[str, str]) -> None:
    x = np.linspace(0, 1, 1001) - (0.5 if sim.scene.initial.kind == "shock" else 0.0)
    for kind, style in kinds.items():
        axes.plot(x, exact_velocity(sim, kind, x), style, color="black", lw=0.8, label=f"exact, {kind}")


def kernels() -> Figure:
    figure, ((left, right),) = page(1, 2, (10, 4))
    for i, (name, code) in enumerate(KERNELS.items()):
        q = np.linspace(0, SUPPORT[code], 400)
        values = np.array([shape(code, 1, x) for x in q])
        left.plot(q, NORM[0][code] * values[:, 0], color=f"C{i}", label=name)
        right.plot(q, NORM[0][code] * np.gradient(values[:, 0], q), color=f"C{i}", label=name)
        if name == "cubic":
            hump = q**2 * values[:, 0]
            left.plot(q, hump / (2 * np.trapezoid(hump, q)), "--", color=f"C{i}", label="double hump of it")
    left.set(xlabel="r / h", ylabel="h W", title="in one dimension")
    right.set(xlabel="r / h", ylabel="h^2 dW/dr")
    left.legend()
    return figure


def waves() -> Figure:
    figure, panels = page(1, 3, (15, 4))
    for axes, coefficient in zip(panels[0], (0.005, 0.5, 500.0), strict=True):
        for i, scheme in enumerate(("mk", "idic", "tsc")):
            sim = run_of(scheme, "wave", coefficient, 0.01, (600, 600), run=EULER | {"timestep": 0.001})
            sim.run()
            profile(axes, sim, "dust", f"dust, {scheme}", f"C{i}")
        profile(axes, sim, "gas", "gas, tsc", "C7")
        exact_line(axes, sim, {"gas": "-", "dust": "--"})
        axes.set(title=f"K = {coefficient:g}, h = .01, t = .5", xlabel="x", ylabel="velocity")
    panels[0, 0].legend(fontsize=7)
    return figure


def gas_tube() -> Simulation:
    eos = {"kind": "adiabatic", "gamma": 1.4}
    sim = Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 0.2},
            "space": {"dimensions": 1, "size": 1.0, "boundary": "open"},
            "initial": {"kind": "shock"},
            "gas": {"particles": 990, "smoothing_length": 0.01, "eos": eos, "viscosity": {"pairs": "approaching"}},
        }
    )
    sim.run()
    return sim


def shocks() -> Figure:
    figure, panels = page(1, 4, (19, 4))
    for axes, coefficient in zip(panels[0], (5.0, 500.0, 5000.0), strict=False):
        for i, (scheme, drag) in enumerate((("idic", {"cell": 0.5}), ("tsc", {}))):
            sim = run_of(scheme, "shock", coefficient, 0.01, (990, 990), drag=drag)
            sim.run()
            profile(axes, sim, "dust", f"dust, {scheme}", f"C{i}")
        profile(axes, sim, "gas", "gas, tsc", "C7")
        exact_line(axes, sim, {"dust": "-"})
        axes.set(title=f"K = {coefficient:g}; exact: strong drag", xlabel="x", ylabel="velocity", xlim=(-0.5, 0.5))
    axes, alone = panels[0, 3], gas_tube()
    profile(axes, alone, "gas", "gas", "C7")
    x = np.linspace(-0.5, 0.5, 1001)
    axes.plot(x, riemann.solution(x, 0.2, (1, 1, 0), (0.125, 0.1, 0), 1.4).velocity, "k", lw=0.8, label="exact")
    axes.set(title="gas alone", xlabel="x", xlim=(-0.5, 0.5))
    panels[0, 0].legend(fontsize=7)
    return figure


def schemes() -> Figure:
    figure, panels = page(1, 3, (16, 4.5))
    cases = ((0.025, 600), (0.01, 600), (0.001, 6000))
    for axes, (h, count) in zip(panels[0], cases, strict=True):
        for i, scheme in enumerate(SCHEMES):
            cells = {"sios-ppm": 400, "emsi-ppm": 400}.get(scheme, count)
            run = {"courant": 0.5} if scheme.endswith("-ppm") else {}
            sim = run_of(scheme, "wave", 500.0, h, (cells, cells), run=run)
            sim.run()
            order = np.argsort(sim.dust.pos[:, 0])
            axes.plot(sim.dust.pos[order, 0], sim.dust.vel[order, 0], color=f"C{i}", lw=1, label=scheme)
        exact_line(axes, sim, {"dust": "--"})
        axes.set(title=f"K = 500, h = {h:g}, 2 x {count} (grids 400 cells)", xlabel="x", ylabel="dust velocity")
    panels[0, 0].legend(fontsize=7, ncol=2)
    return figure


def box() -> Figure:
    figure, ((axes,),) = page(1, 1, (7, 4.5))
    for i, size in enumerate(("1 mm", "1 cm", "10 cm", "1 m", "10 m")):
        sim = Simulation(
            {
                "run": {"until": "3 day"},
                "space": {"dimensions": 1, "size": "1 au", "boundary": "periodic"},
                "initial": {"kind": "box", "density": "1e-9 g/cm3", "dust_velocity": "4 km/s"},
                "gas": {"particles": 40, "eos": {"kind": "isothermal", "sound_speed": "1 km/s"}},
                "dust": {"particles": 40, "ratio": 0.5, "grain_size": size, "grain_density": "3 g/cm3"},
                "drag": {"law": "epstein-stokes", "convention": "papers", "supersonic": True},
            }
        )
        law, start = sim.effects["drag"].law, float(sim.dust.vel[0, 0])
        gas = float(sim.scene.initial.density), sim.scene.gas.eos.sound_speed
        slow = float(law.stopping_time(0, np.array([gas[0]]), np.array([gas[1]]), np.zeros(1), 0.5)[0])

        def rate(speed, law=law, slow=slow, gas=gas):
            return nonlinear_drag_factor(law.code, law.grains[0], *gas, 0.0, speed) / slow

        times = np.geomspace(0.003, 1.0, 15) * sim.scene.run.until
        exact = [dustybox.velocities_by_speed(t, 0.0, start, 0.5, rate)[1][0] / start for t in times]
        found = []
        for t in times:
            sim.run(until=t)
            found.append(float(sim.dust.vel.mean()) / start)
        days = times / times[-1] * 3
        axes.plot(days, exact, color=f"C{i}", lw=1, label=size)
        axes.plot(days, found, "o", ms=4, color=f"C{i}")
    axes.set(
        xscale="log", xlabel="time (day)", ylabel="dust velocity / 4 km/s", title="lines: ODE solver; dots: discsim"
    )
    axes.legend()
    return figure


def fall() -> Figure:
    figure, ((axes,),) = page(1, 1, (7, 4.5))
    for i, stop in enumerate((0.01, 0.1, 1.0, 10.0)):
        sim = layer(stop)
        picked = np.argmin(np.abs(sim.dust.pos[:, 0] - 1.0))
        number, start = sim.dust.ids[picked], float(sim.dust.pos[picked, 0])
        times = np.linspace(0, sim.scene.run.until, 25)[1:]
        exact = [
            settling.trajectories(t, np.array([start]), lambda z, stop=stop: np.full_like(z, stop), 1.0)[0][0]
            for t in times
        ]
        found = []
        for t in times:
            sim.run(until=t)
            found.append(float(sim.dust.pos[sim.dust.ids == number][0, 0]))
        orbits = times / (2 * np.pi)
        axes.plot(orbits, exact, color=f"C{i}", lw=1, label=f"t_stop Omega = {stop:g}")
        axes.plot(orbits, found, "o", ms=3, color=f"C{i}")
    axes.set(xlabel="orbits", ylabel="height of a grain / H", title="lines: ODE; dots: discsim")
    axes.legend()
    return figure


def layer(stop: float) -> Simulation:
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 4 * np.pi},
            "space": {"dimensions": 1, "size": 5.0},
            "initial": {"kind": "settling"},
            "gas": {"particles": 400, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
            "dust": {"particles": 400, "ratio": 1e-6},
            "external": {"vertical_frequency": 1.0},
            "drag": {"law": "stopping-time", "t_stop": stop},
        }
    )


def blasts() -> Figure:
    figure, panels = page(1, 2, (12, 4.5))
    heavy = blast("tsc", 1e-3, side=100)
    heavy.run()
    edges = np.linspace(0, 0.5, 51)
    rings = np.pi * np.diff(edges**2)
    x = np.linspace(0, 0.5, 1001)
    front = sedov.solution(x, heavy.time, 1.0, 2.0, 1.4)
    for axes in panels[0]:
        for i, kind in enumerate(("gas", "dust")):
            p = getattr(heavy, kind)
            r = np.sqrt((p.pos**2).sum(axis=1))
            if axes is panels[0, 0]:
                axes.stairs(np.histogram(r, edges, weights=p.mass)[0] / rings, edges, color=f"C{i}", label=kind)
            else:
                axes.plot(r, (p.pos * p.vel).sum(axis=1) / r, ".", ms=1, color=f"C{i}")
    panels[0, 0].plot(x, front.density / 2, "k", lw=0.8, label="exact, tight coupling")
    panels[0, 1].plot(x, front.velocity, "k", lw=0.8)
    panels[0, 0].set(xlabel="r", ylabel="surface density", title="as much dust as gas, t_stop = .001 of the time")
    panels[0, 1].set(xlabel="r", ylabel="radial velocity")
    panels[0, 0].legend()
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "kernels": kernels,
    "waves": waves,
    "shocks": shocks,
    "schemes": schemes,
    "box": box,
    "settling": fall,
    "blast": blasts,
}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("paper_figures"))
    parser.add_argument("--figures", type=some_of(FIGURES, "figure"), default=",".join(FIGURES))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    for name in track(given.figures, console=Console(stderr=True)):
        FIGURES[name]().savefig(given.out / f"{name}.png", dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
