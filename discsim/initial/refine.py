"""Refinement and thinning of particle sets: each particle split into several, or every k-th kept with the total mass.

Refinement replaces a particle of mass m by k particles of m / k at displacements d_i, sum d_i = 0. They are as far
apart as particles of m / k are at its density: mean |d|^2 = (1 - 1/k) m / (6 Sigma). Velocity and energy are continued
linearly, v + G d_i, with the gradient G of a least-squares fit to the neighbours; this conserves momentum and energy.
The spread of positions and velocities changes the angular momentum by sum d_i x G d_i, which a rigid rotation of the
whole set removes (some 1e-4 of Omega).
Thinning keeps every k-th particle along rings, and scales the masses to the total mass.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
NEAR = 12  # neighbours in the fit of a gradient
RING = 5  # up to this number of children a ring is the best arrangement


# Thinning


def kept_range(count: int, step: int) -> tuple[int, int, int]:
    """Return start, stop and step of the range of kept particles of `count`, from the middle of the first `step`."""
    return min(step // 2, max(count - 1, 0)), count, step


def thinned(arrays: dict[str, Array], step: int) -> dict[str, Array]:
    """Keep every `step`-th particle along rings that are as wide as the spacing of kept ones; conserve the mass."""
    if step == 1 or len(arrays["mass"]) == 0:
        return arrays
    pos = arrays["pos"]
    r, angle = np.sqrt((pos**2).sum(axis=1)), np.arctan2(pos[:, 1], pos[:, 0])
    rising = np.argsort(r, kind="stable")
    held = 2.0 * np.pi * r * np.sqrt(step / _area(pos))  # number of particles in the ring
    ring = np.empty(len(r), np.int64)
    ring[rising] = np.floor(np.cumsum(1.0 / np.maximum(held[rising], 1.0)))
    stay = np.lexsort((angle, ring))[slice(*kept_range(len(r), step))]
    out = {key: values[stay] for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out and out[key].any():
            out[key] = out[key] * (arrays[key].sum() / out[key].sum())
    return out


def _near(pos: Array, count: int) -> tuple[Array, Array]:
    """Return distances and indices (n, count + 1) of each particle itself and its nearest neighbours."""
    from scipy.spatial import cKDTree  # slow to import

    found: tuple[Array, Array] = cKDTree(pos).query(pos, k=list(range(1, count + 2)))
    return found


def _area(pos: Array) -> Array:
    """Return the area per particle (n,) at each particle, from the distance of the NEAR-th neighbour."""
    count = min(NEAR, len(pos) - 1)
    if count == 0:
        return np.ones(len(pos))
    farthest = _near(pos, count)[0][:, -1]
    return np.maximum(np.pi * farthest**2 / (count + 0.5), 1e-300)


# Refinement


def refined(arrays: dict[str, Array], number: int) -> dict[str, Array]:
    """Split each particle into `number`; mass, momentum, heat and angular momentum are conserved to rounding."""
    count = len(arrays["mass"])
    if number == 1 or count == 0:
        return arrays
    out = {key: np.repeat(values, number, axis=0) for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out:
            out[key] /= number
    pos, vel = arrays["pos"], arrays["vel"]
    area = arrays["mass"] / arrays["density"] if "density" in arrays else _area(pos)
    outwards = pos / np.maximum(np.sqrt((pos**2).sum(axis=1)), 1e-300)[:, None]
    along, across = outwards, np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
    away = np.sqrt(area)[:, None, None] * (
        _pattern(number)[:, 0, None] * along[:, None, :] + _pattern(number)[:, 1, None] * across[:, None, :]
    )
    away -= away.mean(axis=1, keepdims=True)
    flat = away.reshape(-1, 2)
    fields = vel if "u" not in arrays else np.column_stack([vel, arrays["u"]])
    slopes = _gradients(pos, fields)
    change = np.einsum("nki,nif->nkf", away, slopes).reshape(len(flat), -1)
    out["pos"], out["vel"] = out["pos"] + flat, out["vel"] + change[:, :2]
    if "u" in arrays:
        out["u"] = out["u"] + np.clip(change[:, 2], -0.5 * out["u"], 0.5 * out["u"])
    _turn_back(arrays, out)
    return out


def _pattern(number: int) -> Array:
    """Return radial and azimuthal displacements (number, 2) of the children, in spacings of the parents.

    Their sum is 0 and their mean |d|^2 is (1 - 1/number) / 6. Up to RING children are on a ring, two of them along
    the orbit; more fill a square in rows whose widths are proportional to their numbers of children.
    """
    if number <= RING:
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
    """Return d field / d x_i (n, 2, fields) of a least-squares plane through each particle and its neighbours."""
    count = min(NEAR, len(pos) - 1)
    if count < 3:
        return np.zeros((len(pos), 2, fields.shape[1]))
    near = _near(pos, count)[1][:, 1:]
    away, change = pos[near] - pos[:, None, :], fields[near] - fields[:, None, :]
    matrix, right = np.einsum("nki,nkj->nij", away, away), np.einsum("nki,nkf->nif", away, change)
    size = np.trace(matrix, axis1=1, axis2=2)
    flat = np.linalg.det(matrix) > 1e-6 * size**2  # otherwise the neighbours are on a line
    out = np.zeros_like(right)
    out[flat] = np.linalg.solve(matrix[flat], right[flat])
    return out


def _spin(arrays: dict[str, Array]) -> float:
    pos, vel = arrays["pos"], arrays["vel"]
    return float((arrays["mass"] * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum())


def _turn_back(before: dict[str, Array], after: dict[str, Array]) -> None:
    """Set the angular momentum of `after` to that of `before` by a rigid rotation about its centre of mass."""
    mass = after["mass"][:, None]
    away = after["pos"] - (mass * after["pos"]).sum(axis=0) / mass.sum()
    rate = (_spin(before) - _spin(after)) / float((mass * away**2).sum())
    after["vel"] = after["vel"] + rate * np.stack([-away[:, 1], away[:, 0]], axis=1)
