"""Drag of each particle towards the interpolated velocity of the other species, for esph and isph.

Momentum is conserved only as well as the interpolation is accurate: the impulses on dust and on gas are different sums,
which cancel only in smooth fields. The heat is the work of the drag on the gas, right to first order in the step.
"""

from __future__ import annotations

import numpy as np

from discsim.drag.base import EMPTY, Array, DragLaw, Dust, Gas, KickResult
from discsim.drag.published.pairs import Pairs, results_of
from discsim.kernels.drag import interpolation as kernels
from discsim.kernels.drag.pairs import sum_to_dust
from discsim.numerics.threads import parallel_for


def kick_towards_interpolated(
    gas: Gas, dust: Dust, law: DragLaw, found: list[Pairs], dt: float, heat: Array, implicit: bool
) -> KickResult:
    """Kick gas and dust in place over dt, towards the interpolated velocities of the other species.

    found: pairs of each population. implicit: whether the drag is implicit in the velocity of the particle itself. The
    interpolated velocities then include the kick by `acc_unshared`. heat (n,): output, the work of the drag on each gas
    particle per mass; not written if it is empty.
    """
    count, grains = len(gas.mass), len(dust.mass)
    gas_now, dust_now = gas.vel, dust.vel
    if implicit:
        gas_now = gas.vel + dt * gas.acc_unshared
        dust_now = dust.vel + dt * dust.acc_unshared if len(dust.acc_unshared) > 0 else dust.vel
    rate, other = gas_velocity_at_dust(dust, found, gas_now)
    gas_rate, gas_other = drag_on_gas(gas, found if law.two_way else [], dust_now)
    parallel_for(kernels.kick_towards, count, gas_rate, gas_other, gas_now.copy(), gas.acc, dt, implicit, gas.vel, heat)
    parallel_for(kernels.kick_towards, grains, rate, other, dust_now.copy(), dust.acc, dt, implicit, dust.vel, EMPTY)
    return results_of(dust, found)


def gas_velocity_at_dust(dust: Dust, found: list[Pairs], gas_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each dust particle, and the gas velocity (n, d) interpolated to its position.

    found: pairs of each population. gas_vel: velocities of the gas.
    """
    rate, other = np.zeros(len(dust.mass)), np.zeros_like(dust.vel)
    for pairs in found:
        there = np.empty_like(pairs.particles.pos)
        parallel_for(sum_to_dust, len(there), pairs.start, pairs.gas, pairs.part, gas_vel, there)
        rate[pairs.particles.members], other[pairs.particles.members] = pairs.rate, there
    return rate, other


def drag_on_gas(gas: Gas, found: list[Pairs], dust_vel: Array) -> tuple[Array, Array]:
    """Return the drag rate (n,) of each gas particle, and the dust velocity (n, d) interpolated to its position.

    The dust velocity is a mean over populations, weighted by their drag rates. found: pairs of each population.
    dust_vel: velocities of the dust.
    """
    rate, pull = np.zeros(len(gas.mass)), np.zeros_like(gas.vel)
    for pairs in found:
        particles = pairs.particles
        parallel_for(
            kernels.drag_on_gas, len(rate), pairs.by_gas, pairs.begin, pairs.dust, pairs.weight, pairs.time,
            particles.mass, particles.density, dust_vel[particles.members], gas.density, rate, pull,
        )  # fmt: skip
    return rate, pull / np.where(rate > 0.0, rate, 1.0)[:, None]


def largest_rate(gas: Gas, dust: Dust, law: DragLaw, found: list[Pairs]) -> float:
    """Return the largest drag rate of a particle; explicit steps up to its inverse are stable (Gershgorin)."""
    gas_rate, _ = drag_on_gas(gas, found if law.two_way else [], dust.vel)
    return max(gas_rate.max(), *(pairs.rate.max() for pairs in found))
