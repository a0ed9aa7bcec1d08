"""CPU time of each effect, summed over all threads, and the table costs.csv."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from discsim.numerics.thread_pool import cpu_time
from discsim.output.costtable import COLUMNS
from discsim.output.files import replace_atomically


class Costs:
    """Number of calls and CPU seconds of each effect, by the name of its table."""

    def __init__(self, names: Iterable[str]) -> None:
        self.calls = dict.fromkeys(names, 0)
        self.seconds = dict.fromkeys(self.calls, 0.0)

    @contextmanager
    def __call__(self, name: str, calls: int = 1) -> Iterator[None]:
        """Add the CPU time within the context to the seconds of `name`, and `calls` to its calls.

        The CPU time is that of this thread and of its helpers in parallel loops.
        """
        start = cpu_time()
        yield
        spent = cpu_time() - start  # before the sum is read: another thread may add to it at the same time
        self.seconds[name] += spent
        self.calls[name] += calls

    @property
    def total(self) -> float:
        """CPU seconds of all effects together."""
        return sum(self.seconds.values())

    @property
    def shares(self) -> dict[str, float]:
        """Fraction of `total` that each effect has taken, by name."""
        return {name: seconds / (self.total or 1.0) for name, seconds in self.seconds.items()}

    def arrays(self) -> dict[str, np.ndarray]:
        """Return `calls` and `seconds` as arrays (effects,), for a checkpoint."""
        return {"calls": np.array([*self.calls.values()]), "seconds": np.array([*self.seconds.values()])}

    def copy(self) -> Costs:
        """Return costs with the present numbers, which do not change later."""
        return self.of(self.calls)

    def of(self, names: Iterable[str]) -> Costs:
        """Return costs of the effects `names` with the present numbers; other effects have no calls so far."""
        same = Costs(names)
        for name in same.calls:
            same.calls[name], same.seconds[name] = self.calls.get(name, 0), self.seconds.get(name, 0.0)
        return same

    def forget(self, start: Costs, end: Costs) -> None:
        """Subtract the cost of compilation, the difference between `end` and `start`.

        end, start: copies made after and before kernels were compiled.
        """
        for name in self.calls:
            self.calls[name] -= end.calls[name] - start.calls[name]
            self.seconds[name] -= end.seconds[name] - start.seconds[name]

    def gather(self) -> None:
        """Collect the costs of all processes, for `write`; does nothing in serial runs."""

    def rows(self) -> Iterator[list[str]]:
        """Yield the rows of the table; the first row has the column names."""
        shares = self.shares
        yield [*COLUMNS]
        for name, seconds in self.seconds.items():
            yield [name, str(self.calls[name]), f"{seconds:.4f}", f"{shares[name]:.4f}"]

    def write(self, path: Path) -> None:
        """Write the table as CSV to `path`, where the file appears only when it is complete."""
        with replace_atomically(path) as temporary, temporary.open("w", newline="") as file:
            csv.writer(file).writerows(self.rows())
