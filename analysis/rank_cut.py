"""Tiles cut into more parts than there are ranks: rank r has the parts r, r + ranks and so on, and so more borders than
with one part. With few ranks, of which each has a core of its own, that shows what others' particles cost.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from discsim.ranks import world
from discsim.ranks.division import Division


class Interleaved(Division):
    """Tiles that are cut into `parts`, a whole multiple of the ranks."""

    parts = 0

    def rebalance(self, species: dict[str, Any]) -> bool:
        ranks = self.comm
        self.owner = getattr(self, "part", self.owner)
        self.comm = SimpleNamespace(size=self.parts, rank=ranks.rank, allreduce=ranks.allreduce)
        try:
            changed = super().rebalance(species)
        finally:
            self.comm = ranks
        self.part = self.owner  # (tiles,)
        self.owner = self.part % ranks.size
        return changed


def division_of(parts: int) -> type[Division]:
    """What cuts tiles into so many parts; 0: as many as there are ranks."""
    return type("Cut", (Interleaved,), {"parts": parts}) if parts > 0 else Division


@contextmanager
def cut_into(parts: int) -> Iterator[None]:
    """Within it ranks that begin a run divide its particles so."""
    usual, world.Division = world.Division, division_of(parts)  # type: ignore[misc]
    try:
        yield
    finally:
        world.Division = usual  # type: ignore[misc]
