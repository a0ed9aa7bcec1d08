"""Grains of dust in gas: Epstein's stopping time, and the mean free path beyond which another regime begins."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Array = np.ndarray
GOLDEN = 0.6180339887498949  # multiples of it, without their whole part, are spread evenly from the first few on


def epstein_stopping_time(
    grain_size: Any, grain_density: Any, sound_speed: Any, gas_density: Any, convention: str = "kinetic"
) -> Any:
    """Epstein stopping time of a grain, from astropy Quantities; `gas_density` is the volume density, c_s isothermal.

    "kinetic": t = sqrt(pi/8) s rho_s / (c_s rho_g), free-molecular drag, with the mean molecular speed sqrt(8/pi) c_s;
    "papers": t = s rho_s / (c_s rho_g), as in Stoyanovskaya et al. 2018 (arXiv:1811.06506).
    """
    factor = {"papers": 1.0, "kinetic": math.sqrt(math.pi / 8)}[convention]
    time = factor * grain_size * grain_density / (sound_speed * gas_density)
    return time.decompose() if hasattr(time, "decompose") else time


def mean_free_column(scene: Any) -> float:
    """Column density of gas in one mean free path, m / sigma, in code units: of the scene, or of its mean molecule with
    the cross-section of H2, 2e-15 cm^2 (Chapman & Cowling 1970)."""
    if scene.drag.mean_free_column is not None:
        return scene.drag.mean_free_column
    from discsim.scene.astropy_units import constants

    molecule = scene.table(scene.model.table).eos.mean_molecular_weight * constants.u.cgs.value
    return molecule / 2e-15 / scene.units.cgs("surface_density")


def has_sizes(population: Any) -> bool:
    """Whether the grains of a population of dust have sizes of their own."""
    return hasattr(population.grain_size, "smallest")


def own_sizes(scene: Any) -> bool:
    """Whether dust particles have sizes of their own: given ones, or those that they grow to."""
    return scene.table("growth") is not None or any(map(has_sizes, scene.dust or ()))


def sizes_of(population: Any, count: int) -> tuple[Array, Array]:
    """Sizes of `count` particles of a population (n,), and masses over their mean, such that n(s) ~ s^-index.

    Particles next to each other have sizes far apart, so that all sizes are everywhere.
    """
    if not has_sizes(population):
        return np.full(count, population.grain_size), np.ones(count)
    given = population.grain_size
    place, bins = (0.5 + GOLDEN * np.arange(count)) % 1.0, given.bins
    if bins is not None:
        place = (np.floor(place * bins) + 0.5) / bins
    size = given.smallest * (given.largest / given.smallest) ** place
    weight = (size / given.largest) ** (4.0 - given.index)  # m dn/d ln s; of a bin in ln s the same but for a factor
    return size, weight / weight.mean()


def typical_size(population: Any) -> float:
    """The mean size, by mass, of a population's grains: what previews show."""
    if not has_sizes(population):
        return float(population.grain_size)
    size, weight = sizes_of(population, population.grain_size.bins or 1000)
    return float((size * weight).sum() / weight.sum())
