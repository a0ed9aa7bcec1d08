"""Kepler frame of drag cells: the circular motion w about the star that is subtracted from velocities in drag cells.

    w(x) = sigma(r) Omega_K(r) (-y, x)                                                                     (1)

sigma is the sense of rotation: 1 or -1, the sign of the mass-weighted mean of v_phi / v_K over all gas and dust. The
plane is divided into rings, which are intervals of ln r. A ring whose own mean has the opposite sign and an absolute
value above 1/2 gets the opposite sigma. sigma has to be smooth over cells, so it is interpolated between the centres of
rings. w depends on the position alone, so that momentum is conserved.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from discsim.drag.base import NO_ROWS
from discsim.kernels.drag.frame import Frame, multiples_of
from discsim.numerics import alloc, world

Array = np.ndarray
RINGS = 16
SAMPLE = 1024  # about the largest number of sampled particles of a species


class Sample(NamedTuple):
    """Sample of the particles of a species: those whose id is a multiple of a power of two.

    ids (n,): ids of all particles of the species. power: the power of two. rows: indices of the sampled particles.
    unsorted: number of unsorted rows when the sample was taken.
    """

    ids: Array
    power: int
    rows: Array
    unsorted: int


Samples = dict[str, Sample]  # by species


def frame_of(species: Mapping[str, Any], mass: float, softening: float, samples: Samples) -> Frame:
    """Return the frame of eq. (1) about a star.

    species: `Particles` of gas and dust by name. mass, softening: mass and softening length of the star; without a star
    the mass is 0, and the frame is at rest. samples: samples of the last call by species, updated in place.
    """
    if mass == 0.0:
        return Frame(0.0, 0.0, 0.0, 0.0, np.ones(1))
    chosen = [_sampled_rows(samples, name, p) for name, p in species.items()]
    parts = [
        world.processes.gather_sample(np.column_stack([p.mass[rows], p.pos[rows], p.vel[rows]]), p.global_index, rows)
        for p, rows in zip(species.values(), chosen, strict=True)
    ]
    table = np.concatenate(parts)
    weight, pos, vel = table[:, 0], table[:, 1:3], table[:, 3:]
    r2 = np.maximum(np.einsum("ij,ij->i", pos, pos), 1e-300)
    log = np.log(r2)
    low, high = log.min(), log.max()
    if not np.isfinite(low + high):  # the check after the kick reports the particle that is not finite
        return Frame(mass, softening, 0.0, 0.0, np.ones(1))
    rings_per_unit = RINGS / max(high - low, 1e-9)
    ring = np.minimum(((log - low) * rings_per_unit).astype(np.int64), RINGS - 1)
    # v_phi / v_K = L / (r^2 Omega_K), with the softening of the star.
    d2 = r2 + softening**2
    speed = (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]) / (r2 * np.sqrt(mass / (d2 * np.sqrt(d2))))
    mass_of_ring, sum_of_ring = np.bincount(ring, weight, RINGS), np.bincount(ring, weight * speed, RINGS)
    filled = np.flatnonzero(mass_of_ring > 0.0)
    mean_sense = 1.0 if sum_of_ring.sum() >= 0.0 else -1.0
    opposite = mean_sense * sum_of_ring[filled] < -0.5 * mass_of_ring[filled]
    sense = np.interp(np.arange(RINGS), filled, np.where(opposite, -mean_sense, mean_sense))
    return Frame(mass, softening, low, rings_per_unit, sense[:1] if np.ptp(sense) == 0.0 else sense)


def _sampled_rows(samples: Samples, name: str, particles: Any) -> Array:
    """Return the indices of the sampled particles of the species `name`, and update its entry in `samples`.

    The entry of the last call is used again as far as it is still valid.
    """
    ids, count = particles.ids, particles.global_count
    every = 1 << max(0, -(-count // SAMPLE) - 1).bit_length()
    known = samples.get(name, Sample(NO_ROWS, 0, NO_ROWS, 0))
    if _only_unsorted_changed(known, ids, every):
        rows = np.concatenate([known.rows, particles.unsorted_rows[known.unsorted :]])
        rows = rows[rows < len(ids)]
        rows = np.unique(rows[ids[rows] & every - 1 == 0])
    elif known.power == every and (known.ids is ids or _rows_still_sampled(known.rows, known.ids, ids, every)):
        rows = known.rows
    else:
        rows = multiples_of(ids, every)
    samples[name] = Sample(ids, every, rows, len(particles.unsorted_rows))
    return rows


def _only_unsorted_changed(known: Sample, ids: Array, every: int) -> bool:
    """Return whether `ids` can differ from the ids of the sample `known` only in unsorted rows and in rows at the end.

    On several processes this is the case if the array still begins at the same memory address, because sorting makes a
    new array. The sample must also have the power `every`.
    """
    return known.power == every and world.processes.is_parallel and alloc.same_address(known.ids, ids)


def _rows_still_sampled(rows: Array, before: Array, ids: Array, every: int) -> bool:
    """Return whether the multiples of `every` have the same `rows` in the new `ids` as in the ids `before`.

    In a serial run, ids can only be removed or sorted. If all `rows` of the new ids hold multiples of `every`, no other
    row does. On several processes the result is False, as particles may have come from another process.
    """
    if world.processes.is_parallel or len(ids) > len(before):
        return False
    return bool(np.all(rows < len(ids)) and np.all(ids[rows] & every - 1 == 0))


def is_clockwise(frame: Frame) -> bool:
    """Return whether most rings of the frame rotate clockwise. The lattice of cells is then mirrored."""
    return bool(frame.sense.sum() < 0.0)
