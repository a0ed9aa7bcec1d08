"""Writing and checked reading of checkpoints: HDF5 files with all arrays and numbers of a run, bit for bit."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NoReturn

import h5py
import numpy as np

from discsim.numerics.entries import EntryError
from discsim.output import hdf5
from discsim.printable import UserError, printable
from discsim.scene.units import clipped
from discsim.version import __version__

Array = np.ndarray
Scalar = str | int | float | bool
PARTICLES = ("gas", "dust", "own_acc")  # groups of arrays with one row per particle
ROWS_PER_CHECK = 1 << 20  # largest number of rows that `check_checkpoint` holds in memory
MAX_WHOLE = 1 << 53  # largest whole number; floats represent all whole numbers up to it
REMEDY = "move this file away to resume from the previous checkpoint"


class CheckpointError(UserError):
    """A checkpoint file that is missing or damaged, or another file in its place; the message has the reason."""


class Entries(dict[str, Any]):
    """Arrays, groups or values of the checkpoint at `path` by name; a missing entry raises CheckpointError."""

    def __init__(self, path: str | os.PathLike[str], entries: dict[str, Any]) -> None:
        super().__init__(entries)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise CheckpointError(
            f"{self.path}: the checkpoint has no {name!r}; it is damaged, or was written by another version "
            f"of discsim; "
            f"{REMEDY}"
        )


class Values(Entries):
    """Single values of a checkpoint by name; its methods check type and range, and raise CheckpointError.

    `version` is the version of discsim that wrote the file.
    """

    def __init__(self, path: str | os.PathLike[str], entries: dict[str, Any], version: str) -> None:
        super().__init__(path, entries)
        self.version = version

    def whole(self, name: str, least: int = 0, most: int = MAX_WHOLE) -> int:
        """Return the value `name`, which must be a whole number from `least` to `most`."""
        value = self[name]
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.refuse(name, f"a whole number from {least} to {most}")
        return int(value)

    def number(self, name: str, least: float = -math.inf, may_be_infinite: bool = False) -> float:
        """Return the value `name`, a finite number of at least `least`; with `may_be_infinite` also infinity."""
        value = self[name]
        right = isinstance(value, int | float) and not isinstance(value, bool) and value >= least
        if not right or not (math.isfinite(value) or (may_be_infinite and value > 0.0)):
            least_words = "" if least == -math.inf else f", {least:g} or more"
            self.refuse(name, f"a{'' if may_be_infinite else ' finite'} number{least_words}")
        return float(value)

    def text(self, name: str) -> str:
        """Return the value `name`, which must be a text."""
        if not isinstance(self[name], str):
            self.refuse(name, "text")
        return str(self[name])

    def refuse(self, name: str, expected: str) -> NoReturn:
        """Raise CheckpointError: the value `name` is not as `expected`, a description like "a text"."""
        value = clipped(repr(self[name]))
        raise CheckpointError(f"{self.path}: damaged checkpoint: {name} is {value}; expected {expected}; {REMEDY}")


def write_checkpoint(
    path: str | os.PathLike[str], groups: dict[str, dict[str, Array]], attrs: dict[str, Scalar],
    backup: Path | None = None,
    create: Callable[[Any, Path | None], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:  # fmt: skip
    """Write a checkpoint to `path`: the arrays in `groups` by group and name, and the single values `attrs`.

    An existing file at `path` is replaced, or with `backup` renamed to `backup`. The existing file stays in place if
    the new file cannot be written, which raises OSError. `create` is the context manager that creates the file.
    """
    with create(path, backup) as file:
        hdf5.write_provenance(file, "checkpoint")
        values = file.create_group("values")
        for name, value in attrs.items():
            values.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
        arrays = file.create_group("arrays")
        for name, members in groups.items():
            group = arrays.create_group(name)
            for key, array in members.items():
                hdf5.write_array(group, key, array)


def read_checkpoint(
    path: str | os.PathLike[str], share: tuple[int, int] = (0, 1)
) -> tuple[dict[str, dict[str, Array]], Values]:
    """Return the groups of arrays and the single values that `write_checkpoint` wrote to `path`, bit for bit.

    `share` = (i, k) is a rank and the number of ranks: of n particles, rows n i / k to n (i + 1) / k are read. Raises
    CheckpointError; a look-up of a missing entry in the result raises it too.
    """

    def rows_of_share(stored: hdf5.CheckedDataset) -> Array:
        number, of = share
        return stored.read(slice(len(stored) * number // of, len(stored) * (number + 1) // of))

    return _read_groups(path, rows_of_share)


def check_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, dict[str, Array]], Values]:
    """Read a whole checkpoint; return its groups and single values, with empty arrays of the particles.

    At most ROWS_PER_CHECK rows of particles are in memory at the same time. Raises CheckpointError.
    """

    def check_rows(stored: hdf5.CheckedDataset) -> Array:
        for first in range(0, len(stored), ROWS_PER_CHECK):
            stored.read(slice(first, first + ROWS_PER_CHECK))
        return stored.read(slice(0, 0))

    return _read_groups(path, check_rows)


def _read_groups(
    path: str | os.PathLike[str], read_particles: Callable[[hdf5.CheckedDataset], Array]
) -> tuple[dict[str, dict[str, Array]], Values]:
    """Return the groups and values of a checkpoint; `read_particles` reads a dataset with a row per particle."""
    with hdf5.open_file_of_kind(path, CheckpointError, "checkpoint") as file:
        arrays, single = file.group("arrays"), file.group("values")
        groups: dict[str, Any] = {}
        for group in arrays.names:
            held, read = arrays.group(group), read_particles if group in PARTICLES else hdf5.CheckedDataset.read
            groups[group] = Entries(path, {name: read(held.dataset(name)) for name in held.names})
        values = {name: _scalar_value(single.attribute(name), name) for name in single.attributes}
        return Entries(path, groups), Values(path, values, file.text("version"))


def _scalar_value(value: Any, name: str) -> Scalar:
    """Return an attribute of the group "values" as a Python object. Raises EntryError for an array."""
    if np.ndim(value) != 0:
        raise EntryError(f"/values@{name} has shape {np.shape(value)}; expected a single value")
    return hdf5.decode_text(value, f"/values@{name}") if isinstance(value, bytes) else value.item()


class OtherVersionWarning(UserWarning):
    """Warning that a run resumes from a checkpoint of another version of discsim."""


def other_version_warning(values: Values) -> str:
    """Return the text of a warning if another version of discsim wrote the checkpoint with these values, else ""."""
    if values.version == __version__:
        return ""
    versions = f"{values.path} was written by discsim {values.version}, and this is discsim {__version__}"
    return printable(
        f"{versions}: the run continues, but its results differ by rounding from results of discsim {values.version}"
    )
