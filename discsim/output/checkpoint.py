"""Checkpoints: HDF5 files with the arrays and numbers of a run, bit for bit, from which the run resumes."""

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
ROWS_PER_CHECK = 1 << 20  # largest number of rows in memory during a check
MAX_WHOLE = 1 << 53  # largest whole number: up to this limit floats are exact


class CheckpointError(UserError):
    """A checkpoint that is absent, damaged or of another kind; the message has the reason."""


class Entries(dict[str, Any]):
    """Entries of a checkpoint by name; a missing entry raises CheckpointError."""

    def __init__(self, path: str | os.PathLike[str], entries: dict[str, Any]) -> None:
        super().__init__(entries)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise CheckpointError(
            f"{self.path}: the checkpoint has no {name!r}: it is damaged, or written by another version of discsim"
        )


class Values(Entries):
    """Single values of a checkpoint by name, checked for type and range; a wrong value raises CheckpointError.

    `version` is the version of discsim that wrote the file.
    """

    def __init__(self, path: str | os.PathLike[str], entries: dict[str, Any], version: str) -> None:
        super().__init__(path, entries)
        self.version = version

    def whole(self, name: str, least: int = 0, most: int = MAX_WHOLE) -> int:
        """Return a whole number from `least` to `most`."""
        value = self[name]
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.refuse(name, f"a whole number from {least} to {most}")
        return int(value)

    def number(self, name: str, least: float = -math.inf, may_be_infinite: bool = False) -> float:
        """Return a finite number of at least `least`; with `may_be_infinite` also infinity."""
        value = self[name]
        right = isinstance(value, int | float) and not isinstance(value, bool) and value >= least
        if not right or not (math.isfinite(value) or (may_be_infinite and value > 0.0)):
            least_words = "" if least == -math.inf else f", {least:g} or more"
            self.refuse(name, f"a{'' if may_be_infinite else ' finite'} number{least_words}")
        return float(value)

    def text(self, name: str) -> str:
        if not isinstance(self[name], str):
            self.refuse(name, "a text")
        return str(self[name])

    def refuse(self, name: str, expected: str) -> NoReturn:
        """Raise CheckpointError with the wrong value of `name` and the expected one."""
        value = clipped(repr(self[name]))
        raise CheckpointError(f"{self.path}: damaged checkpoint: {name} is {value}; expected {expected}")


def write_checkpoint(
    path: str | os.PathLike[str],
    groups: dict[str, dict[str, Array]],
    attrs: dict[str, Scalar],
    before: Path | None = None,
    into: Callable[[Any, Path | None], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:
    """Write a checkpoint: arrays by group and name, and single values `attrs`.

    An existing file at `path` is replaced, or renamed to `before`. It stays in place if the new file cannot be
    written, which raises OSError. `into` is the context manager that creates the file.
    """
    with into(path, before) as file:
        hdf5.write_provenance(file, "checkpoint")
        values = file.create_group("values")
        for name, value in attrs.items():
            values.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
        arrays = file.create_group("arrays")
        for group, members in groups.items():
            into = arrays.create_group(group)
            for name, array in members.items():
                hdf5.write_array(into, name, array)


def read_checkpoint(
    path: str | os.PathLike[str], share: tuple[int, int] = (0, 1)
) -> tuple[dict[str, dict[str, Array]], Values]:
    """Return the groups and values that `write_checkpoint` wrote, bit for bit. Raises CheckpointError.

    `share` = (i, k) is a rank and the number of ranks: of n particles, rows n i / k to n (i + 1) / k are read. A
    look-up of a missing entry in the result raises CheckpointError too.
    """

    def rows(group: str, length: int) -> slice:
        number, of = share if group in PARTICLES else (0, 1)
        return slice(length * number // of, length * (number + 1) // of)

    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        groups = {
            group: Entries(path, {name: stored.read(rows(group, len(stored))) for name, stored in members.items()})
            for group, members in _datasets(file).items()
        }
        return Entries(path, groups), _values(path, file)


def checked_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, dict[str, Array]], Values]:
    """Return groups and values without the particles, whose arrays are only checked, ROWS_PER_CHECK rows at a time."""
    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        groups = {}
        for group, members in _datasets(file).items():
            if group in PARTICLES:
                for stored in members.values():
                    for first in range(0, len(stored), ROWS_PER_CHECK):
                        stored.read(slice(first, first + ROWS_PER_CHECK))
            else:
                groups[group] = Entries(path, {name: stored.read() for name, stored in members.items()})
        return Entries(path, groups), _values(path, file)


def _datasets(file: hdf5.CheckedGroup) -> dict[str, dict[str, hdf5.CheckedDataset]]:
    """Return all datasets by group and name."""
    arrays = file.group("arrays")
    return {group: {name: held.dataset(name) for name in held.names} for group, held in _groups(arrays).items()}


def _groups(held: hdf5.CheckedGroup) -> dict[str, hdf5.CheckedGroup]:
    return {name: held.group(name) for name in held.names}


def _values(path: str | os.PathLike[str], file: hdf5.CheckedGroup) -> Values:
    held = file.group("values")
    values = {name: _scalar(held.attribute(name), name) for name in held.attributes}
    return Values(path, values, file.text("version"))


def _scalar(value: Any, name: str) -> Scalar:
    if np.ndim(value) != 0:
        raise EntryError(f"/values@{name} has shape {np.shape(value)}; expected one value")
    return hdf5.decoded(value, f"/values@{name}") if isinstance(value, bytes) else value.item()


class OtherVersionWarning(UserWarning):
    """A run resumes from a checkpoint that another version of discsim wrote."""


def other_version(values: Values) -> str:
    """Return a warning if another version of discsim wrote the checkpoint, else ""."""
    if values.version == __version__:
        return ""
    words = f"{values.path} was written by discsim {values.version}, and this is {__version__}"
    return printable(f"{words}: the run continues, but its results differ by rounding from those of the other version")
