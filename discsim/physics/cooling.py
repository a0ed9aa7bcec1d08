"""What cooling gas cools to, and by what law, in code units: the passive disc's u = (H/r)^2 (G M / r) / (gamma - 1),
H/r ~ r^((1 - q)/2), and the constants of its light.
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
    """(u, q, least r^2) of the energy that gas cools to, u r^-q with u that at radius 1; q = 0 where it is uniform.

    The keys of [cooling] go before those of gas.eos.
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
    """The energy (n,) that gas at radius `r` cools to."""
    at_one, q, least = passive_law(scene)
    return at_one * np.maximum(np.asarray(r, float) ** 2, least) ** (-0.5 * q)


def cooling_time(scene: Scene, r: Array) -> Array:
    """t_cool (n,) at radius `r`, of cooling by a time."""
    own: Any = scene.cooling
    r = np.asarray(r, float)
    return own.beta / kepler_omega(scene, r) if own.kind == "beta" else np.full(r.shape, own.t_cool)


def light(scene: Scene) -> Array:
    """What radiative cooling takes of physics, in code units: 2 sigma (T/u)^4, the code unit of density in g/cm3 at a
    height of one unit of length, (c/u)^2 of the isothermal speed, T/u in K, and cm2/g.
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


def depth(tau: Array) -> Array:
    """tau_eff of a disc whose midplane is below an optical depth tau (Hubeny 1990, ApJ 351, 632)."""
    return 0.375 * tau + 0.25 * math.sqrt(3.0) + 0.25 / tau
