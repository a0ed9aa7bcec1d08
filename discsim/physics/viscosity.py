"""The kinematic viscosity that a scene asks for (`[alpha_viscosity]`), and the flow that it drives. Numpy only.

    nu    = alpha c_s H = alpha c_s^2 / Omega_K,  or a constant                    (1)  Shakura & Sunyaev 1973
    alpha = alpha (r / r_0)^index, or from inner_alpha to outer_alpha: their mean, and half their difference times
            tanh(ln(r / radius) / width), of them or of their logarithms           (2)
            in a dead zone dead_alpha: the share [tanh(ln(r / dead_inner) / dead_width)
            - tanh(ln(r / dead_outer) / dead_width)] / 2 of the way to it          (3)
    v_r   = -3 / (Sigma sqrt(r)) d(nu Sigma sqrt(r))/dr                            (4)  Lynden-Bell & Pringle 1974

c_s is the thermal speed sqrt(P / Sigma), as in every H of discsim, of gas that holds heat that of its present
temperature. Omega_K is that of circles about the central mass, softened as the star is.

What the gas has beside it: of the artificial viscosity's linear term on all pairs, half as much on approaching ones,
and of its quadratic one at the shear S = 3 Omega / 2 of a disc, from their sums over a kernel in even gas (nothing on
reconstructed velocities, which a smooth shear leaves without a jump),

    nu    = 3/16 alpha_sph <q> c_s h + beta <q^2> S h^2 / (6 pi)                   (5)

a quarter of it with Balsara's switch; and the noise of particles, .014 to .034 c_s h by the kernel, times
(36 / N)^1.1 with N neighbours, and in quiet gas times (1.03 - share) 10 / time (fitted to the figures of
`analysis/noise.py`, of one start each, so within a factor of two).
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
STEP = 1e-4  # of ln r, for the slope in (4): of fourth order
# In the step limit 1 / (STABLE W(0, h) nu). Velocities grow on a lattice in steps with 22 or less in its place, and in
# any disorder with 14. The largest Courant factor, .72 (`scene/rules.py`), makes it 25.
STABLE = 18.0
SWITCHED = 0.25  # what Balsara's switch leaves in shear
USUAL, CALMER = 36.0, 1.1  # neighbours of the kernels' `noise`, and how it falls with more of them
UNSHARED, MEMORY = 0.03, 10.0  # of quiet gas: what the rings' share leaves at least, at a `time` of so much


def alpha(scene: Scene, r: Array) -> Array:
    """alpha at the radii `r` (n,) > 0, of a table that gives no `nu`."""
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
    """Where a power of r has the value of `alpha`: the start's reference radius; 1 for the caller's own particles."""
    return getattr(scene.initial, "reference_radius", 1.0)


def diffusivity(scene: Scene, r: Array, thermal_speed: Array | None = None, central_mass: float | None = None) -> Array:
    """nu (n,) at the radii `r` (n,) in code units, eq. (1).

    thermal_speed: c_s (n,) of the gas there; without it, that of the temperature that the scene starts with, which a
    polytrope of particles does not have. central_mass: by default that of the start.
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
    """Radial velocity (n,) at the radii `r` (n,) of a disc that its viscosity moves, eq. (4), where Sigma is not 0.

    surface_density, thermal_speed: functions of radii (n,), of the smooth disc. The slope is of fourth order: off by
    about (STEP r / l)^4 where these vary over l.
    """

    def torque(radius: Array) -> Array:
        sigma = surface_density(radius)
        speed = profile.thermal_speed(scene, radius, sigma) if thermal_speed is None else thermal_speed(radius)
        return diffusivity(scene, radius, speed) * sigma * np.sqrt(radius)

    near, far = (torque(r * np.exp(step)) - torque(r * np.exp(-step)) for step in (STEP, 2.0 * STEP))
    rise = (8.0 * near - far) / 6.0  # over 2 STEP
    return -1.5 * rise / (STEP * r**1.5 * surface_density(r))  # eq. (4)


def longest_step(scene: Scene, nu: Array, h: Array) -> Array:
    """The longest step (n,) of gas with a viscosity nu (n,) and smoothing lengths h (n,): 1 / (18 W(0, h) nu)."""
    central = SMOOTHING[scene.gas.kernel].least_eta[1] ** 2  # W(0, h) h^2
    with np.errstate(divide="ignore"):
        return h * h / (STABLE * central * nu)


def at_places(scene: Scene, radius: Array | None, thermal_speed: Array | None, h: Array) -> Array | None:
    """nu (n,) where `radius` and c_s are so; None where the scene asks for none, or does not define it there."""
    keys: Any = scene.table("alpha_viscosity")
    if keys is None or (keys.nu is None and (radius is None or thermal_speed is None)):
        return None
    return diffusivity(scene, np.ones_like(h) if radius is None else radius, thermal_speed)


def artificial(scene: Scene, at: Local) -> Array:
    """nu (n,) of the artificial viscosity at the places of `at`, eq. (5); beta's part only where there is an Omega."""
    given, kernel = scene.gas.viscosity, SMOOTHING[scene.gas.kernel]
    if given is None or not given.acts_in_shear or at.h is None or at.sound_speed is None:
        return np.zeros_like(at.density)
    found = 3.0 / 16.0 * given.alpha * kernel.mean_q[0] * at.sound_speed * at.h * (1.0 if given.pairs == "all" else 0.5)
    if at.omega is not None:
        found = found + given.beta * kernel.mean_q[1] * 1.5 * at.omega * at.h**2 / (6.0 * np.pi)
    return SWITCHED * found if given.switch == "balsara" else found


def noise(scene: Scene, at: Local) -> Array:
    """nu (n,) of the particles' noise in a disc at the places of `at`, about."""
    if at.resolution is None or at.thermal_speed is None:
        return np.zeros_like(at.density)
    kernel = SMOOTHING[scene.gas.kernel]
    found = kernel.noise * (USUAL / kernel.neighbours(scene.gas.eta)) ** CALMER * at.thermal_speed * at.resolution
    quiet = scene.gas.quiet
    return found if quiet is None else found * min(1.0, (1.0 + UNSHARED - quiet.share) * MEMORY / quiet.time)
