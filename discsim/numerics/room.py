"""Arrays with room behind their last entries, where others' entries go: those of both are then there without a copy."""

from weakref import WeakValueDictionary

import numpy as np

Array = np.ndarray
_made: WeakValueDictionary[int, Array] = WeakValueDictionary()  # whole arrays by identity: what is behind is nobody's


def empty(count: int, like: Array, spare: int) -> Array:
    """An array of `count` entries such as those of `like` (n, ...), with room for some more."""
    whole = np.empty((count + spare, *like.shape[1:]), like.dtype)
    if spare > 0:
        _made[id(whole)] = whole
    return whole[:count]


def like(array: Array) -> Array:
    """An array such as this one, with as much room."""
    whole = array.base
    return empty(len(array), array, len(whole) - len(array) if whole is not None and _has_room(array, whole) else 0)


def longer(array: Array, count: int) -> Array | None:
    """`count` entries: the array and what is behind it, in one memory. None where it has no room for them."""
    whole = array.base
    if whole is None or not _has_room(array, whole) or len(whole) < count:
        return None
    return whole[:count]


def _has_room(array: Array, whole: Array) -> bool:
    return id(whole) in _made and array.ndim == whole.ndim and _begin(array) == _begin(whole)


def _begin(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
