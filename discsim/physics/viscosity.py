"""The kinematic viscosity of a scene (`[alpha_viscosity]`), and the radial flow that it drives. Numpy only.

    nu    = alpha c_s H = alpha c_s^2 / Omega_K,  or a constant                    (1)  Shakura & Sunyaev 1973
    alpha = alpha (r / r_0)^index, or a step from inner_alpha to outer_alpha: the mean of both (or of their logarithms)
            plus half their difference times tanh(ln(r / radius) / width)          (2)
            in a dead zone alpha is changed towards dead_alpha, by the fraction
            [tanh(ln(r / dead_inner) / dead_width) - tanh(ln(r / dead_outer) / dead_width)] / 2
            of the difference                                                      (3)
    v_r   = -3 / (Sigma sqrt(r)) d(nu Sigma sqrt(r))/dr                            (4)  Lynden-Bell & Pringle 1974

c_s is the thermal speed sqrt(P / Sigma), as in every H of discsim; for gas with an energy equation it follows from the
present temperature. Omega_K is the frequency of circular orbits about the central mass, with the softening of the star.

The gas has two numerical viscosities in addition. The artificial viscosity acts in shear as

    nu    = 3/16 alpha_sph <q> c_s h + beta <q^2> S h^2 / (6 pi)                   (5)

with the kernel-weighted means <q> and <q^2> of q = r / h in uniform gas, and the shear S = 3 Omega / 2 of a disc. The
linear term holds for viscosity between all pairs; it is half as large if only approaching pairs have viscosity.
Balsara's switch reduces (5) to a quarter. Reconstructed velocities have no jump in smooth shear, so that (5) is 0.
Particle noise has a viscosity of 0.014 to 0.034 c_s h, depending on the kernel, times (36 / N)^1.1 for N neighbours; in
quiet gas it is multiplied by (1.03 - share) 10 / time, with these keys of gas.quiet. The numbers are fits to results of
`analysis/noise.py`, each from one start, and accurate to a factor of two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from discsim.formulas.smoothing import SMOOTHING
from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.centre import kepler_omega

if TYPE_CHECKING:
    from discsim.physics.local import GasSamples
    from discsim.scene import Scene

polar = Lazy("discsim.physics.polar")
Array = np.ndarray
STEP = 1e-4  # step in ln r of the fourth-order finite differences in (4)
# Constant of the step limit 1 / (STEP_CONSTANT W(0, h) nu). Constants up to 22 are unstable on a lattice, and
# disordered ones up to 14. The largest Courant factor, 0.72 (`scene/rules.py`), raises the constant to 25.
STEP_CONSTANT = 18.0
BALSARA_FACTOR = 0.25  # factor of Balsara's switch in shear
# Number of neighbours to which `KernelConstants.noise` refers, and exponent of its decrease with this number.
NOISE_NEIGHBOURS, NOISE_POWER = 36.0, 1.1
QUIET_NOISE, QUIET_TIME = 0.03, 10.0  # quiet gas: fraction of noise left at share = 1, for time = QUIET_TIME


def alpha(scene: Scene, r: Array) -> Array:
    """Return alpha (n,) of [alpha_viscosity] at radii `r` (n,) > 0, eqs. (2) and (3); not for a table with `nu`."""
    keys = scene.table("alpha_viscosity")
    log = np.log(r)
    if keys.alpha is not None:
        found = np.full_like(log, keys.alpha)
        if keys.index != 0.0:
            found *= np.exp(keys.index * (log - np.log(reference_radius(scene))))  # eq. (2)
    else:
        share = 0.5 * (1.0 + np.tanh((log - np.log(keys.radius)) / keys.width))  # eq. (2)
        if keys.step == "linear":
            found = keys.inner_alpha + (keys.outer_alpha - keys.inner_alpha) * share
        else:
            found = keys.inner_alpha * (keys.outer_alpha / keys.inner_alpha) ** share
    if keys.dead_alpha is not None:
        inner, outer = ((log - np.log(edge)) / keys.dead_width for edge in (keys.dead_inner, keys.dead_outer))
        found += 0.5 * (np.tanh(inner) - np.tanh(outer)) * (keys.dead_alpha - found)  # eq. (3)
    return found


def reference_radius(scene: Scene) -> float:
    """Return r_0 of eq. (2), the reference radius of the start. Starts without one and given particles have r_0 = 1."""
    return getattr(scene.initial, "reference_radius", 1.0)


def diffusivity(scene: Scene, r: Array, thermal_speed: Array | None = None, central_mass: float | None = None) -> Array:
    """Return nu (n,) at radii `r` (n,) in code units, eq. (1).

    thermal_speed (n,): c_s of the gas, by default from the scene's initial temperature; polytropic SPH gas has no
    default. central_mass: central mass, by default the initial one.
    """
    keys = scene.table("alpha_viscosity")
    if keys.nu is not None:
        return np.full(np.shape(r), keys.nu)
    r = np.maximum(r, 1e-300)
    if thermal_speed is None:
        thermal_speed = profile.initial_thermal_speed(scene, r)
    return alpha(scene, r) * thermal_speed**2 / kepler_omega(scene, r, central_mass)


def radial_flow(
    scene: Scene,
    r: Array,
    surface_density: Callable[[Array], Array],
    thermal_speed: Callable[[Array], Array] | None = None,
) -> Array:
    """Return the radial velocity (n,) of a viscous disc at radii `r` (n,), eq. (4); Sigma must not be 0.

    surface_density, thermal_speed: functions that return these quantities (n,) at radii (n,). Both functions must be
    smooth: the relative error of the derivative is about (STEP r / l)^4 for functions that vary over a length l.
    """

    def torque(radius: Array) -> Array:
        sigma = surface_density(radius)
        speed = profile.initial_thermal_speed(scene, radius, sigma) if thermal_speed is None else thermal_speed(radius)
        return diffusivity(scene, radius, speed) * sigma * np.sqrt(radius)

    near, far = (torque(r * np.exp(step)) - torque(r * np.exp(-step)) for step in (STEP, 2.0 * STEP))
    rise = (8.0 * near - far) / 6.0  # over 2 STEP
    return -1.5 * rise / (STEP * r**1.5 * surface_density(r))  # eq. (4)


def longest_step(scene: Scene, nu: Array, h: Array) -> Array:
    """Return the step limit (n,) of gas with viscosity nu (n,) and smoothing length h (n,).

    It is 1 / (18 W(0, h) nu) for SPH gas, and a fourth of (shorter side)^2 / nu in polar cells.
    """
    if scene.model.polar:
        found: Array = polar.longest_viscous_step(scene, nu, h)
        return found
    central = SMOOTHING[scene.gas.kernel].least_eta[1] ** 2  # W(0, h) h^2
    with np.errstate(divide="ignore"):
        return h * h / (STEP_CONSTANT * central * nu)


def diffusivity_at(scene: Scene, radius: Array | None, thermal_speed: Array | None, like: Array) -> Array | None:
    """Return nu (n,) at points with `radius` (n,) and `thermal_speed` (n,).

    like (n,): any array with a value for each point, for the length of the result. Returns None if the scene has no
    viscosity, or nu needs a radius or thermal speed that is None.
    """
    keys = scene.table("alpha_viscosity")
    if keys is None or (keys.nu is None and (radius is None or thermal_speed is None)):
        return None
    return diffusivity(scene, np.ones_like(like) if radius is None else radius, thermal_speed)


def artificial_nu(scene: Scene, at: GasSamples) -> Array:
    """Return nu (n,) of the artificial viscosity at the points of `at`, eq. (5).

    Gas without orbital frequencies has only the first term.
    """
    keys, kernel = scene.gas.viscosity, SMOOTHING[scene.gas.kernel]
    if keys is None or not keys.acts_in_shear or at.h is None or at.sound_speed is None:
        return np.zeros_like(at.density)
    found = 3.0 / 16.0 * keys.alpha * kernel.mean_q[0] * at.sound_speed * at.h * (1.0 if keys.pairs == "all" else 0.5)
    if at.omega is not None:
        found = found + keys.beta * kernel.mean_q[1] * 1.5 * at.omega * at.h**2 / (6.0 * np.pi)
    return BALSARA_FACTOR * found if keys.switch == "balsara" else found


def noise_nu(scene: Scene, at: GasSamples) -> Array:
    """Estimate nu (n,) of particle noise in a disc at the points of `at`."""
    if at.resolution is None or at.thermal_speed is None:
        return np.zeros_like(at.density)
    kernel = SMOOTHING[scene.gas.kernel]
    strength = kernel.noise * (NOISE_NEIGHBOURS / kernel.neighbours(scene.gas.eta)) ** NOISE_POWER
    found = strength * at.thermal_speed * at.resolution
    quiet = scene.gas.quiet
    return found if quiet is None else found * min(1.0, (1.0 + QUIET_NOISE - quiet.share) * QUIET_TIME / quiet.time)
