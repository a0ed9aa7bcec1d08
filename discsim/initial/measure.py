"""Errors of a run relative to the exact solution of its start."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Dust, Gas, State

Array = np.ndarray


class Simulated(Protocol):
    """Attributes of a `Simulation` from which errors are computed: its time and its particles."""

    @property
    def time(self) -> float: ...

    @property
    def gas(self) -> Gas | None: ...

    @property
    def dust(self) -> Dust | None: ...

    @property
    def state(self) -> State: ...


class ErrorMeasure(NamedTuple):
    """An error relative to an exact solution: how it is computed, and its description.

    Attributes
    ----------
    words : str
        Text for reports that says what is compared, like "particle velocities compared with the exact wave".
    errors : callable (sim)
        Return the errors of the simulation `sim` at its present time as {species: error}. The species "" stands for an
        error of all species together.
    """

    words: str
    errors: Callable[[Simulated], dict[str, float]]


def velocity_errors(
    exact: Callable[[Simulated, str], tuple[Array, Array | float]],
) -> Callable[[Simulated], dict[str, float]]:
    """Return a function errors(sim) that returns the relative RMS error of particle velocities of each species.

    exact: function exact(sim, kind) that returns the exact velocities (n, d) of the particles of the species `kind`,
    and the velocity of a reference frame. The RMS error is divided by the largest exact speed in this frame. Immobile
    particles do not count.
    """

    def errors(sim: Simulated) -> dict[str, float]:
        out = {}
        for kind, p in sim.state.species.items():
            found, frame = exact(sim, kind)
            free = np.ones(p.count, bool) if p.immobile is None else ~p.immobile
            found = np.broadcast_to(found, p.vel.shape)[free]
            scale = np.sqrt(((found - frame) ** 2).sum(axis=1).max())
            out[kind] = float(np.sqrt(((p.vel[free] - found) ** 2).sum(axis=1).mean()) / scale)
        return out

    return errors
