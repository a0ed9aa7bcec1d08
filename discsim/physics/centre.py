"""Central mass of a scene's disc, and frequencies of circles about it (`formulas/centre.py`). Numpy only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas import centre

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def central(scene: Scene) -> Array:
    """Return which bodies are part of the disc's central mass: bool (n,), the star first."""
    star: Any = scene.star
    return centre.central(star.centre, [c.eccentricity for c in scene.table("companion") or ()])


def central_mass(scene: Scene) -> float:
    """Return the central mass of the disc at the start."""
    star: Any = scene.star
    masses = np.array([star.mass, *(c.mass for c in scene.table("companion") or ())])
    return float(masses[central(scene)].sum())


def kepler_omega(scene: Scene, r: Array | float, mass: float | None = None) -> Array:
    """Return the orbital frequency (n,) of circles of radius `r` (n,) about `mass`, by default that of the start."""
    star: Any = scene.star
    return centre.omega(central_mass(scene) if mass is None else mass, r, star.softening)


def star_pull(scene: Scene, r: Array) -> Array:
    """Return the inward acceleration (n,) at radius `r` (n,) by the star alone at the centre.

    Radiation pressure is a multiple of this acceleration.
    """
    star: Any = scene.star
    return np.asarray(star.mass * r / (r**2 + star.softening**2) ** 1.5)


def passive_speed(scene: Scene, aspect_ratio: float, r: float) -> float:
    """Return the isothermal sound speed at radius `r` of a disc with that H/r there."""
    return centre.passive_speed(central_mass(scene), aspect_ratio, r)
