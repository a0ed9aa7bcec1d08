"""Equal shares of consecutive items for ranks."""

from __future__ import annotations

from typing import NamedTuple


class Share(NamedTuple):
    """Shares of consecutive items: those of a rank go from `edges[rank]` up to `edges[rank + 1]`."""

    edges: list[int]

    @classmethod
    def of(cls, count: int, size: int, ranks: int) -> Share:
        """Return the shares of `count` items, in whole pieces of `size` items."""
        pieces = -(-count // size)
        return cls([min(size * (pieces * rank // ranks), count) for rank in range(ranks + 1)])

    def span(self, rank: int) -> slice:
        return slice(self.edges[rank], self.edges[rank + 1])

    def count(self, rank: int) -> int:
        return self.edges[rank + 1] - self.edges[rank]
