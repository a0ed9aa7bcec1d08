"""Where the time of a step goes: the loops that threads share, by the names of their kernels."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

LEAST = 0.01  # share of a step, below which a loop is not shown by name


@contextmanager
def watched() -> Iterator[Counter[str]]:
    """CPU seconds of all loops that run meanwhile, by name; of modules that are loaded already."""
    from discsim.numerics import threads
    from discsim.numerics.thread_pool import cpu_time

    passes: Counter[str] = Counter()

    def timed(share: Callable[..., Any], kernel: Any, *given: Any, **named: Any) -> Any:
        start = cpu_time()  # other loops may run at the same time
        out = share(kernel, *given, **named)
        spent = cpu_time() - start
        passes[_name(kernel)] += spent
        return out

    def timed_in_turn(share: Callable[..., Any], kernels: list[tuple[Any, ...]], *given: Any, **named: Any) -> None:
        spent: list[tuple[str, float]] = []  # by piece, of several threads at the same time

        def timed_one(kernel: Any, *arguments: Any) -> None:
            start = time.thread_time()
            kernel(*arguments)
            spent.append((_name(kernel), time.thread_time() - start))

        share([(partial(timed_one, kernel), *arguments) for kernel, *arguments in kernels], *given, **named)
        for name, seconds in spent:
            passes[name] += seconds

    shares = {
        threads.parallel_for: timed,
        threads.parallel_for_ranges: timed,
        threads.parallel_for_fused: timed_in_turn,
    }
    modules: list[Any] = list(sys.modules.values())
    users = [
        (module, share.__name__, share)
        for share in shares
        for module in modules
        if getattr(module, share.__name__, None) is share
    ]
    try:
        for module, name, share in users:
            setattr(module, name, partial(shares[share], share))
        yield passes
    finally:
        for module, name, share in users:
            setattr(module, name, share)


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
