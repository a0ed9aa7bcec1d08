"""What fields have to know of the centre: places and velocities about it, and its mass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


def central_mass(snap: Snapshot) -> float:
    """What the disc turns about, in code units: the star, or about the barycentre all bodies."""
    star = snap.tables["star"]
    if snap.bodies is None:
        return in_code(snap.units, star["mass"], "mass")
    return float(snap.bodies.mass.sum() if star.get("centre") == "barycentre" else snap.bodies.mass[0])


def omega(snap: Snapshot, radius: Array) -> Array:
    """Frequency of circles (n,) about the star, softened as it is: Omega_K^2 = M / (r^2 + s^2)^(3/2)."""
    softening = in_code(snap.units, snap.tables["star"].get("softening", 0.0), "length")
    return np.sqrt(central_mass(snap) / np.maximum(radius**2 + softening**2, 1e-300) ** 1.5)


def in_code(units: Units, value: Any, dimension: str) -> float:
    """A value of a scene, a number or a text with a unit, in code units. Raises UnitError."""
    return units.parse(value, dimension) if isinstance(value, str) else float(value)
