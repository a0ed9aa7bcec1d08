"""Numbers of rings and cells of a polar grid, and the sides of the rings."""

import math

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
