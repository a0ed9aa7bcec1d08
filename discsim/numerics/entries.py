"""Checks of types, shapes and ranges of particle arrays that a caller has set or that were read from a file.

Files are checkpoints and snapshots. Kernels do not check their arrays, and use some of them as indices.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from discsim.printable import UserError

Array = np.ndarray
VECTORS = ("pos", "vel", "acc", "kick_acc", "pressure_acc", "pressure_vel")  # (n, dimensions); others (n,)
TYPES = {"ids": np.int64, "species": np.int64, "global_index": np.uint64, "immobile": np.bool_}  # others float64
POSITIVE = {"gas": ("mass", "h", "h_before")}
NOT_NEGATIVE = {
    "gas": ("density", "small"),
    "dust": ("mass", "size", "density"),
    "bodies": ("mass", "gained", "accreted", "felt"),
}


class EntryError(UserError, ValueError):
    """Error for an array or a value that is absent or has a wrong type, shape or range; the message names it."""


def check_arrays(species: str, arrays: Mapping[str, Array], dimensions: int) -> int:
    """Check types, shapes and memory layout of the arrays of a species, and return the number of particles.

    Raises EntryError.
    """
    count = -1
    for name, array in arrays.items():
        wanted = np.dtype(TYPES.get(name, np.float64))
        if not isinstance(array, np.ndarray) or array.dtype != wanted or not array.dtype.isnative:
            found = f"{array.dtype.str}" if isinstance(array, np.ndarray) else f"a {type(array).__name__}"
            raise EntryError(f"{species}.{name} is of type {found}; expected a numpy array of {wanted.str}")
        count = len(array) if count < 0 and array.ndim > 0 else count
        shape = (count, dimensions) if name in VECTORS else (count,)
        if array.shape != shape:
            raise EntryError(f"{species}.{name} has shape {array.shape}; expected {shape}, as the other arrays")
        if not array.flags.carray:
            raise EntryError(
                f"{species}.{name} is not C-contiguous, aligned and writeable; expected np.array(..., order='C')"
            )
    return count


def check_like(species: str, arrays: Mapping[str, Array], others: Mapping[str, Array]) -> None:
    """Raise EntryError unless `arrays` have the names, types and shapes of `others`; species: name for messages."""
    if arrays.keys() != others.keys():
        raise EntryError(f"{species} has the arrays {', '.join(arrays)}; expected {', '.join(others)}")
    for name, other in others.items():
        array = arrays[name]
        if not isinstance(array, np.ndarray) or array.dtype != other.dtype or array.shape != other.shape:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else f"a {type(array).__name__}"
            raise EntryError(f"{species}.{name} is {found}; expected {other.dtype} {other.shape}")


def check_ranges(species: str, arrays: Mapping[str, Array], populations: int = 0, time: float = math.inf) -> None:
    """Check signs and population indices in the arrays of a species; for bodies, that `begun` is not after `time`.

    populations: number of dust populations. Raises EntryError.
    """
    for name in POSITIVE.get(species, ()):
        if name in arrays and len(arrays[name]) and not arrays[name].min() > 0.0:
            _refuse(species, name, arrays[name], arrays[name] > 0.0, "a positive number")
    for name in NOT_NEGATIVE.get(species, ()):
        if name in arrays and len(arrays[name]) and not arrays[name].min() >= 0.0:
            _refuse(species, name, arrays[name], arrays[name] >= 0.0, "0 or a positive number")
    number = arrays.get("species")
    if number is not None and len(number) and not (number.min() >= 0 and number.max() < populations):
        right = (number >= 0) & (number < populations)
        _refuse(species, "species", number, right, f"a population of the scene, 0 to {populations - 1}")
    begun = arrays.get("begun")
    if begun is not None and not (begun <= time).all():
        _refuse(species, "begun", begun, begun <= time, f"at most its time, {time:g}")


def check_finite(species: str, arrays: Mapping[str, Array]) -> None:
    """Raise EntryError unless all floating-point numbers in `arrays` are finite."""
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            _refuse(species, name, array, np.isfinite(array), "a finite number")


def _refuse(species: str, name: str, array: Array, right: Array, expected: str) -> None:
    index = tuple(int(i) for i in np.argwhere(~right)[0])
    place = ", ".join(str(i) for i in index)
    raise EntryError(f"{species}.{name}[{place}] is {array[index]:g}; expected {expected}")
