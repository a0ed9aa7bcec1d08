"""Kepler's problem r'' = -mu r / |r|^3 in the plane: positions from elements, elements from positions, and drifts.

Drifts use the universal anomaly s, dt = |r| ds, and beta = 2 mu / r0 - v0^2 (Stumpff; Wisdom & Hernandez 2015,
arXiv:1508.02699):

    dt = r0 G1 + eta G2 + mu G3,   r = r0 G0 + eta G1 + mu G2,   eta = r0 . v0                                 (1)
    x  = (1 - mu G2 / r0) x0 + (dt - mu G3) v0                                                               (2)
    v  = -(mu G1 / (r r0)) x0 + (1 - mu G2 / r) v0                                                           (3)

Here G_n(beta, s) = s^n c_n(beta s^2). The right side of (1) rises with s, so that its root can be bracketed.
"""

import math
from typing import NamedTuple

ROUNDS = 200  # iterations, enough to halve any bracket to rounding
SERIES = 0.1  # |beta s^2| below which c_2 and c_3 are computed from their series


class Orbit(NamedTuple):
    """Orbital elements; angles in radians, counter-clockwise from +x.

    Attributes
    ----------
    semi_major_axis : float
        Semi-major axis, negative for a hyperbola.
    eccentricity : float
        Eccentricity.
    pericentre : float
        Longitude of the pericentre.
    anomaly : float
        True anomaly.
    """

    semi_major_axis: float
    eccentricity: float
    pericentre: float
    anomaly: float


class Motion(NamedTuple):
    """Position (x, y) and velocity (vx, vy) relative to the central body."""

    x: float
    y: float
    vx: float
    vy: float


def elements(mu: float, x: float, y: float, vx: float, vy: float) -> Orbit:
    """Return the elements of the orbit through a position with a velocity.

    Parameters
    ----------
    mu : float
        GM of the orbit, above 0. Any consistent units.
    x, y, vx, vy : float
        Position and velocity relative to the central body.

    Returns
    -------
    Orbit
        Elements. On a circle the pericentre is the position of the body.
    """
    r = math.hypot(x, y)
    spin = x * vy - y * vx
    ex, ey = vy * spin / mu - x / r, -vx * spin / mu - y / r
    e = math.hypot(ex, ey)
    longitude = math.atan2(y, x)
    pericentre = math.atan2(ey, ex) if e > 1e-14 else longitude
    binding = 2.0 / r - (vx * vx + vy * vy) / mu
    anomaly = math.remainder(longitude - pericentre, 2.0 * math.pi) * (-1.0 if spin < 0.0 else 1.0)
    return Orbit(1.0 / binding if binding != 0.0 else math.inf, e, pericentre, anomaly)


def motion_at_anomaly(mu: float, size: float, e: float, anomaly: float) -> Motion:
    """Return position and velocity at a true anomaly of a counter-clockwise orbit with its pericentre on +x.

    Parameters
    ----------
    mu : float
        GM of the orbit.
    size : float
        Semi-major axis, or its absolute value for a hyperbola.
    e : float
        Eccentricity, not 1.
    anomaly : float
        True anomaly in radians.

    Returns
    -------
    Motion
        Position and velocity.
    """
    wide = size * abs(1.0 - e * e)  # the semi-latus rectum
    r = wide / (1.0 + e * math.cos(anomaly))
    speed = math.sqrt(mu / wide)
    c, s = math.cos(anomaly), math.sin(anomaly)
    return Motion(r * c, r * s, -speed * s, speed * (e + c))


def mean_anomaly(e: float, anomaly: float) -> float:
    """Return the mean anomaly at a true anomaly.

    Parameters
    ----------
    e : float
        Eccentricity, not 1.
    anomaly : float
        True anomaly in radians.

    Returns
    -------
    float
        Mean anomaly in radians, with the same number of whole turns.
    """
    half = math.sqrt(abs(1.0 - e) / (1.0 + e)) * math.tan(0.5 * anomaly)
    if e < 1.0:
        turns = round(anomaly / (2.0 * math.pi))
        eccentric = 2.0 * math.atan(half) + 2.0 * math.pi * turns
        return eccentric - e * math.sin(eccentric)
    eccentric = 2.0 * math.atanh(half)
    return e * math.sinh(eccentric) - eccentric


def motion_at_mean_anomaly(mu: float, size: float, e: float, mean: float) -> Motion:
    """Return position and velocity at a mean anomaly of a counter-clockwise orbit with its pericentre on +x.

    Parameters
    ----------
    mu : float
        GM of the orbit.
    size : float
        Semi-major axis, or its absolute value for a hyperbola.
    e : float
        Eccentricity, not 1.
    mean : float
        Mean anomaly in radians.

    Returns
    -------
    Motion
        Position and velocity.
    """
    rate = math.sqrt(mu / size)
    if e < 1.0:
        eccentric = _eccentric_anomaly(e, math.remainder(mean, 2.0 * math.pi))
        c, s, wide = math.cos(eccentric), math.sin(eccentric), math.sqrt((1.0 - e) * (1.0 + e))
        rate /= 1.0 - e * c
        return Motion(size * (c - e), size * wide * s, -rate * s, rate * wide * c)
    eccentric = _hyperbolic_anomaly(e, mean)
    c, s, wide = math.cosh(eccentric), math.sinh(eccentric), math.sqrt((e - 1.0) * (e + 1.0))
    rate /= e * c - 1.0
    return Motion(size * (e - c), size * wide * s, -rate * s, rate * wide * c)


