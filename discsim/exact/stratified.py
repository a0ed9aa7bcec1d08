"""Pull in a disc that is Gaussian in height, from that of the razor-thin disc with the same surface density.

With rho = Sigma exp(-z^2 / 2H^2) / (sqrt(2 pi) H) both where the mass is and where the pull is felt, H constant, the
heights z - z' of one above the other are Gaussian with the variance 2H^2, and the pull on a column is

    a(r) = (1 / sqrt(pi) H) int_0^inf exp(-z^2 / 4H^2) a_razor(r, z) dz                                (1)

(Rendon Restrepo et al. 2025, arXiv:2506.10812, whose thin-disc kernel is this for a point of mass.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray
NODES = 48  # of Gauss-Legendre, out to 12 H, where exp(-36) is left


def mean_over_height(razor_thin: Callable[[float], Array], thickness: float) -> Array:
    """Radial acceleration from `razor_thin`, that of a razor-thin disc at a height > 0; any shape."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    height = 6 * thickness * (node + 1)
    weight = 6 * weight * np.exp(-((height / thickness) ** 2) / 4) / np.sqrt(np.pi)
    return sum(w * razor_thin(float(z)) for z, w in zip(height, weight, strict=True))  # eq. (1)
