"""Allocation of arrays with spare capacity or aligned to cache lines.

Spare capacity behind the last entry of an array takes the entries of ghosts or migrated particles without a copy.
"""

import math
from weakref import WeakValueDictionary

import numpy as np

Array = np.ndarray
_made: WeakValueDictionary[int, Array] = WeakValueDictionary()  # arrays whose spare capacity is unused, by id


LINE = 64  # bytes of a cache line, and of the longest SIMD vectors


def aligned(shape: tuple[int, ...], dtype: type = np.float64) -> Array:
    """Return an uninitialised array aligned to a cache line, so that no SIMD vector crosses two lines.

    np.empty aligns to 16 bytes, with which the speed of loops over packs varied by 10% from run to run (2026-11).
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + LINE, np.uint8)
    first = -_begin(memory) % LINE
    return memory[first : first + size].view(dtype).reshape(shape)


def allocate(count: int, like: Array, spare: int) -> Array:
    """Return an uninitialised array (count, ...) like `like` (n, ...), with capacity for `spare` further entries."""
    whole = np.empty((count + spare, *like.shape[1:]), like.dtype)
    if spare > 0:
        _made[id(whole)] = whole
    return whole[:count]


def allocate_like(array: Array, numbers: type | None = None) -> Array:
    """Return an uninitialised array of the same shape, type and spare capacity; with `numbers` (n,) of that type."""
    whole, same = array.base, array if numbers is None else np.empty(0, numbers)
    return allocate(len(array), same, len(whole) - len(array) if whole is not None and _has_room(array, whole) else 0)


def grow(array: Array, count: int) -> Array | None:
    """Return a view of the array extended to `count` entries, or None if its capacity is too small."""
    whole = array.base
    if whole is None or not _has_room(array, whole) or len(whole) < count:
        return None
    return whole[:count]


def begin_alike(one: Array, other: Array) -> bool:
    """Return whether two arrays begin at the same address."""
    return len(one) > 0 and len(other) > 0 and _begin(one) == _begin(other)


def _has_room(array: Array, whole: Array) -> bool:
    return id(whole) in _made and array.ndim == whole.ndim and _begin(array) == _begin(whole)


def _begin(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
