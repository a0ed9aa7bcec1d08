"""Growth of grains as functions of a scene (`[growth]`): sizes, alpha, small dust carried by gas. Numpy only.

Gas particles carry the small dust, with sizes from a_min to a_*. With two-way drag their mass includes the small dust.
With one-way drag it does not, as dust must not change the gas.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.formulas import growth as formulas
from discsim.physics import profile, viscosity
from discsim.physics.grains import epstein_stopping_time

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.physics.local import Local
    from discsim.scene import Scene

Array = np.ndarray
RANGE = 200.0  # default of a_* / a_min: that of the usual 1 um and 5e-3 um
SEED = 1e-12  # fraction of a dust particle's share of all dust that it keeps if all dust is small


def smallest_size(scene: Scene) -> float:
    """Return a_min in code units."""
    keys: Any = scene.table("growth")
    return keys.small_size / RANGE if keys.smallest is None else keys.smallest


def small_ratio(scene: Scene) -> float:
    """Return the initial mass ratio of small dust to gas."""
    keys: Any = scene.table("growth")
    (dust,) = scene.dust or ()
    return dust.ratio if keys.small_ratio is None else keys.small_ratio


def small_at(scene: Scene, r: Array, dust_share: Callable[[Array], Array] | None) -> Array:
    """Return the initial mass ratio (n,) of small dust to gas at radii `r` (n,).

    dust_share: return a factor (n,) of the dust-to-gas ratio at radii (n,); None for a factor of 1.
    """
    (dust,) = scene.dust or ()
    there = (r >= (dust.inner or 0.0)) & (r <= (dust.outer or np.inf))
    return np.where(there, small_ratio(scene), 0.0) * (1.0 if dust_share is None else dust_share(r))


def small_dust_in_mass(scene: Scene) -> bool:
    """Return whether the mass of gas particles includes the small dust that they carry."""
    return scene.table("growth") is not None and scene.drag is not None and scene.drag.direction == "two-way"


def gas_share(scene: Scene, gas: Gas, piece: slice = slice(None)) -> Array | float:
    """Return the mass fraction (n,) of gas in the gas particles `piece`; 1 if their mass excludes small dust."""
    assert gas.small is not None
    return 1.0 - gas.small[piece] / gas.mass[piece] if small_dust_in_mass(scene) else 1.0


def alpha(scene: Scene, r: Array, speed2: Array, omega: Array) -> Array:
    """Return the turbulence parameter alpha (n,) at radii `r` (n,). speed2 (n,): c_s^2. omega (n,): Omega."""
    keys: Any = scene.table("growth")
    if keys.alpha is not None:
        return np.full(np.shape(r), keys.alpha)
    nu = scene.table("alpha_viscosity").nu
    if nu is not None:
        return np.divide(nu * omega, speed2, out=np.zeros_like(speed2), where=speed2 > 0.0)
    return viscosity.alpha(scene, np.maximum(r, 1e-300))


class Limits(NamedTuple):
    """Limits of grain growth at sample points, arrays (n,).

    fragmentation: largest size that fragmentation allows, eq. (6) of `formulas/growth.py`. drift: size at which drift
    is as fast as growth. stokes: Stokes number at the smaller of these sizes, but at least at a_*. time: growth time.
    """

    fragmentation: Array
    drift: Array
    stokes: Array
    time: Array


def limits(scene: Scene, at: Local) -> Limits | None:
    """Return the growth limits at the points of `at`, for the initial dust; None if the scene is not a disc.

    The drift limit is 2 Sigma_d / (pi rho_s gamma) (v_K / c_s)^2, gamma = |d ln P / d ln r|, as in Birnstiel et al.
    (2012), eq. 18 without the factor f_d. P is the pressure integrated over height, as in the equation of motion of a
    run. The growth time is that of settled grains, Sigma_g / (Sigma_d Omega).
    """
    if at.radius is None or at.omega is None or at.thermal_speed is None:
        return None
    slopes = profile.pressure_slopes(scene, at.radius)
    if slopes is None:
        return None
    (dust,) = scene.dust or ()
    speed2, material = at.thermal_speed**2, dust.grain_density
    strength = alpha(scene, at.radius, speed2, at.omega)
    given = scene.table("growth").fragmentation_speed, material
    breaks = np.array(
        [
            formulas.fragmentation_size(sigma, given[0], a, float(np.sqrt(c2)), given[1])
            for sigma, a, c2 in zip(at.density, strength, speed2, strict=True)
        ]
    )
    steep = np.maximum(np.abs(slopes[0]), 1e-100)
    drift = 2.0 * dust.ratio * at.density / (np.pi * material * steep) * (at.radius * at.omega) ** 2 / speed2
    largest = np.maximum(np.minimum(breaks, drift), scene.table("growth").small_size)
    volume = at.density * at.omega / (np.sqrt(2.0 * np.pi) * at.thermal_speed)
    time = epstein_stopping_time(largest, material, at.thermal_speed, volume, scene.drag.convention)
    return Limits(breaks, drift, time * at.omega, 1.0 / (dust.ratio * at.omega))