def _eccentric_anomaly(e: float, mean: float) -> float:
    """Solve E - e sin E = M, |M| <= pi, by Newton's method within a bracket."""
    low, high = mean - e, mean + e
    root = mean + e * math.sin(mean)
    for _ in range(ROUNDS):
        wrong = root - e * math.sin(root) - mean
        low, high = (root, high) if wrong < 0.0 else (low, root)
        guess = root - wrong / (1.0 - e * math.cos(root))
        guess = guess if low <= guess <= high else 0.5 * (low + high)
        if abs(guess - root) <= 1e-16 * (1.0 + abs(root)):
            return guess
        root = guess
    return root


def _hyperbolic_anomaly(e: float, mean: float) -> float:
    """Solve e sinh F - F = M by Newton's method, from a guess that makes it converge monotonically."""
    root = math.asinh(mean / e) if abs(mean) < 1e-8 else math.copysign(math.log(2.0 * abs(mean) / e + 1.8), mean)
    for _ in range(ROUNDS):
        step = (e * math.sinh(root) - root - mean) / (e * math.cosh(root) - 1.0)
        root -= step
        if abs(step) <= 1e-16 * (1.0 + abs(root)):
            break
    return root


def drift(mu: float, at: Motion, dt: float) -> Motion:
    """Return position and velocity after a time dt on any orbit, eqs. (1) to (3).

    Parameters
    ----------
    mu : float
        GM of the orbit; the motion is straight unless it is above 0.
    at : Motion
        Position and velocity at the start.
    dt : float
        Time, positive or negative.

    Returns
    -------
    Motion
        Position and velocity after `dt`.
    """
    x, y, vx, vy = at
    r0 = math.hypot(x, y)
    if mu <= 0.0 or r0 == 0.0 or dt == 0.0 or not math.isfinite(r0 + vx + vy):
        return Motion(x + dt * vx, y + dt * vy, vx, vy)
    eta, beta = x * vx + y * vy, 2.0 * mu / r0 - (vx * vx + vy * vy)
    if beta > 0.0:  # drop whole periods
        dt = math.remainder(dt, 2.0 * math.pi * mu / (beta * math.sqrt(beta)))
    s = _universal_anomaly(mu, r0, eta, beta, dt)
    g0, g1, g2, g3 = _stumpff(beta, s)
    r = r0 * g0 + eta * g1 + mu * g2
    f, g = 1.0 - mu * g2 / r0, dt - mu * g3
    df, dg = -mu * g1 / (r * r0), 1.0 - mu * g2 / r
    return Motion(f * x + g * vx, f * y + g * vy, df * x + dg * vx, df * y + dg * vy)


def _universal_anomaly(mu: float, r0: float, eta: float, beta: float, dt: float) -> float:
    """Solve (1) for s by Newton's method within a bracket."""
    sign = 1.0 if dt > 0.0 else -1.0
    reach = abs(dt) / r0
    if beta > 0.0:
        reach = min(reach, math.pi / math.sqrt(beta))
    low, high = 0.0, sign * reach
    while sign * (_time_of_anomaly(mu, r0, eta, beta, high) - dt) < 0.0:
        low, high = high, 2.0 * high
    root = 0.5 * (low + high) if low else _first_guess(mu, r0, eta, dt, high)
    for _ in range(ROUNDS):
        g0, g1, g2, g3 = _stumpff(beta, root)
        wrong = r0 * g1 + eta * g2 + mu * g3 - dt
        r = r0 * g0 + eta * g1 + mu * g2
        if sign * wrong < 0.0:
            low = root
        else:
            high = root
        guess = root - wrong / r if r > 0.0 else low
        if not min(low, high) < guess < max(low, high):
            guess = 0.5 * (low + high)
        if abs(guess - root) <= 3e-16 * abs(root):
            return guess
        root = guess
    return root


def _first_guess(mu: float, r0: float, eta: float, dt: float, most: float) -> float:
    """Return s to second order in dt, or `most` / 2 if this value is not between 0 and `most`."""
    guess = dt / r0 - 0.5 * eta * dt * dt / r0**3
    return guess if 0.0 < guess / most < 1.0 else 0.5 * most


def _time_of_anomaly(mu: float, r0: float, eta: float, beta: float, s: float) -> float:
    """Return dt of eq. (1)."""
    _, g1, g2, g3 = _stumpff(beta, s)
    return r0 * g1 + eta * g2 + mu * g3


def _stumpff(beta: float, s: float) -> tuple[float, float, float, float]:
    """Return G_0(beta, s) to G_3(beta, s); infinite values for a hyperbola where cosh would overflow."""
    x = beta * s * s
    if abs(x) < SERIES:
        c2 = c3 = 0.0
        for n in range(15, 1, -2):  # c_2 = (1 - x/(3 4) (1 - ...)) / (1 2), c_3 = (1 - x/(4 5) (1 - ...)) / (2 3)
            c3 = (1.0 - x * c3) / (n * (n - 1))
            c2 = (1.0 - x * c2) / ((n - 1) * (n - 2))
        return 1.0 - x * c2, s * (1.0 - x * c3), s * s * c2, s**3 * c3
    if x > 0.0:
        root = math.sqrt(beta)
        g0, g1 = math.cos(root * s), math.sin(root * s) / root
    else:
        root = math.sqrt(-beta)
        if abs(root * s) > 700.0:
            return math.inf, math.copysign(math.inf, s), math.inf, math.copysign(math.inf, s)
        g0, g1 = math.cosh(root * s), math.sinh(root * s) / root
    return g0, g1, (1.0 - g0) / beta, (s - g1) / beta
