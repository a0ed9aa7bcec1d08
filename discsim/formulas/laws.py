"""Laws of the stopping time of a grain with slip speed w in gas of density rho_g and thermal speed c_s.

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

# Forms of drag laws. Several laws of [drag] may share a form.
CONSTANT, STOPPING_TIME, STOKES_NUMBER, EPSTEIN, EPSTEIN_STOKES = range(5)
# Indices of a grain's parameters: K, t_stop, St or s rho_s c_s / c; factor of w^2 / c_s^2 in (2); s; mean free column;
# c / c_s.
VALUE, SUPERSONIC, SIZE, COLUMN, THERMAL = range(5)
KWOK = 9.0 * math.pi / 128.0
RAM = 0.44 / 24.0  # the last term of (4), turbulent drag over Stokes drag, is RAM Re
TURBULENT = RAM ** (-2.0 / 3.0)  # value of the maximum in (4) above which it is the last term


def volume_density(density: float, sound: float, omega: float) -> float:
    return density * omega / (math.sqrt(2.0 * math.pi) * sound) if omega > 0.0 else density


def stopping_time(
    law: int, grain: Sequence[float], mass_ratio: float, density: float, sound: float, omega: float
) -> float:
    """Return the stopping time of dust at zero slip.

    law: form. grain (5,): parameters, with the indices VALUE to THERMAL. mass_ratio: rho_d / rho_g. density, sound,
    omega: density, thermal speed and orbital frequency of the gas; density is Sigma if omega > 0, else rho_g.
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


def quickening(law: int, grain: Sequence[float], density: float, sound: float, omega: float) -> tuple[float, float]:
    """Return (mach2, reynolds2), the coefficients of w^2 by which the drag rate grows with the slip w.

    mach2: factor of w^2 in eq. (2). reynolds2: Re^2 / w^2 where eq. (3) applies, else 0.
    """
    if law == EPSTEIN_STOKES:
        path = grain[COLUMN] / volume_density(density, sound, omega)
        if 9.0 * path < 4.0 * grain[SIZE]:
            reynolds = 4.0 * grain[SIZE] / (path * grain[THERMAL] * sound)
            return 0.0, reynolds * reynolds
    return grain[SUPERSONIC] / (sound * sound), 0.0


def hastened(mach2: float, reynolds2: float, slip2: float) -> float:
    """Return the ratio of the drag rate at the squared slip `slip2` to that at zero slip, eqs. (2) and (4).

    mach2, reynolds2: results of `quickening`.
    """
    if reynolds2 > 0.0:
        square = reynolds2 * slip2
        return max(square**0.2, RAM * math.sqrt(square)) if square > 1.0 else 1.0
    return math.sqrt(1.0 + mach2 * slip2)


def steepness(mach2: float, reynolds2: float, slip2: float, fast: float) -> float:
    """Return d ln F / d ln w of the factor F = `fast`, the result of `hastened`, for slip w."""
    if reynolds2 > 0.0:
        return 1.0 if fast > TURBULENT else 0.4 if fast > 1.0 else 0.0
    return mach2 * slip2 / (fast * fast)


def unhastened(mach2: float, reynolds2: float, slip2: float) -> bool:
    """Return whether drag is linear for all slips with squares up to `slip2`.

    The factor of eq. (2) is then 1 to rounding, and Re in eq. (4) is at most 1. mach2, reynolds2: from `quickening`.
    """
    return mach2 * slip2 < 1e-16 and reynolds2 * slip2 <= 1.0


def hastening(law: int, grain: Sequence[float], density: float, sound: float, omega: float, speed: float) -> float:
    """Return the ratio of the drag rate at the slip `speed` to that at zero slip; arguments as in `stopping_time`."""
    mach2, reynolds2 = quickening(law, grain, density, sound, omega)
    return hastened(mach2, reynolds2, speed * speed)
