"""Where the time of a step goes: the loops that threads share, by the names of their kernels."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

LEAST = 0.01  # share of a step, below which a loop is not shown by name


@contextmanager
def watched() -> Iterator[Counter[str]]:
    """CPU seconds of all loops that run meanwhile, by name; of modules that are loaded already."""
    from discsim.numerics import threads
    from discsim.numerics.teams import cpu_time

    share = threads.share
    passes: Counter[str] = Counter()

    def timed(kernel: Any, *given: Any, **named: Any) -> list[Any]:
        start = cpu_time()  # other loops may run at the same time
        out = share(kernel, *given, **named)
        spent = cpu_time() - start
        passes[_name(kernel)] += spent
        return out

    users: list[Any] = [module for module in list(sys.modules.values()) if getattr(module, "share", None) is share]
    try:
        for module in users:
            module.share = timed
        yield passes
    finally:
        for module in users:
            module.share = share


def _name(kernel: Any) -> str:
    """Of a kernel its own, of a loop in Python that of the function around it."""
    if hasattr(kernel, "py_func"):
        return str(kernel.py_func.__name__)
    function = getattr(kernel, "func", kernel)  # of a partial one
    return str(function.__qualname__).partition(".<locals>")[0].rpartition(".")[2].strip("_")


def table_of(title: str, passes: dict[str, float], step: float, particles: int) -> Table:
    """The passes of a step of `step` CPU seconds, those of at least LEAST of it by name, and all else."""
    table = Table("pass", "ms", "ns a particle", "share", title=title, box=SIMPLE)
    shown = {name: seconds for name, seconds in passes.items() if seconds >= LEAST * step}
    shown["other loops"] = sum(passes.values()) - sum(shown.values())
    shown["outside of loops"] = step - sum(passes.values())
    for name, seconds in shown.items():
        table.add_row(name, f"{1e3 * seconds:.2f}", f"{1e9 * seconds / particles:.1f}", f"{seconds / step:.1%}")
    return table
