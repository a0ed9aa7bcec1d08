"""Hill radius of a planet, and the width of the gap that it opens.

    R_H = r (q / 3)^(1/3)                                            at distance r from the star; q = m / M   (1)
    (r_out - r_in) / a = 0.41 q^(1/2) (H/r)^(-3/4) alpha^(-1/4)      between the edges of a gap               (2)

The edges r_in and r_out of a gap are where Sigma is half of the surface density without the planet. (2) and this
definition: Kanagawa et al. (2016, PASJ 68, 43).
"""

from __future__ import annotations

LARGEST_PLANET = 0.03  # ratio of companion mass to stellar mass above which a companion counts as a second star


def hill_radius(distance: float, ratio: float) -> float:
    """Return the Hill radius, eq. (1), at a distance from the star; the mass ratio is companion over star."""
    return float(distance * (ratio / 3.0) ** (1.0 / 3.0))


def gap_width(ratio: float, aspect_ratio: float, alpha: float) -> float:
    """Return the width of a gap over the semi-major axis, eq. (2); `aspect_ratio` is H/r at the planet."""
    return float(0.41 * ratio**0.5 * aspect_ratio**-0.75 * alpha**-0.25)
