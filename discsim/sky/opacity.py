"""Absorption opacity of dust by wavelength and grain size, in cm2 per gram of dust.

The default, for all sizes, is 10 cm2/g (nu / 1 THz) (Beckwith et al. 1990, AJ 99, 924). A file has a table, which is
interpolated linearly in the logarithms of wavelength, size and opacity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.output.fields.binned import Optics
from discsim.output.fields.display import positive_quantity
from discsim.printable import printable
from discsim.scene.units import clipped

Array = np.ndarray
COLUMNS = {"wavelength": "mm", "size": "cm", "absorption": "cm2/g"}  # of a table in a file; `size` may be absent
MAX_BYTES = 1 << 28  # largest file of opacities


class Opacity(Protocol):
    """Opacity of dust."""

    @property
    def text(self) -> str:
        """Description for figures and files."""

    def absorption(self, wavelength: Any, species: Array, size: Array | None) -> Array:
        """Return the opacity (n,) in cm2/g of grains of populations `species` (n,) with radii `size` (n,) in cm.

        Raises PlotError.
        """


@dataclass(frozen=True)
class Beckwith:
    """Opacity of Beckwith et al. (1990), the same for all grains."""

    text = "10 cm2/g (nu / THz), Beckwith et al. 1990"

    def absorption(self, wavelength: Any, species: Array, size: Array | None) -> Array:
        return np.full(len(species), Optics(wavelength).opacity_cgs)


@dataclass(frozen=True)
class OfPopulations:
    """Opacity in cm2/g of each dust population, or one opacity for all populations, at any wavelength."""

    values: Sequence[float]

    @property
    def text(self) -> str:
        """The values as text."""
        return ", ".join(f"{value:.4g}" for value in self.values) + " cm2/g"

    def absorption(self, wavelength: Any, species: Array, size: Array | None) -> Array:
        if len(self.values) == 1:
            return np.full(len(species), self.values[0])
        count = int(species.max(initial=-1)) + 1
        if count > len(self.values):
            raise PlotError(
                f"opacity: {len(self.values)} values for {count} populations of dust; give one value, or one "
                f"for each population"
            )
        return np.asarray(self.values)[species]


@dataclass(frozen=True)
class OfTable:
    """Opacity from a table: `absorption` [wavelength, size] in cm2/g at rising wavelengths in mm and sizes in cm.

    `size` is None, and the table has one column, if the opacity does not depend on size.
    """

    path: str
    wavelength: Array
    size: Array | None
    table: Array

    @property
    def text(self) -> str:
        """The name of the file."""
        return f"table {printable(Path(self.path).name)}"

    def absorption(self, wavelength: Any, species: Array, size: Array | None) -> Array:
        from scipy.interpolate import RegularGridInterpolator

        at = float(wavelength.to_value("mm"))
        self._check_range("wavelengths", "mm", self.wavelength, np.array([at]))
        by_wavelength = np.array([np.interp(np.log(at), np.log(self.wavelength), row) for row in np.log(self.table.T)])
        if self.size is None:
            return np.full(len(species), np.exp(by_wavelength[0]))
        if size is None:
            raise PlotError(
                f"{self.path}: the table has opacities by grain size, but the run has no grain sizes; use a "
                f"table without the column size"
            )
        self._check_range("grain sizes", "cm", self.size, size)
        found = RegularGridInterpolator((np.log(self.size),), by_wavelength)(np.log(size)[:, None])
        return np.exp(found)

    def _check_range(self, what: str, unit: str, table: Array, wanted: Array) -> None:
        """Raise PlotError if some of the values `wanted` (n,) are not between the ends of the rising `table`."""
        if not wanted.size:
            return
        low, high = float(wanted.min()), float(wanted.max())
        if low < table[0] * (1 - 1e-9) or high > table[-1] * (1 + 1e-9):
            raise PlotError(
                f"{self.path}: the table has {what} from {table[0]:.3g} to {table[-1]:.3g} {unit}, but "
                f"{low:.3g} to {high:.3g} "
                f"{unit} are needed; use a table with a wider range"
            )


def opacity_of(given: Any, prefix: str = "") -> Opacity:
    """Return an opacity: None (the default), "2 cm2/g", one such value for each population, or the name of a file.

    Values are texts or Quantities, several as a sequence or as a text with commas. Raises PlotError.
    """
    name = f"{prefix}opacity"
    if given is None:
        return Beckwith()
    if isinstance(given, str | Path) and Path(given).suffix in (".ecsv", ".npz"):
        return read_opacities(Path(given))
    parts = given.split(",") if isinstance(given, str) else given if isinstance(given, list | tuple) else [given]
    if isinstance(given, str) and not given[:1].isdigit() and not given.startswith("."):
        raise PlotError(
            f'{name}: "{clipped(given)}"; expected a value like "2 cm2/g", values for all populations separated by '
            "commas, or a file .ecsv or .npz"
        )
    return OfPopulations([float(positive_quantity(part, name, "cm2/g").to_value("cm2/g")) for part in parts])


def read_opacities(path: Path) -> OfTable:
    """Read opacities from a file: an ECSV table of astropy, or an npz file with the arrays of dsharp_opac.

    The columns of the ECSV table are `wavelength`, `absorption` and, where it matters, `size`, each with its unit; its
    rows are all pairs of wavelength and size, in any order. The arrays of an npz file are `lam` (m,) and `a` (n,) in cm
    and `k_abs` (n, m) in cm2/g (Birnstiel et al. 2018, ApJ 869, L45). Raises PlotError.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PlotError(f"{path}: the file is larger than {MAX_BYTES >> 20} MiB; use a smaller table of opacities")
        wavelength, size, table = _from_npz(path) if path.suffix == ".npz" else _from_ecsv(path)
    except OSError as error:
        raise PlotError(f"{path}: cannot be read: {error.strerror or error}; use another file") from None
    arrays = [wavelength, table] + ([] if size is None else [size])
    if any(not np.isfinite(array).all() or (array <= 0.0).any() or not array.size for array in arrays):
        raise PlotError(f"{path}: the table has values that are not positive and finite; expected positive numbers")
    if any((np.diff(axis) <= 0.0).any() for axis in (wavelength, size) if axis is not None):
        raise PlotError(f"{path}: a wavelength or a size occurs twice; give each pair of wavelength and size once")
    return OfTable(str(path), wavelength, size, table)


