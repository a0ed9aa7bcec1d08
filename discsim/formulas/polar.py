"""Numbers of rings and cells of a polar grid."""

import math

MIN_RINGS, MIN_ANGLES = 5, 8


def ring_count(cells: int, inner: float, outer: float) -> int:
    """Return the number of rings, even in ln r, for which about `cells` cells between two radii are square."""
    return max(MIN_RINGS, round(math.sqrt(cells * math.log(outer / inner) / (2.0 * math.pi))))


def angle_count(cells: int, rings: int) -> int:
    """Return the number of cells in each of `rings` rings, so that their product is closest to `cells`."""
    return max(MIN_ANGLES, round(cells / rings))
