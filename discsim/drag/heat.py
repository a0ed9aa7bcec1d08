"""Heat of drag that is less than nothing, paid by the gas around.

Drag's heat is the kinetic energy that is lost beside the work of the other forces. Its sum over a front is right; that
of a single particle may be below zero, and in cold gas by more than there is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.numerics import world

if TYPE_CHECKING:
    from discsim.numerics.state import Gas

Array = np.ndarray

MOST = 0.25  # of its energy is what a particle can lose in a kick: foreseen, as much again leaves it half
SIDES = 1024  # squares along the longest side, at most


def pay_losses(gas: Gas, width: float, heat: Array) -> None:
    """`share_losses` among the gas of all processes, where any would lose too much."""
    if not world.together.most(bool((heat + MOST * gas.u < 0.0).any())):
        return
    everyone = world.together.everyone(gas)
    whole = everyone.of(heat)
    share_losses(everyone.of(gas.pos), everyone.of(gas.mass), everyone.of(gas.u), width, whole)
    heat[:] = whole[everyone.own]


def share_losses(pos: Array, mass: Array, u: Array, width: float, heat: Array) -> None:
    """Make up, in `heat` (n,) per mass, what particles would lose above a quarter of their energy `u` (n,), out of what
    those around them have to spare: in squares of side `width`, then of twice that, and so on. The sum stays.
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
        with np.errstate(over="ignore"):  # where the other one is taken
            left = np.where(need > given, 1.0 - given / np.maximum(need, 1e-300), 0.0)[index]
            kept = np.where(given > need, 1.0 - need / np.maximum(given, 1e-300), 0.0)[index]
        spare *= np.where(short, left, kept)
        cell //= 2
        if len(need) == 1 or spare.min() >= 0.0:
            break
    heat[:] = spare / mass - MOST * u
