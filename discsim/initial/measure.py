"""Errors of a run relative to an exact solution, for starts that have one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Dust, Gas, State

Array = np.ndarray


class Simulated(Protocol):
    """The attributes of a `Simulation` from which errors are computed: time and particles."""

    @property
    def time(self) -> float: ...

    @property
    def gas(self) -> Gas | None: ...

    @property
    def dust(self) -> Dust | None: ...

    @property
    def state(self) -> State: ...


class ErrorMeasure(NamedTuple):
    """A measure of error against an exact solution.

    Attributes
    ----------
    words : str
        Description of the error, as text for reports.
    errors : callable (sim)
        Return the errors of a simulation at its present time by species; the key "" is for an error of all species.
    """

    words: str
    errors: Callable[[Simulated], dict[str, float]]


def velocity_errors(
    exact: Callable[[Simulated, str], tuple[Array, Array | float]],
) -> Callable[[Simulated], dict[str, float]]:
    """Return a function of a simulation: the relative RMS error of particle velocities by species.

    exact(sim, kind): return the exact velocities (n, d) of the particles of the species `kind`, and the velocity of a
    frame. Errors are relative to the largest exact speed in this frame. Immobile particles are left out.
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
