"""Costs of effects in a run on several ranks; MPI communication has separate rows in the table.

CPU seconds are measured on this rank. Wall-clock seconds in MPI calls, the time spent waiting in them, bytes and
messages are means over all ranks (`traffic.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from discsim.ranks.traffic import CallCost, Traffic
from discsim.run.costs import Costs

OUTSIDE_EFFECTS = "step"  # name of communication between effects


class DividedCosts(Costs):
    """`Costs` of a run on one rank, including MPI communication. The methods `copy` and `gather` are collective."""

    def __init__(self, costs: Costs, traffic: Traffic) -> None:
        super().__init__(costs.calls)
        self.calls.update(costs.calls)
        self.seconds.update(costs.seconds)
        self.traffic = traffic
        traffic.add_waiting()
        self._spent = traffic.sums  # when this object was created
        self._forgotten: dict[str, CallCost] = {}
        self._means: dict[str, CallCost] = {}

    @contextmanager
    def __call__(self, name: str, calls: int = 1) -> Iterator[None]:
        self.traffic.effect = name
        try:
            with super().__call__(name, calls):
                yield
        finally:
            self.traffic.effect = ""

    def copy(self) -> DividedCosts:
        return DividedCosts(self, self.traffic)

    def forget(self, start: Costs, end: Costs) -> None:
        super().forget(start, end)
        if isinstance(start, DividedCosts) and isinstance(end, DividedCosts):
            for name, spent in end._spent.items():
                self._forgotten[name] = spent - start._spent.get(name, CallCost())

    @property
    def communication(self) -> dict[str, CallCost]:
        """Cost of communication on this rank by effect; under the name OUTSIDE_EFFECTS between effects."""
        sums = {name: spent - self._forgotten.get(name, CallCost()) for name, spent in self.traffic.sums.items()}
        return {name or OUTSIDE_EFFECTS: sums[name] for name in (*self.seconds, "") if name in sums}

    def gather(self) -> None:
        self.traffic.add_waiting()
        self._means = self.traffic.mean(self.communication)

    def rows(self) -> Iterator[list[str]]:
        own, means = self.communication, self._means
        cpu = dict(self.seconds)
        for name in cpu.keys() & own.keys():
            cpu[name] = max(cpu[name] - own[name].cpu_seconds, 0.0)
        total = (sum(cpu.values()) + sum(spent.cpu_seconds for spent in own.values())) or 1.0
        yield ["effect", "calls", "cpu_seconds", "share", "seconds", "waiting", "bytes", "messages"]
        for name, seconds in cpu.items():
            yield [name, str(self.calls[name]), f"{seconds:.4f}", f"{seconds / total:.4f}", *[""] * 4]
        for name, mean in means.items():
            seconds = own[name].cpu_seconds
            line = [f"{name} communication", f"{mean.calls:.0f}", f"{seconds:.4f}", f"{seconds / total:.4f}"]
            yield [*line, f"{mean.seconds:.4f}", f"{mean.waiting:.4f}", f"{mean.bytes:.0f}", f"{mean.messages:.0f}"]
