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


def longer(array: Array, count: int) -> Array | None:
    """`count` entries: the array and what is behind it, in one memory. None where it has no room for them."""
    whole = array.base
    if whole is None or id(whole) not in _made or len(whole) < count or array.ndim != whole.ndim:
        return None
    return whole[:count] if _begin(array) == _begin(whole) else None


def _begin(array: Array) -> int:
    return int(array.__array_interface__["data"][0])
