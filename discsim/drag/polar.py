"""Kick of the scheme emsi (`drag/emsi.py`): divide grains among polar cells, relax each cell, and kick the grains."""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.drag.base import EMPTY, NO_ROWS, DragLaw, Dust, Gas, KickContext, KickResult
from discsim.drag.cells import law_over
from discsim.kernels.drag import polar as kernels
from discsim.kernels.drag.frame import Frame
from discsim.kernels.drag.types import Species
from discsim.numerics.sorting import counting_sort
from discsim.numerics.threads import parallel_for

CHUNK = 4096  # smallest number of cells in a chunk of a parallel loop


def kick(gas: Gas, dust: Dust, law: DragLaw, frame: Frame, dt: float, cells: Any, context: KickContext) -> KickResult:
    """Kick gas and dust in place over dt, as `Scheme.kick`; the cells are those of `context.geometry`."""
    geometry, count, grains = context.geometry, len(gas.pos), len(dust.pos)
    cell = np.empty((grains, kernels.PARTS), np.int64)
    parts = kernels.Parts(
        np.empty(cell.shape), np.empty((grains, kernels.COLUMNS)), np.empty((*cell.shape, 2)), np.full(grains, np.inf)
    )
    parallel_for(kernels.divide_grains, grains, dust.pos, geometry, cell, parts.share)
    parallel_for(kernels.fill_table, grains, dust.pos, dust.vel, dust.acc_unshared, parts.grain)
    order, start = counting_sort(cell.ravel(), count + 1)
    outside = cell[:, kernels.NEAREST] == count
    of_gas = Species(
        gas.pos, gas.vel, gas.acc, gas.acc_unshared, gas.mass, gas.density, gas.thermal_speed, NO_ROWS, NO_ROWS, 1, 0
    )
    of_dust = Species(
        dust.pos, dust.vel, dust.acc, dust.acc_unshared, dust.mass, dust.per_grain, EMPTY, order, start,
        len(law.grains), 1,
    )  # fmt: skip
    by_drag = np.empty((count, 2))
    parallel_for(
        kernels.relax_cells, len(geometry.radius), of_gas, of_dust, dust.class_of, geometry, law_over(law, dt),
        law.nonlinear, law.several, frame, parts, by_drag, least=max(1, CHUNK // len(geometry.cos)),
    )  # fmt: skip
    parallel_for(kernels.kick_grains, grains, dust.vel, dust.acc, outside, parts, dt)
    if len(context.heat) > 0:
        parallel_for(kernels.find_heat, count, of_gas, of_dust, by_drag, parts, dt, context.heat, least=CHUNK)
    if law.two_way:  # with one-way drag the caller discards the gas velocities
        parallel_for(kernels.kick_cells, count, gas.vel, gas.acc, by_drag, dt, light=True)
    return KickResult(np.flatnonzero(outside), parts.time)
