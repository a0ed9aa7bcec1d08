"""Frame of drag cells: the circular motion w about the star that drag cells subtract from velocities.

    w(x) = sigma(r) Omega_K(r) (-y, x)                                                                     (1)

sigma is the sense of rotation: 1 or -1, the sign of the mass-weighted mean of v_phi / v_K of gas and dust. In a ring
(an interval of ln r) whose own mean has the other sign and an absolute value above 1/2, sigma has the other sign. sigma
has to be smooth over cells, so it is interpolated between the centres of rings. w depends on position alone, so that
momentum is conserved.
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
SAMPLE = 1024  # about the largest number of sampled particles of a species; their ids are multiples of a power of two


class Sample(NamedTuple):
    """Sample of the particles of a species.

    ids (n,): ids of all particles. power: power of two of which the sampled ids are multiples. rows: indices of the
    sampled particles. unsorted: number of unsorted rows when the sample was taken.
    """

    ids: Array
    power: int
    rows: Array
    unsorted: int


Samples = dict[str, Sample]  # by species


def frame_of(species: Mapping[str, Any], mass: float, softening: float, samples: Samples) -> Frame:
    """Return the frame of eq. (1) about a star.

    species: `Particles` of gas and dust, by name. mass, softening: of the star; mass 0 gives a frame at rest. samples:
    samples of the last call, which are updated.
    """
    if mass == 0.0:
        return Frame(0.0, 0.0, 0.0, 0.0, np.ones(1))
    few = [_sample(samples, name, p) for name, p in species.items()]
    parts = [
        world.processes.sample(np.column_stack([p.mass[part], p.pos[part], p.vel[part]]), p.global_index, part)
        for p, part in zip(species.values(), few, strict=True)
    ]
    table = np.concatenate(parts)
    weight, pos, vel = table[:, 0], table[:, 1:3], table[:, 3:]
    r2 = np.maximum(np.einsum("ij,ij->i", pos, pos), 1e-300)
    log = np.log(r2)
    low, high = log.min(), log.max()
    if not np.isfinite(low + high):  # the check after the kick reports the particle
        return Frame(mass, softening, 0.0, 0.0, np.ones(1))
    per_ring = RINGS / max(high - low, 1e-9)
    ring = np.minimum(((log - low) * per_ring).astype(np.int64), RINGS - 1)
    # v_phi / v_K = L / (r^2 Omega_K), with the softening of the star.
    d2 = r2 + softening**2
    turns = (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]) / (r2 * np.sqrt(mass / (d2 * np.sqrt(d2))))
    total, moving = np.bincount(ring, weight, RINGS), np.bincount(ring, weight * turns, RINGS)
    there = np.flatnonzero(total > 0.0)
    whole = 1.0 if moving.sum() >= 0.0 else -1.0
    against = whole * moving[there] < -0.5 * total[there]
    sense = np.interp(np.arange(RINGS), there, np.where(against, -whole, whole))
    return Frame(mass, softening, low, per_ring, sense[:1] if np.ptp(sense) == 0.0 else sense)


def _sample(samples: Samples, name: str, particles: Any) -> Array:
    """Return the indices of the sampled particles of a species, from `samples` if they are still valid there."""
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
    """Return whether ids can differ from those of the sample only in unsorted rows and in rows at the end.

    The condition holds on several processes if the array still begins at the same memory address, as sorting creates
    a new array.
    """
    return known.power == every and world.processes.many and alloc.same_address(known.ids, ids)


def _rows_still_sampled(rows: Array, before: Array, ids: Array, every: int) -> bool:
    """Return whether the sampled `rows` of the ids `before` are also those of the new `ids`.

    In a serial run, ids can only be removed or sorted. If all `rows` of the new ids still hold multiples of `every`, no
    other row does. On several processes the result is False, as particles may have come from another process.
    """
    if world.processes.many or len(ids) > len(before):
        return False
    return bool(np.all(rows < len(ids)) and np.all(ids[rows] & every - 1 == 0))


def clockwise(frame: Frame) -> bool:
    """Return whether most rings of the frame rotate clockwise. The lattice of cells is then mirrored."""
    return bool(frame.sense.sum() < 0.0)
