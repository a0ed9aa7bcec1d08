"""Allocation of arrays that have spare capacity or are aligned to cache lines.

Spare capacity is reserved memory after the last entry. Ghosts or arriving particles can be appended there without a
copy of the array.
"""

import math
from weakref import WeakValueDictionary

import numpy as np

Array = np.ndarray
# Arrays made by `allocate`, with their spare capacity, by id.
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
    """Return an uninitialised array (count, ...) with the dtype and the other axes of `like` (n, ...).

    spare: spare capacity, the number of entries that can be appended without a copy.
    """
    whole = np.empty((count + spare, *like.shape[1:]), like.dtype)
    if spare > 0:
        _with_spare_capacity[id(whole)] = whole
    return whole[:count]


def allocate_like(array: Array, numbers: type | None = None) -> Array:
    """Return an uninitialised array with the shape, dtype and spare capacity of `array` (n, ...).

    numbers: if given, the result has the shape (n,) and this dtype.
    """
    like = array if numbers is None else np.empty(0, numbers)
    return allocate(len(array), like, len(_with_capacity(array)) - len(array))


def grow(array: Array, count: int) -> Array | None:
    """Return a view of `array` extended to `count` entries, or None if its spare capacity is too small.

    The additional entries are uninitialised.
    """
    whole = _with_capacity(array)
    return None if whole is array or len(whole) < count else whole[:count]


def same_address(one: Array, other: Array) -> bool:
    """Return whether two arrays begin at the same address."""
    return len(one) > 0 and len(other) > 0 and _address(one) == _address(other)


def _with_capacity(array: Array) -> Array:
    """Return `array` extended by its spare capacity; `array` itself if it has none."""
    whole = array.base
    if whole is None or id(whole) not in _with_spare_capacity or array.ndim != whole.ndim:
        return array
    return whole if _address(array) == _address(whole) else array


def _address(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
