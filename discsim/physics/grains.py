"""Grains of dust in gas: Epstein's stopping time, the mean free path of the gas, and size distributions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Array = np.ndarray
GOLDEN = 0.6180339887498949  # the fractional parts of n GOLDEN, n = 0, 1, ..., are evenly spread for any count


def epstein_stopping_time(
    grain_size: Any, grain_density: Any, sound_speed: Any, gas_density: Any, convention: str = "kinetic"
) -> Any:
    """Return the Epstein stopping time of a grain.

    Parameters
    ----------
    grain_size, grain_density : Quantity, float or ndarray
        Radius s and material density rho_s of the grain.
    sound_speed : Quantity, float or ndarray
        Isothermal sound speed c_s of the gas.
    gas_density : Quantity, float or ndarray
        Volume density rho_g of the gas.
    convention : {"kinetic", "papers"}
        "kinetic": t = sqrt(pi/8) s rho_s / (c_s rho_g), free-molecular drag with the mean molecular speed
        sqrt(8/pi) c_s; "papers": t = s rho_s / (c_s rho_g), as in Stoyanovskaya et al. 2018 (arXiv:1811.06506).

    Returns
    -------
    Quantity, float or ndarray
        Stopping time; astropy Quantities give a Quantity in SI base units.
    """
    factor = {"papers": 1.0, "kinetic": math.sqrt(math.pi / 8)}[convention]
    time = factor * grain_size * grain_density / (sound_speed * gas_density)
    return time.decompose() if hasattr(time, "decompose") else time


def mean_free_column(scene: Any) -> float:
    """Return m / sigma, the mean free path times the gas density, in code units.

    m and sigma are mass and cross-section of a molecule. The result is drag.mean_free_column or, by default, follows
    from the scene's mean molecular weight and the cross-section of H2, 2e-15 cm^2 (Chapman & Cowling 1970).
    """
    if scene.drag.mean_free_column is not None:
        return scene.drag.mean_free_column
    from discsim.scene.astropy_units import constants

    molecule = scene.table(scene.model.table).eos.mean_molecular_weight * constants.u.cgs.value
    return molecule / 2e-15 / scene.units.cgs("surface_density")


def has_sizes(population: Any) -> bool:
    """Return whether a dust population has a distribution of grain sizes."""
    return hasattr(population.grain_size, "smallest")


def has_individual_sizes(scene: Any) -> bool:
    """Return whether dust particles have individual grain sizes, from a size distribution or growth."""
    return scene.table("growth") is not None or any(map(has_sizes, scene.dust or ()))


def sampled_sizes(population: Any, count: int) -> tuple[Array, Array]:
    """Return the grain sizes (count,) of particles of a population, and their masses over the mean mass (count,).

    The number density of grains is n(s) ~ s^-index. Consecutive particles have very different sizes, so that all sizes
    are present in every region.
    """
    if not has_sizes(population):
        return np.full(count, population.grain_size), np.ones(count)
    given = population.grain_size
    fraction, bins = (0.5 + GOLDEN * np.arange(count)) % 1.0, given.bins  # of the range of ln s
    if bins is not None:
        fraction = (np.floor(fraction * bins) + 0.5) / bins
    size = given.smallest * (given.largest / given.smallest) ** fraction
    weight = (size / given.largest) ** (4.0 - given.index)  # m dn/d ln s, to which the mass of a bin is proportional
    return size, weight / weight.mean()


def typical_size(population: Any) -> float:
    """Return the mass-weighted mean size of a population's grains."""
    if not has_sizes(population):
        return float(population.grain_size)
    size, weight = sampled_sizes(population, population.grain_size.bins or 1000)
    return float((size * weight).sum() / weight.sum())
