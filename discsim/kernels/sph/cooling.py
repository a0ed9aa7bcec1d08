"""Cooling of gas over a kick at a constant heating rate: relaxation to a given energy, or radiative cooling.

    towards         du/dt = rate - (u - u_eq) / t_cool                                                          (1)
    radiative       du/dt = rate - 2 sigma (T^4 - T_irr^4) / (tau_eff Sigma),  tau = kappa Sigma / 2            (2)
                    tau_eff = 3 tau / 8 + sqrt(3) / 4 + 1 / (4 tau)      (Hubeny 1990)

(1) is solved exactly. (2) is one equation per particle, integrated by an exponential Rosenbrock method of third order
(exprb32 of Hochbruck, Ostermann & Schweitzer 2009). Adaptive sub-steps keep the error of each within TOLERANCE of u.
The method is L-stable: a kick of any length ends where heating and cooling balance. Both solutions compose from kick
to kick.

u stays at or above 0 where gas expands (rate < 0). In (2) the loss by expansion is constant down to LEAST of the energy
at the start of the kick, and proportional to u below. The result of (1) is at least LEAST times the solution with a
loss proportional to u.
"""

import math

import numpy as np

from discsim.formulas.opacity import BELL_LIN, METALS, THINNEST
from discsim.jit.decorators import inline_jit, jit

LEAST = 0.1
TOLERANCE = 1e-6
MOST = 100_000  # sub-steps of a kick: a few if cooling is resolved, 100 from 1000 times the equilibrium energy
POWERS = np.array(BELL_LIN)


@inline_jit
def relaxed(u, settled, rate, t_cool, dt):
    """Return u of (1) after dt; `settled` is u_eq."""
    x = dt / t_cool
    gone = -math.expm1(-x)
    after = u * math.exp(-x) + (settled + rate * t_cool) * gone
    if rate >= 0.0:
        return after
    if u <= 0.0:
        return max(after, 0.0)
    quick = 1.0 / t_cool - rate / u  # rate of a loss in proportion to u
    lost = -math.expm1(-quick * dt)
    return max(after, LEAST * (u * (1.0 - lost) + settled / (t_cool * quick) * lost))


@jit
def towards(begin, end, pos, u, rate, dt, at_orbit, t_cool, passive, star, softening, out):
    """Write u of (1) after dt for energies (n,). `t_cool` is in units of 1/Omega about the central mass if `at_orbit`.

    u_eq = passive[0] r^-passive[1], with r^2 at least passive[2].
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


@inline_jit
def power(number, rho, temperature):
    return POWERS[number, 0] * rho ** POWERS[number, 1] * temperature ** POWERS[number, 2]


@inline_jit
def lesser(a, b):
    return a if a[0] <= b[0] else b


@inline_jit
def greater(a, b):
    return a if a[0] >= b[0] else b


@inline_jit
def of_number(number, rho, temperature):
    """Return one opacity of the table and its slopes in ln rho and ln T."""
    return power(number, rho, temperature), POWERS[number, 1], POWERS[number, 2]


@inline_jit
def bell_lin(rho, temperature):
    """Return the opacity in cm2/g at a density in g/cm3 and a temperature in K, and its slopes in ln rho and ln T."""
    rho = max(rho, THINNEST)
    if temperature < METALS:
        return lesser(of_number(0, rho, temperature), of_number(1, rho, temperature))
    grains = lesser(of_number(2, rho, temperature), of_number(3, rho, temperature))
    cool = greater(of_number(4, rho, temperature), of_number(5, rho, temperature))
    hot = greater(of_number(6, rho, temperature), of_number(7, rho, temperature))
    return greater(grains, lesser(cool, hot))


@jit
def opacities(begin, end, rho, temperature, out):
    """Write Bell & Lin's opacity (n,) in cm2/g."""
    for i in range(begin, end):
        out[i] = bell_lin(rho[i], temperature[i])[0]


@inline_jit
def radiated(u, settled, column, omega, kappa, unit):
    """Return the net radiative loss of (2) and its derivative by u; `unit` as in `radiative`."""
    slope = 0.0
    if kappa <= 0.0:
        # rho = Sigma Omega / (sqrt(2 pi) c) with the isothermal sound speed, which sets the scale height.
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


@inline_jit
def flow(u, rate, lowest, settled, column, omega, kappa, unit):
    """Return du/dt of (2) and its derivative by u; below `lowest` the loss by expansion is proportional to u."""
    lost, steep = radiated(u, settled, column, omega, kappa, unit)
    if rate < 0.0 and u < lowest:
        return rate * u / lowest - lost, rate / lowest - steep
    return rate - lost, -steep


@inline_jit
def phi_functions(z):
    """Return phi_1 and phi_3 of z: (e^z - 1)/z and (e^z - 1 - z - z^2/2)/z^3."""
    if abs(z) < 0.05:
        third = 1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z * (1.0 / 720.0 + z / 5040.0)))
        return 1.0 + z * (0.5 + z * third), third
    first = math.expm1(z) / z
    return first, ((first - 1.0) / z - 0.5) / z


@inline_jit
def radiate(u, rate, dt, settled, column, omega, kappa, unit):
    """Return u of (2) after dt."""
    if u <= 0.0:
        return max(0.0, rate * dt)
    lowest, left, step = LEAST * u, dt, dt
    for _ in range(MOST):
        step = min(step, left)
        slope, steep = flow(u, rate, lowest, settled, column, omega, kappa, unit)
        if slope == 0.0:
            return u
        first, third = phi_functions(max(-1e300, min(step * steep, 500.0)))
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


@jit
def radiative(begin, end, pos, u, density, rate, dt, kappa, passive, star, softening, unit, out):
    """Write u of (2) after dt for energies (n,) at surface densities (n,).

    kappa: a constant opacity, or 0 for Bell & Lin's. passive: as in `towards`, for the energy at T_irr.
    unit: (2 sigma (T/u)^4, density in g/cm3, (c/u)^2, T/u in K, cm2/g) in code units.
    """
    for i in range(begin, end):
        r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
        d2 = r2 + softening * softening
        settled = passive[0] * max(r2, passive[2]) ** (-0.5 * passive[1])
        omega = math.sqrt(star / (d2 * math.sqrt(d2)))
        out[i] = radiate(u[i], rate[i], dt, settled, density[i], omega, kappa, unit)
