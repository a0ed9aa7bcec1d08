"""Pairs of gas and dust particles, for drag schemes that exchange momentum between the particles of a pair.

A gas and a dust particle form a pair if their distance is within the support radius of the gas particle. The density of
a dust population is an SPH sum over its own particles, whose smoothing lengths follow the same rule as those of the
gas. A scheme computes the impulse on the dust particle of each pair; the gas particle gets the opposite impulse.

Implicit schemes kick one population after the other, as several stiff populations at once would overshoot. Explicit
schemes kick all from the same velocities. The kinetic energy that a pair loses beyond the work of accelerations heats
its gas particle.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.drag.base import Array, Dust, Gas, Kicked, Law, Work
from discsim.drag.cloud import Cloud, cloud_of, guess_h, solve_density
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


class Pairs(NamedTuple):
    """Pairs of one population; the pairs of its dust particle j have the indices start[j] to start[j + 1] - 1."""

    cloud: Cloud
    start: Array
    dust: Array
    gas: Array
    offset: Array  # x_dust - x_gas (pairs, d)
    weight: Array
    by_gas: Array  # indices of pairs, sorted by gas particle
    begin: Array  # start of the pairs of each gas particle in `by_gas` (gas + 1,)
    part: Array  # share of the dust particle's drag (pairs,)
    time: Array  # stopping time in the gas of the pair (pairs,)
    rate: Array  # inverse stopping time of each dust particle (n,)


def pair_up(gas: Gas, dust: Dust, law: Law, frame: Frame, work: Work, whole: bool) -> list[Pairs]:
    """Return the pairs of every population.

    whole: whether the weights of a dust particle's pairs are normalised, so that their sum is one.
    """
    sph, found = work.new_sph(), []
    cells = sph.cells_of(gas)
    for population, ratio in enumerate(work.ratios):
        members = np.flatnonzero(dust.class_of == population)
        if len(members) > 0:
            cloud = cloud_of(dust, members, sph)
            found.append(_pairs_of(gas, cloud, dust.vel[members], cells, ratio, law, population, frame, whole, work))
    return found


def _pairs_of(
    gas: Gas, cloud: Cloud, vel: Array, cells: Cells, ratio: float, law: Law, population: int, frame: Frame,
    whole: bool, work: Work,
) -> Pairs:  # fmt: skip
    """Return the pairs of one population, with its density and drag rates; vel (n, d): velocities of its particles."""
    sph, n = cloud.sph, cloud.count
    start, index, offset = _list_pairs(cloud, gas, cells)
    by_gas, begin = counting_sort(index, len(gas.mass))
    plain = np.empty(len(index))
    parallel_for(kernels.weight_driver(sph.kernel, sph.dim, False), len(index), index, offset, gas.h, plain)
    _solve_density(cloud, gas, start, index, plain, ratio)
    weight = plain
    if work.double_hump:
        weight = np.empty(len(index))
        parallel_for(kernels.weight_driver(sph.kernel, sph.dim, True), len(index), index, offset, gas.h, weight)
    part, time, rate = np.empty(len(index)), np.empty(len(index)), np.empty(n)
    parallel_for(
        kernels.couple, n, kernels.Couples(start, index, part, time), weight,
        kernels.Side(gas.mass, gas.density, gas.vel), gas.thermal_speed,
        kernels.Side(cloud.mass, cloud.density, vel), cloud.pos, law.code, law.grains[population], law.nonlinear,
        frame.star, frame.softening, whole, rate,
    )  # fmt: skip
    dust = np.repeat(np.arange(n), np.diff(start))
    return Pairs(cloud, start, dust, index, offset, weight, by_gas, begin, part, time, rate)


def _list_pairs(cloud: Cloud, gas: Gas, cells: Cells) -> tuple[Array, Array, Array]:
    """Return `start` (n + 1,), `gas` (pairs,) and `offset` (pairs, d) of `Pairs`, from a neighbour search."""
    low, width = cloud.sph.box_of(cloud)
    area = np.prod(width[width > 1e-300])
    side = (IN_A_CELL * area / cloud.count) ** (1.0 / max(1, (width > 1e-300).sum()))
    dust_cells = sort_into_cells(
        cloud.pos, np.full(cloud.count, side), 1.0 / CELL_OVER_REACH, low, width, cloud.sph.periodic
    )
    lists = candidates(dust_cells, cells, mutual=True, extent=0.0)
    radius = cloud.sph.support * gas.h
    start = np.zeros(cloud.count + 1, np.int64)
    index, offset = np.empty(0, np.uint32), np.empty((0, cloud.sph.dim))
    for _ in range(2):  # count pairs, then list them
        parallel_for(
            kernels.list_pairs, len(dust_cells.filled), dust_cells, cells, cloud.pos, radius, start, index,
            offset, least=LEAST, each=lists,
        )  # fmt: skip
        if len(index) == 0:
            np.cumsum(start, out=start)
            index, offset = np.empty(start[-1], np.uint32), np.empty((start[-1], cloud.sph.dim))
        if len(index) == 0:
            break
    return start, index, offset


def _solve_density(cloud: Cloud, gas: Gas, start: Array, index: Array, weight: Array, ratio: float) -> None:
    """Solve for smoothing length and density of the dust; the first guess is dust mixed with the gas at `ratio`."""
    sph = cloud.sph
    if sph.fixed:
        cloud.h[:] = gas.h[0]
    else:
        parallel_for(kernels.gather, cloud.count, start, index, weight, gas.mass, cloud.density)
        mixed = ratio * np.where(cloud.density > 0.0, cloud.density, gas.density.min())
        cloud.h[:] = guess_h(cloud, mixed)
    solve_density(cloud)


Impulse = Callable[[Pairs, Array, Array, Array], None]  # pairs, velocities of dust and gas, output of impulses


def exchange(
    gas: Gas, dust: Dust, law: Law, found: list[Pairs], dt: float, heat: Array, impulse: Impulse, at_once: bool
) -> None:
    """Kick gas and dust over dt, by the impulses of all pairs and by accelerations, and add the heat to `heat`.

    impulse: function that computes the impulses of a population's pairs. at_once: whether the impulses of all
    populations depend on the initial gas velocities; else populations are kicked one after the other.
    """
    count, gas_before, dust_before = len(gas.mass), gas.vel.copy(), dust.vel.copy()
    given = []
    for pairs in found:
        cloud = pairs.cloud
        vel = dust.vel[cloud.members]
        pushed = np.zeros_like(pairs.offset)
        impulse(pairs, vel, gas_before if at_once else gas.vel, pushed)
        parallel_for(kernels.pull_dust, cloud.count, pairs.start, pushed, cloud.mass, vel)
        dust.vel[cloud.members] = vel
        if law.two_way:
            parallel_for(kernels.pull_gas, count, pairs.by_gas, pairs.begin, pushed, gas.mass, gas.vel)
        given.append(pushed)
    parallel_for(add_scaled, count, gas.vel, gas.acc, dt)
    parallel_for(add_scaled, len(dust.mass), dust.vel, dust.acc, dt)
    if len(heat) > 0:
        gas_mean, dust_mean = 0.5 * (gas_before + gas.vel), 0.5 * (dust_before + dust.vel)
        for pairs, pushed in zip(found, given, strict=True):
            parallel_for(
                kernels.add_pair_heat, count, pairs.by_gas, pairs.begin, pairs.dust, pushed, gas.mass,
                dust_mean[pairs.cloud.members], gas_mean, heat,
            )  # fmt: skip


def times_in(dust: Dust, found: list[Pairs]) -> Kicked:
    """Return the results of a kick: stopping times of the dust, and the indices of dust without gas."""
    times = np.full(len(dust.mass), np.inf)
    for pairs in found:
        coupled = pairs.rate > 0.0
        times[pairs.cloud.members[coupled]] = 1.0 / pairs.rate[coupled]
    return Kicked(np.flatnonzero(times == np.inf), times)


def short_steps(scheme: str, law: Law, dt: float, rate: float) -> int:
    """Return the number of explicit substeps in a kick over dt; `rate` is the largest drag rate.

    It is 1 with two-way drag, which limits the step of the run instead. Raises FloatingPointError above MOST_STEPS.
    """
    if law.two_way or dt == 0.0:
        return 1
    if not dt * rate <= MOST_STEPS:
        raise FloatingPointError(
            f'drag.scheme "{scheme}" would need {dt * rate:.2g} explicit substeps in one time step; '
            f'expected an implicit scheme, like "{DEFAULT_SCHEME}", or a shorter run.timestep'
        )
    return max(1, ceil(dt * rate))


def fastest(gas: Gas, law: Law, work: Work, found: list[Pairs]) -> float:
    """Return the largest rate at which drag changes the velocity of a particle.

    Explicit steps up to the inverse of this rate are stable: the rows of the drag matrix sum to zero, so that no
    eigenvalue is above twice the largest diagonal element (Gershgorin).
    """
    rates = np.zeros(len(gas.mass))
    if law.two_way:
        for pairs in found:
            parallel_for(
                kernels.gas_rates, len(rates), pairs.by_gas, pairs.begin, pairs.dust, pairs.part, pairs.time,
                pairs.cloud.mass, gas.mass, rates,
            )  # fmt: skip
    return max(rates.max(), *(pairs.rate.max() for pairs in found)) * work.dim
