"""Smoothing kernels W(r, h) = sigma h^-d w(q), q = r/h, by name; their polynomials are in `kernels/sph/smoothing.py`."""

from __future__ import annotations

import math
from typing import NamedTuple


class Smoothing(NamedTuple):
    """A smoothing kernel; pairs of numbers are for one and for two dimensions.

    support: its radius in h. squeezed: h over that of the same kernel in the usual units. norm: sigma. eta: of
    h = eta (m/rho)^(1/d), such that sound on an even lattice has the right speed. least_eta: W(0)^(1/d) in h; with less
    a particle is dense enough by itself at any h, which then falls to nothing. mean_q: of W in two dimensions, <q> and
    <q^2>. fastest: the largest frequency of sound on a lattice of particles, in c_s / h, h as the usual units have it.
    noise: viscosity that particles' noise makes in the shear of a disc, in c_s h, with 36 neighbours; fitted to the
    rings of `analysis/noise.py`.
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
        """Neighbours in even gas in two dimensions."""
        return math.pi * (self.support * eta) ** 2


# eta: in 1D whole numbers of spacings; only then is a B-spline's sum density exact. In 2D on a square lattice, along an
# axis, c_s^2 is right to .5% with the B-splines (with eta = 1.2 the cubic one is 8% off), to 2% with Wendland's.
# quintic-h is the quintic squeezed to support h: thrice the eta.
CUBIC_Q, QUINTIC_Q, WENDLAND_C4_Q = (5 / 7, 31 / 49), (210 / 239, 2771 / 2868), (32 / 55, 14 / 33)
WENDLAND_C2_Q = 2 / 3, 5 / 9
SQUEEZED_Q = QUINTIC_Q[0] / 3, QUINTIC_Q[1] / 9
QUINTIC_W = (2.10, 1.88)
QUIET = "wendland-c4"  # the kernel of quiet gas where none is named: the mean pull is right to 1% (analysis/noise.py)
SMOOTHING = {
    "cubic": Smoothing(
        2.0, 1.0, (2.0 / 3.0, 10.0 / (7.0 * math.pi)), (2.0, 1.345), (0.667, 0.675), CUBIC_Q, (2.62, 2.37), 0.032
    ),
    "quintic": Smoothing(
        3.0, 1.0, (1.0 / 120.0, 7.0 / (478.0 * math.pi)), (2.0, 1.1), (0.55, 0.555), QUINTIC_Q, QUINTIC_W, 0.034
    ),
    "quintic-h": Smoothing(
        1.0, 3.0, (3.0 / 120.0, 63.0 / (478.0 * math.pi)), (6.0, 3.3), (1.65, 1.665), SQUEEZED_Q, QUINTIC_W, 0.034
    ),
    "wendland-c2": Smoothing(
        2.0, 1.0, (0.625, 7.0 / (4.0 * math.pi)), (2.0, 1.7), (0.625, 0.747), WENDLAND_C2_Q, (2.27, 2.49), 0.014
    ),
    "wendland-c4": Smoothing(
        2.0, 1.0, (0.75, 9.0 / (4.0 * math.pi)), (2.0, 1.7), (0.75, 0.847), WENDLAND_C4_Q, (2.90, 2.84), 0.021
    ),
}
