"""Cooling of gas over a kick at a constant heating rate: towards an energy in a time, or by its own light.

    towards         du/dt = rate - (u - u_eq) / t_cool                                                          (1)
    radiative       du/dt = rate - 2 sigma (T^4 - T_irr^4) / (tau_eff Sigma),  tau = kappa Sigma / 2            (2)
                    tau_eff = 3 tau / 8 + sqrt(3) / 4 + 1 / (4 tau)      (Hubeny 1990)

(1) is solved exactly. (2) is one equation a particle, which an exponential Rosenbrock method of third order follows
(exprb32 of Hochbruck, Ostermann & Schweitzer 2009), with steps of its own that hold the error of each to TOLERANCE of
u: L-stable, so that a kick of any length ends where heating and cooling balance. Both compose from kick to kick.

No u falls below 0: gas that expands loses heat at the rate that it had at the start of the kick only down to LEAST of
its energy, and below that in proportion to u.
"""

import math

import numpy as np

from discsim.formulas.opacity import BELL_LIN, METALS, THINNEST
from discsim.jit.decorators import compiled, inner

LEAST = 0.1
TOLERANCE = 1e-6
MOST = 100_000  # steps within a kick; a few where it is resolved, a hundred from a thousand times the balance
POWERS = np.array(BELL_LIN)


@inner
def relaxed(u, settled, rate, t_cool, dt):
    """u of (1) after dt."""
    x = dt / t_cool
    gone = -math.expm1(-x)
    after = u * math.exp(-x) + (settled + rate * t_cool) * gone
    if rate >= 0.0:
        return after
    if u <= 0.0:
        return max(after, 0.0)
    quick = 1.0 / t_cool - rate / u  # heat that is lost in proportion to u
    lost = -math.expm1(-quick * dt)
    return max(after, LEAST * (u * (1.0 - lost) + settled / (t_cool * quick) * lost))


@compiled
def towards(begin, end, pos, u, rate, dt, at_orbit, t_cool, passive, star, softening, out):
    """(1) for energies (n,): t_cool is in units of 1/Omega about the central mass where `at_orbit`; u_eq = passive[0]
    r^-passive[1].
    """
    flat = passive[1] == 0.0
    for i in range(begin, end):
        r2 = 0.0
        for k in range(pos.shape[1]):
            r2 += pos[i, k] * pos[i, k]
        settled, time = passive[0], t_cool
        if not flat:
            settled *= max(r2, passive[2]) ** (-0.5 * passive[1])
        if at_orbit:
            d2 = r2 + softening * softening
            time = t_cool * math.sqrt(d2 * math.sqrt(d2) / star)
        out[i] = relaxed(u[i], settled, rate[i], time, dt) if time > 0.0 else settled


@inner
def power(number, rho, temperature):
    return POWERS[number, 0] * rho ** POWERS[number, 1] * temperature ** POWERS[number, 2]


@inner
def lesser(a, b):
    return a if a[0] <= b[0] else b


@inner
def greater(a, b):
    return a if a[0] >= b[0] else b


@inner
def of_number(number, rho, temperature):
    """One opacity of the table and its slopes in ln rho and ln T."""
    return power(number, rho, temperature), POWERS[number, 1], POWERS[number, 2]


@inner
def bell_lin(rho, temperature):
    """Opacity in cm2/g at a density in g/cm3 and a temperature in K, with its slopes in ln rho and ln T."""
    rho = max(rho, THINNEST)
    if temperature < METALS:
        return lesser(of_number(0, rho, temperature), of_number(1, rho, temperature))
    grains = lesser(of_number(2, rho, temperature), of_number(3, rho, temperature))
    cool = greater(of_number(4, rho, temperature), of_number(5, rho, temperature))
    hot = greater(of_number(6, rho, temperature), of_number(7, rho, temperature))
    return greater(grains, lesser(cool, hot))


@compiled
def opacities(begin, end, rho, temperature, out):
    """Bell & Lin's opacity (n,) in cm2/g."""
    for i in range(begin, end):
        out[i] = bell_lin(rho[i], temperature[i])[0]


@inner
def radiated(u, settled, column, omega, kappa, unit):
    """What (2) radiates and its derivative by u; `unit` as in `radiative`."""
    slope = 0.0
    if kappa <= 0.0:
        # rho = Sigma Omega / (sqrt(2 pi) c) with the isothermal speed, that of the scale height.
        rho = unit[1] * column * omega / math.sqrt(2.0 * math.pi * unit[2] * u)
        kappa, by_density, by_temperature = bell_lin(rho, unit[3] * u)
        kappa *= unit[4]
        slope = by_temperature - 0.5 * by_density
    tau = 0.5 * kappa * column
    depth = 0.375 * tau + 0.25 * math.sqrt(3.0) + 0.25 / tau
    steep = (0.375 * tau - 0.25 / tau) * slope / (depth * u)  # d ln depth / du
    u3, s2 = u * u * u, settled * settled
    given = unit[0] / (column * depth)
    net = given * (u3 * u - s2 * s2)
    return net, 4.0 * given * u3 - net * steep


@inner
def flow(u, rate, lowest, settled, column, omega, kappa, unit):
    """du/dt of (2) and its derivative, heat that is lost falling with u below `lowest`."""
    lost, steep = radiated(u, settled, column, omega, kappa, unit)
    if rate < 0.0 and u < lowest:
        return rate * u / lowest - lost, rate / lowest - steep
    return rate - lost, -steep


@inner
def gains(z):
    """phi_1 and phi_3 of z: (e^z - 1)/z and (e^z - 1 - z - z^2/2)/z^3."""
    if abs(z) < 0.05:
        third = 1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z * (1.0 / 720.0 + z / 5040.0)))
        return 1.0 + z * (0.5 + z * third), third
    first = math.expm1(z) / z
    return first, ((first - 1.0) / z - 0.5) / z


@inner
def shone(u, rate, dt, settled, column, omega, kappa, unit):
    """u of (2) after dt."""
    if u <= 0.0:
        return max(0.0, rate * dt)
    lowest, left, step = LEAST * u, dt, dt
    for _ in range(MOST):
        step = min(step, left)
        slope, steep = flow(u, rate, lowest, settled, column, omega, kappa, unit)
        if slope == 0.0:
            return u
        first, third = gains(max(-1e300, min(step * steep, 500.0)))
        near = u + step * first * slope
        error = np.inf
        if near > 0.0:
            rest = flow(near, rate, lowest, settled, column, omega, kappa, unit)[0] - slope - steep * (near - u)
            change = 2.0 * step * third * rest
            if near + change > 0.0:
                error = abs(change) / (TOLERANCE * min(u, near + change))
        if error <= 1.0:
            u = near + change
            left -= step
            if left <= 0.0:
                break
        step *= max(0.1, min(20.0, 0.8 * error ** (-1.0 / 3.0))) if error < np.inf else 0.1
    return u


@compiled
def radiative(begin, end, pos, u, density, rate, dt, kappa, passive, star, softening, unit, out):
    """(2) for energies (n,) at surface densities (n,); kappa: a constant opacity, 0 for Bell & Lin's.

    unit: (2 sigma (T/u)^4, density in g/cm3, (c/u)^2, T/u in K, cm2/g) in code units.
    """
    for i in range(begin, end):
        r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
        d2 = r2 + softening * softening
        settled = passive[0] * max(r2, passive[2]) ** (-0.5 * passive[1])
        omega = math.sqrt(star / (d2 * math.sqrt(d2)))
        out[i] = shone(u[i], rate[i], dt, settled, density[i], omega, kappa, unit)
