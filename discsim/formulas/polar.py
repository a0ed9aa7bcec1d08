"""Numbers of rings and cells of a polar grid, the sides of the rings, and the mass in other rings."""

import math
from typing import NamedTuple

import numpy as np

MIN_RINGS, MIN_ANGLES = 5, 8
FLOOR = 1e-6  # smallest initial surface density, over the largest one


def ring_count(cells: int, inner: float, outer: float) -> int:
    """Return the number of rings, even in ln r, for which about `cells` cells between two radii are square."""
    return max(MIN_RINGS, round(math.sqrt(cells * math.log(outer / inner) / (2.0 * math.pi))))


def angle_count(cells: int, rings: int) -> int:
    """Return the number of cells in each of `rings` rings, so that their product is closest to `cells`."""
    return max(MIN_ANGLES, round(cells / rings))


def ring_sides(rings: int, inner: float, outer: float, ghosts: int = 0) -> np.ndarray:
    """Return the radii (rings + 1 + 2 ghosts,) of the sides of rings even in ln r, with `ghosts` more at each edge."""
    sides = inner * (outer / inner) ** (np.arange(-ghosts, rings + ghosts + 1) / rings)
    sides[ghosts], sides[rings + ghosts] = inner, outer  # without rounding
    return sides


def centroid_azimuths(angles: int) -> np.ndarray:
    """Return the azimuths (angles,) of the centroids of the cells in a ring."""
    return (np.arange(angles) + 0.5) * (2.0 * np.pi / angles)


def ring_centroids(sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centroid radii (rings,) of cells in rings with `sides` (rings + 1,), and areas per angle (rings,)."""
    low, high = sides[:-1], sides[1:]
    volume = 0.5 * (high - low) * (high + low)
    # (r_o^3 - r_i^3) / (3 volume), without a difference of cubes.
    return (high - low) * (high * high + high * low + low * low) / (3.0 * volume), volume


class PolarShape(NamedTuple):
    """Polar grid: numbers of rings and of cells in a ring, radii of the edges, and whether the edges are closed."""

    rings: int
    angles: int
    inner: float
    outer: float
    closed: bool

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rings * self.angles

    @property
    def elongation(self) -> float:
        """Azimuthal over radial side of the cells."""
        return 2.0 * np.pi / self.angles / float(np.log(self.outer / self.inner) / self.rings)

    def side(self, r: np.ndarray) -> np.ndarray:
        """Return the sides (n,) of cells at the radii `r` (n,), the roots of their areas."""
        return r * np.sqrt(np.log(self.outer / self.inner) * 2.0 * np.pi / self.cells)

    def centroids(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return radii (rings,) and azimuths (angles,) of the centroids of cells, and the areas (rings,) of cells."""
        radius, volume = ring_centroids(ring_sides(self.rings, self.inner, self.outer))
        return radius, centroid_azimuths(self.angles), volume * (2.0 * np.pi / self.angles)

    def mass_in_rings(self, mass: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the mass in rings between the radii `edges` (n + 1,), which divide cells with uniform density.

        mass (cells,): mass of each cell.
        """
        of_ring = mass.reshape(self.rings, self.angles).sum(axis=1)
        sides = ring_sides(self.rings, self.inner, self.outer)
        return np.diff(np.interp(edges**2, sides**2, np.concatenate([[0.0], np.cumsum(of_ring)])))


class Interpolation:
    """Interpolation of values in cells of a polar grid, linear in ln r and azimuth, at points `r` and `azimuth`.

    Beyond the centroids of the innermost and outermost ring values are those of this ring. ring, outwards: ring below
    each point, and the part of the way to the next ring.
    """

    def __init__(self, shape: PolarShape, r: np.ndarray, azimuth: np.ndarray) -> None:
        middle = shape.centroids()[0]
        with np.errstate(divide="ignore"):
            position = np.interp(np.log(r), np.log(middle), np.arange(shape.rings))
        self.ring = np.minimum(position.astype(np.int64), shape.rings - 2)
        self.outwards = position - self.ring
        along = azimuth * (shape.angles / (2.0 * np.pi)) - 0.5
        left = np.floor(along).astype(np.int64)
        self._ahead = along - left
        self._left, self._right = left % shape.angles, (left + 1) % shape.angles

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return the `values` (rings, angles) of cells at the points."""
        inner, outer = (
            (1.0 - self._ahead) * values[k, self._left] + self._ahead * values[k, self._right]
            for k in (self.ring, self.ring + 1)
        )
        found: np.ndarray = (1.0 - self.outwards) * inner + self.outwards * outer
        return found


def shape_of_cells(pos: np.ndarray, closed: bool = False) -> PolarShape:
    """Return the polar grid whose cells have the centroids `pos` (n, 2), in rings from the inside.

    Raises ValueError if there is no such grid.
    """
    r = np.sqrt((pos**2).sum(axis=1))
    rings = 1 + int((np.diff(r) > 1e-12 * r[1:]).sum())
    if rings > 1 and len(r) % rings == 0 and r[0] > 0.0 and r[-1] > r[0]:
        ratio = float(r[-1] / r[0]) ** (1.0 / (rings - 1))
        # The centroid of a ring is at 2/3 (r_o^3 - r_i^3) / (r_o^2 - r_i^2), here without differences of powers.
        inner = float(r[0]) * 1.5 * (ratio + 1.0) / (ratio**2 + ratio + 1.0)
        shape = PolarShape(rings, len(r) // rings, inner, inner * ratio**rings, closed)
        radius, azimuth, _ = shape.centroids()
        wanted = np.stack([np.outer(radius, np.cos(azimuth)), np.outer(radius, np.sin(azimuth))], axis=-1)
        if np.allclose(pos, wanted.reshape(-1, 2), rtol=0.0, atol=1e-9 * shape.outer):
            return shape
    raise ValueError("the gas is not in the cells of a polar grid")
