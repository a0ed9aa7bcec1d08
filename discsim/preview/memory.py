"""Comparison of the memory that a run needs, from the forecast of `discsim check`, with the memory of the machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

from discsim.preview.forecast import BASE_BYTES, BYTES_PER_PARTICLE, memory

if TYPE_CHECKING:
    from discsim.scene import Scene


def memory_warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning if a run of the scene needs more memory than the machine has."""
    needed, there = required_memory(scene), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        yield (
            f"memory: the run needs about {_gib_text(needed)}, and this machine has {_gib_text(there)}; expected fewer "
            "particles or cells"
        )


def required_memory(scene: Scene) -> float:
    """Return the memory of a run in bytes.

    The grid is left out in 1D and for particles that the caller passes.
    """
    if scene.initial is not None and scene.space.dimensions == 2:
        return memory(scene)
    gas = scene.gas.particles if scene.gas else 0
    return (
        BASE_BYTES
        + BYTES_PER_PARTICLE["gas"] * gas
        + BYTES_PER_PARTICLE["dust"] * sum(population.particles for population in scene.dust or ())
    )


def _gib_text(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"
