"""The kinematic viscosity that a scene asks for (`[alpha_viscosity]`), and the flow that it drives. Numpy only.

    nu    = alpha c_s H = alpha c_s^2 / Omega_K,  or a constant                    (1)  Shakura & Sunyaev 1973
    alpha = alpha (r / r_0)^index, or from inner_alpha to outer_alpha: their mean, and half their difference times
            tanh(ln(r / radius) / width)                                           (2)
            in a dead zone dead_alpha: the share [tanh(ln(r / dead_inner) / dead_width)
            - tanh(ln(r / dead_outer) / dead_width)] / 2 of the way to it          (3)
    v_r   = -3 / (Sigma sqrt(r)) d(nu Sigma sqrt(r))/dr                            (4)  Lynden-Bell & Pringle 1974

c_s is the isothermal sound speed, sqrt(P / Sigma), of gas that holds heat that of its present temperature; of a
polytrope it is sqrt(dP/dSigma), as in every H of discsim. Omega_K is that of circles about the star, softened as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.physics import profile

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
STEP = 1e-4  # of ln r, for the slope in (4): off by its square


def alpha(scene: Scene, r: Array) -> Array:
    """alpha at the radii `r` (n,) > 0, of a table that gives no `nu`."""
    keys: Any = scene.table("alpha_viscosity")
    log = np.log(r)
    if keys.alpha is not None:
        found = np.full_like(log, keys.alpha)
        if keys.index != 0.0:
            found *= np.exp(keys.index * (log - np.log(reference_radius(scene))))  # eq. (2)
    else:
        rise = 0.5 * (keys.outer_alpha - keys.inner_alpha)
        found = keys.inner_alpha + rise * (1.0 + np.tanh((log - np.log(keys.radius)) / keys.width))
    if keys.dead_alpha is not None:
        inner, outer = ((log - np.log(edge)) / keys.dead_width for edge in (keys.dead_inner, keys.dead_outer))
        found += 0.5 * (np.tanh(inner) - np.tanh(outer)) * (keys.dead_alpha - found)  # eq. (3)
    return found


def reference_radius(scene: Scene) -> float:
    """Where a power of r has the value of `alpha`: the start's reference radius; 1 for the caller's own particles."""
    return getattr(scene.initial, "reference_radius", 1.0)


def diffusivity(scene: Scene, r: Array, sound_speed: Array | None = None) -> Array:
    """nu (n,) at the radii `r` (n,) in code units, eq. (1).

    sound_speed: c_s (n,) of the gas there; without it, that of the temperature that the scene starts with, which a
    polytrope does not have.
    """
    keys: Any = scene.table("alpha_viscosity")
    if keys.nu is not None:
        return np.full(np.shape(r), keys.nu)
    r = np.maximum(r, 1e-300)
    if sound_speed is None:
        sound_speed = profile.sound_speed(scene, r, np.ones_like(r))
    return alpha(scene, r) * sound_speed**2 / profile.kepler_omega(scene, r)


def radial_flow(
    scene: Scene,
    r: Array,
    surface_density: Callable[[Array], Array],
    sound_speed: Callable[[Array], Array] | None = None,
) -> Array:
    """Radial velocity (n,) at the radii `r` (n,) of a disc that its viscosity moves, eq. (4), where Sigma is not 0.

    surface_density, sound_speed: functions of radii (n,), of the smooth disc. Off by about STEP^2 of itself where
    these vary over r.
    """

    def torque(radius: Array) -> Array:
        speed = None if sound_speed is None else sound_speed(radius)
        return diffusivity(scene, radius, speed) * surface_density(radius) * np.sqrt(radius)

    rise = torque(r * np.exp(STEP)) - torque(r * np.exp(-STEP))
    return -1.5 * rise / (STEP * r**1.5 * surface_density(r))  # eq. (4)
