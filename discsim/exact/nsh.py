"""Steady drift of gas and dust in a Keplerian disc (Nakagawa, Sekiya & Hayashi 1986).

As Youdin & Johansen (2007), eqs. (7a)-(7d), with St = Omega t_stop, eps = rho_d/rho_g and
D = (1 + eps)^2 + St^2, relative to the Keplerian velocity:

    gas    radial   2 eps St / D                            eta v_K   (1)
    gas    azimuth  -(1 + eps + St^2) / D                   eta v_K   (2)
    dust   radial   -2 St / D                               eta v_K   (3)
    dust   azimuth  -(1 + eps) / D                          eta v_K   (4)

which is where the pressure, the drag, and the Coriolis and shear terms balance. (2) and (4) are the
published forms with their differences carried out, so that they keep their digits at any St and eps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Drift(NamedTuple):
    """Velocities relative to Keplerian rotation, in the headwind's unit and the inputs' joint shape."""

    gas_radial: np.ndarray
    gas_azimuthal: np.ndarray
    dust_radial: np.ndarray
    dust_azimuthal: np.ndarray


def velocities(stokes: ArrayLike, dust_ratio: ArrayLike, headwind: ArrayLike) -> Drift:
    """Drift of both species at Stokes number `stokes` = Omega t_stop and dust/gas ratio `dust_ratio`.

    `headwind` is eta v_K: by how much gas alone lags the Keplerian velocity (2D: eta = (p + q) h^2/2).
    Source: Youdin & Johansen (2007), eq. (7).
    """
    stokes, ratio, headwind = (np.asarray(x, dtype=float) for x in (stokes, dust_ratio, headwind))
    scale = headwind / ((1 + ratio) ** 2 + stokes**2)
    return Drift(
        gas_radial=2 * ratio * stokes * scale,  # eq. (1)
        gas_azimuthal=-(1 + ratio + stokes**2) * scale,  # eq. (2)
        dust_radial=-2 * stokes * scale,  # eq. (3)
        dust_azimuthal=-(1 + ratio) * scale,  # eq. (4)
    )
