"""How wrong a run is: against the exact solution where its start has one, and what should have stayed the same.

Error of velocities: rms over particles of (velocity - exact at the particle's place), over the largest exact velocity
relative to the frame of the start. Of a wave, box or shock it is that (of a box over its slip at the start), the worse
species counting; of settling grains the rms error of heights over the longest way; of a vortex the mean error of the
azimuthal velocity over the largest; of a sheet that of the amplitude of its density wave; of a blast the radius of its
shock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from discsim.output.history import COLUMNS, history_row
from discsim.physics.eos import eos_of
from discsim.run.simulation import Simulation

Array = np.ndarray
RINGS = 24  # of a disc's radial profile, and squares a side of other maps


class Measure(NamedTuple):
    """What an error is, in words, and the errors of a simulation now by species ("" where it is of neither)."""

    words: str
    errors: Callable[[Simulation], dict[str, float]]


def measure_of(scene: Any) -> Measure | None:
    """The measure against an exact solution; None where the scene has none."""
    start = scene.initial
    if start is None or start.kind not in MEASURES or scene.star or scene.background:
        return None
    if (scene.self_gravity and start.kind != "sheet") or (scene.external and start.kind not in ("settling", "box")):
        return None
    return MEASURES[start.kind](scene)


def velocity_errors(exact: Callable[[Simulation, str], tuple[Array, Array | float]]) -> Callable:
    """Errors by species from `exact(sim, kind)`: velocities (n, d) at the particles that move, and their frame."""

    def errors(sim: Simulation) -> dict[str, float]:
        out = {}
        for kind, p in sim.state.species.items():
            found, frame = exact(sim, kind)
            free = np.ones(p.count, bool) if p.immobile is None else ~p.immobile
            found = np.broadcast_to(found, p.vel.shape)[free]
            scale = np.sqrt(((found - frame) ** 2).sum(axis=1).max())
            out[kind] = float(np.sqrt(((p.vel[free] - found) ** 2).sum(axis=1).mean()) / scale)
        return out

    return errors


def _of_wave(scene: Any) -> Measure | None:
    drag, eos = scene.drag, scene.gas.eos if scene.gas else None
    if eos is None or eos.kind != "isothermal":
        return None
    coupled = drag is not None and drag.direction == "two-way" and drag.law in ("constant", "stopping-time")
    if scene.dust and (not coupled or len(scene.dust) > 1):
        return None
    from discsim.exact import dustywave

    def exact(sim: Simulation, kind: str) -> tuple[Array, Array]:
        start = scene.initial
        size = np.array(scene.space.size)
        wavevector = start.wavenumber * np.array(start.direction) / size
        waves = float(np.linalg.norm(wavevector))
        along, frame = wavevector / waves, np.array(start.velocity)
        ratio = scene.dust[0].ratio if scene.dust else 1e-30
        coefficient = 0.0
        if scene.dust:
            coefficient = drag.K if drag.law == "constant" else ratio / drag.t_stop
        place = sim.state.species[kind].pos @ along - sim.time * (frame @ along)
        wave = dustywave.solution(place, sim.time, coefficient, ratio, eos.sound_speed, start.amplitude, waves)
        return frame + np.outer(getattr(wave, f"{kind}_velocity"), along), frame

    return Measure("particle velocities against the exact wave", velocity_errors(exact))


def _of_shock(scene: Any) -> Measure | None:
    if scene.gas is None or scene.gas.eos.kind != "adiabatic" or len(scene.dust or ()) > 1:
        return None
    if scene.dust and (scene.drag is None or scene.drag.direction == "one-way"):
        return None
    from discsim.exact import dustyshock

    def exact(sim: Simulation, kind: str) -> tuple[Array, float]:
        start = scene.initial
        ratio = scene.dust[0].ratio if scene.dust else 0.0
        x = sim.state.species[kind].pos[:, 0]
        flow = dustyshock.solution(x, sim.time, ratio, start.left, start.right, scene.gas.eos.gamma)
        return flow.velocity[:, None], 0.0

    limit = ", in the limit of strong drag" if scene.dust else ""
    return Measure(f"particle velocities against the exact shock tube{limit}", velocity_errors(exact))


def _of_box(scene: Any) -> Measure | None:
    drag = scene.drag
    if not scene.gas or len(scene.dust or ()) != 1 or drag is None or drag.law not in ("constant", "stopping-time"):
        return None
    from discsim.exact import dustybox

    def exact(sim: Simulation, kind: str) -> tuple[Array, Array]:
        start, ratio = scene.initial, scene.dust[0].ratio
        gas, dust = np.array(start.gas_velocity, dtype=float), np.array(start.dust_velocity, dtype=float)
        pulls = [np.array(getattr(scene.external, name, 0.0 * gas)) for name in ("gas", "dust")]
        coefficient = drag.K / start.density if drag.law == "constant" else ratio / drag.t_stop
        if drag.direction == "one-way":
            # Gas that does not feel the dust is as good as infinitely heavy.
            coefficient, ratio = coefficient * 1e-12 / ratio, 1e-12
        found = dustybox.velocities(sim.time, gas, dust, 1.0, ratio, coefficient, pulls[0], pulls[1])
        exact = found[kind == "dust"]
        return exact, exact - (dust - gas)  # over the slip at the start

    return Measure("particle velocities against the exact relaxation", velocity_errors(exact))


def _of_settling(scene: Any) -> Measure | None:
    if scene.drag is None or scene.drag.law != "stopping-time" or len(scene.dust) > 1:
        return None
    from discsim.exact import settling
    from discsim.initial import setup

    def errors(sim: Simulation) -> dict[str, float]:
        start = setup(scene).particles(scene)["dust"]["pos"][:, 0]
        time, frequency = scene.drag.t_stop, scene.external.vertical_frequency
        height, _ = settling.trajectories(sim.time, start, lambda z: np.full_like(z, time), frequency)
        where = np.argsort(sim.dust.ids)
        way = np.abs(height - start)
        return {"dust": float(np.sqrt(((sim.dust.pos[where, 0] - height) ** 2).mean()) / way.max())}

    return Measure("heights of the grains against their equation of motion, over the longest way", errors)


def _of_vortex(scene: Any) -> Measure | None:
    if scene.dust:
        return None
    from discsim.exact import gresho

    def errors(sim: Simulation) -> dict[str, float]:
        start, size = scene.initial, np.array(scene.space.size)
        frame = np.array(start.velocity)
        away = (sim.gas.pos - 0.5 * size - frame * sim.time + 0.5 * size) % size - 0.5 * size
        vel = sim.gas.vel - frame
        r = np.hypot(*away.T)
        turning = (away[:, 0] * vel[:, 1] - away[:, 1] * vel[:, 0]) / r
        inside = r < 2.0 * start.radius
        return {"gas": float(np.abs(turning - gresho.speed(r, start.speed, start.radius))[inside].mean() / start.speed)}

    return Measure("mean azimuthal velocity within the vortex against the exact one", errors)


def _of_sheet(scene: Any) -> Measure | None:
    if scene.dust or not scene.gas or scene.gas.eos.kind != "isothermal":
        return None
    if scene.self_gravity and scene.self_gravity.kernel != "plummer":
        return None
    from discsim.exact import sheet

    def errors(sim: Simulation) -> dict[str, float]:
        start, gravity = scene.initial, scene.self_gravity
        k = 2.0 * np.pi * start.wavenumber / scene.space.size[0]
        pull = (start.surface_density, scene.gas.eos.sound_speed) + ((gravity.softening,) if gravity else (0.0, 0.0))
        # One of the two is 0: it grows or it swings.
        grown = np.cosh(sheet.growth_rate(k, *pull) * sim.time) * np.cos(sheet.frequency(k, *pull) * sim.time)
        exact = start.amplitude * float(grown)
        mode = 2.0 * (np.exp(-1j * k * sim.gas.pos[:, 0]) * sim.gas.mass).sum() / sim.gas.mass.sum()
        return {"gas": float(abs(mode * 1j - exact) / max(abs(exact), start.amplitude))}

    return Measure("amplitude of the density wave against the exact one", errors)


def _of_blast(scene: Any) -> Measure | None:
    ratio = sum(dust.ratio for dust in scene.dust or ())
    if ratio and (scene.drag is None or scene.drag.direction == "one-way"):
        return None
    from discsim.exact import sedov

    def errors(sim: Simulation) -> dict[str, float]:
        start = scene.initial
        exact = sedov.shock_radius(sim.time, start.energy, start.density * (1.0 + ratio), scene.gas.eos.gamma)
        width = min(scene.space.size) * sim.gas.count**-0.5
        return {kind: abs(front(p, width) / exact - 1.0) for kind, p in sim.state.species.items()}

    return Measure("radius of the shock against the exact one", errors)


MEASURES: dict[str, Callable[[Any], Measure | None]] = {
    "wave": _of_wave, "shock": _of_shock, "box": _of_box, "settling": _of_settling, "vortex": _of_vortex,
    "sheet": _of_sheet, "blast": _of_blast,
}  # fmt: skip


def front(particles: Any, width: float) -> float:
    """Radius of a blast's shock: where the mean density of rings `width` wide is half way up its jump, from outside."""
    r = np.sqrt((particles.pos**2).sum(axis=1))
    edges = np.arange(0.0, np.abs(particles.pos).max(), width)
    middle = 0.5 * (edges[1:] + edges[:-1])
    density = np.histogram(r, edges, weights=particles.mass)[0] / np.pi / (edges[1:] ** 2 - edges[:-1] ** 2)
    ahead = density[-3:].mean()
    peak = int(np.argmax(density))
    out = peak + int(np.argmax(density[peak:] < 0.5 * (density[peak] + ahead)))
    return float(np.interp(0.5 * (density[peak] + ahead), density[[out, out - 1]], middle[[out, out - 1]]))


