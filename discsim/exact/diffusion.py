"""Turbulent diffusion of dust in gas: equilibria with drift in a ring and in a vertical layer, and a spreading line.

    d rho_d/dt = div [D rho_g grad(rho_d / rho_g) - rho_d v]                                              (1)

The flux vanishes for rho_d ~ rho_g exp(int v dx / D), with D = alpha c_s H / (1 + St^2). Solutions are

    ring     Sigma_d ~ Sigma_g P^(St / alpha)                                                             (2)
    layer    H_d = H sqrt(alpha / (alpha + St))                                                           (3)
    line     a Gaussian of variance 2 D t                                                                 (4)

(2) is for the drift that a pressure P causes, v = St c_s H / (1 + St^2) d ln P/dx (Dullemond et al. 2018, eqs. 44 to
46). (3) is for grains that fall to the midplane of a layer at the speed Omega^2 z t_stop. It follows from the moments
of their equation of motion (Dubrulle et al. 1995; Youdin & Lithwick 2007); c_s and H are those of the gas. (4) is for
grains in uniform gas that start on a line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray


def ring(gas: ArrayLike, pressure: ArrayLike, alpha: float, stokes: float) -> Array:
    """Return the equilibrium density of dust near a pressure maximum, up to a constant factor, eq. (2).

    Parameters
    ----------
    gas : array_like, shape (n,)
        Surface density of the gas.
    pressure : array_like, shape (n,)
        Pressure of the gas.
    alpha : float
        Turbulence parameter.
    stokes : float
        Stokes number, the same at all points.

    Returns
    -------
    ndarray, shape (n,)
        Surface density of the dust times a constant, in the unit of `gas`.
    """
    pressure = np.asarray(pressure, dtype=float)
    found: Array = np.asarray(gas, dtype=float) * (pressure / pressure.max()) ** (stokes / alpha)
    return found


def layer_height(height: float, alpha: float, stokes: float) -> float:
    """Return the scale height of a dust layer, eq. (3), which neglects terms of order alpha St.

    Parameters
    ----------
    height : float
        Scale height of the gas.
    alpha : float
        Turbulence parameter.
    stokes : float
        Stokes number in the midplane.

    Returns
    -------
    float
        Scale height of the dust, in the unit of `height`.
    """
    return height * float(np.sqrt(alpha / (alpha + stokes)))


def line(x: ArrayLike, time: float, diffusivity: float) -> Array:
    """Return the density of dust that spreads in uniform gas from a line, eq. (4).

    Parameters
    ----------
    x : array_like, shape (n,)
        Distance from the line.
    time : float
        Time since the line was infinitely thin, above 0.
    diffusivity : float
        Diffusivity D of the dust.

    Returns
    -------
    ndarray, shape (n,)
        Density of dust of mass 1, in the inverse unit of `x`.
    """
    variance = 2.0 * diffusivity * time
    found: Array = np.exp(-0.5 * np.asarray(x, dtype=float) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return found
