"""Beam of a telescope, and noise that the beam correlates.

An image in Jy per beam is the intensity, averaged with an elliptical Gaussian, times the beam's solid angle. Noise is
white noise averaged in the same way, scaled to the rms asked for.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.output.fields.display import positive_quantity
from discsim.scene.units import UnitError, clipped, parse_quantity
from discsim.sky.orientation import angle

Array = np.ndarray
MIN_PIXELS = 3.0  # smallest full width of a beam in pixels; a narrower one is sampled badly
MARGIN = 4.0  # standard deviations of the beam to which the convolution reaches


def beam_of(given: Any, prefix: str = "") -> Any:
    """Return a beam of radio_beam, or None for None.

    given: a text like "0.05 arcsec" or "0.06 arcsec,0.04 arcsec,30 deg" (full widths at half maximum, position angle
    of the longer axis), the same values as Quantities, or a radio_beam.Beam. Raises PlotError.
    """
    if given is None or hasattr(given, "major"):
        return given
    from radio_beam import Beam

    name = f"{prefix}beam"
    parts = given.split(",") if isinstance(given, str) else given if isinstance(given, list | tuple) else [given]
    if len(parts) not in (1, 3):
        raise PlotError(
            f'{name}: "{clipped(str(given))}"; expected a full width "0.05 arcsec", or three values '
            f"separated by commas: full widths "
            "along the major and the minor axis, and the position angle"
        )
    widths = [positive_quantity(part, name, "arcsec") for part in parts[:2]]
    major, minor = widths[0], widths[-1]
    if minor > major:
        raise PlotError(
            f'{name}: "{clipped(str(given))}": the second width is larger than the first; give the larger width first'
        )
    turned = angle(parts[2], name) if len(parts) == 3 else 0.0
    from discsim.scene.astropy_units import units as u

    return Beam(major, minor, u.Quantity(turned, "rad").to("deg"))


def kernel_of(beam: Any, pixel: float, prefix: str = "") -> Array:
    """Return the beam (odd, odd) on pixels of `pixel` arcsec, with sum 1. Raises PlotError if the beam is too narrow.

    The first index increases to the north, the second to the west.
    """
    from discsim.scene.astropy_units import units as u

    narrow = float(beam.minor.to_value("arcsec")) / pixel
    if narrow < MIN_PIXELS:
        raise PlotError(
            f"{prefix}beam: {narrow:.2g} pixels wide, below {MIN_PIXELS:g}; choose a wider beam, more "
            f"{prefix}pixels, or a smaller {prefix}fov"
        )
    sigma = float(beam.major.to_value("arcsec")) / pixel / np.sqrt(8.0 * np.log(2.0))
    size = 2 * int(np.ceil(MARGIN * sigma)) + 1
    values: Array = beam.as_kernel(pixel * u.arcsec, x_size=size, y_size=size).array
    return values / values.sum()


def convolved(values: Array, kernel: Array) -> Array:
    """Return a map convolved with a kernel; outside of the map are zeros."""
    from astropy.convolution import convolve_fft

    found: Array = convolve_fft(
        values, kernel, boundary="fill", fill_value=0.0, normalize_kernel=False, allow_huge=True
    )
    return found


def noise_of(given: Any, prefix: str = "") -> float:
    """Return the rms of noise in Jy per beam from a text like "20 uJy" or "20 uJy/beam", or a Quantity; 0 for None.

    Raises PlotError.
    """
    if given is None:
        return 0.0
    expected = 'a flux density for each beam, above 0, like "20 uJy/beam"'
    try:
        value = given if hasattr(given, "unit") else parse_quantity(str(given), expected)
        for unit in ("Jy", "Jy/beam"):
            if value.unit.is_equivalent(unit) and np.ndim(value.value) == 0 and 0.0 < value.to_value(unit) < np.inf:
                return float(value.to_value(unit))
    except UnitError as error:
        raise PlotError(f"{prefix}noise: {error}") from None
    raise PlotError(f'{prefix}noise: "{clipped(str(given))}"; expected {expected}')


def noise_map(rms: float, kernel: Array, shape: tuple[int, int], seed: tuple[int, int]) -> Array:
    """Return a map of noise (ny, nx) with this rms, correlated by the beam `kernel`; equal seeds give equal noise."""
    half = len(kernel) // 2
    white = np.random.default_rng(seed).standard_normal((shape[0] + 2 * half, shape[1] + 2 * half))
    smooth = convolved(white, kernel)[half : half + shape[0], half : half + shape[1]]
    return rms / np.sqrt(np.square(kernel).sum()) * smooth
