"""Folders of `discsim export`: the input files of a code of radiative transfer, and a README that describes them."""

from __future__ import annotations

import os
import shutil
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discsim.export.options import CODES, ExportOptions
from discsim.output.fields.base import PlotError
from discsim.output.files import command_line
from discsim.output.snapshot import Snapshot, read_snapshot
from discsim.printable import printable
from discsim.scene.orbits import show_plain_time
from discsim.scene.units import clipped
from discsim.sky.image import check_snapshot
from discsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

FORMULAS = """Each layer is a Gaussian in height, rho = Sigma exp(-z^2 / 2 H^2) / (sqrt(2 pi) H), with
    H   = sqrt(P / Sigma) / Omega            of the gas
    H_d = H sqrt(alpha / (alpha + St))       of dust (Dubrulle et al. 1995; Youdin & Lithwick 2007)
and P / Sigma, St and alpha as means in rings. Small dust has the height of the gas. The mass of each size is exact."""


def write(source: Snapshot | str | Path, to: str, folder: str | Path, **options: Any) -> Path:
    """Write a snapshot as input of a code of radiative transfer.

    Parameters
    ----------
    source : str, Path or Snapshot
        Directory of a run (its last snapshot), file of a snapshot, or result of `discsim.read_snapshot`.
    to : str
        "radmc3d" or "mcfost".
    folder : str or Path
        New folder for the files.
    **options
        `alpha`: strength of the turbulence, which sets the heights of dust layers; by default that of the scene.
        `sizes`: number of bins for grains of many sizes (10). `cells`: number of cells in azimuth (256). `opacity`: as
        in `Snapshot.image` (RADMC-3D only). `temperature`: write temperatures of the dust too, "gas" or a law as in
        `Snapshot.image` (RADMC-3D only). `star_radius` ("2 Rsun") and `star_temperature` ("4000 K"): of the star, whose
        mass is that of the scene.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    PlotError, SnapshotError
        If an argument is invalid, the run cannot be exported, or a snapshot cannot be read.
    OSError
        If the folder cannot be written.
    """
    unknown = sorted(set(options) - (set(ExportOptions.__dataclass_fields__) - {"prefix"}))
    if unknown:
        known = ", ".join(name for name in ExportOptions.__dataclass_fields__ if name != "prefix")
        raise PlotError(f"{clipped(unknown[0])}: unknown option; expected one of {known}")
    snap = source if isinstance(source, Snapshot) else read_snapshot(source)
    return write_export(snap, to, Path(folder), ExportOptions(**options))


def write_export(snap: Snapshot, to: str, folder: Path, options: ExportOptions) -> Path:
    """Write the folder of an export; it appears when it is complete. Raises PlotError, OSError."""
    if to not in CODES:
        raise PlotError(f'{options.prefix}to: "{clipped(to)}"; expected one of {", ".join(CODES)}')
    check_snapshot(snap)
    if folder.is_symlink() or folder.exists():
        raise PlotError(f"{folder}: exists already; expected the name of a new folder")
    writer: Callable[[Snapshot, Path, ExportOptions], list[str]]
    writer = import_module(f"discsim.export.{to}").write_folder
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary.mkdir()
    try:
        lines = writer(snap, temporary, options)
        (temporary / "README").write_text("\n".join([*_origin(snap), "", *lines, "", FORMULAS, ""]))
        os.rename(temporary, folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return folder


def _origin(snap: Snapshot) -> list[str]:
    """Return lines about the run and the version."""
    return [
        f"{snap.title or 'A disc'}, {show_plain_time(snap.time, snap.units, snap.scene_text)}",
        f"discsim {__version__}: {printable(command_line())}",
    ]
