"""Checks of types, shapes and ranges of particle arrays from a caller, a checkpoint or a snapshot.

Kernels do not check their arrays, and use some of them as indices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from discsim.printable import UserError

Array = np.ndarray
# Arrays (n, dimensions); others are (n,).
VECTORS = ("pos", "vel", "acc", "kick_acc", "pressure_acc", "pressure_vel", "last_pressure_acc")
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
    """Check types, shapes and memory layout of arrays of a species, and return the number of particles.

    species: name of the species for messages. arrays: arrays by name. dimensions: number of components of vectors.
    Raises EntryError at the first fault.
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
            raise EntryError(
                f"{species}.{name} has shape {array.shape}; expected the shape {shape}, which the other arrays have"
            )
        if not array.flags.carray:
            raise EntryError(
                f"{species}.{name} is not C-contiguous, aligned and writeable; expected np.array(..., order='C')"
            )
    return count


def check_like(species: str, arrays: Mapping[str, Array], others: Mapping[str, Array]) -> None:
    """Raise EntryError unless `arrays` have the names, types and shapes of `others`; species: a name for messages."""
    if arrays.keys() != others.keys():
        raise EntryError(f"{species} has the arrays {', '.join(arrays)}; expected the arrays {', '.join(others)}")
    for name, other in others.items():
        array = arrays[name]
        if not isinstance(array, np.ndarray) or array.dtype != other.dtype or array.shape != other.shape:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else f"a {type(array).__name__}"
            raise EntryError(f"{species}.{name} has type and shape {found}; expected {other.dtype} {other.shape}")


def check_ranges(species: str, arrays: Mapping[str, Array], populations: int = 0, time: float = math.inf) -> None:
    """Check signs and population numbers in arrays of a species, or of "bodies", whose `begun` may not be after `time`.

    arrays: arrays by name. populations: number of dust populations. Raises EntryError at the first fault.
    """
    for name in POSITIVE.get(species, ()):
        _check_entries(species, name, arrays, lambda array: array > 0.0, "a positive number")
    for name in NOT_NEGATIVE.get(species, ()):
        _check_entries(species, name, arrays, lambda array: array >= 0.0, "0 or a positive number")
    last = populations - 1
    _check_entries(
        species, "species", arrays, lambda k: (k >= 0) & (k <= last), f"a population of the scene, 0 to {last}"
    )
    _check_entries(species, "begun", arrays, lambda begun: begun <= time, f"at most the time of the state, {time:g}")


def check_finite(species: str, arrays: Mapping[str, Array]) -> None:
    """Raise EntryError unless all floating-point numbers in `arrays` are finite; species: a name for messages."""
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            _check_entries(species, name, arrays, np.isfinite, "a finite number")


def _check_entries(
    species: str, name: str, arrays: Mapping[str, Array], is_right: Callable[[Array], Array], expected: str
) -> None:
    """Raise EntryError at the first entry of arrays[name], if this array is present, for which `is_right` is False."""
    if name not in arrays or (right := is_right(arrays[name])).all():
        return
    index = tuple(int(i) for i in np.argwhere(~right)[0])
    place = ", ".join(str(i) for i in index)
    raise EntryError(f"{species}.{name}[{place}] is {arrays[name][index]:g}; expected {expected}")
