"""Growth rate of the largest grains in given gas, and the division of dust mass into small and grown dust.

Sizes a have the distribution n(a) ~ a^-3.5 from a_min to a_r. Small dust has a < a_*, grown dust has a > a_*:

    Sigma_small / Sigma_d = (sqrt(a_*) - sqrt(a_min)) / (sqrt(a_r) - sqrt(a_min))                               (1)
    da_r/dt = rho_d v_rel / rho_s                                                                               (2)
    rho_d   = [Sigma_small / H + Sigma_grown / H_d] / sqrt(2 pi),   H_d = H sqrt(alpha / (alpha + St))          (3)
    v_rel^2 = 3 alpha c_s^2 / (St + 1/St) + |u(St) - u(St/2)|^2                                                 (4)
    u(St)   = -eta v_K (2 St, 1) / (1 + St^2), radial and azimuthal, relative to circles                        (5)
    a_frag  = 2 Sigma_g v_frag^2 / (3 pi rho_s alpha c_s^2)                                                     (6)

Sources: (1), (2), (6) as in FEoSaD (Stoyanovskaya et al. 2017; Vorobyov et al. 2018, arXiv:1801.06898); (6) is also
Birnstiel et al. (2012) eq. 8 without its factor f_f. (3) Dubrulle et al. (1995). (4) turbulence: Ormel & Cuzzi (2007);
drift: between a grain and one of half its Stokes number, as in Birnstiel et al. (2012). (5) Nakagawa et al. (1986)
without back-reaction. Brownian motion is neglected: it is 0.05 cm/s for a grain of 1 um at 100 K.

`kernels/dust/growth.py` compiles these functions.
"""

import math

THINNEST = 1e-3  # lower bound of H_d / H, as (3) diverges without turbulence; a settled layer stirs itself


def small_share(size: float, small: float, smallest: float) -> float:
    """Return the fraction of the dust mass in grains smaller than a_*, eq. (1).

    size: a_r, the largest size, at least a_*. small: a_*. smallest: a_min.
    """
    return (math.sqrt(small) - math.sqrt(smallest)) / (math.sqrt(size) - math.sqrt(smallest))


def layer_thickness(stokes: float, alpha: float) -> float:
    """Return H_d / H, the scale height of grains with the Stokes number `stokes` over that of the gas, eq. (3)."""
    return max(math.sqrt(alpha / (alpha + stokes)), THINNEST)


def midplane_density(small: float, grown: float, height: float, stokes: float, alpha: float) -> float:
    """Return rho_d, the density of all dust in the midplane, eq. (3).

    small, grown: surface densities of small and of grown dust. height: scale height H of the gas. stokes: Stokes number
    of the grown dust.
    """
    return (small + grown / layer_thickness(stokes, alpha)) / (math.sqrt(2.0 * math.pi) * height)


def relative_speed(stokes: float, alpha: float, sound: float, headwind: float) -> float:
    """Return v_rel, the relative speed of colliding grains, eq. (4). stokes: St. sound: c_s. headwind: eta v_K."""
    whole, half = 1.0 / (1.0 + stokes * stokes), 1.0 / (1.0 + 0.25 * stokes * stokes)
    turbulent = 3.0 * alpha * sound * sound * stokes * whole
    radial, azimuthal = headwind * stokes * (2.0 * whole - half), headwind * (whole - half)
    return math.sqrt(turbulent + radial * radial + azimuthal * azimuthal)


def fragmentation_size(density: float, speed: float, alpha: float, sound: float, material: float) -> float:
    """Return a_frag, the largest size that fragmentation allows, eq. (6); inf if `alpha` is 0.

    density: Sigma_g. speed: v_frag; 0 gives a_frag = 0. sound: c_s. material: rho_s.
    """
    if speed == 0.0:
        return 0.0
    pull = 3.0 * math.pi * material * alpha * sound * sound
    return 2.0 * density * speed * speed / pull if pull > 0.0 else math.inf
