"""Checkpoints: the arrays and numbers of a run, bit for bit, in an HDF5 file that is complete or absent."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NoReturn

import h5py
import numpy as np

from discsim import __version__
from discsim.output import hdf5
from discsim.printable import UserError, printable

Array = np.ndarray
Scalar = str | int | float | bool
PARTICLES = ("gas", "dust", "own_acc")  # groups of arrays with a row a particle
ROWS = 1 << 20  # that are checked at a time


class CheckpointError(UserError):
    """The file is absent, damaged, or no checkpoint; the message says which."""


class _Held(dict[str, Any]):
    """What a checkpoint holds by name; what it lacks is a CheckpointError."""

    def __init__(self, path: str | os.PathLike[str], entries: dict[str, Any]) -> None:
        super().__init__(entries)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise CheckpointError(f"{self.path}: a checkpoint without {name!r}: damaged, or of another version of discsim")


def write_checkpoint(
    path: str | os.PathLike[str],
    groups: dict[str, dict[str, Array]],
    attrs: dict[str, Scalar],
    before: Path | None = None,
    into: Callable[[Any, Path | None], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:
    """Write named groups of arrays (numbers, one or more dimensions) and single values.

    What is at `path` is replaced, or moved to `before`; it stays where the new file cannot be written, which raises
    OSError. into: what makes the file.
    """
    with into(path, before) as file:
        hdf5.mark(file, "checkpoint")
        values = file.create_group("values")
        for name, value in attrs.items():
            values.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
        arrays = file.create_group("arrays")
        for group, members in groups.items():
            into = arrays.create_group(group)
            for name, array in members.items():
                hdf5.put(into, name, array)


def read_checkpoint(
    path: str | os.PathLike[str], share: tuple[int, int] = (0, 1)
) -> tuple[dict[str, dict[str, Array]], dict[str, Scalar]]:
    """What `write_checkpoint` was given, every array with its bits. Raises CheckpointError.

    So does looking up a group, an array or a value that the file lacks. share: a number below another one: of the
    particles' rows this one of so many runs, about as long.
    """
    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        groups = {}
        for group, members in file["arrays"].items():
            number, of = share if group in PARTICLES else (0, 1)
            arrays = {
                name: hdf5.read(stored, slice(len(stored) * number // of, len(stored) * (number + 1) // of))
                for name, stored in members.items()
            }
            groups[group] = _Held(path, arrays)
        return _Held(path, groups), _values(path, file)


def checked_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, dict[str, Array]], dict[str, Scalar]]:
    """As `read_checkpoint`, but for the particles, which are only read through."""
    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        groups = {}
        for group, members in file["arrays"].items():
            if group in PARTICLES:
                for stored in members.values():
                    for first in range(0, len(stored), ROWS):
                        hdf5.read(stored, slice(first, first + ROWS))
            else:
                groups[group] = _Held(path, {name: hdf5.read(stored) for name, stored in members.items()})
        return _Held(path, groups), _values(path, file)


def _values(path: str | os.PathLike[str], file: h5py.File) -> dict[str, Scalar]:
    return _Held(path, {name: _scalar(value) for name, value in file["values"].attrs.items()})


def _scalar(value: np.generic) -> Scalar:
    return value.decode() if isinstance(value, bytes) else value.item()


class OtherVersionWarning(UserWarning):
    """A run goes on from a checkpoint that another version of discsim has written."""


def other_version(path: str | os.PathLike[str]) -> str:
    """What is to be said where another version of discsim has written a checkpoint; else "". Raises CheckpointError."""
    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        written_by = _scalar(file.attrs["version"])
    if written_by == __version__:
        return ""
    words = f"{path} is of discsim {written_by}, and this is {__version__}"
    return printable(f"{words}: the run goes on, but not with the bits that it would have had there")
