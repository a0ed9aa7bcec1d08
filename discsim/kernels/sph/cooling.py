"""Cooling of gas over a kick at a constant heating rate: relaxation to a given energy (1), or radiative cooling (2).

    du/dt = rate - (u - u_eq) / t_cool                                                                          (1)
    du/dt = rate - 2 sigma (T^4 - T_irr^4) / (tau_eff Sigma),  tau = kappa Sigma / 2                            (2)
            tau_eff = 3 tau / 8 + sqrt(3) / 4 + 1 / (4 tau)      (Hubeny 1990)

(1) is solved exactly. (2) is one equation per particle, integrated by an exponential Rosenbrock method of third order
(exprb32 of Hochbruck, Ostermann & Schweitzer 2009). Adaptive sub-steps keep the error of each within TOLERANCE of u.
The method is L-stable: a kick of any length ends where heating and cooling balance. Two successive kicks have the same
result as one kick of their total length.

u stays at or above 0 where gas expands (rate < 0). In (2) the loss by expansion is constant down to LEAST times the
energy at the start of the kick, and proportional to u below. The result of (1) is at least LEAST times the solution
with a loss proportional to u.
"""

import math

import numpy as np

from discsim.formulas.opacity import BELL_LIN, METALS, THINNEST
from discsim.jit.decorators import inline_jit, jit

LEAST = 0.1
TOLERANCE = 1e-6
MOST = 100_000  # largest number of sub-steps; a few suffice if cooling is resolved, 100 if u begins at 1000 u_eq
POWERS = np.array(BELL_LIN)


@inline_jit
def relaxed_energy(u, equilibrium, rate, t_cool, dt):
    """Return u of (1) after dt; `equilibrium` is u_eq."""
    x = dt / t_cool
    gone = -math.expm1(-x)
    after = u * math.exp(-x) + (equilibrium + rate * t_cool) * gone
    if rate >= 0.0:
        return after
    if u <= 0.0:
        return max(after, 0.0)
    quick = 1.0 / t_cool - rate / u  # for a loss by expansion in proportion to u
    lost = -math.expm1(-quick * dt)
    return max(after, LEAST * (u * (1.0 - lost) + equilibrium / (t_cool * quick) * lost))


@jit
def relax_to_energy(begin, end, pos, u, rate, dt, at_orbit, t_cool, passive, star, softening, out):
    """Write to `out` (n,) the solution u of (1) after dt, from the energies `u` (n,).

    t_cool is in units of 1/Omega about the central mass if `at_orbit`, else a time. u_eq is passive[0] r^-passive[1],
    with r^2 set to passive[2] where it is smaller. star: G M. out may be u.
    """
    flat = passive[1] == 0.0
    for i in range(begin, end):
        r2 = 0.0
        for k in range(pos.shape[1]):
            r2 += pos[i, k] * pos[i, k]
        equilibrium, time = passive[0], t_cool
        if not flat:
            equilibrium *= max(r2, passive[2]) ** (-0.5 * passive[1])
        if at_orbit:
            d2 = r2 + softening * softening
            time = t_cool * math.sqrt(d2 * math.sqrt(d2) / star)
        out[i] = relaxed_energy(u[i], equilibrium, rate[i], time, dt) if time > 0.0 else equilibrium


@inline_jit
def lesser(a, b):
    """Return the one of two results of `table_opacity` with the smaller opacity."""
    return a if a[0] <= b[0] else b


@inline_jit
def greater(a, b):
    """Return the one of two results of `table_opacity` with the larger opacity."""
    return a if a[0] >= b[0] else b


@inline_jit
def table_opacity(number, rho, temperature):
    """Return the opacity of row `number` of POWERS, and its logarithmic slopes with rho and T."""
    by_density, by_temperature = POWERS[number, 1], POWERS[number, 2]
    return POWERS[number, 0] * rho**by_density * temperature**by_temperature, by_density, by_temperature


@inline_jit
def bell_lin(rho, temperature):
    """Return the opacity of Bell & Lin (1994) in cm2/g, and its logarithmic slopes with rho (g/cm3) and T (K)."""
    rho = max(rho, THINNEST)
    if temperature < METALS:
        return lesser(table_opacity(0, rho, temperature), table_opacity(1, rho, temperature))
    grains = lesser(table_opacity(2, rho, temperature), table_opacity(3, rho, temperature))
    cool = greater(table_opacity(4, rho, temperature), table_opacity(5, rho, temperature))
    hot = greater(table_opacity(6, rho, temperature), table_opacity(7, rho, temperature))
    return greater(grains, lesser(cool, hot))


