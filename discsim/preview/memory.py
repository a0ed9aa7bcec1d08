"""Whether the machine has the memory that a run is to take, by the forecast that `discsim check` shows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

from discsim.preview.forecast import BASE, BYTES, memory

if TYPE_CHECKING:
    from discsim.scene import Scene


def too_much(scene: Scene) -> Iterator[str]:
    """What is wrong where the scene needs more memory than there is."""
    needed, there = needed_by(scene), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        yield (
            f"memory: the run needs about {_gib(needed)}, and this machine has {_gib(there)}; expected fewer particles "
            "or cells"
        )


def needed_by(scene: Scene) -> float:
    """Bytes that a run of the scene takes; of its particles alone in one dimension and of the caller's own ones."""
    if scene.initial is not None and scene.space.dimensions == 2:
        return memory(scene)
    gas = scene.gas.particles if scene.gas else 0
    return BASE + BYTES["gas"] * gas + BYTES["dust"] * sum(population.particles for population in scene.dust or ())


def _gib(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"
