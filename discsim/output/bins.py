"""Sums of particles on pixels and in rings, for maps and profiles.

Sigma = sum m G / area,    <q> = sum m q G / sum m G

In rings G is 1. On pixels G is a Gaussian whose width is the radius of a circle with 12 neighbours. The number of
neighbours comes from the particle counts of the pixels, averaged over boxes of increasing side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np

Array = np.ndarray
NEIGHBOURS = 12  # within one width of the Gaussian of a particle
REACH = 3.5  # cutoff of a Gaussian, in standard deviations
_BLOCK = 1 << 19  # particles per block, so that temporary arrays fit into the cache
_MARGIN = 8  # a window has a margin of 1/8 of its longer side: particles there reach into the window
RINGS = 80
FINE, ROUNDS = 240, 4  # bins of smooth profiles; iterations for the widths
WIDEST = 0.03  # largest width, over the length of the profile


class Bins(Protocol):
    """Protocol of bins for sums over particles.

    `measure` is the area (in 1D the length) of each bin: an array, or one number for all bins.
    """

    measure: Any

    def sum(self, weights: Array) -> Array:
        """Return the sum of weights (n,) in each bin."""

    def there(self, mass: Array) -> Array:
        """Return where a bin has enough mass for a mean."""


class Rings:
    """Bins between rising `edges` (bins + 1,) of the values `at` (n,) of particles: a radius, or in 1D a position.

    `measure` (bins,) defaults to the areas of the rings.
    """

    def __init__(self, at: Array, edges: Array, measure: Array | None = None) -> None:
        edges = np.asarray(edges, dtype=float)
        self.count = len(edges) - 1
        self.measure = np.pi * np.diff(edges**2) if measure is None else measure
        self.flat = np.empty(len(at), np.int32)
        for part in blocks(len(at)):
            found = np.searchsorted(edges, at[part], side="right") - 1
            self.flat[part] = np.where(found < 0, self.count, found)
            self.flat[part][at[part] == edges[-1]] = self.count - 1

    def sum(self, weights: Array) -> Array:
        return np.bincount(self.flat, weights, self.count + 1)[: self.count]

    def there(self, mass: Array) -> Array:
        return mass > 0


class SmoothRings:
    """Fine rings between two radii (in 1D bins of x), with particles at `at` (n,) spread by a Gaussian.

    The width of a Gaussian is 0.6 times the local mean distance of particles: n^(-1/2), in 1D 1/n, for a number
    density n. This smooths the rings of a quiet start to 0.1%. `edges` has shape (bins + 1,).
    """

    def __init__(self, at: Array, ends: tuple[float, float], dimensions: int) -> None:
        self.edges = np.linspace(*ends, FINE + 1)
        self.measure = np.pi * np.diff(self.edges**2) if dimensions == 2 else np.diff(self.edges)
        self._bins = Rings(at, self.edges, self.measure)
        counts = self._bins.sum(np.ones(len(at)))
        side = (ends[1] - ends[0]) / FINE
        width = np.full(FINE, WIDEST * FINE)
        for _ in range(ROUNDS):  # iterated, as the density depends on the width
            share = _spread(width, self.measure)
            number = np.maximum(share @ counts / self.measure, 1e-300)
            width = np.clip(0.6 * number ** (-1.0 / dimensions) / side, 1.0, WIDEST * FINE)
        self.share = _spread(width, self.measure)

    def sum(self, weights: Array) -> Array:
        return self.share @ self._bins.sum(weights)

    def there(self, mass: Array) -> Array:
        return mass / self.measure > 1e-3 * np.max(mass / self.measure, initial=0.0)


def _spread(width: Array, measure: Array) -> Array:
    """Return the weights [to, from] of normalised Gaussians between bins.

    `width` (n,) is in bins, `measure` (n,) the area of the bins. Sums over all bins are conserved.
    """
    number = np.arange(len(width))
    away = np.abs(number[:, None] - number) / width
    share = np.where(away <= REACH, np.exp(-0.5 * away**2), 0.0) * measure[:, None]
    return share / share.sum(axis=0)


class Plane:
    """Pixels [i, j] of the window from `lower` to `upper` for `count` particles.

    `of` returns the positions (n, 2) of the particles in a slice. `shape` is the number of pixels along each axis,
    and `periodic` says which axes are periodic. `measure` is the area of a pixel, one number or (nx, ny).
    """

    def __init__(
        self,
        count: int,
        of: Callable[[slice], Array],
        window: tuple[Array, Array],
        shape: tuple[int, int],
        periodic: tuple[bool, bool] = (False, False),
        measure: Any = None,
    ) -> None:
        lower, upper = (np.asarray(corner, dtype=float) for corner in window)
        self.shape, self.periodic = shape, periodic
        pixel = (upper - lower) / shape
        self.measure = pixel.prod() if measure is None else measure
        self.margin = tuple(0 if repeats else -(-max(shape) // _MARGIN) for repeats in periodic)
        self.padded = tuple(n + 2 * m for n, m in zip(shape, self.margin, strict=True))
        self.size = self.padded[0] * self.padded[1]
        self.flat = np.empty(count, np.int32)
        for part in blocks(count):
            self.flat[part] = self._pixel_of((of(part) - lower) / pixel)
        counts = self._deposit(None)
        self.occupied = np.flatnonzero(counts)
        # One filter for each factor of sqrt(2) in width. A particle is shared between the filters below and above its
        # own width, so that the map is continuous in the width. A Gaussian of half a pixel is as good as a point.
        width = _widths(counts.reshape(self.padded), self.occupied, self._modes)
        self.level = 2 * np.log2(np.clip(width, 0.5, max(shape)))

    @property
    def _modes(self) -> tuple[str, ...]:
        return tuple("wrap" if repeats else "constant" for repeats in self.periodic)

    def _pixel_of(self, at: Array) -> Array:
        """Return the flat pixel index (n,) of positions (n, 2) in pixels; `size` beyond the margin."""
        with np.errstate(invalid="ignore"):  # positions that are not finite count as outside
            cell = np.floor(at).astype(np.int64)
        inside = np.isfinite(at).all(axis=1)
        for axis, n in enumerate(self.padded):
            if self.periodic[axis]:
                cell[:, axis] %= n
            cell[:, axis] += self.margin[axis]
            inside &= (cell[:, axis] >= 0) & (cell[:, axis] < n)
        return np.where(inside, cell[:, 0] * self.padded[1] + cell[:, 1], self.size)

    def _deposit(self, weights: Array | None) -> Array:
        return np.bincount(self.flat, weights, self.size + 1)[: self.size]

    def sum(self, weights: Array) -> Array:
        from scipy.ndimage import gaussian_filter

        total = np.zeros(self.padded)
        if not self.occupied.size:
            return self._cut(total)
        deposit = self._deposit(weights)[self.occupied]
        for step in range(int(np.floor(self.level.min())), int(np.ceil(self.level.max())) + 1):
            away = np.abs(self.level - step)
            some, sigma = np.flatnonzero(away < 1), 2 ** (step / 2)
            mass, where = (1 - away[some]) * deposit[some], self.occupied[some]
            if some.size < REACH * sigma and not any(self.periodic):  # direct sums are faster than a filter
                total += gaussians(np.stack(np.divmod(where, self.padded[1]), axis=1), mass, sigma, self.padded)
            elif some.size:
                image = np.zeros(self.size)
                image[where] = mass
                total += gaussian_filter(image.reshape(self.padded), sigma, mode=self._modes, truncate=REACH)
        return self._cut(total)

    def _cut(self, image: Array) -> Array:
        (i, j), (nx, ny) = self.margin, self.shape
        return image[i : i + nx, j : j + ny]

    def there(self, mass: Array) -> Array:
        return mass / self.measure > range_of_mass(mass / self.measure)[0]


def blocks(count: int) -> Iterator[slice]:
    """Yield slices of _BLOCK particles each, up to `count`."""
    yield from (slice(start, start + _BLOCK) for start in range(0, count, _BLOCK))


def _widths(counts: Array, occupied: Array, modes: tuple[str, ...]) -> Array:
    """Return the width s, in pixels, with pi s^2 n = 12, for particles in the pixels `occupied` (flat indices).

    n is the number density averaged over that width. Two successive box averages of side sqrt(6) s stand in for a
    Gaussian of standard deviation s, and take the same time for any width. The width is inf where there are too few
    particles in all.
    """
    from scipy.ndimage import uniform_filter

    image = counts.astype(float)
    # A lone particle counts as pi / 6 particles, and so do all particles once the boxes contain them.
    wanted = min(NEIGHBOURS + 0.5, 0.45 * image.sum())
    width, found = np.full(len(occupied), np.inf), np.zeros(len(occupied), bool)
    before, side = np.full(len(occupied), np.nan), 1
    while not found.all() and side < 4 * max(counts.shape):
        seen = image
        for _ in range(2 if side > 1 else 0):
            seen = uniform_filter(seen, side, mode=modes)
        number = np.maximum(np.pi / 6.0 * side**2 * seen.ravel()[occupied], 0.0)
        now = ~found & (number >= wanted)
        if side == 1:
            width[now] = np.sqrt(wanted / number[now] / 6.0)
        else:  # power-law interpolation between the last two sides
            last = 1 if side == 3 else (side + 1) // 2
            power = np.log(wanted / before[now]) / np.log(number[now] / before[now])
            width[now] = last / np.sqrt(6.0) * (side / last) ** power
        found |= now
        before, side = number, 2 * side + 1 if side == 1 else 2 * side - 1
    return width


def gaussians(cell: Array, mass: Array, sigma: float, shape: tuple[int, ...]) -> Array:
    """Return scipy's `gaussian_filter` of masses (n,) at pixels `cell` (n, 2) of an open map, by direct sums."""
    reach = int(REACH * sigma + 0.5)
    norm = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2).sum()
    along, across = (np.abs(np.arange(n) - at[:, None]) for n, at in zip(shape, cell.T, strict=True))
    x, y = (np.where(away <= reach, np.exp(-0.5 * (away / sigma) ** 2), 0.0) / norm for away in (along, across))
    return (mass[:, None] * x).T @ y


