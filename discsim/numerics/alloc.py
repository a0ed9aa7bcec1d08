"""Allocation of arrays that have spare capacity or are aligned to cache lines.

With spare capacity behind the last entry, ghosts or arriving particles can be appended without a copy of the array.
"""

import math
from weakref import WeakValueDictionary

import numpy as np

Array = np.ndarray
# Arrays whose spare capacity is unused, by id.
_with_spare_capacity: WeakValueDictionary[int, Array] = WeakValueDictionary()

CACHE_LINE = 64  # bytes of a cache line, and of the longest SIMD vectors


def aligned(shape: tuple[int, ...], dtype: type = np.float64) -> Array:
    """Return an uninitialised array that begins at a cache line, so that no SIMD vector crosses two lines.

    np.empty aligns to 16 bytes only; the speed of SIMD loops then varied by 10% from run to run (2026-11).
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + CACHE_LINE, np.uint8)
    first = -_address(memory) % CACHE_LINE
    return memory[first : first + size].view(dtype).reshape(shape)


def allocate(count: int, like: Array, spare: int) -> Array:
    """Return an uninitialised array (count, ...) with the dtype and further axes of `like` (n, ...).

    spare: number of further entries for which memory is reserved.
    """
    whole = np.empty((count + spare, *like.shape[1:]), like.dtype)
    if spare > 0:
        _with_spare_capacity[id(whole)] = whole
    return whole[:count]


def allocate_like(array: Array, numbers: type | None = None) -> Array:
    """Return an uninitialised array with the shape, dtype and spare capacity of `array`.

    numbers: dtype of a one-dimensional result (n,), in place of the dtype and shape of `array`.
    """
    whole, same = array.base, array if numbers is None else np.empty(0, numbers)
    return allocate(
        len(array), same, len(whole) - len(array) if whole is not None and _has_spare_capacity(array, whole) else 0
    )


def grow(array: Array, count: int) -> Array | None:
    """Return a view of `array` extended to `count` entries, or None if its spare capacity is too small."""
    whole = array.base
    if whole is None or not _has_spare_capacity(array, whole) or len(whole) < count:
        return None
    return whole[:count]


def same_address(one: Array, other: Array) -> bool:
    """Return whether two arrays begin at the same address."""
    return len(one) > 0 and len(other) > 0 and _address(one) == _address(other)


def _has_spare_capacity(array: Array, whole: Array) -> bool:
    return id(whole) in _with_spare_capacity and array.ndim == whole.ndim and _address(array) == _address(whole)


def _address(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
