"""Checkpoints: the arrays and numbers of a run, bit for bit, in an HDF5 file that is complete or absent."""

from __future__ import annotations

import os

import numpy as np

from discsim import hdf5

Array = np.ndarray
Scalar = str | int | float | bool


class CheckpointError(Exception):
    """The file is absent, damaged, or no checkpoint; the message says which."""


def write_checkpoint(
    path: str | os.PathLike[str], groups: dict[str, dict[str, Array]], attrs: dict[str, Scalar]
) -> None:
    """Write named groups of arrays (numbers, one or more dimensions) and single values.

    What is at `path` is replaced; it stays where the new file cannot be written, which raises OSError.
    """
    with hdf5.create(path) as file:
        hdf5.mark(file, "checkpoint")
        values = file.create_group("values")
        for name, value in attrs.items():
            values.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
        arrays = file.create_group("arrays")
        for group, members in groups.items():
            into = arrays.create_group(group)
            for name, array in members.items():
                hdf5.put(into, name, array)


def read_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, dict[str, Array]], dict[str, Scalar]]:
    """What `write_checkpoint` was given, every array with its bits. Raises CheckpointError."""
    with hdf5.reading(path, CheckpointError, "checkpoint") as file:
        groups = {
            group: {name: dataset[()] for name, dataset in members.items()} for group, members in file["arrays"].items()
        }
        attrs = {name: _scalar(value) for name, value in file["values"].attrs.items()}
    return groups, attrs


def _scalar(value: np.generic) -> Scalar:
    return value.decode() if isinstance(value, bytes) else value.item()
