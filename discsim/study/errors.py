"""Errors of a run against exact solutions, and changes of conserved quantities.

Each start with an exact solution defines its own error (`discsim/initial`). For most starts it is the rms over
particles of the difference from the exact velocity at the particle's position, divided by the largest exact velocity
in the frame of the start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.initial import start_of
from discsim.initial.measure import ErrorMeasure
from discsim.output.history import history_columns, history_row
from discsim.physics.eos import eos_of
from discsim.run.simulation import Simulation
from discsim.scene import Scene

Array = np.ndarray
RINGS = 24  # rings of the profile of a disc, or squares along each side of a box


def measure_of(scene: Any) -> ErrorMeasure | None:
    """Return the measure of the error of a run against the exact solution; None if there is no exact solution."""
    if scene.initial is None:
        return None
    start = start_of(scene)
    if start.measure is None or set(scene.named) - {"gas", "dust", "drag", *start.exact_effects}:
        return None
    return start.measure(scene)


def is_disc(scene: Scene) -> bool:
    """Return whether the scene is two-dimensional with the origin in the middle of space."""
    return scene.centred and scene.space.dimensions == 2


def binned_masses(sim: Simulation) -> dict[str, list[float]]:
    """Return, by species, the mass in each ring of a disc, or in each square of a box, as a flat list.

    Runs are compared by these masses if there is no exact solution.
    """
    scene, out = sim.scene, {}
    for kind, p in sim.state.species.items():
        if is_disc(scene):
            edges = np.linspace(0.0, 0.5 * min(scene.space.size), RINGS + 1)
            if kind == "gas":
                mass = scene.model.mass_in_rings(scene, p, edges)
            else:
                mass, _ = np.histogram(np.sqrt((p.pos**2).sum(axis=1)), edges, weights=p.mass)
        else:
            half = 0.5 if scene.centred else 0.0
            spans = [(-half * side, (1.0 - half) * side) for side in scene.space.size]
            mass, _ = np.histogramdd(p.pos, bins=RINGS, range=spans, weights=p.mass)
        out[kind] = mass.ravel().tolist()
    return out


def profile_errors(found: dict[str, list[float]], reference: dict[str, list[float]]) -> dict[str, float]:
    """Return, by species, the fraction of the mass in a wrong bin, 0.5 sum |m - m_ref| / sum m_ref.

    found, reference: the masses m and m_ref in bins by species, from `binned_masses`.
    """
    return {
        kind: float(0.5 * np.abs(np.subtract(mass, reference[kind])).sum() / max(np.sum(reference[kind]), 1e-300))
        for kind, mass in found.items()
    }


def totals(sim: Simulation) -> dict[str, float]:
    """Return totals of the conserved quantities of a simulation, by name, and scales for their changes.

    Totals of mass, momentum and angular momentum ("spin") include accreted particles. "moved", "spun" and "size" are
    sums of magnitudes: the scales of momentum, angular momentum and energy. "closed" is 1 if momentum is conserved,
    else 0; "held" is the same for energy.
    """
    with sim.closed() as state:
        entries = history_row(state, sim.effects, 0.0, "")
        row: dict[str, Any] = dict(zip(history_columns(sim.scene), entries, strict=True))
        species = state.species.values()
        moved, spun = 0.0, 0.0
        for p in species:
            speed = np.sqrt((p.vel**2).sum(axis=1))
            moved += float(p.mass @ speed)
            spun += float(p.mass @ (speed * np.sqrt((p.pos**2).sum(axis=1))))
        ledger = state.ledger
    energy = row["kinetic_gas"] + row["kinetic_dust"] + row["thermal"] + row["potential"] + row["radiated"]
    momentum = np.array([row["momentum_x"], row["momentum_y"]]) + ledger.accreted_momentum
    mass = row["mass_gas"] + row["mass_dust"] + ledger.accreted_gas + ledger.accreted_dust + ledger.damped_gas
    return {
        "mass": mass + row.get("mass_small", 0.0) + ledger.accreted_small,
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
    """Return the relative changes of mass, momentum, angular momentum and energy between two results of `totals`.

    Changes are divided by sums of magnitudes. The change of a quantity that is not conserved is None: of the energy of
    gas with a prescribed temperature, and of the momentum in a tube with fixed ends.
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
