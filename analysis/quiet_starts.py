"""How quiet discs start, settled before t = 0 (`initial.relax`) or not: v_r / c_s after some time.

    python analysis/quiet_starts.py [--orbits N] [--particles N] [--starts 'NAME;...']

Gas with H/r = .05 between .5 and 2 about a star, no drag and no gravity of its own. For each start and relaxation it
prints forces out of balance before and after that, over c_s Omega, and the rms of v_r / c_s of all gas and of the
middle 60% of it, in which waves from the edges arrive later.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from script_helpers import some_of

from discsim import Simulation

ASPECT = 0.05
LOW = {"alpha": 0.3, "beta": 0.5}
SHARP = {"kind": "disc", "mass": 1e-4, "inner": 0.5, "outer": 2.0}
TAPERS = {"inner_taper": 0.3, "outer_taper": 0.3}
STARTS: dict[str, tuple[dict, dict]] = {
    "disc, sharp": (SHARP, {"viscosity": {}}),
    "disc, tapers": (SHARP | TAPERS, {"viscosity": LOW}),
    "steady": (
        {"kind": "steady", "accretion_rate": 1e-9, "inner": 0.5, "outer": 2.0} | TAPERS,
        {"shear": {"alpha": 0.02}},
    ),
    "viscous-ring": (
        {"kind": "viscous-ring", "radius": 1.0, "mass": 1e-6},
        {"shear": {"alpha": 0.05, "index": -0.5}},
    ),
    "table": ({"kind": "table"}, {"viscosity": LOW}),
}


def simulation(name: str, relax: float, particles: int, folder: Path) -> Simulation:
    start, more = STARTS[name]
    if start["kind"] == "table":
        path = folder / "profile.txt"
        r = np.linspace(0.5, 2.0, 200)
        edges = [np.sin(0.5 * np.pi * np.clip(x / 0.4, 0.0, 1.0)) ** 2 for x in (r - 0.45, 2.05 - r)]
        np.savetxt(path, np.column_stack([r, 1e-5 / r * edges[0] * edges[1]]), header="r Sigma")
        start = start | {"file": str(path)}
    eos = {"kind": "locally-isothermal", "aspect_ratio": ASPECT, "temperature_index": 1.0}
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e9},
        "space": {"size": 6.0},
        "initial": start | {"relax": relax},
        "gas": {"particles": particles, "eos": eos},
        "star": {"mass": 1.0, "accretion_radius": 0.1},
    }
    if "viscosity" in more:
        scene["gas"] |= {"viscosity": more["viscosity"]}
    if "shear" in more:
        scene["alpha_viscosity"] = more["shear"]
    return Simulation(scene)


def noise(sim: Simulation) -> tuple[float, float]:
    """The rms of v_r / c_s of all gas, and of the middle 60% of it."""
    with sim.synchronised() as state:
        gas = state.gas
        r = np.hypot(*gas.pos.T)
        ratio = (gas.pos * gas.vel).sum(axis=1) / r / gas.sound_speed
    inside = (r > np.quantile(r, 0.2)) & (r < np.quantile(r, 0.8))
    return float(np.sqrt((ratio**2).mean())), float(np.sqrt((ratio[inside] ** 2).mean()))


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--orbits", type=float, default=1.0, help="after which it is measured, at r = 1")
    parser.add_argument("--particles", type=int, default=5000)
    parser.add_argument("--starts", type=some_of(STARTS, "start", ";"), default=list(STARTS), help="separated by ;")
    given = parser.parse_args(arguments)
    print(f"{'start':<14} {'relax':>5} {'out of balance':>18} {'v_r/c_s':>8} {'middle':>7}")
    for name in given.starts:
        for relax in (0, 2, 5):
            with tempfile.TemporaryDirectory() as folder:
                sim = simulation(name, relax, given.particles, Path(folder))
            balance = f"{sim.relaxed.before:.3f} {sim.relaxed.after:.1e}" if sim.relaxed else ""
            sim.run(given.orbits * 2.0 * np.pi)
            everywhere, middle = noise(sim)
            print(f"{name:<14} {relax:>5} {balance:>18} {everywhere:>8.3f} {middle:>7.3f}", flush=True)


if __name__ == "__main__":
    main()
