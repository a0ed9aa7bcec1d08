"""Drag of each particle towards the interpolated velocity of the other species, for esph and isph.

Momentum is conserved only as well as the interpolation is accurate: the impulses on dust and on gas are sums over
different particles, which cancel only in smooth fields. Heat is the work of the drag on the gas, right to first order
in the step.
"""

from __future__ import annotations

import numpy as np

from discsim.drag.base import EMPTY, Array, Dust, Gas, Kicked, Law
from discsim.drag.published.pairs import Pairs, times_in
from discsim.kernels.drag import interpolation as kernels
from discsim.numerics.threads import parallel_for


def follow(gas: Gas, dust: Dust, law: Law, found: list[Pairs], dt: float, heat: Array, implicit: bool) -> Kicked:
    """Kick gas and dust over dt towards each other's interpolated velocities (`kernels/drag/interpolation.py`).

    found: pairs of each population. implicit: whether the kick is implicit in a particle's own velocity; interpolated
    velocities then include `acc_unshared`.
    """
    count, grains = len(gas.mass), len(dust.mass)
    gas_now, dust_now = gas.vel, dust.vel
    if implicit:
        gas_now = gas.vel + dt * gas.acc_unshared
        dust_now = dust.vel + dt * dust.acc_unshared if len(dust.acc_unshared) > 0 else dust.vel
    rate, other = seen_by_dust(dust, found, gas_now)
    gas_rate, gas_other = seen_by_gas(gas, found if law.two_way else [], dust_now)
    parallel_for(kernels.kick_towards, count, gas_rate, gas_other, gas_now.copy(), gas.acc, dt, implicit, gas.vel, heat)
    parallel_for(kernels.kick_towards, grains, rate, other, dust_now.copy(), dust.acc, dt, implicit, dust.vel, EMPTY)
    return times_in(dust, found)


def seen_by_dust(dust: Dust, found: list[Pairs], gas_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each dust particle, and the gas velocity (n, d) interpolated to its position."""
    rate, other = np.zeros(len(dust.mass)), np.zeros_like(dust.vel)
    for pairs in found:
        there = np.empty_like(pairs.cloud.pos)
        parallel_for(kernels.seen_by_dust, len(there), pairs.start, pairs.gas, pairs.part, gas_vel, there)
        rate[pairs.cloud.members], other[pairs.cloud.members] = pairs.rate, there
    return rate, other


def seen_by_gas(gas: Gas, found: list[Pairs], dust_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each gas particle, and the dust velocity (n, d) interpolated to its position.

    Populations contribute to the velocity in proportion to their drag rates.
    """
    rate, pull = np.zeros(len(gas.mass)), np.zeros_like(gas.vel)
    for pairs in found:
        cloud = pairs.cloud
        parallel_for(
            kernels.seen_by_gas, len(rate), pairs.by_gas, pairs.begin, pairs.dust, pairs.weight, pairs.time,
            cloud.mass, cloud.density, dust_vel[cloud.members], gas.density, rate, pull,
        )  # fmt: skip
    return rate, pull / np.where(rate > 0.0, rate, 1.0)[:, None]


def fastest(gas: Gas, dust: Dust, law: Law, found: list[Pairs]) -> float:
    """Return the largest drag rate of a particle; explicit steps up to its inverse are stable (Gershgorin)."""
    gas_rate, _ = seen_by_gas(gas, found if law.two_way else [], dust.vel)
    return max(gas_rate.max(), *(pairs.rate.max() for pairs in found))
