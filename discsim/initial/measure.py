"""How far a run is from an exact solution: what starts that have one are measured by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from discsim.run.simulation import Simulation

Array = np.ndarray


class ErrorMeasure(NamedTuple):
    """What an error is, in words, and the errors of a simulation now by species ("" where it is of neither)."""

    words: str
    errors: Callable[[Simulation], dict[str, float]]


def velocity_errors(
    exact: Callable[[Simulation, str], tuple[Array, Array | float]],
) -> Callable[[Simulation], dict[str, float]]:
    """Errors by species from `exact(sim, kind)`: velocities (n, d) at the particles that move, and their frame."""

    def errors(sim: Simulation) -> dict[str, float]:
        out = {}
        for kind, p in sim.state.species.items():
            found, frame = exact(sim, kind)
            free = np.ones(p.count, bool) if p.immobile is None else ~p.immobile
            found = np.broadcast_to(found, p.vel.shape)[free]
            scale = np.sqrt(((found - frame) ** 2).sum(axis=1).max())
            out[kind] = float(np.sqrt(((p.vel[free] - found) ** 2).sum(axis=1).mean()) / scale)
        return out

    return errors
