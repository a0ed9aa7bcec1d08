"""How fast the largest grains of a place grow, and how small dust and grown dust share its mass.

    n(a) ~ a^-3.5 from a_min to a_r; small dust is what of it is below a_*:
    Sigma_small / Sigma_d = (sqrt(a_*) - sqrt(a_min)) / (sqrt(a_r) - sqrt(a_min))                               (1)
    da_r/dt = rho_d v_rel / rho_s                                                                               (2)
    rho_d   = [Sigma_small / H + Sigma_grown / H_d] / sqrt(2 pi),   H_d = H sqrt(alpha / (alpha + St))          (3)
    v_rel^2 = 3 alpha c_s^2 / (St + 1/St) + |u(St) - u(St/2)|^2                                                 (4)
    u(St)   = -eta v_K (2 St, 1) / (1 + St^2), radial and azimuthal, relative to circles                        (5)
    a_frag  = 2 Sigma_g v_frag^2 / (3 pi rho_s alpha c_s^2)                                                     (6)

(1), (2), (6) as in FEoSaD (Stoyanovskaya et al. 2017; Vorobyov et al. 2018, arXiv:1801.06898), (6) also Birnstiel et
al. (2012) eq. 8 without its factor f_f; (3) Dubrulle et al. (1995); (4) turbulence: Ormel & Cuzzi (2007), drift: of a
grain and one of half its Stokes number, as Birnstiel et al. (2012) have it; (5) Nakagawa et al. (1986) without the
dust's push on the gas. Brownian motion is left out: a grain of 1 um at 100 K has .05 cm/s by it.

`kernels/dust/growth.py` compiles all this.
"""

import math

THINNEST = 1e-3  # of H_d over H: the settled layer stirs itself, and without turbulence (3) has no end


def small_share(size: float, small: float, smallest: float) -> float:
    """Of all dust what is below `small`, where the largest grains have a `size` of that or more; eq. (1)."""
    return (math.sqrt(small) - math.sqrt(smallest)) / (math.sqrt(size) - math.sqrt(smallest))


def layer(stokes: float, alpha: float) -> float:
    """H_d / H of grains, eq. (3)."""
    return max(math.sqrt(alpha / (alpha + stokes)), THINNEST)


def midplane_density(small: float, grown: float, height: float, stokes: float, alpha: float) -> float:
    """rho_d of surface densities of small and of grown dust, in gas of scale height H, eq. (3)."""
    return (small + grown / layer(stokes, alpha)) / (math.sqrt(2.0 * math.pi) * height)


def relative_speed(stokes: float, alpha: float, sound: float, headwind: float) -> float:
    """v_rel of grains of a Stokes number, eq. (4); headwind: eta v_K."""
    whole, half = 1.0 / (1.0 + stokes * stokes), 1.0 / (1.0 + 0.25 * stokes * stokes)
    turbulent = 3.0 * alpha * sound * sound * stokes * whole
    radial, azimuthal = headwind * stokes * (2.0 * whole - half), headwind * (whole - half)
    return math.sqrt(turbulent + radial * radial + azimuthal * azimuthal)


def fragmentation_size(density: float, speed: float, alpha: float, sound: float, material: float) -> float:
    """a_frag in gas of a surface density, eq. (6); speed: v_frag, material: rho_s. Without turbulence inf."""
    if speed == 0.0:
        return 0.0
    pull = 3.0 * math.pi * material * alpha * sound * sound
    return 2.0 * density * speed * speed / pull if pull > 0.0 else math.inf
