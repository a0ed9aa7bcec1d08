"""The kinematic viscosity of a scene (`[alpha_viscosity]`), and the radial flow that it drives. Numpy only.

    nu    = alpha c_s H = alpha c_s^2 / Omega_K,  or a constant                    (1)  Shakura & Sunyaev 1973
    alpha = alpha (r / r_0)^index, or a step from inner_alpha to outer_alpha: the mean plus half the difference
            times tanh(ln(r / radius) / width), of them or of their logarithms     (2)
            in a dead zone, the share [tanh(ln(r / dead_inner) / dead_width)
            - tanh(ln(r / dead_outer) / dead_width)] / 2 of the way to dead_alpha  (3)
    v_r   = -3 / (Sigma sqrt(r)) d(nu Sigma sqrt(r))/dr                            (4)  Lynden-Bell & Pringle 1974

c_s is the thermal speed sqrt(P / Sigma), as in every H of discsim; gas that integrates u has that of its present
temperature. Omega_K is that of circles about the central mass, with the softening of the star.

The gas has two numerical viscosities in addition. The artificial viscosity acts in shear as

    nu    = 3/16 alpha_sph <q> c_s h + beta <q^2> S h^2 / (6 pi)                   (5)

from the sums over a kernel in even gas, with the shear S = 3 Omega / 2 of a disc. The linear term is that on all
pairs, and half as large on approaching ones only. Balsara's switch reduces (5) to a quarter. Reconstructed velocities
have no jump in smooth shear, and (5) is 0. Particle noise has 0.014 to 0.034 c_s h, depending on the kernel, times
(36 / N)^1.1 with N neighbours, and in quiet gas times (1.03 - share) 10 / time. These numbers are fits to the results
of `analysis/noise.py`, of one start each, and good within a factor of two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas.smoothing import SMOOTHING
from discsim.physics import profile
from discsim.physics.centre import kepler_omega

if TYPE_CHECKING:
    from discsim.physics.local import Local
    from discsim.scene import Scene

Array = np.ndarray
STEP = 1e-4  # step in ln r of the fourth-order finite differences in (4)
# Constant of the step limit 1 / (STABLE W(0, h) nu). Steps with at most 22 in its place are unstable on a lattice, and
# with 14 in any disorder. The largest Courant factor, 0.72 (`scene/rules.py`), makes it 25.
STABLE = 18.0
SWITCHED = 0.25  # factor of Balsara's switch in shear
USUAL, CALMER = 36.0, 1.1  # number of neighbours of the kernels' `noise`, and its power law with that number
UNSHARED, MEMORY = 0.03, 10.0  # quiet gas: fraction of noise at `share` 1, and the `time` of these figures


def alpha(scene: Scene, r: Array) -> Array:
    """Return alpha (n,) at the radii `r` (n,) > 0 for a table without `nu`, eqs. (2) and (3)."""
    keys: Any = scene.table("alpha_viscosity")
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
    """Return r_0 of (2): the start's reference radius, or 1 if it has none or the caller passed particles."""
    return getattr(scene.initial, "reference_radius", 1.0)


def diffusivity(scene: Scene, r: Array, thermal_speed: Array | None = None, central_mass: float | None = None) -> Array:
    """Return nu (n,) at the radii `r` (n,) in code units, eq. (1).

    thermal_speed: c_s (n,) of the gas there, by default that of the scene's temperature at the start; a polytrope of
    particles has no such default. central_mass: by default that of the start.
    """
    keys: Any = scene.table("alpha_viscosity")
    if keys.nu is not None:
        return np.full(np.shape(r), keys.nu)
    r = np.maximum(r, 1e-300)
    if thermal_speed is None:
        thermal_speed = profile.thermal_speed(scene, r)
    return alpha(scene, r) * thermal_speed**2 / kepler_omega(scene, r, central_mass)


def radial_flow(
    scene: Scene,
    r: Array,
    surface_density: Callable[[Array], Array],
    thermal_speed: Callable[[Array], Array] | None = None,
) -> Array:
    """Return the radial velocity (n,) at the radii `r` (n,) of a viscous disc, eq. (4), where Sigma is not 0.

    surface_density, thermal_speed: functions of radii (n,) of the smooth disc. The slope is of fourth order: its
    relative error is about (STEP r / l)^4 where these functions vary over l.
    """

    def torque(radius: Array) -> Array:
        sigma = surface_density(radius)
        speed = profile.thermal_speed(scene, radius, sigma) if thermal_speed is None else thermal_speed(radius)
        return diffusivity(scene, radius, speed) * sigma * np.sqrt(radius)

    near, far = (torque(r * np.exp(step)) - torque(r * np.exp(-step)) for step in (STEP, 2.0 * STEP))
    rise = (8.0 * near - far) / 6.0  # over 2 STEP
    return -1.5 * rise / (STEP * r**1.5 * surface_density(r))  # eq. (4)


def longest_step(scene: Scene, nu: Array, h: Array) -> Array:
    """Return the step limit (n,) of gas with viscosity nu (n,) and smoothing length h (n,): 1 / (18 W(0, h) nu)."""
    central = SMOOTHING[scene.gas.kernel].least_eta[1] ** 2  # W(0, h) h^2
    with np.errstate(divide="ignore"):
        return h * h / (STABLE * central * nu)


def at_places(scene: Scene, radius: Array | None, thermal_speed: Array | None, h: Array) -> Array | None:
    """Return nu (n,) at given `radius` and c_s (n,); None if the scene has no viscosity or does not define it."""
    keys: Any = scene.table("alpha_viscosity")
    if keys is None or (keys.nu is None and (radius is None or thermal_speed is None)):
        return None
    return diffusivity(scene, np.ones_like(h) if radius is None else radius, thermal_speed)


def artificial(scene: Scene, at: Local) -> Array:
    """Return nu (n,) of the artificial viscosity at the places of `at`, eq. (5); without Omega, only alpha's term."""
    given, kernel = scene.gas.viscosity, SMOOTHING[scene.gas.kernel]
    if given is None or not given.acts_in_shear or at.h is None or at.sound_speed is None:
        return np.zeros_like(at.density)
    found = 3.0 / 16.0 * given.alpha * kernel.mean_q[0] * at.sound_speed * at.h * (1.0 if given.pairs == "all" else 0.5)
    if at.omega is not None:
        found = found + given.beta * kernel.mean_q[1] * 1.5 * at.omega * at.h**2 / (6.0 * np.pi)
    return SWITCHED * found if given.switch == "balsara" else found


def noise(scene: Scene, at: Local) -> Array:
    """Return an estimate of nu (n,) of particle noise in a disc at the places of `at`."""
    if at.resolution is None or at.thermal_speed is None:
        return np.zeros_like(at.density)
    kernel = SMOOTHING[scene.gas.kernel]
    found = kernel.noise * (USUAL / kernel.neighbours(scene.gas.eta)) ** CALMER * at.thermal_speed * at.resolution
    quiet = scene.gas.quiet
    return found if quiet is None else found * min(1.0, (1.0 + UNSHARED - quiet.share) * MEMORY / quiet.time)
