"""Division of consecutive items, such as rows, into a range of about equal length for each rank."""

from __future__ import annotations

from typing import NamedTuple


class Share(NamedTuple):
    """Ranges of consecutive items, one for each rank: from `edges[rank]` up to `edges[rank + 1]`."""

    edges: list[int]

    @classmethod
    def of(cls, count: int, size: int, ranks: int) -> Share:
        """Return ranges that divide `count` items among ranks, cut at multiples of `size` items."""
        pieces = -(-count // size)
        return cls([min(size * (pieces * rank // ranks), count) for rank in range(ranks + 1)])

    def span(self, rank: int) -> slice:
        return slice(self.edges[rank], self.edges[rank + 1])

    def count(self, rank: int) -> int:
        return self.edges[rank + 1] - self.edges[rank]
