"""Grains of a snapshot in groups of one size each, as codes of radiative transfer need them.

A population with one grain size is one group. Grains of many sizes are divided into bins of equal width in ln s, and
small dust of [growth] is one more group. Each grain is in exactly one group, so that the mass of each is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.output.populations import grain_sizes, small_dust_size
from discsim.scene.populations import populations_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from discsim.output.snapshot import Snapshot
    from discsim.sky.opacity import Opacity

Array = np.ndarray
SAME = 1e-9  # largest relative difference of two equal sizes
WAVELENGTHS = (0.1, 1e4)  # micrometres: shortest and longest


@dataclass(frozen=True)
class Grains:
    """Grains of about one size.

    `pos` (n, 2) and `mass` (n,) are in code units, `size` (n,) is the radius in cm (None if the run has no sizes),
    `stokes` (n,) the Stokes number (None for dust that follows the gas), and `population` (n,) the number of the
    population, as opacities need it. `text` is for readers.
    """

    text: str
    pos: Array
    mass: Array
    size: Array | None
    stokes: Array | None
    population: Array

    @property
    def mean_size(self) -> float | None:
        """Radius in cm: the mean of ln s over mass; None if the run has no sizes."""
        return None if self.size is None else float(np.exp(np.average(np.log(self.size), weights=self.mass)))

    def absorption(self, opacity: Opacity, wavelengths: Array) -> Array:
        """Return the opacity (m,) in cm2/g at wavelengths (m,) in um, the mean over the mass. Raises PlotError."""
        from discsim.scene.astropy_units import units as u

        one_size = self.size is None or self.size.min() == self.size.max()
        chosen = slice(1) if one_size and (self.population == self.population[0]).all() else slice(None)
        size = None if self.size is None else self.size[chosen]
        return np.array([
            np.average(opacity.absorption(each * u.um, self.population[chosen], size), weights=self.mass[chosen])
            for each in wavelengths
        ])  # fmt: skip

    def chosen(self, mask: Array, text: str) -> Grains:
        """Return the grains of a mask (n,)."""
        size, stokes = (None if array is None else array[mask] for array in (self.size, self.stokes))
        return Grains(text, self.pos[mask], self.mass[mask], size, stokes, self.population[mask])


def grains_of(snap: Snapshot) -> list[Grains]:
    """Return the grains of each population, and small dust. Raises PlotError for a run without dust or drag."""
    found = []
    dust, gas = snap.dust, snap.gas
    if dust is not None and dust.count:
        if dust.stokes is None:
            raise PlotError(
                "the snapshot has no Stokes numbers, on which the height of a dust layer depends; expected a run with "
                "[drag]"
            )
        number = np.zeros(dust.count, int) if dust.species is None else np.asarray(dust.species, dtype=int)
        every = Grains("", dust.pos, dust.mass, grain_sizes(snap), dust.stokes, number)
        found = [
            every.chosen(number == p.number, p.text) for p in populations_of(snap.tables) if (number == p.number).any()
        ]
    if gas is not None and gas.small is not None and gas.small.sum() > 0.0:
        size, number = np.full(gas.count, small_dust_size(snap)), np.zeros(gas.count, int)
        found.append(Grains("small dust", gas.pos, gas.small, size, None, number))
    if not found:
        raise PlotError("the snapshot has no dust; expected a run with [dust]")
    return found


def groups_of(grains: Sequence[Grains], bins: int) -> list[Grains]:
    """Return groups of about one size each: the populations, with `bins` bins in ln s for grains of many sizes."""
    found = []
    for each in grains:
        if each.size is None or each.size.max() <= each.size.min() * (1.0 + SAME):
            found.append(each)
            continue
        ends = np.linspace(np.log(each.size.min()), np.log(each.size.max()), bins + 1)
        number = np.clip(np.searchsorted(ends, np.log(each.size), side="right") - 1, 0, bins - 1)
        for k in np.unique(number):
            low, high = np.exp(ends[k : k + 2])
            found.append(each.chosen(number == k, f"{each.text}: {low:.3g} to {high:.3g} cm"))
    return found


def groups_at_equal_ratios(grains: Sequence[Grains], bins: int) -> list[tuple[float, Grains | None]]:
    """Return (radius in cm, grains) at radii with one ratio from each to the next; None where no grain belongs.

    If the sizes of the grains have such radii, these are returned, otherwise `bins` radii from the smallest to the
    largest size; each grain belongs to the nearest in ln s. Raises PlotError if the run has no grain sizes.
    """
    if any(each.size is None for each in grains):
        raise PlotError("the run has no grain sizes, which MCFOST needs; expected dust.grain_size in the scene")
    sizes = np.concatenate([each.size for each in grains if each.size is not None])
    log = np.log(sizes)
    own = np.unique(np.round(log, 9))
    gaps = np.diff(own)
    if len(own) > 1 and not (len(own) <= max(bins, 2) and np.ptp(gaps) < 1e-6):
        own = np.linspace(log.min(), log.max(), max(bins, 2))
    nearest = np.searchsorted(0.5 * (own[1:] + own[:-1]), log)
    # dust that follows the gas has the Stokes number 0
    stokes = np.concatenate([np.zeros(len(each.mass)) if each.stokes is None else each.stokes for each in grains])
    pos, mass, number = (
        np.concatenate([getattr(each, name) for each in grains]) for name in ("pos", "mass", "population")
    )
    every = Grains("", pos, mass, sizes, stokes, number)
    found: list[tuple[float, Grains | None]] = []
    for k, value in enumerate(own):
        radius = float(np.exp(value))
        mask = nearest == k
        found.append((radius, every.chosen(mask, f"{radius:.4g} cm") if mask.any() else None))
    return found


def wavelength_range(opacity: Opacity) -> tuple[float, float]:
    """Return the part of WAVELENGTHS in micrometres that the opacities cover."""
    low, high = WAVELENGTHS
    table = getattr(opacity, "wavelength", None)
    return (low, high) if table is None else (max(low, 1e3 * float(table[0])), min(high, 1e3 * float(table[-1])))
