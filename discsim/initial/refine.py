"""Refinement and thinning of particle sets, to start a run with another number of particles.

Refinement replaces a particle of mass m by k children of mass m / k at displacements d_i, with sum d_i = 0. The
children are as far apart as particles of mass m / k at the same Sigma: mean |d|^2 = (1 - 1/k) m / (6 Sigma). Velocity
and energy are continued linearly, v + G d_i, with the gradient G of a least-squares fit to the neighbours; this
conserves momentum and heat. The displacements change the angular momentum by the sum of (m / k) d_i x G d_i, which a
rigid rotation of the whole set removes (some 1e-4 of Omega).
Thinning keeps every k-th particle along rings, and scales the masses so that the total mass is unchanged.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
NEIGHBOURS = 12  # number of neighbours in the fit of a gradient
MAX_ON_RING = 5  # largest number of children for which a ring is the best arrangement


# Thinning


def kept_range(count: int, step: int) -> tuple[int, int, int]:
    """Return the slice (start, stop, step) of the particles that thinning keeps of `count` sorted particles.

    The first of them is in the middle of the first `step` particles.
    """
    return min(step // 2, max(count - 1, 0)), count, step


def thinned(arrays: dict[str, Array], step: int) -> dict[str, Array]:
    """Return the arrays of every `step`-th particle along rings, with masses scaled to the total mass.

    Each ring is as wide as the spacing of the kept particles.
    """
    if step == 1 or len(arrays["mass"]) == 0:
        return arrays
    pos = arrays["pos"]
    r, angle = np.sqrt((pos**2).sum(axis=1)), np.arctan2(pos[:, 1], pos[:, 0])
    rising = np.argsort(r, kind="stable")
    held = 2.0 * np.pi * r * np.sqrt(step / _particle_areas(pos))  # number of particles in the ring
    ring = np.empty(len(r), np.int64)
    ring[rising] = np.floor(np.cumsum(1.0 / np.maximum(held[rising], 1.0)))
    stay = np.lexsort((angle, ring))[slice(*kept_range(len(r), step))]
    out = {key: values[stay] for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out and out[key].any():
            out[key] = out[key] * (arrays[key].sum() / out[key].sum())
    return out


def _nearest(pos: Array, count: int) -> tuple[Array, Array]:
    """Return distances and indices (n, count + 1) of the particles nearest to each one; the first is itself."""
    from scipy.spatial import cKDTree  # slow to import

    found: tuple[Array, Array] = cKDTree(pos).query(pos, k=list(range(1, count + 2)))
    return found


def _particle_areas(pos: Array) -> Array:
    """Return the area (n,) of each particle, from the distance of its NEIGHBOURS-th neighbour."""
    count = min(NEIGHBOURS, len(pos) - 1)
    if count == 0:
        return np.ones(len(pos))
    farthest = _nearest(pos, count)[0][:, -1]
    return np.maximum(np.pi * farthest**2 / (count + 0.5), 1e-300)


# Refinement


def refined(arrays: dict[str, Array], number: int) -> dict[str, Array]:
    """Return the arrays with each particle replaced by `number` children.

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
    outwards = pos / np.maximum(np.sqrt((pos**2).sum(axis=1)), 1e-300)[:, None]
    along, across = outwards, np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
    away = np.sqrt(area)[:, None, None] * (
        _child_displacements(number)[:, 0, None] * along[:, None, :]
        + _child_displacements(number)[:, 1, None] * across[:, None, :]
    )
    away -= away.mean(axis=1, keepdims=True)
    flat = away.reshape(-1, 2)
    fields = vel if "u" not in arrays else np.column_stack([vel, arrays["u"]])
    slopes = _gradients(pos, fields)
    change = np.einsum("nki,nif->nkf", away, slopes).reshape(len(flat), -1)
    out["pos"], out["vel"] = out["pos"] + flat, out["vel"] + change[:, :2]
    if "u" in arrays:
        out["u"] = out["u"] + np.clip(change[:, 2], -0.5 * out["u"], 0.5 * out["u"])
    _restore_angular_momentum(arrays, out)
    return out


def _child_displacements(number: int) -> Array:
    """Return the radial and azimuthal displacements d (number, 2) of the children, in spacings of the parents.

    sum d = 0, and mean |d|^2 = (1 - 1/number) / 6. Up to MAX_ON_RING children are on a ring. More children fill a
    square in rows along the orbit; the width of a row is proportional to its number of children.
    """
    if number <= MAX_ON_RING:
        angle = np.pi / number * (2 * np.arange(number) + 1)
        places = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        held = np.diff(np.rint(np.linspace(0, number, round(number**0.5) + 1)).astype(int))
        middle = (np.cumsum(held) - 0.5 * held) / number - 0.5
        along = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in held])
        places = np.stack([np.repeat(middle, held), along], axis=1)
    places -= places.mean(axis=0)
    return places * np.sqrt((1.0 - 1.0 / number) / 6.0 / (places**2).sum(axis=1).mean())


def _gradients(pos: Array, fields: Array) -> Array:
    """Return the gradients d field / d x_i (n, 2, fields) of `fields` (n, fields) at the positions `pos` (n, 2).

    They are those of a least-squares plane through each particle and its neighbours, or 0 for neighbours on a line.
    """
    count = min(NEIGHBOURS, len(pos) - 1)
    if count < 3:
        return np.zeros((len(pos), 2, fields.shape[1]))
    near = _nearest(pos, count)[1][:, 1:]
    away, change = pos[near] - pos[:, None, :], fields[near] - fields[:, None, :]
    matrix, right = np.einsum("nki,nkj->nij", away, away), np.einsum("nki,nkf->nif", away, change)
    size = np.trace(matrix, axis1=1, axis2=2)
    flat = np.linalg.det(matrix) > 1e-6 * size**2  # otherwise the neighbours are on a line
    out = np.zeros_like(right)
    out[flat] = np.linalg.solve(matrix[flat], right[flat])
    return out


def _angular_momentum(arrays: dict[str, Array]) -> float:
    pos, vel = arrays["pos"], arrays["vel"]
    return float((arrays["mass"] * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum())


def _restore_angular_momentum(before: dict[str, Array], after: dict[str, Array]) -> None:
    """Set the angular momentum of the arrays `after` to that of `before`, by adding a rigid rotation.

    The rotation is about the centre of mass.
    """
    mass = after["mass"][:, None]
    away = after["pos"] - (mass * after["pos"]).sum(axis=0) / mass.sum()
    rate = (_angular_momentum(before) - _angular_momentum(after)) / float((mass * away**2).sum())
    after["vel"] = after["vel"] + rate * np.stack([-away[:, 1], away[:, 0]], axis=1)
