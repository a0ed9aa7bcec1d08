"""Pairs of gas and dust particles, for drag schemes that exchange momentum between the particles of a pair.

A gas and a dust particle form a pair if their distance is within the support radius of the gas particle. The density of
a dust population is an SPH sum over its own particles. Their smoothing lengths follow from the density as those of the
gas do. A scheme computes the impulse on the dust particle of each pair; the gas particle gets the opposite impulse.

Implicit schemes kick one population after the other, as several stiff populations at once would overshoot. Explicit
schemes kick all populations from the same velocities. The kinetic energy that a pair loses, beyond the work of
accelerations, heats its gas particle.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.drag.base import Array, DragLaw, Dust, Gas, KickContext, KickResult
from discsim.drag.dust_density import DustParticles, h_at_density, particles_of, solve_density
from discsim.kernels.common.move import add_scaled
from discsim.kernels.common.neighbours import CELL_OVER_REACH
from discsim.kernels.drag import pairs as kernels
from discsim.numerics.neighbours import LEAST, candidates, sort_into_cells
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for
from discsim.parts import DEFAULT_SCHEME

if TYPE_CHECKING:
    from discsim.kernels.common.neighbours import Cells
    from discsim.kernels.drag.frame import Frame

IN_A_CELL = 16.0  # mean number of dust particles in a cell of the neighbour search
MOST_STEPS = 20_000  # largest number of explicit substeps in a kick
ALREADY_SORTED = np.empty(0, np.uint32)  # an empty order: pairs are already sorted by dust particle


class Pairs(NamedTuple):
    """Pairs of one dust population; the pairs of its dust particle j have the indices start[j] to start[j + 1] - 1.

    particles: the dust particles. dust, gas (pairs,): indices of the two particles of each pair. offset (pairs, d):
    x_dust - x_gas. weight (pairs,): W(r, h_gas). by_gas (pairs,): indices of the pairs sorted by gas particle; the
    pairs of gas particle a are by_gas[begin[a] : begin[a + 1]]. part (pairs,): share of each pair in the drag on its
    dust particle. time (pairs,): stopping time in the gas of the pair. rate (n,): drag rate of each dust particle.
    """

    particles: DustParticles
    start: Array
    dust: Array
    gas: Array
    offset: Array
    weight: Array
    by_gas: Array
    begin: Array
    part: Array
    time: Array
    rate: Array


def find_pairs(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, context: KickContext, whole: bool) -> list[Pairs]:
    """Return the pairs of every population that has particles; arguments as in `Scheme.kick`.

    whole: whether the shares `part` of the pairs of a dust particle are normalised to a sum of one.
    """
    sph, found = context.new_sph(), []
    cells = sph.cells_of(gas)
    for population, ratio in enumerate(context.ratios):
        members = np.flatnonzero(dust.class_of == population)
        if len(members) > 0:
            particles = particles_of(dust, members, sph)
            given = cells, ratio, law, population, frame, whole, context
            found.append(_pairs_of(gas, particles, dust.vel[members], *given))
    return found


def _pairs_of(
    gas: Gas, particles: DustParticles, vel: Array, cells: Cells, ratio: float, law: DragLaw, population: int,
    frame: Frame, whole: bool, context: KickContext,
) -> Pairs:  # fmt: skip
    """Return the pairs of one population, and compute the densities of its particles.

    vel (n, d): velocities of its particles. cells: neighbour cells of the gas. ratio: dust-to-gas ratio of the
    population. whole: as in `find_pairs`.
    """
    sph, n = particles.sph, particles.count
    start, index, offset = _list_pairs(particles, gas, cells)
    by_gas, begin = counting_sort(index, len(gas.mass))
    plain = np.empty(len(index))
    parallel_for(kernels.weight_driver(sph.kernel, sph.dim, False), len(index), index, offset, gas.h, plain)
    _solve_density(particles, gas, start, index, plain, ratio)
    weight = plain
    if context.double_hump:
        weight = np.empty(len(index))
        parallel_for(kernels.weight_driver(sph.kernel, sph.dim, True), len(index), index, offset, gas.h, weight)
    part, time, rate = np.empty(len(index)), np.empty(len(index)), np.empty(n)
    parallel_for(
        kernels.weigh_pairs, n, kernels.PairList(start, index, part, time), weight,
        kernels.PairSpecies(gas.mass, gas.density, gas.vel), gas.thermal_speed,
        kernels.PairSpecies(particles.mass, particles.density, vel), particles.pos, law.code, law.grains[population],
        law.nonlinear, frame.star, frame.softening, whole, rate,
    )  # fmt: skip
    dust = np.repeat(np.arange(n), np.diff(start))
    return Pairs(particles, start, dust, index, offset, weight, by_gas, begin, part, time, rate)


def _list_pairs(particles: DustParticles, gas: Gas, cells: Cells) -> tuple[Array, Array, Array]:
    """Return (start, gas, offset) of `Pairs` by a neighbour search. cells: neighbour cells of the gas."""
    low, width = particles.sph.box_of(particles)
    area = np.prod(width[width > 1e-300])
    side = (IN_A_CELL * area / particles.count) ** (1.0 / max(1, (width > 1e-300).sum()))
    dust_cells = sort_into_cells(
        particles.pos, np.full(particles.count, side), 1.0 / CELL_OVER_REACH, low, width, particles.sph.periodic
    )
    lists = candidates(dust_cells, cells, mutual=True, extent=0.0)
    radius = particles.sph.support * gas.h
    start = np.zeros(particles.count + 1, np.int64)
    index, offset = np.empty(0, np.uint32), np.empty((0, particles.sph.dim))
    for _ in range(2):  # count pairs, then list them
        parallel_for(
            kernels.list_pairs, len(dust_cells.filled), dust_cells, cells, particles.pos, radius, start, index,
            offset, least=LEAST, each=lists,
        )  # fmt: skip
        if len(index) == 0:
            np.cumsum(start, out=start)
            index, offset = np.empty(start[-1], np.uint32), np.empty((start[-1], particles.sph.dim))
        if len(index) == 0:
            break
    return start, index, offset


def _solve_density(particles: DustParticles, gas: Gas, start: Array, index: Array, weight: Array, ratio: float) -> None:
    """Solve for the smoothing lengths and densities of the dust particles, in place.

    The first guess is `ratio` times the density of the gas. start, index, weight: start, gas and weight of `Pairs`.
    """
    sph = particles.sph
    if sph.fixed:
        particles.h[:] = gas.h[0]
    else:
        sums = gas.mass[:, None], particles.density[:, None]
        parallel_for(kernels.sum_to_dust, particles.count, start, index, weight, *sums)
        mixed = ratio * np.where(particles.density > 0.0, particles.density, gas.density.min())
        particles.h[:] = h_at_density(particles, mixed)
    solve_density(particles)


# Function that writes the impulses of a population's pairs: impulse(pairs, dust_vel, gas_vel, impulses).
Impulse = Callable[[Pairs, Array, Array, Array], None]


def kick_by_impulses(
    gas: Gas, dust: Dust, law: DragLaw, found: list[Pairs], dt: float, heat: Array, impulse: Impulse, at_once: bool
) -> None:
    """Kick gas and dust in place over dt, by accelerations and impulses of pairs, and add the heat to `heat` (n,).

    found: pairs of each population. impulse: function that computes the impulses of the pairs of a population. at_once:
    whether the impulses of all populations depend on the initial gas velocities; otherwise populations are kicked one
    after the other. If `heat` is empty, no heat is computed.
    """
    count, gas_before, dust_before = len(gas.mass), gas.vel.copy(), dust.vel.copy()
    given = []
    for pairs in found:
        particles = pairs.particles
        vel = dust.vel[particles.members]
        impulses = np.zeros_like(pairs.offset)
        impulse(pairs, vel, gas_before if at_once else gas.vel, impulses)
        of_dust, of_gas = (pairs.start, ALREADY_SORTED, impulses, 1.0), (pairs.begin, pairs.by_gas, impulses, -1.0)
        parallel_for(kernels.apply_impulses, particles.count, *of_dust, particles.mass, vel)
        dust.vel[particles.members] = vel
        if law.two_way:
            parallel_for(kernels.apply_impulses, count, *of_gas, gas.mass, gas.vel)
        given.append(impulses)
    parallel_for(add_scaled, count, gas.vel, gas.acc, dt)
    parallel_for(add_scaled, len(dust.mass), dust.vel, dust.acc, dt)
    if len(heat) > 0:
        gas_mean, dust_mean = 0.5 * (gas_before + gas.vel), 0.5 * (dust_before + dust.vel)
        for pairs, impulses in zip(found, given, strict=True):
            parallel_for(
                kernels.add_pair_heat, count, pairs.by_gas, pairs.begin, pairs.dust, impulses, gas.mass,
                dust_mean[pairs.particles.members], gas_mean, heat,
            )  # fmt: skip


def results_of(dust: Dust, found: list[Pairs]) -> KickResult:
    """Return the result of a kick, from the drag rates of all dust particles. found: pairs of each population."""
    times = np.full(len(dust.mass), np.inf)
    for pairs in found:
        coupled = pairs.rate > 0.0
        times[pairs.particles.members[coupled]] = 1.0 / pairs.rate[coupled]
    return KickResult(np.flatnonzero(times == np.inf), times)


def substep_count(scheme: str, law: DragLaw, dt: float, rate: float) -> int:
    """Return the number of explicit substeps in a kick over dt, if `rate` is the largest drag rate.

    With two-way drag the result is 1, as the drag limits the time step of the run instead. Raises FloatingPointError
    if there would be more than MOST_STEPS. scheme: name of the scheme, for the message.
    """
    if law.two_way or dt == 0.0:
        return 1
    if not dt * rate <= MOST_STEPS:
        raise FloatingPointError(
            f'drag.scheme "{scheme}" would need {dt * rate:.2g} explicit substeps in one time step; '
            f'expected an implicit scheme, like "{DEFAULT_SCHEME}", or a shorter run.timestep'
        )
    return max(1, ceil(dt * rate))


def largest_rate(gas: Gas, law: DragLaw, context: KickContext, found: list[Pairs]) -> float:
    """Return the largest rate at which drag changes the velocity of a particle. found: pairs of each population.

    Explicit steps up to the inverse of this rate are stable. The rows of the drag matrix add up to zero, so that no
    eigenvalue is above twice the largest diagonal element (Gershgorin).
    """
    rates = np.zeros(len(gas.mass))
    if law.two_way:
        for pairs in found:
            parallel_for(
                kernels.add_gas_rates, len(rates), pairs.by_gas, pairs.begin, pairs.dust, pairs.part, pairs.time,
                pairs.particles.mass, gas.mass, rates,
            )  # fmt: skip
    return max(rates.max(), *(pairs.rate.max() for pairs in found)) * context.dim
