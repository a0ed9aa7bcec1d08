"""FITS files of maps on the sky (FITS Standard 4.0, Pence et al. 2010, A&A 524, A42), written by astropy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.files import refuse_special, replace_atomically
from discsim.version import __version__

if TYPE_CHECKING:
    from discsim.sky.image import SkyMap

MAX_CARD = 68  # characters of a text that fits into one card
BUNIT = {"km/s": "km s-1"}


def header_of(sky: SkyMap) -> Any:
    """Return the FITS header of a map: world coordinates (SIN projection), unit, beam, object, and how it was made."""
    from astropy.io import fits
    from astropy.wcs import WCS

    ny, nx = sky.values.shape
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---SIN", "DEC--SIN"]
    wcs.wcs.cunit = ["deg", "deg"]
    wcs.wcs.crval = list(sky.centre)
    wcs.wcs.cdelt = [-sky.pixel / 3600.0, sky.pixel / 3600.0]
    wcs.wcs.crpix = [0.5 * (nx + 1), 0.5 * (ny + 1)]
    wcs.wcs.radesys = "ICRS"
    header = wcs.to_header()
    header["BUNIT"] = (BUNIT.get(sky.unit, sky.unit), sky.quantity)
    header["BTYPE"] = sky.quantity.title()
    if sky.beam is not None:
        for key, value in sky.beam.to_header_keywords().items():
            header[key] = (float(value), "deg")
    if sky.wavelength is not None:
        from astropy import units as u

        header["RESTFRQ"] = (float(sky.wavelength.to_value("Hz", equivalencies=u.spectral())), "Hz")
    header["OBJECT"] = _card_text(sky.title or "discsim")
    header["ORIGIN"] = f"discsim {__version__}"
    header["DISTANCE"] = (sky.distance, "pc")
    for key, value, comment in (
        ("INCL", sky.orientation.inclination, "inclination in deg"),
        ("POSANG", sky.orientation.position_angle, "position angle in deg, receding major axis"),
        ("AZIMUTH", sky.orientation.azimuth, "rotation in deg before the inclination"),
    ):
        header[key] = (float(np.degrees(value)), comment)
    header["SIMTIME"] = (_card_text(sky.time), "time of the snapshot")
    header["SCENE"] = sky.scene_hash  # no room for a comment
    for line in sky.description:
        header["HISTORY"] = _card_text(line)
    assert isinstance(header, fits.Header)
    return header


def write_fits(sky: SkyMap, path: str | Path) -> None:
    """Write a map as a FITS file with checksums; the file appears when it is complete. Raises OSError, PlotError."""
    from astropy.io import fits

    path = Path(path)
    refuse_special(path)
    hdu = fits.PrimaryHDU(sky.values.astype(">f4"), header_of(sky))
    hdu.add_checksum(when="checksum of the header and data unit")
    with replace_atomically(path, ".fits") as temporary:
        hdu.writeto(temporary, overwrite=True)


def _card_text(text: str) -> str:
    """Return a text for a FITS card: printable ASCII, at most MAX_CARD characters."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text).strip()
    return plain if len(plain) <= MAX_CARD else plain[: MAX_CARD - 3] + "..."