def profiles(sim: Simulation) -> dict[str, list[float]]:
    """Mass of each species in rings of a disc, or in squares of a box: what runs without an exact solution compare."""
    scene, out = sim.scene, {}
    for kind, p in sim.state.species.items():
        if scene.centred and scene.space.dimensions == 2:
            edges = np.linspace(0.0, 0.5 * min(scene.space.size), RINGS + 1)
            mass, _ = np.histogram(np.sqrt((p.pos**2).sum(axis=1)), edges, weights=p.mass)
        else:
            half = 0.5 if scene.centred else 0.0
            spans = [(-half * side, (1.0 - half) * side) for side in scene.space.size]
            mass, _ = np.histogramdd(p.pos, bins=RINGS, range=spans, weights=p.mass)
        out[kind] = mass.ravel().tolist()
    return out


def profile_errors(found: dict[str, list[float]], reference: dict[str, list[float]]) -> dict[str, float]:
    """Mass that is elsewhere than in the reference, over all of it, by species."""
    return {
        kind: float(0.5 * np.abs(np.subtract(mass, reference[kind])).sum() / max(np.sum(reference[kind]), 1e-300))
        for kind, mass in found.items()
    }


def totals(sim: Simulation) -> dict[str, float]:
    """The conserved quantities of a simulation now, with what was accreted, and the scales to judge them by."""
    with sim.synchronised() as state:
        row: dict[str, Any] = dict(zip(COLUMNS, history_row(state, sim.effects, 0.0, ""), strict=True))
        species = state.species.values()
        speeds = [np.sqrt((p.vel**2).sum(axis=1)) for p in species]
        moved = sum(float(p.mass @ speed) for p, speed in zip(species, speeds, strict=True))
        spun = sum(
            float(p.mass @ (speed * np.sqrt((p.pos**2).sum(axis=1)))) for p, speed in zip(species, speeds, strict=True)
        )
        ledger = state.ledger
    energy = row["kinetic_gas"] + row["kinetic_dust"] + row["thermal"] + row["potential"]
    momentum = np.array([row["momentum_x"], row["momentum_y"]]) + ledger.accreted_momentum
    return {
        "mass": row["mass_gas"] + row["mass_dust"] + ledger.accreted_gas + ledger.accreted_dust,
        "momentum_x": float(momentum[0]),
        "momentum_y": float(momentum[1]),
        "spin": row["angular_momentum"] + ledger.accreted_angular_momentum,
        "energy": energy,
        "moved": moved,
        "spun": spun,
        "closed": float(sim.scene.space.dimensions == 2 or sim.scene.space.boundary == "periodic"),
        "held": float(sim.gas is None or eos_of(sim.scene).closes_energy),
        "size": abs(row["kinetic_gas"]) + abs(row["kinetic_dust"]) + abs(row["thermal"]) + abs(row["potential"]),
    }


def drifts(before: dict[str, float], after: dict[str, float]) -> dict[str, float | None]:
    """Changes of mass, momentum, angular momentum and energy, over the sums of the sizes of their terms.

    None for the energy of gas that is held at a temperature, and for the momentum of a tube whose ends are held.
    """

    def over(change: float, scale: str) -> float:
        return abs(change) / max(before[scale], after[scale], 1e-300)

    momentum = np.hypot(after["momentum_x"] - before["momentum_x"], after["momentum_y"] - before["momentum_y"])
    return {
        "mass": over(after["mass"] - before["mass"], "mass"),
        "momentum": over(float(momentum), "moved") if before["closed"] else None,
        "angular_momentum": over(after["spin"] - before["spin"], "spun"),
        "energy": over(after["energy"] - before["energy"], "size") if before["held"] else None,
    }
