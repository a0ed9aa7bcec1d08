"""Compensation of negative drag heat by the energy of neighbouring gas.

The heat of drag is the loss of kinetic energy beyond the work of other forces. Its sum over a shock front is right, but
the heat of a single particle may be negative, and in cold gas exceed the energy of the particle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.numerics import world

Array = np.ndarray

MOST = 0.25  # largest loss in a kick over a particle's energy; with an equal loss in the prediction, half is left
SIDES = 1024  # largest number of squares along the longest side


def pay_losses(gas: Any, width: float, heat: Array) -> None:
    """Apply `share_losses` to the gas of all processes, if any particle would lose too much.

    width: side of the smallest squares. heat (n,): heat per mass of local gas, changed in place.
    """
    if not world.processes.most(bool((heat + MOST * gas.u < 0.0).any())):
        return
    everyone = world.processes.everyone(gas)
    whole = everyone.of(heat)
    share_losses(everyone.of(gas.pos), everyone.of(gas.mass), everyone.of(gas.u), width, whole)
    heat[:] = whole[everyone.own]


def share_losses(pos: Array, mass: Array, u: Array, width: float, heat: Array) -> None:
    """Change `heat` (n,) in place such that no particle loses more than a quarter of its energy; keep the total heat.

    u (n,), heat (n,): energy and heat per mass. Particles in the same square give energy to those that lose too much.
    Squares have the side `width`; their side doubles until all losses are compensated.
    """
    spare = mass * (heat + MOST * u)
    if spare.min() >= 0.0:
        return
    place = pos - pos.min(axis=0)
    cell = (place / max(width, place.max() / SIDES)).astype(np.int64)
    while True:
        index = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
        short = spare < 0.0
        need = np.bincount(index, np.where(short, -spare, 0.0))
        given = np.bincount(index, np.where(short, 0.0, spare))
        with np.errstate(over="ignore"):  # in the one of the two that is not used below
            left = np.where(need > given, 1.0 - given / np.maximum(need, 1e-300), 0.0)[index]
            kept = np.where(given > need, 1.0 - need / np.maximum(given, 1e-300), 0.0)[index]
        spare *= np.where(short, left, kept)
        cell //= 2
        if len(need) == 1 or spare.min() >= 0.0:
            break
    heat[:] = spare / mass - MOST * u
