"""Laws of the stopping time, of one grain in gas of density rho_g and sound speed c_s that passes at a speed w.

    constant        t = rho_d / K
    stopping-time   t given
    stokes-number   t = St / Omega
    epstein         t = s rho_s / (rho_g c)                                                               (1)
      supersonic    1/t times sqrt(1 + (9 pi / 128) (w / c_s)^2)                                          (2)
    epstein-stokes  (1) where lambda >= 4 s / 9, else 1/t = (9 lambda / 4 s) rho_g c / (s rho_s) times    (3)
                    max(1, Re^0.4, 0.44 Re / 24),   Re = 2 s w / nu,   nu = lambda c / 2                  (4)

c is c_s, or with the kinetic convention the mean thermal speed sqrt(8/pi) c_s; rho_s is the grain's material density;
the mean free path lambda = (mean free column) / rho_g. In two dimensions rho_g = Sigma Omega / (sqrt(2 pi) c_s).
(1), (3) and (4): Weidenschilling 1977, with the drag coefficients 24/Re, 24/Re^0.6 and 0.44 (Whipple 1972), each where
it is the largest, so that the drag is continuous; (2): Kwok 1975. `kernels/laws.py` compiles all this.
"""

import math
from collections.abc import Sequence

# Forms: what a stopping time depends on. Several laws may have one, with values of their own.
CONSTANT, STOPPING_TIME, STOKES_NUMBER, EPSTEIN, EPSTEIN_STOKES = range(5)
# Of a population: K, t_stop, St or s rho_s c_s / c; what w^2 / c_s^2 counts in (2); s; the mean free column; c / c_s.
VALUE, SUPERSONIC, SIZE, COLUMN, THERMAL = range(5)
KWOK = 9.0 * math.pi / 128.0


def volume_density(density: float, sound: float, omega: float) -> float:
    return density * omega / (math.sqrt(2.0 * math.pi) * sound) if omega > 0.0 else density


def stopping_time(
    law: int, grain: Sequence[float], mass_ratio: float, density: float, sound: float, omega: float
) -> float:
    """Stopping time of the dust at vanishing speed; `grain` (5,), rho_d = mass_ratio density."""
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


def hastening(law: int, grain: Sequence[float], density: float, sound: float, omega: float, speed: float) -> float:
    """By how much the drag is faster than at vanishing speed; eqs. (2) and (4)."""
    if law == EPSTEIN_STOKES:
        path = grain[COLUMN] / volume_density(density, sound, omega)
        if 9.0 * path < 4.0 * grain[SIZE]:
            reynolds = 4.0 * grain[SIZE] * speed / (path * grain[THERMAL] * sound)
            return max(1.0, reynolds**0.4, 0.44 / 24.0 * reynolds)
    mach = speed / sound
    return math.sqrt(1.0 + grain[SUPERSONIC] * mach * mach)