def _from_npz(path: Path) -> tuple[Array, Array | None, Array]:
    """Return wavelengths (m,) in mm, sizes (n,) in cm and opacities (m, n) of a file of dsharp_opac."""
    import zipfile

    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            lam, a, k_abs = (np.asarray(file[name], dtype=float) for name in ("lam", "a", "k_abs"))
    except (AttributeError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise PlotError(f"{path}: {clipped(str(error))}; expected arrays lam, a and k_abs of dsharp_opac") from None
    if lam.ndim != 1 or a.ndim != 1 or k_abs.shape != (len(a), len(lam)):
        raise PlotError(f"{path}: k_abs has shape {k_abs.shape}; expected (sizes, wavelengths) = {(a.size, lam.size)}")
    rows, columns = np.argsort(lam), np.argsort(a)
    return 10.0 * lam[rows], a[columns], k_abs.T[np.ix_(rows, columns)]


def _from_ecsv(path: Path) -> tuple[Array, Array | None, Array]:
    """Return wavelengths (m,) in mm, sizes (n,) in cm (or None) and opacities (m, n) of an ECSV table."""
    from astropy import units as u
    from astropy.table import QTable

    try:
        found = QTable.read(path, format="ascii.ecsv")
    except (ValueError, TypeError, UnicodeDecodeError) as error:
        reason = clipped(str(error).strip().partition("\n")[0])
        raise PlotError(f"{path}: not an ECSV table: {reason}; expected the columns {', '.join(COLUMNS)}") from None
    columns = {}
    for name, unit in COLUMNS.items():
        if name not in found.colnames:
            if name == "size":
                continue
            raise PlotError(f"{path}: no column {name}; expected the columns {', '.join(COLUMNS)} with units")
        try:
            columns[name] = np.asarray(found[name].to_value(unit), dtype=float)
        except (AttributeError, u.UnitConversionError):
            raise PlotError(f"{path}: column {name} has no unit like {unit}; add the unit in the header") from None
    wavelength, at = np.unique(columns["wavelength"], return_inverse=True)
    if "size" not in columns:
        if len(wavelength) != len(at):
            raise PlotError(f"{path}: a wavelength occurs twice; give each wavelength once, or add a column size")
        return wavelength, None, columns["absorption"][np.argsort(columns["wavelength"])][:, None]
    size, of = np.unique(columns["size"], return_inverse=True)
    table = np.zeros((len(wavelength), len(size)))
    table[at, of] = columns["absorption"]
    if len(at) != table.size or (np.bincount(at * len(size) + of, minlength=table.size) != 1).any():
        raise PlotError(
            f"{path}: {len(at)} rows for {len(wavelength)} wavelengths and {len(size)} sizes; give each pair "
            f"of wavelength and size once"
        )
    return wavelength, size, table
