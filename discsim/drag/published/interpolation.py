"""Drag of each particle towards the interpolated velocity of the other species, for esph and isph.

Momentum is as good as the interpolation. The impulses that dust takes from gas and gas from dust are sums over
different particles, which are equal only where fields are smooth. Heat is the work of the drag on the gas, right to
first order in the step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.published.pairs import Pairs, note_times
from discsim.kernels.drag import interpolation as kernels
from discsim.numerics.threads import parallel_for

if TYPE_CHECKING:
    from discsim.effects.drag import Effect as Drag
    from discsim.numerics.state import Dust, Gas, State

Array = np.ndarray
NONE = np.empty(0)


def follow(
    drag: Drag, state: State, found: list[Pairs], dt: float, gas_vel: Array, heat: Array, implicit: bool
) -> None:
    """Kick gas and dust over dt, each towards the interpolated velocity of the other (`kernels/drag/interpolation.py`).

    With `implicit` the interpolated velocities include the accelerations that gas and dust do not share.
    """
    gas, dust, own = state.gas, state.dust, state.own_acc
    gas_now, dust_now = gas_vel, dust.vel
    if implicit:
        gas_now = gas_vel + dt * own["gas"]
        dust_now = dust.vel + dt * own["dust"] if len(own["dust"]) > 0 else dust.vel
    rate, other = seen_by_dust(dust, found, gas_now)
    gas_rate, gas_other = seen_by_gas(drag, gas, found, dust_now)
    note_times(drag, dust, found)
    parallel_for(
        kernels.kick_towards, gas.count, gas_rate, gas_other, gas_now.copy(), gas.acc, dt, implicit, gas_vel, heat
    )
    parallel_for(kernels.kick_towards, dust.count, rate, other, dust_now.copy(), dust.acc, dt, implicit, dust.vel, NONE)


def seen_by_dust(dust: Dust, found: list[Pairs], gas_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each dust particle, and the velocity (n, d) of the gas at its position."""
    rate, other = np.zeros(dust.count), np.zeros_like(dust.vel)
    for pairs in found:
        there = np.empty_like(pairs.cloud.pos)
        parallel_for(kernels.seen_by_dust, len(there), pairs.start, pairs.gas, pairs.part, gas_vel, there)
        rate[pairs.cloud.members], other[pairs.cloud.members] = pairs.rate, there
    return rate, other


def seen_by_gas(drag: Drag, gas: Gas, found: list[Pairs], dust_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each gas particle, and the velocity (n, d) of the dust there, weighted by the
    rates.
    """
    rate, pull = np.zeros(gas.count), np.zeros_like(gas.vel)
    for pairs in found if drag.two_way else ():
        cloud = pairs.cloud
        parallel_for(
            kernels.seen_by_gas, gas.count, pairs.by_gas, pairs.begin, pairs.dust, pairs.weight, pairs.time,
            cloud.mass, cloud.density, dust_vel[cloud.members], gas.density, rate, pull,
        )  # fmt: skip
    return rate, pull / np.where(rate > 0.0, rate, 1.0)[:, None]


def fastest(drag: Drag, state: State, found: list[Pairs]) -> float:
    """Return the largest drag rate of a particle; explicit steps up to its inverse are stable (Gershgorin)."""
    gas_rate, _ = seen_by_gas(drag, state.gas, found, state.dust.vel)
    return max(gas_rate.max(), *(pairs.rate.max() for pairs in found))
