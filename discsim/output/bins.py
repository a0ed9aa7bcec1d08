"""Sums of particles on pixels and in rings, from which maps and profiles are made.

Sigma = sum m G / area,    <q> = sum m q G / sum m G

In rings G is 1. On pixels each particle is a Gaussian as wide as a circle that holds 12 neighbours; how many there are
is found from the counts of pixels, seen through wider and wider boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np

Array = np.ndarray
NEIGHBOURS = 12  # within one width of the Gaussian of a particle
REACH = 3.5  # widths of a Gaussian, beyond which it is cut
_BLOCK = 1 << 19  # particles that are looked at together: their temporary arrays stay in a cache
_MARGIN = 8  # a window has a margin of this share of its longer side, whose particles reach into it
RINGS = 80
FINE, ROUNDS = 240, 4  # bins of smooth profiles; rounds in which their widths are found
WIDEST = 0.03  # such width, of the profile's length


class Bins(Protocol):
    """Where particles are summed: `measure` is the area (or length) of each bin, an array or one number for all."""

    measure: Any

    def sum(self, weights: Array) -> Array:
        """The sum of weights (n,) in each bin."""

    def there(self, mass: Array) -> Array:
        """Where there is so much mass that a mean says something."""


class Rings:
    """Bins between rising `edges` (bins + 1,) of what each particle has (n,): a radius, or in 1D a place."""

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
    """Fine rings between two radii, or in 1D bins of x, over which particles at these (n,) are spread as on pixels.

    Each is a Gaussian of three fifths of their mean distance n^(-1/2), in 1D 1/n, n the number density there: that
    levels the rings of a quiet start to a thousandth. `edges` (bins + 1,).
    """

    def __init__(self, at: Array, ends: tuple[float, float], dimensions: int) -> None:
        self.edges = np.linspace(*ends, FINE + 1)
        self.measure = np.pi * np.diff(self.edges**2) if dimensions == 2 else np.diff(self.edges)
        self._bins = Rings(at, self.edges, self.measure)
        counts = self._bins.sum(np.ones(len(at)))
        side = (ends[1] - ends[0]) / FINE
        width = np.full(FINE, WIDEST * FINE)
        for _ in range(ROUNDS):  # the density is that seen through the width
            share = _spread(width, self.measure)
            number = np.maximum(share @ counts / self.measure, 1e-300)
            width = np.clip(0.6 * number ** (-1.0 / dimensions) / side, 1.0, WIDEST * FINE)
        self.share = _spread(width, self.measure)

    def sum(self, weights: Array) -> Array:
        return self.share @ self._bins.sum(weights)

    def there(self, mass: Array) -> Array:
        return mass / self.measure > 1e-3 * np.max(mass / self.measure, initial=0.0)


def _spread(width: Array, measure: Array) -> Array:
    """Shares [to, from] of what is in bins of an area (n,), Gaussians of a width (n,) in bins; nothing is lost."""
    number = np.arange(len(width))
    away = np.abs(number[:, None] - number) / width
    share = np.where(away <= REACH, np.exp(-0.5 * away**2), 0.0) * measure[:, None]
    return share / share.sum(axis=0)


class Plane:
    """Pixels [i, j] of the window from `lower` to `upper` of places (n, 2), made `of` a block of particles at a time.

    shape: pixels along each axis; periodic: axes on which the window repeats. measure: area of a pixel (nx, ny) or one.
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
        # One filter for each factor of sqrt(2) in width; a particle is shared between the two about its own, so that
        # nothing jumps where the width passes from one to the next. Half a pixel is as good as sharp.
        width = _widths(counts.reshape(self.padded), self.occupied, self._modes)
        self.level = 2 * np.log2(np.clip(width, 0.5, max(shape)))

    @property
    def _modes(self) -> tuple[str, ...]:
        return tuple("wrap" if repeats else "constant" for repeats in self.periodic)

    def _pixel_of(self, at: Array) -> Array:
        """The number of the pixel at places in pixels (n, 2); `size` for those beyond the margin."""
        with np.errstate(invalid="ignore"):  # what is not finite is not inside
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
            if some.size < REACH * sigma and not any(self.periodic):  # one by one: a wide filter takes longer
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
    """Slices of as many particles as are looked at together."""
    yield from (slice(start, start + _BLOCK) for start in range(0, count, _BLOCK))


def _widths(counts: Array, occupied: Array, modes: tuple[str, ...]) -> Array:
    """The width s, in pixels, at which pi s^2 n = 12 for particles in each of the pixels `occupied` (flat).

    n is the number density seen through that width: counts under two boxes in a row, of side sqrt(6) s, which is
    nearly a Gaussian of standard deviation s, and as quick for any. inf where all particles together are too few.
    """
    from scipy.ndimage import uniform_filter

    image = counts.astype(float)
    # One particle alone counts as pi / 6 of one, and all that there are count so where the boxes hold them.
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
        else:  # between the two the number grows as a power of the width
            last = 1 if side == 3 else (side + 1) // 2
            power = np.log(wanted / before[now]) / np.log(number[now] / before[now])
            width[now] = last / np.sqrt(6.0) * (side / last) ** power
        found |= now
        before, side = number, 2 * side + 1 if side == 1 else 2 * side - 1
    return width


def gaussians(cell: Array, mass: Array, sigma: float, shape: tuple[int, ...]) -> Array:
    """What `gaussian_filter` makes on pixels of `shape` of masses (n,) at `cell` (n, 2), open at the edges."""
    reach = int(REACH * sigma + 0.5)
    norm = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2).sum()
    along, across = (np.abs(np.arange(n) - at[:, None]) for n, at in zip(shape, cell.T, strict=True))
    x, y = (np.where(away <= reach, np.exp(-0.5 * (away / sigma) ** 2), 0.0) / norm for away in (along, across))
    return (mass[:, None] * x).T @ y


def range_of_mass(sigma: Array, decades: float = 3.5) -> tuple[float, float]:
    """Least and greatest surface density that matter in a map: 99% of the mass, `decades` at most."""
    seen = np.sort(sigma[sigma > 0])
    if not seen.size:
        return 0.1, 1.0
    mass = np.cumsum(seen)
    low, high = seen[np.minimum(np.searchsorted(mass, np.array([0.01, 0.999]) * mass[-1]), seen.size - 1)]
    if high < 1.05 * low:  # uniform: colours must not blow up the last digits
        return low / 1.05, high * 1.05
    return max(low * max(0.5, (low / high) ** 0.25), high * 10**-decades), high


def square_window(pos: Array, window: tuple[Array, Array], pixels: int, periodic: bool = False) -> Plane:
    """Square pixels over a window of the plane, `pixels` on its longer side; periodic: the window is the box."""
    side = np.subtract(window[1], window[0])
    nx, ny = (max(int(np.rint(pixels * length / max(side))), 1) for length in side)
    return Plane(len(pos), lambda part: pos[part], window, (nx, ny), (periodic, periodic))


def polar_window(pos: Array, inner: float, outer: float, pixels: int) -> Plane:
    """Pixels [phi, r] between two radii, phi from -pi to pi: half as many in r as the `pixels` in phi."""

    def polar(part: slice) -> Array:
        x, y = pos[part].T
        return np.stack([np.arctan2(y, x), np.hypot(x, y)], axis=1)

    rings = pixels // 2
    edges = np.linspace(inner, outer, rings + 1)
    area = np.broadcast_to(np.pi * np.diff(edges**2) / pixels, (pixels, rings))
    window = np.array([-np.pi, inner]), np.array([np.pi, outer])
    return Plane(len(pos), polar, window, (pixels, rings), (True, False), area)