@jit
def write_opacities(begin, end, rho, temperature, out):
    """Write to `out` (n,) the opacity of Bell & Lin (1994) in cm2/g, for `rho` (n,) in g/cm3 and temperatures in K."""
    for i in range(begin, end):
        out[i] = bell_lin(rho[i], temperature[i])[0]


@inline_jit
def radiative_loss(u, equilibrium, column, omega, kappa, unit):
    """Return the net radiative loss in (2), -du/dt, and its derivative with respect to u.

    equilibrium: u at T_irr. column: Sigma. kappa, unit: as in `cool_radiatively`.
    """
    slope = 0.0
    if kappa <= 0.0:
        # rho = Sigma Omega / (sqrt(2 pi) c) with the isothermal sound speed c, which gives the scale height.
        rho = unit[1] * column * omega / math.sqrt(2.0 * math.pi * unit[2] * u)
        kappa, by_density, by_temperature = bell_lin(rho, unit[3] * u)
        kappa *= unit[4]
        slope = by_temperature - 0.5 * by_density
    tau = 0.5 * kappa * column
    depth = 0.375 * tau + 0.25 * math.sqrt(3.0) + 0.25 / tau
    steep = (0.375 * tau - 0.25 / tau) * slope / (depth * u)  # d ln depth / du
    u3, s2 = u * u * u, equilibrium * equilibrium
    factor = unit[0] / (column * depth)
    net = factor * (u3 * u - s2 * s2)
    return net, 4.0 * factor * u3 - net * steep


@inline_jit
def energy_rate(u, rate, lowest, equilibrium, column, omega, kappa, unit):
    """Return du/dt of (2) and its derivative with respect to u.

    rate: heating. A negative rate, by expansion, is multiplied by u / lowest where u is below `lowest`. Other
    arguments: as in `radiative_loss`.
    """
    lost, steep = radiative_loss(u, equilibrium, column, omega, kappa, unit)
    if rate < 0.0 and u < lowest:
        return rate * u / lowest - lost, rate / lowest - steep
    return rate - lost, -steep


@inline_jit
def phi_functions(z):
    """Return phi_1(z) = (e^z - 1)/z and phi_3(z) = (e^z - 1 - z - z^2/2)/z^3."""
    if abs(z) < 0.05:
        third = 1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z * (1.0 / 720.0 + z / 5040.0)))
        return 1.0 + z * (0.5 + z * third), third
    first = math.expm1(z) / z
    return first, ((first - 1.0) / z - 0.5) / z


@inline_jit
def cooled_energy(u, rate, dt, equilibrium, column, omega, kappa, unit):
    """Return the solution u of (2) after dt; arguments as in `energy_rate`."""
    if u <= 0.0:
        return max(0.0, rate * dt)
    lowest, left, step = LEAST * u, dt, dt
    for _ in range(MOST):
        step = min(step, left)
        slope, steep = energy_rate(u, rate, lowest, equilibrium, column, omega, kappa, unit)
        if slope == 0.0:
            return u
        first, third = phi_functions(max(-1e300, min(step * steep, 500.0)))
        near = u + step * first * slope
        error = np.inf
        if near > 0.0:
            end = energy_rate(near, rate, lowest, equilibrium, column, omega, kappa, unit)[0]
            rest = end - slope - steep * (near - u)
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
def cool_radiatively(begin, end, pos, u, density, rate, dt, kappa, passive, star, softening, unit, out):
    """Write to `out` (n,) the solution u of (2) after dt, from the energies `u` (n,).

    density, rate (n,): surface densities and heating rates. kappa: a constant opacity, or 0 for the opacity of Bell &
    Lin. passive: the energy at T_irr, in the form of u_eq in `relax_to_energy`. star: G M.

    unit: (2 sigma (T/u)^4 in code units; the code unit of density in g/cm3; c^2 / u, with the isothermal sound speed c;
    T/u in K per code unit of u; 1 cm2/g in code units).
    """
    for i in range(begin, end):
        r2 = pos[i, 0] * pos[i, 0] + pos[i, 1] * pos[i, 1]
        d2 = r2 + softening * softening
        equilibrium = passive[0] * max(r2, passive[2]) ** (-0.5 * passive[1])
        omega = math.sqrt(star / (d2 * math.sqrt(d2)))
        out[i] = cooled_energy(u[i], rate[i], dt, equilibrium, density[i], omega, kappa, unit)
