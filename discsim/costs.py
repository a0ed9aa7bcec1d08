"""CPU seconds by effect, of all threads, and the table of their shares."""

import csv
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Costs:
    """Adds up calls and CPU seconds by name; `skip` forgets the first calls, in which kernels compile."""

    def __init__(self, names):
        self.calls = dict.fromkeys(names, 0)
        self.seconds = dict.fromkeys(names, 0.0)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        start = time.process_time()
        yield
        self.seconds[name] += time.process_time() - start
        self.calls[name] += 1

    def write(self, path: Path) -> None:
        total = sum(self.seconds.values()) or 1.0
        with path.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["effect", "calls", "cpu_seconds", "share"])
            for name, seconds in self.seconds.items():
                rows.writerow([name, self.calls[name], f"{seconds:.4f}", f"{seconds / total:.4f}"])
