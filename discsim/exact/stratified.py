"""Self-gravity of a disc with a Gaussian vertical profile, from that of the razor-thin disc of equal surface density.

The density is rho = Sigma exp(-z^2 / 2H^2) / (sqrt(2 pi) H) with constant H. The differences z - z' of the heights of
two points are Gaussian with the variance 2H^2, so that the mean acceleration of a column is

    a(r) = (1 / sqrt(pi) H) int_0^inf exp(-z^2 / 4H^2) a_razor(r, z) dz                                (1)

The thin-disc kernel of Rendon Restrepo et al. 2025, arXiv:2506.10812, is (1) for a point mass.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray
NODES = 48  # nodes of Gauss-Legendre quadrature up to 12 H, where the weight is exp(-36)


def mean_over_height(razor_thin: Callable[[float], Array], thickness: float) -> Array:
    """Return the mean acceleration of columns of a disc with a thickness, eq. (1).

    Parameters
    ----------
    razor_thin : callable (height)
        Return the acceleration by the razor-thin disc at a height above 0, an array of any shape.
    thickness : float
        Scale height H.

    Returns
    -------
    ndarray
        Acceleration, of the shape that `razor_thin` returns.
    """
    node, weight = np.polynomial.legendre.leggauss(NODES)
    height = 6 * thickness * (node + 1)
    weight = 6 * weight * np.exp(-((height / thickness) ** 2) / 4) / np.sqrt(np.pi)
    return sum(w * razor_thin(float(z)) for z, w in zip(height, weight, strict=True))  # eq. (1)
