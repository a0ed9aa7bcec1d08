"""Relative changes of the conserved quantities of a run, from history.csv.

A change since the first row is divided by a scale, which is the largest value that it has during the run:

    quantity            terms                                       scale
    mass                gas, dust and accreted mass                 mass
    momentum            sum m v                                     sqrt(2 E_kin M)
    angular momentum    about the origin, only of a disc            its magnitude
    energy              kinetic, thermal, potential and radiated    sum of the magnitudes of the terms

The momentum of accreted particles is not included.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from discsim.physics.eos import eos_of
from discsim.scene import Scene

Array = np.ndarray
MOMENTUM_EFFECTS = ("star", "companion", "external", "background", "damping", "radiation_pressure", "dust_diffusion")
ENERGY_EFFECTS = ("companion", "external", "background", "damping", "radiation_pressure", "dust_diffusion")


class Totals(NamedTuple):
    """A conserved quantity of a run.

    first, last: value in the first and last row, as text. change (rows,): relative change since the first row.
    why: the effects that may change the quantity, as text; "" if nothing should.
    """

    name: str
    first: str
    last: str
    change: Array
    why: str

    @property
    def now(self) -> str:
        """The last relative change, as text."""
        return f"{self.change[-1]:.1e}"

    @property
    def most(self) -> str:
        """The largest relative change, as text."""
        return f"{np.abs(self.change).max():.1e}"


def totals(scene: Scene, rows: list[dict[str, str]]) -> list[Totals]:
    """Return the conserved quantities of a run; `rows` are those of its history.csv."""

    def column(name: str) -> Array:
        return np.array([float(row[name]) for row in rows]) if name in rows[0] else np.zeros(len(rows))

    def entry(name: str, values: Array, scale: float, measure: str, why: list[str]) -> Totals:
        change = (values - values[0]) / max(scale, 1e-300)
        first, last = (scene.units.show(float(value), measure) for value in (values[0], values[-1]))
        return Totals(name, first, last, change, f"changed by {', '.join(why)}" if why else "")

    kinds = [name for name in ("gas", "dust", "small") if f"mass_{name}" in rows[0]]
    mass = sum(column(f"mass_{kind}") + column(f"accreted_{kind}") for kind in kinds)
    kinetic = column("kinetic_gas") + column("kinetic_dust")
    others = [column(name) for name in ("thermal", "potential", "radiated")]
    size = kinetic + sum(np.abs(each) for each in others)
    moved = float(np.sqrt(2.0 * kinetic * np.maximum(mass, 0.0)).max())
    flat = scene.space.dimensions == 2
    taken = ["accretion by the star"] if (column("accreted_gas") + column("accreted_dust"))[-1] > 0.0 else []
    pushes = [f"[{name}]" for name in MOMENTUM_EFFECTS if scene.table(name) is not None] + taken
    ends = [] if flat or scene.space.boundary == "periodic" else ["the ends of the tube"]
    heats = [f"[{name}]" for name in ENERGY_EFFECTS if scene.table(name) is not None] + taken
    heats += [] if scene.gas is None or eos_of(scene).closes_energy else ["the prescribed gas temperature"]
    # In one dimension masses are column densities, and derived quantities are per area.
    of = (lambda name: name) if flat or scene.units.system == "code" else lambda name: "surface_density"
    found = [entry("mass", mass, float(np.abs(mass).max()), of("mass"), [])]
    if flat or scene.units.system == "code":
        momentum = np.hypot(*(column(f"momentum_{x}") - column(f"momentum_{x}")[0] for x in "xy"))
        found.append(entry("momentum", momentum, moved, "momentum", pushes + ends))
        if scene.centred and flat:
            spin = column("angular_momentum")
            turned = [each for each in pushes if each != "[star]"]
            found.append(entry("angular momentum", spin, float(np.abs(spin).max()), "angular_momentum", turned))
        found.append(entry("energy", kinetic + sum(others), float(size.max()), "energy", heats + ends))
    return found
