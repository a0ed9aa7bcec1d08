"""Laws of the stopping time t of a grain with slip speed w in gas of density rho_g and thermal speed c_s.

    constant        t = rho_d / K
    stopping-time   t given
    stokes-number   t = St / Omega
    epstein         t = s rho_s / (rho_g c)                                                               (1)
      supersonic    1/t times sqrt(1 + (9 pi / 128) (w / c_s)^2)                                          (2)
    epstein-stokes  (1) where lambda >= 4 s / 9, else 1/t = (9 lambda / 4 s) rho_g c / (s rho_s) times    (3)
                    max(1, Re^0.4, 0.44 Re / 24),   Re = 2 s w / nu,   nu = lambda c / 2                  (4)

c_s = sqrt(P / rho_g) is the isothermal sound speed of any gas. c is the mean speed of molecules, sqrt(8/pi) c_s, or
c_s with the convention "papers". rho_s is the grain's material density. The mean free path is lambda = (mean free
column) / rho_g. In two dimensions rho_g = Sigma Omega / (sqrt(2 pi) c_s).
Sources: (1), (3) and (4) Weidenschilling 1977, with the drag coefficients 24/Re, 24/Re^0.6 and 0.44 (Whipple 1972),
each where it is the largest, so that the drag is continuous; (2) Kwok 1975. `kernels/drag/laws.py` compiles
these functions.
"""

import math
from collections.abc import Sequence

# Forms of drag laws. Several values of `drag.law` may share a form.
CONSTANT, STOPPING_TIME, STOKES_NUMBER, EPSTEIN, EPSTEIN_STOKES = range(5)
# Indices of a grain's five parameters: VALUE is K, t_stop, St or s rho_s c_s / c, depending on the form; SUPERSONIC is
# the factor of w^2 / c_s^2 in (2), SIZE is s, COLUMN is the mean free column, THERMAL is c / c_s.
VALUE, SUPERSONIC, SIZE, COLUMN, THERMAL = range(5)
KWOK = 9.0 * math.pi / 128.0
RAM = 0.44 / 24.0  # the last term of (4), turbulent drag over Stokes drag, is RAM Re
TURBULENT = RAM ** (-2.0 / 3.0)  # the maximum in (4) is its last term if it exceeds this value


Grain = Sequence[float]  # the five parameters of a grain


def volume_density(density: float, sound: float, omega: float) -> float:
    """Return the gas density rho_g: Sigma Omega / (sqrt(2 pi) c_s) if omega > 0, else `density` itself."""
    return density * omega / (math.sqrt(2.0 * math.pi) * sound) if omega > 0.0 else density


def stopping_time(law: int, grain: Grain, mass_ratio: float, density: float, sound: float, omega: float) -> float:
    """Return the stopping time of a grain at zero slip.

    law: form of the drag law. grain (5,): parameters of the grain, with the indices VALUE to THERMAL. mass_ratio:
    rho_d / rho_g. density, sound, omega: density, thermal speed and orbital frequency of the gas; density is Sigma if
    omega > 0, else rho_g.
    """
    value = grain[VALUE]
    if law == CONSTANT:
        return mass_ratio * density / value
    if law == STOPPING_TIME:
        return value
    if law == STOKES_NUMBER:
        return value / omega
    if law == EPSTEIN:
        if omega > 0.0:  # c_s cancels
            return value * math.sqrt(2.0 * math.pi) / (density * omega)
        return value / (sound * density)
    volume = volume_density(density, sound, omega)
    return value / (sound * volume) * max(1.0, 4.0 * grain[SIZE] * volume / (9.0 * grain[COLUMN]))


def drag_speed_terms(law: int, grain: Grain, density: float, sound: float, omega: float) -> tuple[float, float]:
    """Return (mach2, reynolds2), the two factors of w^2 that determine how the drag rate grows with the slip speed w.

    mach2: factor of w^2 in eq. (2). reynolds2: Re^2 / w^2 where eq. (3) applies. One of the two is always 0. The
    arguments are those of `stopping_time`.
    """
    if law == EPSTEIN_STOKES:
        path = grain[COLUMN] / volume_density(density, sound, omega)
        if 9.0 * path < 4.0 * grain[SIZE]:
            reynolds = 4.0 * grain[SIZE] / (path * grain[THERMAL] * sound)
            return 0.0, reynolds * reynolds
    return grain[SUPERSONIC] / (sound * sound), 0.0


def drag_factor(mach2: float, reynolds2: float, slip2: float) -> float:
    """Return the ratio of the drag rate at the slip speed sqrt(slip2) to the drag rate at zero slip, eqs. (2) and (4).

    mach2, reynolds2: results of `drag_speed_terms`.
    """
    if reynolds2 > 0.0:
        square = reynolds2 * slip2
        return max(square**0.2, RAM * math.sqrt(square)) if square > 1.0 else 1.0
    return math.sqrt(1.0 + mach2 * slip2)


def drag_factor_slope(mach2: float, reynolds2: float, slip2: float, factor: float) -> float:
    """Return the logarithmic derivative d ln F / d ln w of the drag factor F at the slip speed w = sqrt(slip2).

    mach2, reynolds2: results of `drag_speed_terms`. factor: F, the result of `drag_factor` for the same arguments.
    """
    if reynolds2 > 0.0:
        return 1.0 if factor > TURBULENT else 0.4 if factor > 1.0 else 0.0
    return mach2 * slip2 / (factor * factor)


def is_linear_up_to(mach2: float, reynolds2: float, slip2: float) -> bool:
    """Return whether the drag is linear in the slip for all slip speeds up to sqrt(slip2).

    The factor of eq. (2) is then 1 to rounding, and Re in eq. (4) is at most 1. mach2, reynolds2: results of
    `drag_speed_terms`.
    """
    return mach2 * slip2 < 1e-16 and reynolds2 * slip2 <= 1.0


def nonlinear_drag_factor(law: int, grain: Grain, density: float, sound: float, omega: float, speed: float) -> float:
    """Return the ratio of the drag rate at the slip speed `speed` to the drag rate at zero slip.

    The other arguments are those of `stopping_time`.
    """
    mach2, reynolds2 = drag_speed_terms(law, grain, density, sound, omega)
    return drag_factor(mach2, reynolds2, speed * speed)
