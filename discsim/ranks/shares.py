"""Equal shares of ranks of what lies in a row."""

from __future__ import annotations

from typing import NamedTuple


class Share(NamedTuple):
    """What each rank has of some things in a row: from `edges[rank]` to `edges[rank + 1]`."""

    edges: list[int]

    @classmethod
    def of(cls, count: int, size: int, ranks: int) -> Share:
        """Of `count`, in whole pieces of a `size`."""
        pieces = -(-count // size)
        return cls([min(size * (pieces * rank // ranks), count) for rank in range(ranks + 1)])

    def span(self, rank: int) -> slice:
        return slice(self.edges[rank], self.edges[rank + 1])

    def count(self, rank: int) -> int:
        return self.edges[rank + 1] - self.edges[rank]
