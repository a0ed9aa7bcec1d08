"""Sums over particles on pixels and in rings, for maps and profiles.

    Sigma = sum m G / area,    <q> = sum m q G / sum m G

with the mass m and a quantity q of each particle, and its weight G in the bin. In rings G is 1 for the particles in the
ring. On pixels G is a Gaussian, whose standard deviation is the radius of a circle around the particle that contains 12
neighbours. This radius is estimated from particle counts of pixels, averaged over boxes of increasing side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol

import numpy as np

Array = np.ndarray
NEIGHBOURS = 12  # neighbours within one standard deviation of the Gaussian of a particle
CUTOFF = 3.5  # cutoff of a Gaussian, in standard deviations
_BLOCK = 1 << 19  # particles per block, so that temporary arrays fit into the cache
# A map is computed with a margin of 1/8 of its longer side, because Gaussians of particles there extend into the map.
_MARGIN_DIVISOR = 8
RINGS = 80  # number of rings in a figure
FINE_BINS, ITERATIONS = 240, 4  # number of bins of a smooth profile; iterations for the widths of Gaussians
BINS_PER_WIDTH, MAX_BINS = 4, 20_000  # bins in a given width of the smoothing, and bins of such a profile, at most
MAX_WIDTH = 0.03  # largest standard deviation of a Gaussian, as a fraction of the length of the profile


class Bins(Protocol):
    """Bins for sums over particles.

    `measure` is the area of each bin, in 1D its length: an array, or one number for all bins.
    """

    measure: Any

    def sum(self, weights: Array) -> Array:
        """Return for each bin the sum of the particles' `weights` (n,)."""

    def has_enough_mass(self, mass: Array) -> Array:
        """Return a mask of the bins with enough mass for a mean over particles; `mass` is the mass in each bin."""


class Rings:
    """Rings, or in 1D bins in x, between increasing `edges` (bins + 1,).

    `at` (n,) are the radii of the particles, or in 1D their positions. By default `measure` (bins,) has areas of rings.
    """

    def __init__(self, at: Array, edges: Array, measure: Array | None = None) -> None:
        edges = np.asarray(edges, dtype=float)
        self.count = len(edges) - 1
        self.measure = np.pi * np.diff(edges**2) if measure is None else measure
        self.bin_index = np.empty(len(at), np.int32)  # of each particle; `count` for particles outside
        for part in particle_slices(len(at)):
            found = np.searchsorted(edges, at[part], side="right") - 1
            self.bin_index[part] = np.where(found < 0, self.count, found)
            self.bin_index[part][at[part] == edges[-1]] = self.count - 1

    def sum(self, weights: Array) -> Array:
        return np.bincount(self.bin_index, weights, self.count + 1)[: self.count]

    def has_enough_mass(self, mass: Array) -> Array:
        return mass > 0


class SmoothRings:
    """Fine rings, or in 1D bins in x, over which each particle is spread by a Gaussian.

    `at` (n,) are the radii of the particles, or in 1D their positions. `ends` are the first and the last edge, and the
    attribute `edges` (bins + 1,) has all edges, which are equally spaced, with `log` in the logarithm. The standard
    deviation of a Gaussian is `width`, for which edges are spaced without `log`. By default it is 0.6 times the local
    distance between particles, n^(-1/2) for a number density n, in 1D 1/n. This reduces density variations that come
    from the rings of particles in a quiet start to 0.1%, if these rings are as far apart as the particles.
    """

    def __init__(
        self, at: Array, ends: tuple[float, float], dimensions: int, log: bool = False, width: float | None = None
    ) -> None:
        self.edges = smooth_edges(ends, log, width)
        self.measure = np.pi * np.diff(self.edges**2) if dimensions == 2 else np.diff(self.edges)
        self._bins = _QuadraticBins(at, ends, len(self.measure), log)
        side = np.diff(self.edges)
        if width is None:
            self._spread = self._spread_by_distance(side, dimensions)
        else:
            self._spread = partial(spread_evenly, width=_without_deposit(width / side[0]), measure=self.measure)

    def _spread_by_distance(self, side: Array, dimensions: int) -> Callable[[Array], Array]:
        """Return the function that spreads the contents of bins by Gaussians as wide as the distance of particles."""
        counts = self._bins.sum(None)
        width = np.full(FINE_BINS, MAX_WIDTH * FINE_BINS)
        for _ in range(ITERATIONS):  # iterated, as the density depends on the width
            weight = _gaussian_weights(width, self.measure)
            number = np.maximum(weight @ counts / self.measure, 1e-300)
            wanted = np.clip(0.6 * number ** (-1.0 / dimensions) / side, 1.0, MAX_WIDTH * FINE_BINS)
            width = _without_deposit(wanted)
        return partial(np.matmul, _gaussian_weights(width, self.measure))

    def sum(self, weights: Array) -> Array:
        return self._spread(self._bins.sum(weights))

    def has_enough_mass(self, mass: Array) -> Array:
        return mass / self.measure > 1e-3 * np.max(mass / self.measure, initial=0.0)


