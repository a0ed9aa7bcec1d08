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


def target_energy_law(scene: Scene) -> Array:
    """Return (u_1, q, r2_min) of the target energy u = u_1 max(r^2, r2_min)^(-q/2); q = 0 if it is uniform.

    Keys of [cooling] take precedence over those of gas.eos.
    """
    own: Any = scene.cooling
    eos: Any = scene.gas.eos
    ratio, q, r0 = (
        getattr(eos if getattr(own, key) is None else own, key)
        for key in ("aspect_ratio", "temperature_index", "reference_radius")
    )
    if ratio is None:
        return np.array([eos.sound_speed**2 / eos.gamma / (eos.gamma - 1.0), 0.0, 0.0])
    return np.array([passive_speed(scene, ratio, r0) ** 2 * r0**q / (eos.gamma - 1.0), q, (1e-12 * r0) ** 2])


def target_energy(scene: Scene, r: Array) -> Array:
    """Return the target energy (n,) of cooling at radius `r` (n,)."""
    at_one, q, least = target_energy_law(scene)
    return at_one * np.maximum(np.asarray(r, float) ** 2, least) ** (-0.5 * q)


def cooling_time(scene: Scene, r: Array) -> Array:
    """Return t_cool (n,) at radius `r` (n,), for cooling in a fixed time or in a time beta / Omega."""
    own: Any = scene.cooling
    r = np.asarray(r, float)
    return own.beta / kepler_omega(scene, r) if own.kind == "beta" else np.full(r.shape, own.t_cool)


def radiative_constants(scene: Scene) -> Array:
    """Return five constants of radiative cooling, with the temperature T and the specific energy u of the gas.

    In this order: 2 sigma (T/u)^4 in code units; the code unit of volume density in g/cm3; c_T^2 / u with the
    isothermal sound speed c_T; T/u in K per code unit; 1 cm2/g in code units.
    """
    from discsim.scene.astropy_units import constants

    eos: Any = scene.gas.eos
    units = scene.units
    molecule = eos.mean_molecular_weight * (constants.m_p + constants.m_e).cgs.value  # mass, as in snapshots
    per_energy = (eos.gamma - 1.0) * molecule / constants.k_B.cgs.value * units.cgs("specific_energy")
    flux = units.cgs("energy") / units.cgs("length") ** 2 / units.cgs("time")
    stefan = constants.sigma_sb.cgs.value / flux
    density, opacity = units.cgs("volume_density"), 1.0 / units.cgs("opacity")
    return np.array([2.0 * stefan * per_energy**4, density, eos.gamma - 1.0, per_energy, opacity])


def effective_depth(tau: Array) -> Array:
    """Return the effective optical depth (n,) of a disc with the optical depth `tau` (n,) from surface to midplane.

    The formula is from Hubeny (1990, ApJ 351, 632).
    """
    return 0.375 * tau + 0.25 * math.sqrt(3.0) + 0.25 / tau
