"""Costs of effects in a run on several ranks; MPI communication has separate rows in the table.

CPU seconds are those of this rank. Wall-clock seconds in MPI calls, the waiting among them (`traffic.py`), bytes and
messages are means over all ranks.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from discsim.ranks.traffic import Sum, Traffic
from discsim.run.costs import Costs

OUTSIDE_EFFECTS = "step"  # communication outside effects


class DividedCosts(Costs):
    """`Costs` of one rank, including MPI communication. `copy` and `gather` are collective."""

    def __init__(self, costs: Costs, traffic: Traffic) -> None:
        super().__init__(costs.calls)
        self.calls.update(costs.calls)
        self.seconds.update(costs.seconds)
        self.traffic = traffic
        traffic.fold()
        self._spent = dict(traffic.sums)  # sums at the start
        self._forgotten: dict[str, Sum] = {}
        self._means: dict[str, Sum] = {}

    @contextmanager
    def __call__(self, name: str, calls: int = 1) -> Iterator[None]:
        self.traffic.doing = name
        try:
            with super().__call__(name, calls):
                yield
        finally:
            self.traffic.doing = ""

    def copy(self) -> DividedCosts:
        return DividedCosts(self, self.traffic)

    def forget(self, start: Costs, end: Costs) -> None:
        super().forget(start, end)
        if isinstance(start, DividedCosts) and isinstance(end, DividedCosts):
            for name, spent in end._spent.items():
                self._forgotten[name] = spent - start._spent.get(name, Sum())

    @property
    def communication(self) -> dict[str, Sum]:
        """Cost of communication on this rank by effect; outside effects under the name OUTSIDE_EFFECTS."""
        sums = {name: spent - self._forgotten.get(name, Sum()) for name, spent in self.traffic.sums.items()}
        return {name or OUTSIDE_EFFECTS: sums[name] for name in (*self.seconds, "") if name in sums}

    def gather(self) -> None:
        self.traffic.fold()
        self._means = self.traffic.mean(self.communication)

    def rows(self) -> Iterator[list[str]]:
        own, means = self.communication, self._means
        cpu = {name: max(seconds - own.get(name, Sum()).cpu_seconds, 0.0) for name, seconds in self.seconds.items()}
        total = (sum(cpu.values()) + sum(spent.cpu_seconds for spent in own.values())) or 1.0
        yield ["effect", "calls", "cpu_seconds", "share", "seconds", "waiting", "bytes", "messages"]
        for name, seconds in cpu.items():
            yield [name, str(self.calls[name]), f"{seconds:.4f}", f"{seconds / total:.4f}", *[""] * 4]
        for name, mean in means.items():
            seconds = own[name].cpu_seconds
            line = [f"{name} communication", f"{mean.calls:.0f}", f"{seconds:.4f}", f"{seconds / total:.4f}"]
            yield [*line, f"{mean.seconds:.4f}", f"{mean.waiting:.4f}", f"{mean.bytes:.0f}", f"{mean.messages:.0f}"]
