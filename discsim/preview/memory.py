"""Comparison of the memory of a run, by the forecast that `discsim check` shows, with that of the machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

from discsim.preview.forecast import BASE, BYTES, memory

if TYPE_CHECKING:
    from discsim.scene import Scene


def too_much(scene: Scene) -> Iterator[str]:
    """Yield a problem if the scene needs more memory than the machine has."""
    needed, there = needed_by(scene), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        yield (
            f"memory: the run needs about {_gib(needed)}, and this machine has {_gib(there)}; expected fewer particles "
            "or cells"
        )


def needed_by(scene: Scene) -> float:
    """Return the memory of a run in bytes; in 1D and for particles passed by the caller, without the grid."""
    if scene.initial is not None and scene.space.dimensions == 2:
        return memory(scene)
    gas = scene.gas.particles if scene.gas else 0
    return BASE + BYTES["gas"] * gas + BYTES["dust"] * sum(population.particles for population in scene.dust or ())


def _gib(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"
