"""Refinement and thinning of a set of particles, to start a run with another number of particles.

Refinement replaces each particle of mass m by k children of mass m / k at displacements d_i, with sum d_i = 0. The
children are as far apart as particles of mass m / k at the same Sigma: mean |d|^2 = (1 - 1/k) m / (6 Sigma). Velocity
and energy are extrapolated linearly, v + G d_i, with the gradient G of a least-squares fit to the neighbours. This
conserves momentum and heat. The displacements change the angular momentum by the sum of (m / k) d_i x G d_i. A rigid
rotation of the whole set cancels this change, at a rate of about 1e-4 Omega.
Thinning keeps every k-th particle along rings, and scales the masses so that the total mass is unchanged.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
NEIGHBOURS = 12  # number of neighbours in the fit of a gradient
MAX_ON_RING = 5  # largest number of children for which a ring is the best arrangement


# Thinning


def thinning_range(count: int, step: int) -> tuple[int, int, int]:
    """Return (start, stop, step) of the slice that thinning keeps of `count` sorted particles.

    The first kept particle is in the middle of the first `step` particles.
    """
    return min(step // 2, max(count - 1, 0)), count, step


def thin_particles(arrays: dict[str, Array], step: int) -> dict[str, Array]:
    """Return the arrays of every `step`-th particle along rings, with masses scaled to the same total mass.

    Each ring is as wide as the spacing of the kept particles.
    """
    if step == 1 or len(arrays["mass"]) == 0:
        return arrays
    pos = arrays["pos"]
    r, angle = np.sqrt((pos**2).sum(axis=1)), np.arctan2(pos[:, 1], pos[:, 0])
    by_radius = np.argsort(r, kind="stable")
    held = 2.0 * np.pi * r * np.sqrt(step / _particle_areas(pos))  # number of particles in the ring
    ring = np.empty(len(r), np.int64)
    ring[by_radius] = np.floor(np.cumsum(1.0 / np.maximum(held[by_radius], 1.0)))
    kept = np.lexsort((angle, ring))[slice(*thinning_range(len(r), step))]
    out = {key: values[kept] for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out and out[key].any():
            out[key] = out[key] * (arrays[key].sum() / out[key].sum())
    return out


def _nearest_particles(pos: Array, count: int) -> tuple[Array, Array]:
    """Return distances and indices (n, count + 1): for each particle itself, then the `count` nearest others."""
    from scipy.spatial import cKDTree  # slow to import

    found: tuple[Array, Array] = cKDTree(pos).query(pos, k=list(range(1, count + 2)))
    return found


def _particle_areas(pos: Array) -> Array:
    """Return the area (n,) that each particle occupies, from the distance of its NEIGHBOURS-th neighbour."""
    count = min(NEIGHBOURS, len(pos) - 1)
    if count == 0:
        return np.ones(len(pos))
    farthest = _nearest_particles(pos, count)[0][:, -1]
    return np.maximum(np.pi * farthest**2 / (count + 0.5), 1e-300)


# Refinement


def refine_particles(arrays: dict[str, Array], number: int) -> dict[str, Array]:
    """Return the arrays of a species with each particle replaced by `number` children.

    Mass, momentum, heat and angular momentum are conserved to rounding.
    """
    count = len(arrays["mass"])
    if number == 1 or count == 0:
        return arrays
    out = {key: np.repeat(values, number, axis=0) for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out:
            out[key] /= number
    pos, vel = arrays["pos"], arrays["vel"]
    area = arrays["mass"] / arrays["density"] if "density" in arrays else _particle_areas(pos)
    along = pos / np.maximum(np.sqrt((pos**2).sum(axis=1)), 1e-300)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    children = _child_displacements(number)
    away = np.sqrt(area)[:, None, None] * (
        children[:, 0, None] * along[:, None, :] + children[:, 1, None] * across[:, None, :]
    )
    away -= away.mean(axis=1, keepdims=True)
    flat = away.reshape(-1, 2)
    fields = vel if "u" not in arrays else np.column_stack([vel, arrays["u"]])
    slopes = gradients(pos, fields)
    change = np.einsum("nki,nif->nkf", away, slopes).reshape(len(flat), -1)
    out["pos"], out["vel"] = out["pos"] + flat, out["vel"] + change[:, :2]
    if "u" in arrays:
        out["u"] = out["u"] + np.clip(change[:, 2], -0.5 * out["u"], 0.5 * out["u"])
    _restore_angular_momentum(arrays, out)
    return out


def _child_displacements(number: int) -> Array:
    """Return the radial and azimuthal displacements d (number, 2) of children from their parent.

    The unit is the spacing of the parents. sum d = 0, and mean |d|^2 = (1 - 1/number) / 6. Up to MAX_ON_RING children
    are on a ring. More children fill a square in rows along the orbit; the width of a row is proportional to its number
    of children.
    """
    if number <= MAX_ON_RING:
        angle = np.pi / number * (2 * np.arange(number) + 1)
        pos = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        held = np.diff(np.rint(np.linspace(0, number, round(number**0.5) + 1)).astype(int))
        middle = (np.cumsum(held) - 0.5 * held) / number - 0.5
        along = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in held])
        pos = np.stack([np.repeat(middle, held), along], axis=1)
    pos -= pos.mean(axis=0)
    return pos * np.sqrt((1.0 - 1.0 / number) / 6.0 / (pos**2).sum(axis=1).mean())


def gradients(pos: Array, fields: Array) -> Array:
    """Return the gradients (n, 2, fields) of the quantities `fields` (n, fields) at the positions `pos` (n, 2).

    The gradient at a particle is that of a least-squares plane through the values at the particle and its neighbours,
    or 0 if the neighbours are on a line.
    """
    count = min(NEIGHBOURS, len(pos) - 1)
    if count < 3:
        return np.zeros((len(pos), 2, fields.shape[1]))
    near = _nearest_particles(pos, count)[1][:, 1:]
    away, change = pos[near] - pos[:, None, :], fields[near] - fields[:, None, :]
    matrix, right = np.einsum("nki,nkj->nij", away, away), np.einsum("nki,nkf->nif", away, change)
    size = np.trace(matrix, axis1=1, axis2=2)
    solvable = np.linalg.det(matrix) > 1e-6 * size**2  # otherwise the neighbours are on a line
    out = np.zeros_like(right)
    out[solvable] = np.linalg.solve(matrix[solvable], right[solvable])
    return out


def _angular_momentum(arrays: dict[str, Array]) -> float:
    pos, vel = arrays["pos"], arrays["vel"]
    return float((arrays["mass"] * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum())


def _restore_angular_momentum(before: dict[str, Array], after: dict[str, Array]) -> None:
    """Change after["vel"] by a rigid rotation, so that the angular momentum is that of the arrays `before`.

    The rotation is about the centre of mass.
    """
    mass = after["mass"][:, None]
    away = after["pos"] - (mass * after["pos"]).sum(axis=0) / mass.sum()
    rate = (_angular_momentum(before) - _angular_momentum(after)) / float((mass * away**2).sum())
    after["vel"] = after["vel"] + rate * np.stack([-away[:, 1], away[:, 0]], axis=1)
