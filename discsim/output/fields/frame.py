"""Position, velocity and mass of the disc's centre: of the star, or the barycentre of star and companions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas import centre
from discsim.scene.units import Units

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


def central_mass(snap: Snapshot) -> float:
    """Return the mass in code units about which the disc orbits: of the star, or of star and companions.

    `formulas/centre.py` has the rule.
    """
    if snap.bodies is None:
        return in_code(snap.units, snap.tables["star"]["mass"], "mass")
    return float(snap.bodies.mass[_is_central(snap)].sum())


def centre_of(snap: Snapshot) -> tuple[Array, Array]:
    """Return position and velocity (2,) of the disc's centre; the snapshot must have bodies."""
    assert snap.bodies is not None and snap.bodies.vel is not None
    share = snap.bodies.mass * _is_central(snap)
    share /= share.sum()
    return share @ snap.bodies.pos, share @ snap.bodies.vel


def _is_central(snap: Snapshot) -> Array:
    """Return a mask (n,) of the bodies about which the disc orbits."""
    star, companions = snap.tables["star"], snap.tables.get("companion", [])
    each = [companions] if isinstance(companions, dict) else companions
    return centre.central_flags(star.get("centre", "star"), [float(c.get("eccentricity", 0.0)) for c in each])


def omega(snap: Snapshot, radius: Array) -> Array:
    """Return Omega_K (n,) at `radius` (n,): Omega_K^2 = M / (r^2 + s^2)^(3/2), with central mass M and softening s."""
    softening = in_code(snap.units, snap.tables["star"].get("softening", 0.0), "length")
    return centre.omega(central_mass(snap), radius, softening)


def in_code(units: Units, value: Any, dimension: str) -> float:
    """Return a scene's `value`, a number in code units or a text with a unit, in code units. Raises UnitError."""
    return units.parse(value, dimension) if isinstance(value, str) else float(value)
