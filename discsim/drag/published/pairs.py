"""Pairs of gas and dust particles, for the schemes that exchange momentum between them.

Gas and dust are a pair within the support of the gas particle's own h. The density of a population is an SPH sum over
its own particles, whose smoothing lengths follow the gas's rule. A scheme computes the impulse of each pair, and the
gas gets the opposite.

Populations are kicked one after the other, as many stiff ones at once would overshoot. An explicit scheme kicks all
from the same velocities. The kinetic energy that a kick loses beyond the work of the accelerations is heat of the gas
of the pair.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.drag.base import Array, Dust, Gas, Kicked, Law, Work
from discsim.drag.cloud import Cloud, cloud_of, guess_h, settle_density
from discsim.kernels.common.move import add_scaled
from discsim.kernels.common.neighbours import CELL_OVER_REACH
from discsim.kernels.drag import pairs as kernels
from discsim.numerics.neighbours import LEAST, candidates, sort_into_cells
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for
from discsim.parts import USUAL_SCHEME

if TYPE_CHECKING:
    from discsim.kernels.common.neighbours import Cells
    from discsim.kernels.drag.frame import Frame

IN_A_CELL = 16.0  # dust particles in a cell of the neighbour search
MOST_STEPS = 20_000  # most explicit steps within a kick


class Pairs(NamedTuple):
    """Pairs of one population; those of dust particle j are start[j] to start[j + 1]."""

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

    whole: whether the shares of a dust particle's drag sum to one.
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
    """Return the pairs of one population, with density, shares and rates of its drag."""
    sph, n = cloud.sph, cloud.count
    start, index, offset = _list(cloud, gas, cells)
    by_gas, begin = counting_sort(index, len(gas.mass))
    plain = np.empty(len(index))
    parallel_for(kernels.weight_driver(sph.kernel, sph.dim, False), len(index), index, offset, gas.h, plain)
    _settle_density(cloud, gas, start, index, plain, ratio)
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


def _list(cloud: Cloud, gas: Gas, cells: Cells) -> tuple[Array, Array, Array]:
    """Return the start of the pairs of each dust particle (n + 1,), and the gas index and offset of each pair."""
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


def _settle_density(cloud: Cloud, gas: Gas, start: Array, index: Array, weight: Array, ratio: float) -> None:
    """Solve for smoothing length and density of the dust; the first guess is dust mixed evenly with the gas."""
    sph = cloud.sph
    if sph.fixed:
        cloud.h[:] = gas.h[0]
    else:
        parallel_for(kernels.gather, cloud.count, start, index, weight, gas.mass, cloud.density)
        mixed = ratio * np.where(cloud.density > 0.0, cloud.density, gas.density.min())
        cloud.h[:] = guess_h(cloud, mixed)
    settle_density(cloud)


Impulse = Callable[[Pairs, Array, Array, Array], None]  # pairs, velocities of dust and gas, output of impulses


def exchange(
    gas: Gas, dust: Dust, law: Law, found: list[Pairs], dt: float, heat: Array, impulse: Impulse, at_once: bool
) -> None:
    """Kick gas and dust over dt with the impulses of all pairs; with `at_once` all from the initial velocities."""
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
    """Return the stopping times of the dust, and the rows of dust without gas."""
    times = np.full(len(dust.mass), np.inf)
    for pairs in found:
        coupled = pairs.rate > 0.0
        times[pairs.cloud.members[coupled]] = 1.0 / pairs.rate[coupled]
    return Kicked(np.flatnonzero(times == np.inf), times)


def short_steps(scheme: str, law: Law, dt: float, rate: float) -> int:
    """Return the number of explicit steps within a kick over dt, at the largest drag rate.

    Two-way drag limits the step of the run instead. Raises FloatingPointError above MOST_STEPS.
    """
    if law.two_way or dt == 0.0:
        return 1
    if not dt * rate <= MOST_STEPS:
        raise FloatingPointError(
            f'drag.scheme "{scheme}" would need {dt * rate:.2g} explicit substeps in one time step; '
            f'expected an implicit scheme, like "{USUAL_SCHEME}", or a shorter run.timestep'
        )
    return max(1, ceil(dt * rate))


def fastest(gas: Gas, law: Law, work: Work, found: list[Pairs]) -> float:
    """Return the largest rate at which drag changes the velocity of a particle.

    Explicit steps up to its inverse are stable: a row of the drag's matrix sums to zero, so that no eigenvalue is
    above twice its diagonal (Gershgorin).
    """
    rates = np.zeros(len(gas.mass))
    if law.two_way:
        for pairs in found:
            parallel_for(
                kernels.gas_rates, len(rates), pairs.by_gas, pairs.begin, pairs.dust, pairs.part, pairs.time,
                pairs.cloud.mass, gas.mass, rates,
            )  # fmt: skip
    return max(rates.max(), *(pairs.rate.max() for pairs in found)) * work.dim
