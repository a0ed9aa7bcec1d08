"""Fields of a snapshot in bins, which are pixels or rings; fields and sums over particles are cached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.bins import Bins
from discsim.output.fields.names import split_population
from discsim.output.populations import only_population
from discsim.parts import FIELDS

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray


@dataclass(frozen=True)
class Optics:
    """Wavelength and opacity of dust, as astropy Quantities, for the fields emission and optical_depth.

    The opacity is per mass of dust. By default it is 10 cm2/g (nu / 1 THz), from Beckwith et al. (1990).
    """

    wavelength: Any
    opacity: Any = None

    @property
    def frequency(self) -> float:
        """Frequency in Hz."""
        from discsim.scene.astropy_units import units as u

        return float(self.wavelength.to_value(u.Hz, equivalencies=u.spectral()))

    @property
    def opacity_cgs(self) -> float:
        """Opacity in cm2 per gram of dust."""
        return 10.0 * self.frequency / 1e12 if self.opacity is None else float(self.opacity.to_value("cm2/g"))

    def planck(self, temperature: Array) -> Array:
        """Return B_nu(T) in mJy/arcsec2 for temperatures in K; 0 at T = 0."""
        from discsim.scene.astropy_units import constants, units

        nu, h, c, k = self.frequency, *(getattr(constants, name).cgs.value for name in ("h", "c", "k_B"))
        with np.errstate(divide="ignore", over="ignore"):
            brightness = 2.0 * h * nu**3 / c**2 / np.expm1(h * nu / (k * temperature))
        return brightness * units.Unit("erg / (s cm2 Hz sr)").to("mJy/arcsec2")

    @property
    def text(self) -> str:
        """Wavelength and opacity as text for a figure."""
        return rf"$\lambda$ = {self.wavelength:.3g}, $\kappa$ = {self.opacity_cgs:.3g} cm$^2$ per g of dust"

    @classmethod
    def default(cls) -> Optics:
        from discsim.scene.astropy_units import units

        return cls(1.3 * units.mm)


class BinnedFields:
    """The fields of a snapshot in bins, in code units: `binned["gas.v_r"]` is the array of a field.

    `bins_of` returns the bins of particles. `binned["dust.0.v_r"]` is the field of one population of dust.
    """

    def __init__(
        self, snap: Snapshot, bins_of: Callable[[SnapshotParticles], Bins], optics: Optics | None = None
    ) -> None:
        self.snap, self._bins_of, self._optics = snap, bins_of, optics
        self._bins: dict[str, Bins] = {}
        self._found: dict[str, Array] = {}
        self._populations: dict[str, BinnedFields] = {}

    @cached_property
    def optics(self) -> Optics:
        return self._optics or Optics.default()

    def __getitem__(self, name: str) -> Array:
        """Return the field `name` in each bin: a density (0 in empty bins), or a mean (NaN for too little mass)."""
        if name not in self._found:
            self._found[name] = self._compute(name)
        return self._found[name]

    def _compute(self, name: str) -> Array:
        population, plain = split_population(name)
        if population is not None:
            return self.of_population(population)[plain]
        field = FIELDS[name]
        if field.kind == "places":
            return field.values(self)
        values, bins = field.values(self.snap), self.bins(field.species)
        if field.kind == "density":
            return bins.sum(values) / bins.measure
        return self.mean(field.species, values)

    def of_population(self, population: str) -> BinnedFields:
        """Return the fields of one population of dust, in the same bins."""
        if population not in self._populations:
            apart = only_population(self.snap, population)
            self._populations[population] = BinnedFields(apart, self._bins_of, self._optics)
        return self._populations[population]

    def mean(self, species: str, values: Array) -> Array:
        """Return the mass-weighted mean of `values` (n,) of the particles of a species; NaN for too little mass.

        Infinite values, such as Stokes numbers of grains without gas, are left out.
        """
        bins, mass, infinite = self.bins(species), self.mass(species), np.isinf(values)
        if infinite.any():
            values = np.where(infinite, 0.0, values)
            mass = bins.sum(np.where(infinite, 0.0, self.snap.species[species].mass))
        weighted = bins.sum(self.snap.species[species].mass * values)
        return np.divide(weighted, mass, where=bins.has_enough_mass(mass), out=np.full(mass.shape, np.nan))

    def has_enough_mass(self, species: str) -> Array:
        """Return a mask of the bins with enough mass of a species for a mean."""
        return self.bins(species).has_enough_mass(self.mass(species))

    def mass(self, species: str) -> Array:
        """Return the mass of a species in each bin."""
        key = f"{species} mass"
        if key not in self._found:
            self._found[key] = self.bins(species).sum(self.snap.species[species].mass)
        return self._found[key]

    def bins(self, species: str) -> Bins:
        """Return the bins of a species."""
        if species not in self._bins:
            self._bins[species] = self._bins_of(self.snap.species[species])
        return self._bins[species]
