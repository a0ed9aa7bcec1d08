"""Memory of arrays.

Some have room behind their last entries, where others' entries go: those of both are then there without a copy. Others
begin where a cache line does.
"""

import math
from weakref import WeakValueDictionary

import numpy as np

Array = np.ndarray
_made: WeakValueDictionary[int, Array] = WeakValueDictionary()  # whole arrays by identity: what is behind is nobody's


LINE = 64  # bytes of a cache line, and of the longest vectors of processors


def aligned(shape: tuple[int, ...], dtype: type = np.float64) -> Array:
    """An empty array that begins with a cache line: a vector, or a row of as many bytes, is never of two of them.

    np.empty begins at any multiple of 16 bytes, which made loops over packs faster or slower by a tenth from run to run
    (2026-11).
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + LINE, np.uint8)
    first = -_begin(memory) % LINE
    return memory[first : first + size].view(dtype).reshape(shape)


def empty(count: int, like: Array, spare: int) -> Array:
    """An array of `count` entries such as those of `like` (n, ...), with room for some more."""
    whole = np.empty((count + spare, *like.shape[1:]), like.dtype)
    if spare > 0:
        _made[id(whole)] = whole
    return whole[:count]


def like(array: Array, numbers: type | None = None) -> Array:
    """An array such as this one, with as much room; or of `numbers` of that type, one for each entry."""
    whole, same = array.base, array if numbers is None else np.empty(0, numbers)
    return empty(len(array), same, len(whole) - len(array) if whole is not None and _has_room(array, whole) else 0)


def longer(array: Array, count: int) -> Array | None:
    """`count` entries: the array and what is behind it, in one memory. None where it has no room for them."""
    whole = array.base
    if whole is None or not _has_room(array, whole) or len(whole) < count:
        return None
    return whole[:count]


def begin_alike(one: Array, other: Array) -> bool:
    """Whether two arrays begin at one place in memory."""
    return len(one) > 0 and len(other) > 0 and _begin(one) == _begin(other)


def _has_room(array: Array, whole: Array) -> bool:
    return id(whole) in _made and array.ndim == whole.ndim and _begin(array) == _begin(whole)


def _begin(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
