"""Options of a compilation are compared by what is set of them.

numba looks up each operator and function of a kernel by its arguments and by all options of the kernel, and reads them
one property at a time, set or not: a tenth of a compilation. Where the same are set to the same, all are the same.
"""

from functools import cache
from typing import Any

from numba.core.targetconfig import TargetConfig

one_by_one = TargetConfig.__eq__


def same(own: Any, other: Any) -> bool:
    return (type(own) is type(other) and own._values == other._values) or one_by_one(own, other)


@cache
def of_names(kind: Any) -> int:
    """The hash that numba makes anew each time: of the names of all options."""
    return hash(tuple(sorted(kind.options)))


def compare_what_is_set() -> None:
    TargetConfig.__eq__ = same  # type: ignore[method-assign]
    TargetConfig.__hash__ = lambda own: of_names(type(own))  # type: ignore[method-assign]
