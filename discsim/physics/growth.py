"""Growth of grains as functions of a scene (`[growth]`): sizes, alpha, small dust carried by gas. Numpy only.

Gas particles carry the small dust, with sizes from a_min to a_*. With two-way drag their mass includes the small dust.
With one-way drag it does not, as dust must not change the gas.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.formulas import growth as formulas
from discsim.physics import profile, viscosity
from discsim.physics.grains import epstein_stopping_time

if TYPE_CHECKING:
    from discsim.numerics.state import Gas
    from discsim.physics.local import GasSamples
    from discsim.scene import Scene

Array = np.ndarray
RANGE = 200.0  # default of a_* / a_min, the ratio of the usual 1 um and 5e-3 um
SEED = 1e-12  # smallest mass of a dust particle, as a fraction of the total dust mass per particle


def smallest_size(scene: Scene) -> float:
    """Return a_min in code units."""
    keys = scene.table("growth")
    return keys.small_size / RANGE if keys.smallest is None else keys.smallest


def small_ratio(scene: Scene) -> float:
    """Return the initial mass ratio of small dust to gas."""
    keys = scene.table("growth")
    (dust,) = scene.dust or ()
    return dust.ratio if keys.small_ratio is None else keys.small_ratio


def small_ratio_at(scene: Scene, r: Array, dust_share: Callable[[Array], Array] | None) -> Array:
    """Return the initial mass ratio (n,) of small dust to gas at radii `r` (n,).

    dust_share: function that returns a factor (n,) of the dust-to-gas ratio at radii (n,); None for a factor of 1.
    """
    (dust,) = scene.dust or ()
    has_dust = (r >= (dust.inner or 0.0)) & (r <= (dust.outer or np.inf))
    return np.where(has_dust, small_ratio(scene), 0.0) * (1.0 if dust_share is None else dust_share(r))


def gas_mass_includes_small_dust(scene: Scene) -> bool:
    """Return whether the mass of gas particles includes the small dust that they carry."""
    return scene.table("growth") is not None and scene.drag is not None and scene.drag.direction == "two-way"


def gas_fraction(scene: Scene, gas: Gas, rows: slice = slice(None)) -> Array | float:
    """Return the mass fraction (n,) of gas without small dust in the gas particles `rows`; 1 with one-way drag."""
    return 1.0 - gas.small[rows] / gas.mass[rows] if gas_mass_includes_small_dust(scene) else 1.0


def alpha(scene: Scene, r: Array, speed2: Array, omega: Array) -> Array:
    """Return the turbulence parameter alpha (n,) at radii `r` (n,). speed2 (n,): c_T^2. omega (n,): Omega."""
    keys = scene.table("growth")
    if keys.alpha is not None:
        return np.full(np.shape(r), keys.alpha)
    nu = scene.table("alpha_viscosity").nu
    if nu is not None:
        return np.divide(nu * omega, speed2, out=np.zeros_like(speed2), where=speed2 > 0.0)
    return viscosity.alpha(scene, np.maximum(r, 1e-300))


class Limits(NamedTuple):
    """Limits of grain growth at sample points, arrays (n,).

    fragmentation: largest size that fragmentation allows, eq. (6) of `formulas/growth.py`. drift: size at which drift
    is as fast as growth. stokes: Stokes number at the smaller of these sizes, or at a_* if a_* is larger. time: growth
    time.
    """

    fragmentation: Array
    drift: Array
    stokes: Array
    time: Array


def limits(scene: Scene, at: GasSamples) -> Limits | None:
    """Return the growth limits of the initial dust at the points of `at`; None if the scene is not a disc.

    The drift limit is 2 Sigma_d / (pi rho_s gamma) (v_K / c_s)^2, gamma = |d ln P / d ln r|, as in Birnstiel et al.
    (2012), eq. 18 without the factor f_d. P is the pressure integrated over height, as in the equation of motion of a
    run. The growth time of settled grains is Sigma_g / (Sigma_d Omega).
    """
    if at.radius is None or at.omega is None or at.thermal_speed is None:
        return None
    slopes = profile.pressure_slopes(scene, at.radius)
    if slopes is None:
        return None
    (dust,) = scene.dust or ()
    speed2, material = at.thermal_speed**2, dust.grain_density
    strength = alpha(scene, at.radius, speed2, at.omega)
    keys = scene.table("growth")
    points = zip(at.density, strength, speed2, strict=True)
    breaks = [
        formulas.fragmentation_size(sigma, keys.fragmentation_speed, a, float(np.sqrt(c2)), material)
        for sigma, a, c2 in points
    ]
    steep = np.maximum(np.abs(slopes[0]), 1e-100)
    drift = 2.0 * dust.ratio * at.density / (np.pi * material * steep) * (at.radius * at.omega) ** 2 / speed2
    largest = np.maximum(np.minimum(breaks, drift), keys.small_size)
    volume = at.density * at.omega / (np.sqrt(2.0 * np.pi) * at.thermal_speed)
    time = epstein_stopping_time(largest, material, at.thermal_speed, volume, scene.drag.convention)
    return Limits(np.array(breaks), drift, time * at.omega, 1.0 / (dust.ratio * at.omega))
