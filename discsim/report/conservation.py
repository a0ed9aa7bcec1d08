"""Relative changes of the conserved quantities of a run, computed from history.csv.

A relative change is the change since the first row of the table, divided by the largest scale during the run:

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


class ConservedQuantity(NamedTuple):
    """A conserved quantity of a run, such as the momentum, with its changes.

    first, last: value in the first and the last row of history.csv, as text. change (rows,): relative change since the
    first row. causes: the effects that may change the quantity, as text; "" if nothing should change it.
    """

    name: str
    first: str
    last: str
    change: Array
    causes: str

    @property
    def last_change(self) -> str:
        """The relative change in the last row, as text."""
        return f"{self.change[-1]:.1e}"

    @property
    def largest_change(self) -> str:
        """The largest relative change, as text."""
        return f"{np.abs(self.change).max():.1e}"


def conserved_quantities(scene: Scene, rows: list[dict[str, str]]) -> list[ConservedQuantity]:
    """Return the conserved quantities of a run; `rows` are the rows of its history.csv by column."""

    def column(name: str) -> Array:
        return np.array([float(row[name]) for row in rows]) if name in rows[0] else np.zeros(len(rows))

    def quantity(name: str, values: Array, scale: float, dimension: str, causes: list[str]) -> ConservedQuantity:
        change = (values - values[0]) / max(scale, 1e-300)
        first, last = (scene.units.show(float(value), dimension) for value in (values[0], values[-1]))
        return ConservedQuantity(name, first, last, change, f"changed by {', '.join(causes)}" if causes else "")

    kinds = [name for name in ("gas", "dust", "small") if f"mass_{name}" in rows[0]]
    mass = sum(column(f"mass_{kind}") + column(f"accreted_{kind}") for kind in kinds)
    kinetic = column("kinetic_gas") + column("kinetic_dust")
    others = [column(name) for name in ("thermal", "potential", "radiated")]
    size = kinetic + sum(np.abs(each) for each in others)
    momentum_scale = float(np.sqrt(2.0 * kinetic * np.maximum(mass, 0.0)).max())
    is_2d = scene.space.dimensions == 2
    accretion = ["accretion by the star"] if (column("accreted_gas") + column("accreted_dust"))[-1] > 0.0 else []
    momentum_causes = [f"[{name}]" for name in MOMENTUM_EFFECTS if scene.table(name) is not None] + accretion
    ends = [] if is_2d or scene.space.boundary == "periodic" else ["the ends of the tube"]
    energy_causes = [f"[{name}]" for name in ENERGY_EFFECTS if scene.table(name) is not None] + accretion
    energy_causes += [] if scene.gas is None or eos_of(scene).closes_energy else ["the prescribed gas temperature"]
    damping = scene.table("damping")
    mass_causes = ["[damping]"] if damping is not None and damping.surface_density else []
    has_units = is_2d or scene.units.system == "code"  # else all quantities are per area, and mass is a surface density
    found = [quantity("mass", mass, float(np.abs(mass).max()), "mass" if has_units else "surface_density", mass_causes)]
    if has_units:
        momentum = np.hypot(*(column(f"momentum_{x}") - column(f"momentum_{x}")[0] for x in "xy"))
        found.append(quantity("momentum", momentum, momentum_scale, "momentum", momentum_causes + ends))
        if scene.centred and is_2d:
            spin = column("angular_momentum")
            spin_causes = [each for each in momentum_causes if each != "[star]"]
            found.append(quantity("angular momentum", spin, float(np.abs(spin).max()), "angular_momentum", spin_causes))
        found.append(quantity("energy", kinetic + sum(others), float(size.max()), "energy", energy_causes + ends))
    return found
