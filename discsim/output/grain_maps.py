"""What the figure of a snapshot shows of grains: their mean size and Stokes number, and small dust that gas carries.

<s> = sum m s / sum m  over the particles about a pixel, of St in the same way
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.colors import LogNorm

from discsim.output.snapshot import Snapshot, SnapshotParticles, range_of_mass

Array = np.ndarray
COLOURS = {"size": "cividis", "stokes": "plasma"}  # by attribute of the particles


def shown(snap: Snapshot) -> list[str]:
    """The maps that there are, of a snapshot whose grains have sizes of their own and some mass."""
    dust = snap.dust
    if dust is None or dust.size is None or not (dust.mass > 0).any():
        return []
    return [name for name in COLOURS if getattr(dust, name) is not None]


def mean_map(snap: Snapshot, name: str, window: tuple[Array, Array], pixels: int, periodic: bool) -> tuple[Array, str]:
    """The mean on pixels [ix, iy], NaN where there is hardly any dust, and what it is; in cm or code units."""
    dust = snap.dust
    assert dust is not None
    values, label = getattr(dust, name), "mean Stokes number"
    if name == "size":
        physical = snap.units.system != "code"
        values = values * (float(snap.units.quantity(1.0, "length").to_value("cm")) if physical else 1.0)
        label = "mean size" + (" [cm]" if physical else "")
    sigma = dust.surface_density_map(*window, pixels, periodic)
    weighted = replace(dust, mass=dust.mass * values).surface_density_map(*window, pixels, periodic)
    there = sigma > range_of_mass(sigma)[0]
    return np.divide(weighted, sigma, where=there, out=np.full_like(sigma, np.nan)), label


def colours(mean: Array) -> LogNorm:
    """From the least to the greatest, but for half a per cent at each end."""
    seen = mean[mean > 0]
    if not seen.size:
        return LogNorm(0.1, 1.0, clip=True)
    low, high = np.quantile(seen, (0.005, 0.995))
    return LogNorm(low / 1.05, high * 1.05, clip=True)  # a mean that is the same everywhere has a range too


def small_dust(snap: Snapshot) -> SnapshotParticles | None:
    """Gas as carriers of the small dust in it; None where it carries none."""
    gas = snap.gas
    small = getattr(gas, "small", None)
    return None if gas is None or small is None else replace(gas, mass=small)
