"""Central mass of a scene's disc, and orbital frequencies about it (`formulas/centre.py`). Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas import centre

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def central_mask(scene: Scene) -> Array:
    """Return a mask (n,) of the bodies in the central mass of the disc; entry 0 is the star, then come companions."""
    return centre.central_flags(scene.star.centre, [c.eccentricity for c in scene.table("companion") or ()])


def central_mass(scene: Scene) -> float:
    """Return the central mass of the disc at the start."""
    masses = np.array([scene.star.mass, *(c.mass for c in scene.table("companion") or ())])
    return float(masses[central_mask(scene)].sum())


def kepler_omega(scene: Scene, r: Array | float, mass: float | None = None) -> Array:
    """Return the frequency (n,) of circular orbits at radius `r` (n,).

    mass: central mass, by default the initial one.
    """
    return centre.omega(central_mass(scene) if mass is None else mass, r, scene.star.softening)


def star_pull(scene: Scene, r: Array) -> Array:
    """Return the inward acceleration (n,) by the gravity of the star at the distance `r` (n,).

    Radiation pressure is a fixed fraction of this acceleration, outwards.
    """
    return np.asarray(scene.star.mass * r / (r**2 + scene.star.softening**2) ** 1.5)


def passive_speed(scene: Scene, aspect_ratio: float, r: float) -> float:
    """Return the isothermal sound speed at radius `r` of a disc with H/r = `aspect_ratio` at this radius."""
    return centre.passive_speed(central_mass(scene), aspect_ratio, r)