class _QuadraticBins:
    """Sums in equally spaced bins, where a particle is shared among three bins by the quadratic B-spline (TSC).

    The spline has the variance of 1/4 bin wherever the particle lies in its bin. In plain bins, rings of particles that
    are a few bins apart beat with the bins, which shows as waves of the density of 10% even after smoothing.
    """

    def __init__(self, at: Array, ends: tuple[float, float], count: int, log: bool) -> None:
        self.count, (low, high) = count, np.log(ends) if log else ends
        self.bin_index, self.offset = np.empty(len(at), np.int32), np.empty(len(at), np.float32)
        for part in particle_slices(len(at)):
            inside = (at[part] >= ends[0]) & (at[part] <= ends[1])
            place = np.where(inside, at[part], ends[0])
            place = ((np.log(place) if log else place) - low) * (count / (high - low)) - 0.5
            nearest = np.rint(place)
            self.offset[part] = place - nearest
            self.bin_index[part] = np.where(inside, np.clip(nearest, 0, count - 1), count)  # `count` is outside

    def sum(self, weights: Array | None) -> Array:
        """Return for each bin the sum of the particles' `weights` (n,), or the number of particles."""
        found = np.zeros(self.count + 1)
        for part in particle_slices(len(self.bin_index)):
            index, d = self.bin_index[part], self.offset[part].astype(float)
            outside = index == self.count
            own = 1.0 if weights is None else weights[part]
            for step, share in ((-1, 0.5 * (0.5 - d) ** 2), (0, 0.75 - d**2), (1, 0.5 * (0.5 + d) ** 2)):
                bins = np.where(outside, self.count, np.clip(index + step, 0, self.count - 1))
                found += np.bincount(bins, own * share, self.count + 1)
        return found[: self.count]


def _without_deposit(width: Any) -> Any:
    """Return the width in bins of the Gaussian that, after the deposit by a quadratic B-spline, gives `width`."""
    return np.sqrt(np.square(width) - 0.25)


def smooth_edges(ends: tuple[float, float], log: bool = False, width: float | None = None) -> Array:
    """Return the edges (bins + 1,) of the bins of a smooth profile; see `SmoothRings`.

    A `width` has at least BINS_PER_WIDTH bins. It must be at least that of `smallest_width`.
    """
    count = FINE_BINS if width is None else max(FINE_BINS, math.ceil(BINS_PER_WIDTH * (ends[1] - ends[0]) / width))
    return spaced_edges(*ends, count, log)


def smallest_width(ends: tuple[float, float]) -> float:
    """Return the smallest standard deviation of the smoothing of a profile between two radii."""
    return BINS_PER_WIDTH * (ends[1] - ends[0]) / MAX_BINS


def spread_evenly(contents: Array, width: float, measure: Array) -> Array:
    """Return the contents (n,) of bins, each spread by a Gaussian with a standard deviation of `width` bins.

    The spread content of a bin is proportional to the areas `measure` (n,) of the bins; sums stay the same.
    """
    from scipy.ndimage import gaussian_filter1d

    blur = partial(gaussian_filter1d, sigma=width, mode="constant", truncate=CUTOFF)
    return np.asarray(measure * blur(contents / blur(measure)))


def spaced_edges(low: float, high: float, count: int, log: bool = False) -> Array:
    """Return edges (count + 1,) from `low` to `high`, equally spaced, with `log` in the logarithm."""
    return np.geomspace(low, high, count + 1) if log else np.linspace(low, high, count + 1)


