"""Target energy, cooling time and radiative constants of cooling gas, in code units.

The target energy is that of a disc heated only by the star, u = (H/r)^2 (G M / r) / (gamma - 1), with
H/r ~ r^((1 - q)/2).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.physics.centre import kepler_omega, passive_speed

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray


def passive_law(scene: Scene) -> Array:
    """Return (u_1, q, r2_min) of the target energy u = u_1 max(r^2, r2_min)^(-q/2); q = 0 if it is uniform.

    Keys of [cooling] take precedence over those of gas.eos.
    """
    own: Any = scene.cooling
    eos: Any = scene.gas.eos
    ratio = own.aspect_ratio if own.aspect_ratio is not None else eos.aspect_ratio
    if ratio is None:
        return np.array([eos.sound_speed**2 / eos.gamma / (eos.gamma - 1.0), 0.0, 0.0])
    q = own.temperature_index if own.temperature_index is not None else eos.temperature_index
    r0 = own.reference_radius if own.reference_radius is not None else eos.reference_radius
    return np.array([passive_speed(scene, ratio, r0) ** 2 * r0**q / (eos.gamma - 1.0), q, (1e-12 * r0) ** 2])


def passive_energy(scene: Scene, r: Array) -> Array:
    """Return the target energy (n,) of cooling at radius `r` (n,)."""
    at_one, q, least = passive_law(scene)
    return at_one * np.maximum(np.asarray(r, float) ** 2, least) ** (-0.5 * q)


def cooling_time(scene: Scene, r: Array) -> Array:
    """Return t_cool (n,) at radius `r` (n,) where it is a constant or proportional to 1 / Omega."""
    own: Any = scene.cooling
    r = np.asarray(r, float)
    return own.beta / kepler_omega(scene, r) if own.kind == "beta" else np.full(r.shape, own.t_cool)


def radiative_constants(scene: Scene) -> Array:
    """Return the constants (5,) of radiative cooling.

    In this order: 2 sigma (T/u)^4 in code units; the code unit of volume density in g/cm3; c_T^2 / u with the
    isothermal sound speed c_T; T/u in K per code unit; 1 cm2/g in code units.
    """
    from discsim.scene.astropy_units import constants

    eos: Any = scene.gas.eos
    units = scene.units
    molecule = eos.mean_molecular_weight * (constants.m_p + constants.m_e).cgs.value  # that of the snapshots
    per_energy = (eos.gamma - 1.0) * molecule / constants.k_B.cgs.value * units.cgs("specific_energy")
    flux = units.cgs("energy") / units.cgs("length") ** 2 / units.cgs("time")
    stefan = constants.sigma_sb.cgs.value / flux
    return np.array(
        [
            2.0 * stefan * per_energy**4,
            units.cgs("volume_density"),
            eos.gamma - 1.0,
            per_energy,
            1.0 / units.cgs("opacity"),
        ]
    )


def effective_depth(tau: Array) -> Array:
    """Return the effective optical depth (n,) of a disc whose midplane has the optical depth `tau` (n,).

    The formula is that of Hubeny (1990, ApJ 351, 632).
    """
    return 0.375 * tau + 0.25 * math.sqrt(3.0) + 0.25 / tau
