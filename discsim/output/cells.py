"""Sums over gas in polar cells, on pixels and in rings: the cells have no smoothing, as particles have in `bins.py`."""

from __future__ import annotations

import numpy as np

from discsim.formulas.polar import Interpolation, PolarShape, ring_sides, shape_of_cells
from discsim.output.bins import spaced_edges, spread_evenly

Array = np.ndarray


def polar_grid(pos: Array) -> PolarShape | None:
    """Return the polar grid whose cells have the centroids `pos` (n, d); None for other particles."""
    try:
        return shape_of_cells(pos) if pos.shape[1] == 2 and len(pos) else None
    except ValueError:
        return None


class CellRings:
    """Rings between increasing `edges` (bins + 1,), for the `Bins` of gas in cells of the polar grid `shape`.

    The sum within a radius is interpolated between the sides of the cells by cubics (Fritsch & Carlson 1980). width:
    standard deviation of an additional smoothing by Gaussians, for equally spaced edges.
    """

    def __init__(self, shape: PolarShape, edges: Array, width: float | None = None) -> None:
        self.shape, self._squares = shape, edges**2
        self._width = None if width is None else width / (edges[1] - edges[0])
        self.measure = np.pi * np.diff(self._squares)

    def sum(self, weights: Array) -> Array:
        from scipy.interpolate import PchipInterpolator  # slow to import

        sides = ring_sides(self.shape.rings, self.shape.inner, self.shape.outer) ** 2
        of_rings = weights.reshape(self.shape.rings, -1).sum(axis=1)
        within = PchipInterpolator(sides, np.concatenate([[0.0], np.cumsum(of_rings)]))
        found = np.diff(within(np.clip(self._squares, sides[0], sides[-1])))
        return np.asarray(found if self._width is None else spread_evenly(found, self._width, self.measure))

    def has_enough_mass(self, mass: Array) -> Array:
        return mass > 0.0


class CellPixels:
    """Pixels at `r` and `azimuth`, for the `Bins` of gas in cells of the polar grid `shape`; `measure`: their areas.

    Densities are interpolated linearly in ln r and azimuth.
    """

    def __init__(self, shape: PolarShape, r: Array, azimuth: Array, measure: Array | float) -> None:
        self.shape, self.measure = shape, measure
        self._inside = (r >= shape.inner) & (r <= shape.outer)
        self._at = Interpolation(shape, np.clip(r, shape.inner, shape.outer), azimuth)

    def sum(self, weights: Array) -> Array:
        area = self.shape.centroids()[2][:, None]
        density = self._at.of(weights.reshape(self.shape.rings, -1) / area)
        return np.where(self._inside, density * self.measure, 0.0)

    def has_enough_mass(self, mass: Array) -> Array:
        return mass > 0.0


def square_cell_pixels(shape: PolarShape, window: tuple[Array, Array], pixels: int) -> CellPixels:
    """Return square pixels [ix, iy] in a window for the cells of `shape`; arguments as of `bins.square_pixels`."""
    side = np.subtract(window[1], window[0])
    numbers = [max(int(np.rint(pixels * length / max(side))), 1) for length in side]
    x, y = (low + (np.arange(n) + 0.5) * length / n for low, n, length in zip(window[0], numbers, side, strict=True))
    return CellPixels(
        shape, np.hypot(x[:, None], y), np.arctan2(y, x[:, None]), float(np.prod(side / np.array(numbers)))
    )


def polar_cell_pixels(shape: PolarShape, inner: float, outer: float, pixels: int, log: bool = False) -> CellPixels:
    """Return pixels [phi, r] between two radii for the cells of `shape`; arguments as of `bins.polar_pixels`."""
    edges = spaced_edges(inner, outer, pixels // 2, log)
    azimuth = -np.pi + (np.arange(pixels) + 0.5) * (2.0 * np.pi / pixels)
    middle = np.sqrt(edges[1:] * edges[:-1]) if log else 0.5 * (edges[1:] + edges[:-1])
    r, azimuth = np.broadcast_arrays(middle, azimuth[:, None])
    return CellPixels(shape, r, azimuth, np.broadcast_to(np.pi * np.diff(edges**2) / pixels, r.shape))
