"""Temperature of dust for images: the temperature of the gas near each grain, or a given law.

    uniform:           T = T0
    power law:         T = T0 (r / r0)^-q                                              (1)
    passive disc:      T = [phi L / (8 pi sigma r^2)]^(1/4)                            (2)

with the luminosity L of the star and the grazing angle phi of its light (Chiang & Goldreich 1997, ApJ 490, 368).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.output.fields.display import positive_quantity
from discsim.scene.units import UnitError, clipped, parse_quantity

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
TemperatureLaw = Callable[[Array], Array]  # temperature in K as a function of the radius in au
NEIGHBOURS = 12  # gas particles over which the temperature at a grain is averaged
GRAZING_ANGLE = 0.05
EXPECTED = (
    'expected "20 K", a power law "150 K,1 au,0.5" (value, radius, index), or a luminosity "1 Lsun" '
    'or "1 Lsun,0.05" (with the grazing angle)'
)


def law_of(given: Any, prefix: str = "") -> TemperatureLaw | None:
    """Return the law of temperature that `given` means; None, for the temperature of the gas, if `given` is None.

    given: a text as in EXPECTED, a Quantity, or a function of radii (n,) in au that returns K. Raises PlotError.
    """
    if given is None or callable(given):
        return given
    name = f"{prefix}temperature"
    parts = [part.strip() for part in str(given).split(",")]
    try:
        first = given if hasattr(given, "unit") else parse_quantity(parts[0])
        if first.unit.is_equivalent("Lsun") and len(parts) <= 2:
            angle = float(parts[1]) if len(parts) == 2 else GRAZING_ANGLE
            at_au = _passive_disc_temperature(positive_quantity(first, name, "Lsun"), angle)
            return _power_law(at_au, 1.0, 0.5) if 0.0 < angle < 1.0 else _raise_fault(name, given)
        if len(parts) == 1 and first.unit.is_equivalent("K"):
            return _power_law(float(positive_quantity(first, name, "K").to_value("K")), 1.0, 0.0)
        if len(parts) == 3:
            value, radius = positive_quantity(first, name, "K"), positive_quantity(parts[1], name, "au")
            return _power_law(float(value.to_value("K")), float(radius.to_value("au")), float(parts[2]))
    except (UnitError, ValueError):
        pass
    return _raise_fault(name, given)


def _raise_fault(name: str, given: Any) -> Any:
    raise PlotError(f'{name}: "{clipped(str(given))}"; {EXPECTED}')


def _power_law(value: float, radius: float, index: float) -> TemperatureLaw:
    """Return the power law of eq. (1), with the temperature `value` in K at `radius` in au."""
    if not np.isfinite(index):
        raise ValueError(index)
    return lambda r: value * (np.maximum(r, 1e-300) / radius) ** -index


def _passive_disc_temperature(luminosity: Any, angle: float) -> float:
    """Return the temperature in K of a passive disc at 1 au, eq. (2)."""
    from discsim.scene.astropy_units import constants, units

    flux = angle * luminosity / (8.0 * np.pi * constants.sigma_sb * units.au**2)
    return float((flux**0.25).to_value("K"))


def temperatures(snap: Snapshot, pos: Array, law: TemperatureLaw | None) -> Array:
    """Return the temperature (n,) in K at positions (n, 2) in the disc.

    Without a law the temperature is the mean over the nearest gas particles, with Gaussian weights. Raises
    PlotError.
    """
    if law is not None:
        au = float(snap.units.quantity(1.0, "length").to_value("au"))
        found = np.asarray(law(au * np.hypot(*pos.T)), dtype=float)
        if found.shape != (len(pos),) or not np.isfinite(found).all() or (found < 0.0).any():
            raise PlotError(
                "temperature: the law gives values that are negative or not finite; expected a temperature "
                "in K for each radius"
            )
        return found
    if snap.gas is None or not snap.gas.count or snap.gas.temperature is None:
        raise PlotError("temperature: the snapshot has no gas with a temperature; " + EXPECTED)
    from scipy.spatial import cKDTree

    number = min(NEIGHBOURS, snap.gas.count)
    distance, near = cKDTree(snap.gas.pos).query(pos, k=np.arange(1, number + 1))
    scale = np.maximum(distance[:, -1:], 1e-300)
    weight = np.exp(-4.5 * (distance / scale) ** 2)  # the outermost neighbour is at three standard deviations
    mean: Array = (weight * snap.gas.temperature[near]).sum(axis=1) / weight.sum(axis=1)
    return mean