def _gaussian_weights(width: Array, measure: Array) -> Array:
    """Return a matrix (n, n) that spreads the content of each bin over all bins by a Gaussian.

    The matrix times an array (n,) of contents gives the spread contents; their sum stays the same. `width` (n,) is the
    standard deviation for each bin, in bins, and `measure` (n,) the area of the bins.
    """
    index = np.arange(len(width))
    distance = np.abs(index[:, None] - index) / width
    weight = np.where(distance <= CUTOFF, np.exp(-0.5 * distance**2), 0.0) * measure[:, None]
    return weight / weight.sum(axis=0)


class PixelBins:
    """Pixels [i, j] over which particles are spread by Gaussians.

    `count` is the number of particles, and `positions(part)` returns the positions (n, 2) of the particles in a slice.
    `window` is the lower and the upper corner of the map, `shape` the number of pixels along each axis, and `periodic`
    is True for a periodic axis. `measure` is the area of a pixel, one number or (nx, ny); by default width x height.
    """

    def __init__(
        self,
        count: int,
        positions: Callable[[slice], Array],
        window: tuple[Array, Array],
        shape: tuple[int, int],
        periodic: tuple[bool, bool] = (False, False),
        measure: Any = None,
    ) -> None:
        lower, upper = (np.asarray(corner, dtype=float) for corner in window)
        self.shape, self.periodic = shape, periodic
        pixel = (upper - lower) / shape
        self.measure = pixel.prod() if measure is None else measure
        self.margin = tuple(0 if repeats else -(-max(shape) // _MARGIN_DIVISOR) for repeats in periodic)
        self.padded = tuple(n + 2 * m for n, m in zip(shape, self.margin, strict=True))
        self.size = self.padded[0] * self.padded[1]
        self.pixel_index = np.empty(count, np.int32)
        for part in particle_slices(count):
            self.pixel_index[part] = self._flat_index((positions(part) - lower) / pixel)
        counts = self._deposit(None)
        self.occupied = np.flatnonzero(counts)
        # The widths of filters rise in steps of sqrt(2). The mass of a particle is divided between the two filters next
        # to its own width, so that the map depends continuously on the width. Widths below half a pixel do not matter.
        width = _gaussian_widths(counts.reshape(self.padded), self.occupied, self._modes)
        self.level = 2 * np.log2(np.clip(width, 0.5, max(shape)))

    @property
    def _modes(self) -> tuple[str, ...]:
        """The boundary modes of scipy's filters for the two axes."""
        return tuple("wrap" if repeats else "constant" for repeats in self.periodic)

    def _flat_index(self, at: Array) -> Array:
        """Return the index (n,) in the flattened map of the pixels at positions `at` (n, 2), in units of pixels.

        The map includes the margin. The index is `size` for positions outside the map.
        """
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
        """Return for each pixel the sum of the particles' `weights`, or the number of particles, without smoothing."""
        return np.bincount(self.pixel_index, weights, self.size + 1)[: self.size]

    def sum(self, weights: Array) -> Array:
        from scipy.ndimage import gaussian_filter

        total = np.zeros(self.padded)
        if not self.occupied.size:
            return self._without_margin(total)
        deposit = self._deposit(weights)[self.occupied]
        for step in range(int(np.floor(self.level.min())), int(np.ceil(self.level.max())) + 1):
            distance = np.abs(self.level - step)
            chosen, sigma = np.flatnonzero(distance < 1), 2 ** (step / 2)
            mass, where = (1 - distance[chosen]) * deposit[chosen], self.occupied[chosen]
            if chosen.size < CUTOFF * sigma and not any(self.periodic):  # direct sums are faster than a filter
                total += gaussians(np.stack(np.divmod(where, self.padded[1]), axis=1), mass, sigma, self.padded)
            elif chosen.size:
                image = np.zeros(self.size)
                image[where] = mass
                total += gaussian_filter(image.reshape(self.padded), sigma, mode=self._modes, truncate=CUTOFF)
        return self._without_margin(total)

    def _without_margin(self, image: Array) -> Array:
        """Return the map `image` without its margin."""
        (i, j), (nx, ny) = self.margin, self.shape
        return image[i : i + nx, j : j + ny]

    def has_enough_mass(self, mass: Array) -> Array:
        return mass / self.measure > density_range(mass / self.measure)[0]


def particle_slices(count: int) -> Iterator[slice]:
    """Yield slices of at most _BLOCK particles that together contain the particles 0 to `count` - 1."""
    yield from (slice(start, start + _BLOCK) for start in range(0, count, _BLOCK))


def _gaussian_widths(counts: Array, occupied: Array, modes: tuple[str, ...]) -> Array:
    """Return the standard deviation s, in pixels, of the Gaussians of the particles in the pixels `occupied`.

    s solves pi s^2 n = 12 with the number density n, averaged over the width s. The average is computed by two
    successive box filters of side sqrt(6) s, which take the same time for any width. s is inf if the map has too few
    particles. `counts` (nx, ny) is the number of particles in each pixel, and `occupied` are indices in the flattened
    map. `modes` are the boundary modes of the filters.
    """
    from scipy.ndimage import uniform_filter

    image = counts.astype(float)
    # In a box that contains all particles, the number below is pi / 6 times their number. A smaller number is wanted.
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
    """Return a map of `shape` pixels, not periodic, with the masses (n,) at pixels `cell` (n, 2) spread by a Gaussian.

    The map is that of `gaussian_filter` of scipy, but computed by direct sums, which are faster for few pixels.
    """
    reach = int(CUTOFF * sigma + 0.5)
    norm = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2).sum()
    along, across = (np.abs(np.arange(n) - at[:, None]) for n, at in zip(shape, cell.T, strict=True))
    x, y = (
        np.where(distance <= reach, np.exp(-0.5 * (distance / sigma) ** 2), 0.0) / norm for distance in (along, across)
    )
    return (mass[:, None] * x).T @ y


def density_range(sigma: Array, decades: float = 3.5, clump: float = np.inf) -> tuple[float, float]:
    """Return the lowest and the highest surface density on the colour scale of a map with surface densities `sigma`.

    Pixels in this range have about 99% of the mass. The highest value is at most `clump` times the median; half of the
    mass has a density above the median. The range has at most `decades` powers of ten.
    """
    seen = np.sort(sigma[sigma > 0])
    if not seen.size:
        return 0.1, 1.0
    mass = np.cumsum(seen)
    shares = np.array([0.01, 0.5, 0.999])
    low, median, high = seen[np.minimum(np.searchsorted(mass, shares * mass[-1]), seen.size - 1)]
    high = min(high, clump * median)
    if high < 1.05 * low:  # uniform: colours must not amplify rounding errors
        return low / 1.05, high * 1.05
    return max(low * max(0.5, (low / high) ** 0.25), high * 10**-decades), high


def square_pixels(pos: Array, window: tuple[Array, Array], pixels: int, periodic: bool = False) -> PixelBins:
    """Return square pixels in a window (lower, upper corner) for particles at `pos` (n, 2).

    `pixels` is the number of pixels along the longer side. With `periodic` the window must be the whole periodic box.
    """
    side = np.subtract(window[1], window[0])
    nx, ny = (max(int(np.rint(pixels * length / max(side))), 1) for length in side)
    return PixelBins(len(pos), lambda part: pos[part], window, (nx, ny), (periodic, periodic))


def polar_pixels(pos: Array, inner: float, outer: float, pixels: int, log: bool = False) -> PixelBins:
    """Return pixels [phi, r] between the radii `inner` and `outer` for particles at `pos` (n, 2).

    The number of pixels is `pixels` along phi, from -pi to pi, and half as many along r; with `log` they are equally
    spaced in log r.
    """

    def polar(part: slice) -> Array:
        x, y = pos[part].T
        radius = np.hypot(x, y)
        return np.stack([np.arctan2(y, x), np.log(np.maximum(radius, 1e-300)) if log else radius], axis=1)

    rings = pixels // 2
    edges = spaced_edges(inner, outer, rings, log)
    area = np.broadcast_to(np.pi * np.diff(edges**2) / pixels, (pixels, rings))
    ends = np.log([inner, outer]) if log else np.array([inner, outer])
    window = np.array([-np.pi, ends[0]]), np.array([np.pi, ends[1]])
    return PixelBins(len(pos), polar, window, (pixels, rings), (True, False), area)
