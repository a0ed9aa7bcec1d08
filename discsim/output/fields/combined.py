"""Fields that combine gas and dust: the dust-to-gas ratio, and emission and optical depth of the dust.

The intensity is that of optically thin dust at the temperature T of the gas, seen face-on:

    I_nu = kappa_nu Sigma_d B_nu(T),    tau = kappa_nu Sigma_d

The opacity per mass of dust kappa_nu is an argument, by default 10 cm2/g (nu / 1 THz), from Beckwith et al. (1990,
AJ 99, 924).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.output.fields import base

if TYPE_CHECKING:
    from discsim.output.fields.binned import BinnedFields

Array = np.ndarray
SMALL = ("gas.small",)


@base.of_places(
    "",
    r"dust-to-gas ratio $\Sigma_\mathrm{dust} / \Sigma_\mathrm{gas}$",
    needs=("gas.mass", "dust.mass"),
    reads=SMALL,
    colours="plasma",
)
def dust_to_gas(at: BinnedFields) -> Array:
    """dust-to-gas ratio: (Sigma_d + Sigma_s) / Sigma, with small dust"""
    gas = at["gas.surface_density"]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(at.has_enough_mass("gas") & at.has_enough_mass("dust"), _all_dust(at) / gas, np.nan)


@base.of_places("", r"optical depth $\tau$", needs=("dust.mass", "physical", "plane"), reads=SMALL, colours="inferno")
def optical_depth(at: BinnedFields) -> Array:
    """optical depth at --wavelength, seen face-on: tau = kappa Sigma_dust"""
    return at.optics.opacity_cgs * _all_dust(at) * at.snap.units.cgs("surface_density")


@base.of_places(
    "intensity", r"$I_\nu$", needs=("gas.temperature", "dust.mass", "physical", "plane"), reads=SMALL, colours="inferno"
)
def emission(at: BinnedFields) -> Array:
    """optically thin emission of dust at the gas's temperature, at --wavelength: I = kappa Sigma_dust B(T)"""
    return optical_depth.values(at) * at.optics.planck(np.nan_to_num(at["gas.temperature"]))


def _all_dust(at: BinnedFields) -> Array:
    """Return the surface density of all dust in each bin: that of dust particles and of small dust in gas particles."""
    dust = at["dust.surface_density"]
    return dust if at.snap.gas is None or at.snap.gas.small is None else dust + at["small_dust.surface_density"]
