"""Constants of smoothing kernels W(r, h) = sigma h^-d w(q), q = r/h, by name; w(q) is in `kernels/sph/smoothing.py`."""

from __future__ import annotations

import math
from typing import NamedTuple


class KernelConstants(NamedTuple):
    """Constants of a smoothing kernel; pairs of numbers are for one and for two dimensions.

    Attributes
    ----------
    support : float
        Support radius in h.
    squeezed : float
        Ratio of h to the usual definition of h for this kernel.
    norm : (float, float)
        sigma.
    eta : (float, float)
        Default of eta in h = eta (m/rho)^(1/d), for which sound on a regular lattice has the right speed.
    least_eta : (float, float)
        [W(0) h^d]^(1/d), the lower bound of eta. Below it, the equation for h has no solution, and h falls to 0.
    mean_q : (float, float)
        Moments <q> and <q^2> of W in two dimensions.
    fastest : (float, float)
        Largest angular frequency of sound on a lattice of particles, in c_s / h with the usual definition of h.
    noise : float
        Viscosity by particle noise in the shear of a disc with 36 neighbours, in c_s h; a fit to the rings of
        `analysis/noise.py`.
    """

    support: float
    squeezed: float
    norm: tuple[float, float]
    eta: tuple[float, float]
    least_eta: tuple[float, float]
    mean_q: tuple[float, float]
    fastest: tuple[float, float]
    noise: float

    def neighbours(self, eta: float) -> float:
        """Return the number of neighbours of a particle in uniform gas in two dimensions."""
        return math.pi * (self.support * eta) ** 2


# eta in 1D is a whole number of spacings, as only then the summed density of a B-spline is exact. In 2D on a square
# lattice along an axis, the error of c_s^2 is 0.5% with B-splines (8% for the cubic one with eta = 1.2), and 2% with
# Wendland kernels. quintic-h is the quintic scaled to support h, with three times its eta.
CUBIC_Q, QUINTIC_Q, WENDLAND_C4_Q = (5 / 7, 31 / 49), (210 / 239, 2771 / 2868), (32 / 55, 14 / 33)
WENDLAND_C2_Q = 2 / 3, 5 / 9
SQUEEZED_Q = QUINTIC_Q[0] / 3, QUINTIC_Q[1] / 9
QUINTIC_W = (2.10, 1.88)
QUIET = "wendland-c4"  # default kernel of quiet gas: the error of the mean force is 1% (analysis/noise.py)
SMOOTHING = {
    "cubic": KernelConstants(
        2.0, 1.0, (2.0 / 3.0, 10.0 / (7.0 * math.pi)), (2.0, 1.345), (0.667, 0.675), CUBIC_Q, (2.62, 2.37), 0.032
    ),
    "quintic": KernelConstants(
        3.0, 1.0, (1.0 / 120.0, 7.0 / (478.0 * math.pi)), (2.0, 1.1), (0.55, 0.555), QUINTIC_Q, QUINTIC_W, 0.034
    ),
    "quintic-h": KernelConstants(
        1.0, 3.0, (3.0 / 120.0, 63.0 / (478.0 * math.pi)), (6.0, 3.3), (1.65, 1.665), SQUEEZED_Q, QUINTIC_W, 0.034
    ),
    "wendland-c2": KernelConstants(
        2.0, 1.0, (0.625, 7.0 / (4.0 * math.pi)), (2.0, 1.7), (0.625, 0.747), WENDLAND_C2_Q, (2.27, 2.49), 0.014
    ),
    "wendland-c4": KernelConstants(
        2.0, 1.0, (0.75, 9.0 / (4.0 * math.pi)), (2.0, 1.7), (0.75, 0.847), WENDLAND_C4_Q, (2.90, 2.84), 0.021
    ),
}
