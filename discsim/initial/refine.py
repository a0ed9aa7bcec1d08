"""A set of particles refined or thinned: each as several, or every k-th with the mass of all.

Refined, a particle of mass m is replaced by k of m / k about its place, sum d_i = 0, as far apart as particles of
m / k are at its density: mean |d|^2 = (1 - 1/k) m / (6 Sigma). Velocity and energy go on linearly, v + G d_i, with the
gradient G of a least-squares fit to the neighbours, which keeps momentum and energy; what the spread of places and
velocities adds to the angular momentum, sum d_i x G d_i, a rigid turn of the whole takes out (some 1e-4 of Omega).
Thinned, every k-th particle along rings stays, with the mass of all.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
NEAR = 12  # neighbours that a gradient is fitted to
RING = 5  # up to so many are best on a ring


# Thinning


def every(count: int, step: int) -> tuple[int, int, int]:
    """The range of those that stay of `count`: from the middle of the first `step` on."""
    return min(step // 2, max(count - 1, 0)), count, step


def thinned(arrays: dict[str, Array], step: int) -> dict[str, Array]:
    """Every `step`-th along rings as wide as those that stay are apart; the mass stays what it is."""
    if step == 1 or len(arrays["mass"]) == 0:
        return arrays
    pos = arrays["pos"]
    r, angle = np.sqrt((pos**2).sum(axis=1)), np.arctan2(pos[:, 1], pos[:, 0])
    rising = np.argsort(r, kind="stable")
    held = 2.0 * np.pi * r * np.sqrt(step / _area(pos))  # particles of the ring
    ring = np.empty(len(r), np.int64)
    ring[rising] = np.floor(np.cumsum(1.0 / np.maximum(held[rising], 1.0)))
    stay = np.lexsort((angle, ring))[slice(*every(len(r), step))]
    out = {key: values[stay] for key, values in arrays.items()}
    for key in ("mass", "small"):
        if key in out and out[key].any():
            out[key] = out[key] * (arrays[key].sum() / out[key].sum())
    return out


def _near(pos: Array, count: int) -> tuple[Array, Array]:
    """Distances and numbers (n, count + 1) of each particle and its neighbours."""
    from scipy.spatial import cKDTree  # slow to import

    found: tuple[Array, Array] = cKDTree(pos).query(pos, k=list(range(1, count + 2)))
    return found


def _area(pos: Array) -> Array:
    """Area (n,) that each particle has to itself, by its neighbours."""
    count = min(NEAR, len(pos) - 1)
    if count == 0:
        return np.ones(len(pos))
    farthest = _near(pos, count)[0][:, -1]
    return np.maximum(np.pi * farthest**2 / (count + 0.5), 1e-300)


# Refinement


def refined(arrays: dict[str, Array], number: int) -> dict[str, Array]:
    """Each particle as `number` of them; mass, momentum, energy of heat and angular momentum to rounding."""
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
    """Places (number, 2) about 0 in spacings of the parents, radial and along the orbit, with sum 0 and mean |d|^2 =
    (1 - 1/number) / 6.

    Few are on a ring, two of them one behind the other; more share a square in rows, each as wide as it holds of them.
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
    """d field / d x_i (n, 2, fields) of a least-squares plane through each particle and its neighbours."""
    count = min(NEAR, len(pos) - 1)
    if count < 3:
        return np.zeros((len(pos), 2, fields.shape[1]))
    near = _near(pos, count)[1][:, 1:]
    away, change = pos[near] - pos[:, None, :], fields[near] - fields[:, None, :]
    matrix, right = np.einsum("nki,nkj->nij", away, away), np.einsum("nki,nkf->nif", away, change)
    size = np.trace(matrix, axis1=1, axis2=2)
    flat = np.linalg.det(matrix) > 1e-6 * size**2  # else on a line
    out = np.zeros_like(right)
    out[flat] = np.linalg.solve(matrix[flat], right[flat])
    return out


def _spin(arrays: dict[str, Array]) -> float:
    pos, vel = arrays["pos"], arrays["vel"]
    return float((arrays["mass"] * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum())


def _turn_back(before: dict[str, Array], after: dict[str, Array]) -> None:
    """Give `after` the angular momentum of `before` by a rigid turn about its centre of mass."""
    mass = after["mass"][:, None]
    away = after["pos"] - (mass * after["pos"]).sum(axis=0) / mass.sum()
    rate = (_spin(before) - _spin(after)) / float((mass * away**2).sum())
    after["vel"] = after["vel"] + rate * np.stack([-away[:, 1], away[:, 0]], axis=1)
