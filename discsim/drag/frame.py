"""Frame of drag cells: circular motion about the star, in the direction of gas and dust, subtracted from velocities.

    w(x) = sigma(r) Omega_K(r) (-y, x)                                                                     (1)

sigma is 1 or -1, the sign of the mass-weighted mean of v_phi / v_K of both species. A ring, of even width in ln r,
has the opposite sign if its own mean is beyond half of v_K in that direction. sigma has to be smooth over cells, so
it is interpolated between the centres of rings. The frame depends on the position alone, so that momentum is
conserved.
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
SAMPLE = 1024  # most sampled particles of a species: those with ids that are multiples of a power of two


class Sample(NamedTuple):
    """Sample of a species: the `rows` of `ids` (n,) that are multiples of `power`; number of unsorted rows."""

    ids: Array
    power: int
    rows: Array
    unsorted: int


Samples = dict[str, Sample]  # by species


def frame_of(species: Mapping[str, Any], mass: float, softening: float, samples: Samples) -> Frame:
    """Return the Keplerian frame about a star of a mass and softening, from samples of both species.

    species: `Particles` of each, by name. Without a star, of mass 0, the frame is at rest.
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
    """Return the rows of the sample of a species, and record them in `samples` until rows change."""
    ids, count = particles.ids, particles.everywhere
    every = 1 << max(0, -(-count // SAMPLE) - 1).bit_length()
    known = samples.get(name, Sample(NO_ROWS, 0, NO_ROWS, 0))
    if _only_unsorted_changed(known, ids, every):
        rows = np.concatenate([known.rows, particles.unsorted_rows[known.unsorted :]])
        rows = rows[rows < len(ids)]
        rows = np.unique(rows[ids[rows] & every - 1 == 0])
    elif known.power == every and (known.ids is ids or _still_there(known.rows, known.ids, ids, every)):
        rows = known.rows
    else:
        rows = multiples_of(ids, every)
    samples[name] = Sample(ids, every, rows, len(particles.unsorted_rows))
    return rows


def _only_unsorted_changed(known: Sample, ids: Array, every: int) -> bool:
    """Return whether ids can differ only in rows that became unsorted since the sample, and in rows at the end.

    This holds while the array begins at the same place in memory, as sorting makes a new one.
    """
    return known.power == every and world.processes.many and alloc.same_address(known.ids, ids)


def _still_there(rows: Array, before: Array, ids: Array, every: int) -> bool:
    """Return whether the sampled `rows` of `before` are still those of `ids`, after some rows went or all were
    sorted.

    If all these rows hold multiples, no other row does. On several processes particles of another process may have
    come, so the result is then False.
    """
    if world.processes.many or len(ids) > len(before):
        return False
    return bool(np.all(rows < len(ids)) and np.all(ids[rows] & every - 1 == 0))


def clockwise(frame: Frame) -> bool:
    """Return whether most of the frame turns clockwise. Cells then lie where those of the mirror image would."""
    return bool(frame.sense.sum() < 0.0)
