"""lab14: drag between pairs along their line of sight; the slip of each pair relaxes exactly by itself.

    m_j du_j = sum_a d w_a m_j [rho_a / (rho_a + rho_j)] (f y + g b) r^,   w_a = V_a W(r, h_a) / sum_a V_a W(r, h_a)
    f y + g b = (y - b t) (exp(-dt/t) - 1) - b dt,   y = (u_j - v_a) . r^,   b = (a_j - a_a) . r^
    1/t = (1 + rho_j / rho_a) / t_stop

with the number d of dimensions; the gas of a pair gets exactly the opposite. Loren-Aguilar & Bate 2014
(arXiv:1406.3250) apply the accelerations in a kick before, and have b = 0. With b in the relaxation, as in their second
paper (2015, arXiv:1509.08374), the slip is right at steps beyond t_stop. Momentum and angular momentum are exact, at
any step. The scheme damps waves, by about (k h)^2 a step. `drag.kernel = "double-hump"` gives distant pairs more
weight.

Where dust is much sparser than gas, the whole impulse of a dust particle would accelerate the gas particles near it
beyond its own velocity. Both impulses of a pair are therefore multiplied by

    2 / max(2, e_j, e_a),   e_i = max over the pairs (j, a) of i of l_j + l_a                                        (1)

where the impulse of a pair with slip y is c y, and l_i is the largest eigenvalue of sum c r^ r^T / m_i over the pairs
of particle i. As |sum c y r^|^2 <= m_i l_i sum c y^2 for both particles of each pair, the kinetic energy then changes
by

    dE = -sum c y^2 + sum_i |sum c y r^|^2 / (2 m_i) <= 0.

If gas and dust have similar numbers of particles, l_j + l_a is about 1 - exp(-dt/t), and no impulse is scaled. Where
impulses are scaled down, gas and dust are coupled less strongly than by the drag law.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import NO_CELLS, Array, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.drag.dust_density import DustParticles
    from discsim.drag.published.pairs import Pairs
    from discsim.kernels.drag.frame import Frame
    from discsim.numerics.sph import Sph

    Slopes = Callable[[Sph, Gas | DustParticles, Array], Array]

kernels, between = Lazy("discsim.kernels.drag.pairs"), Lazy("discsim.drag.published.pairs")

NO_SLOPES = np.empty((0, 0, 0))


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`."""
    return relax_each_pair(gas, dust, law, frame, dt, context, lambda sph, points, vel: NO_SLOPES)


def relax_each_pair(
    gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, context: KickContext, slopes: Slopes
) -> KickResult:
    """Kick gas and dust in place over dt; the slip of each pair relaxes independently of other pairs.

    slopes: function `slopes(sph, points, vel)` that returns the velocity gradients (n, d, d) of a species. The
    gradients extrapolate the velocities of a pair to a common point. If `slopes` returns an empty array, velocities
    are not extrapolated. The other arguments are those of `Scheme.kick`.
    """
    found = between.find_pairs(gas, dust, law, frame, context, whole=True)

    def impulse(pairs: Pairs, vel: Array, gas_vel: Array, impulses: Array) -> None:
        particles = pairs.particles
        slope, gas_slope = slopes(particles.sph, particles, vel), slopes(particles.sph, gas, gas_vel)
        pull = np.empty(len(impulses))
        parallel_for(
            kernels.relaxation_impulses, particles.count,
            kernels.PairList(pairs.start, pairs.gas, pairs.part, pairs.time), pairs.offset,
            kernels.PairSpecies(gas.mass, gas.density, gas_vel), gas.acc_unshared, gas_slope,
            kernels.PairSpecies(particles.mass, particles.density, vel), particles.acc_unshared, slope,
            law.two_way, dt, law.exponential, pull, impulses,
        )  # fmt: skip
        if law.two_way:
            limit_impulses(pairs, gas, pull, impulses)

    between.kick_by_impulses(gas, dust, law, found, dt, context.heat, impulse, at_once=False)
    return between.results_of(dust, found)


def limit_impulses(pairs: Pairs, gas: Gas, pull: Array, impulses: Array) -> None:
    """Scale the impulses `impulses` (pairs, d) down, in place, by eq. (1). pull (pairs,): c of each pair."""
    particles, count = pairs.particles, len(gas.mass)
    one, other = np.empty(particles.count), np.empty(count)
    both, gas_both = np.empty(particles.count), np.empty(count)
    of_dust, of_gas = (particles.count, pairs.start, between.ALREADY_SORTED), (count, pairs.begin, pairs.by_gas)
    parallel_for(kernels.removed_fractions, *of_dust, pairs.offset, pull, particles.mass, one)
    parallel_for(kernels.removed_fractions, *of_gas, pairs.offset, pull, gas.mass, other)
    parallel_for(kernels.largest_pair_sums, *of_dust, pairs.gas, one, other, both)
    parallel_for(kernels.largest_pair_sums, *of_gas, pairs.dust, other, one, gas_both)
    parallel_for(kernels.limit_impulses, particles.count, pairs.start, pairs.gas, both, gas_both, impulses)


# Damping is too strong where h > c_s t_stop: Laibe & Price (2012), sec. 4.
SCHEME = Scheme(kick, by_component=False, damps=True, unused=NO_CELLS)
