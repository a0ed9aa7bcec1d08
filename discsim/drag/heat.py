"""Compensation of negative heat of drag by the energy of neighbouring gas particles.

The heat of drag is the loss of kinetic energy beyond the work of other forces. Its sum over a shock front is right, but
the heat of a single particle may be negative. In cold gas such a particle could lose more than its thermal energy.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.numerics import world

Array = np.ndarray

MOST = 0.25  # largest loss in a kick over a particle's thermal energy; the prediction may lose as much once more
SIDES = 1024  # largest number of squares along the longer side of the gas


def compensate_losses(gas: Any, width: float, heat: Array) -> None:
    """Change `heat` in place such that no gas particle of any rank loses more than a quarter of its thermal energy.

    gas: `Particles` of the gas. width: side of the smallest squares whose particles share their losses. heat (n,): heat
    per mass of the local gas.
    """
    if not world.processes.max(bool((heat + MOST * gas.u < 0.0).any())):
        return
    everyone = world.processes.allgather(gas)
    whole = everyone.with_ghosts(heat)
    pos, mass, u = (everyone.with_ghosts(array) for array in (gas.pos, gas.mass, gas.u))
    compensate_by_neighbours(pos, mass, u, width, whole)
    heat[:] = whole[everyone.local_rows]


def compensate_by_neighbours(pos: Array, mass: Array, u: Array, width: float, heat: Array) -> None:
    """Change `heat` in place such that no particle loses more than a quarter of its energy; the total heat stays.

    u, heat (n,): thermal energy and heat per mass. In each square, particles give energy to those that lose too much.
    Squares have the side `width` at first; their side doubles until all losses are compensated.
    """
    available = mass * (heat + MOST * u)
    if available.min() >= 0.0:
        return
    offset = pos - pos.min(axis=0)
    square = (offset / max(width, offset.max() / SIDES)).astype(np.int64)
    while True:
        index = np.ravel_multi_index(tuple(square.T), tuple(square.max(axis=0) + 1))
        lacks = available < 0.0
        lacking = np.bincount(index, np.where(lacks, -available, 0.0))
        offered = np.bincount(index, np.where(lacks, 0.0, available))
        with np.errstate(over="ignore"):  # in the quotient that np.where does not use
            unpaid = np.where(lacking > offered, 1.0 - offered / np.maximum(lacking, 1e-300), 0.0)[index]
            kept = np.where(offered > lacking, 1.0 - lacking / np.maximum(offered, 1e-300), 0.0)[index]
        available *= np.where(lacks, unpaid, kept)
        square //= 2
        if len(lacking) == 1 or available.min() >= 0.0:
            break
    heat[:] = available / mass - MOST * u