def range_of_mass(sigma: Array, decades: float = 3.5) -> tuple[float, float]:
    """Return the lower and upper surface density of the colours of a map.

    The range holds about 99% of the mass, and spans at most `decades`.
    """
    seen = np.sort(sigma[sigma > 0])
    if not seen.size:
        return 0.1, 1.0
    mass = np.cumsum(seen)
    low, high = seen[np.minimum(np.searchsorted(mass, np.array([0.01, 0.999]) * mass[-1]), seen.size - 1)]
    if high < 1.05 * low:  # uniform: colours must not amplify rounding errors
        return low / 1.05, high * 1.05
    return max(low * max(0.5, (low / high) ** 0.25), high * 10**-decades), high


def square_window(pos: Array, window: tuple[Array, Array], pixels: int, periodic: bool = False) -> Plane:
    """Return square pixels over a window, `pixels` on its longer side; periodic: the window is the box."""
    side = np.subtract(window[1], window[0])
    nx, ny = (max(int(np.rint(pixels * length / max(side))), 1) for length in side)
    return Plane(len(pos), lambda part: pos[part], window, (nx, ny), (periodic, periodic))


def polar_window(pos: Array, inner: float, outer: float, pixels: int) -> Plane:
    """Return pixels [phi, r] between two radii, phi from -pi to pi, with pixels / 2 rings in r."""

    def polar(part: slice) -> Array:
        x, y = pos[part].T
        return np.stack([np.arctan2(y, x), np.hypot(x, y)], axis=1)

    rings = pixels // 2
    edges = np.linspace(inner, outer, rings + 1)
    area = np.broadcast_to(np.pi * np.diff(edges**2) / pixels, (pixels, rings))
    window = np.array([-np.pi, inner]), np.array([np.pi, outer])
    return Plane(len(pos), polar, window, (pixels, rings), (True, False), area)
