"""The disc that a scene asks for, as functions of radius: Sigma, c_s and the pressure's pull. Numpy only.

Sigma = Sigma_ref (r / r_ref)^-p T(r) between the edges, T rising as sin^2 over the inner taper and falling as
cos^2 over the outer one; Sigma_ref from the mass, from the least Toomre Q = c_s Omega_K / (pi G Sigma), c_s the speed
of sound waves (of adiabatic gas the adiabatic one), or given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import STARTS
from discsim.physics.companions import central_mass
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SAMPLES = 20_001
SLOPE = 1e-4  # of r, over which the slope of a Sigma of no known power is taken


@dataclass(frozen=True)
class Radial:
    """A disc as functions of radii (n,), in code units: of it starts make particles, and balance its velocities.

    surface_density: of the gas. pressure_acceleration: -(1/Sigma) dP/dr. mass_within: of the gas between the first of
    rising radii and each. dust_share: what multiplies the ratio of each population (None: 1). inflow: radial velocity
    that its viscosity gives it (None: what follows from Sigma). resolution: gas particles per mass, up to a factor
    (None: 1).
    """

    inner: float
    outer: float
    surface_density: Callable[[Array], Array]
    pressure_acceleration: Callable[[Array], Array]
    mass_within: Callable[[Array], Array]
    dust_share: Callable[[Array], Array] | None = None
    inflow: Callable[[Array], Array] | None = None
    resolution: Callable[[Array], Array] | None = None


def radial(scene: Scene) -> Radial:
    """The disc that the scene starts with."""
    found: Radial = STARTS[scene.initial.kind].radial(scene)
    return found


def of_density(
    scene: Scene,
    inner: float,
    outer: float,
    surface_density: Callable[[Array], Array],
    inflow: Callable[[Array], Array] | None = None,
) -> Radial:
    """The disc of any Sigma(r), with the temperature of gas.eos; where Sigma falls within less than H, as if it fell
    over H.
    """

    def pressure_acceleration(r: Array) -> Array:
        sigma = surface_density(r)
        speed2 = sound_speed(scene, r, sigma) ** 2
        steepest = kepler_omega(scene, r) * r / np.sqrt(speed2)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = surface_density(r * (1.0 + SLOPE)) - surface_density(r * (1.0 - SLOPE))
            slope = np.clip(np.nan_to_num(-0.5 * rise / (SLOPE * sigma), nan=0.0), -steepest, steepest)
        return (slope + eos_of(scene).temperature_slope(scene.gas.eos)) * speed2 / r

    def mass_within(r: Array) -> Array:
        return integral(r, surface_density(r))

    return Radial(inner, outer, surface_density, pressure_acceleration, mass_within, inflow=inflow)


def shape(start: Any, r: Array) -> Array:
    """Sigma / Sigma_ref at radius `r`, zero beyond the edges."""
    return tapered(start, r, (r / start.reference_radius) ** -start.surface_density_index)


def tapered(start: Any, r: Array, out: Array) -> Array:
    """What edges and tapers leave of a surface density `out` (n,) at radius `r`."""
    out = out * ((r >= start.inner) & (r <= start.outer))
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            out = out * np.sin(0.5 * np.pi * np.clip(sign * (r - edge) / width, 0.0, 1.0)) ** 2
    return out


def radii(start: Any) -> Array:
    return np.linspace(start.inner, start.outer, SAMPLES)


def cumulative(start: Any, r: Array) -> Array:
    """Integral of 2 pi r Sigma / Sigma_ref up to each of the rising radii `r`, from the first of them."""
    return integral(r, shape(start, r))


def integral(r: Array, density: Array) -> Array:
    """Integral of 2 pi r density up to each of the rising radii `r`, from the first of them."""
    f = 2.0 * np.pi * r * density
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(r))])


def scale(scene: Scene) -> float:
    """Sigma_ref in code units."""
    start: Any = scene.initial
    if start.surface_density is not None:
        return start.surface_density
    r = radii(start)
    if start.mass is not None:
        return start.mass / float(cumulative(start, r)[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        q = wave_speed(scene, r, shape(start, r)) * kepler_omega(scene, r) / (np.pi * shape(start, r))
    power = eos_of(scene).toomre_power(scene.gas.eos)
    return (float(np.nanmin(q)) / start.toomre_q) ** (1.0 / power)


def reference_density(scene: Scene) -> float:
    """Sigma at the reference radius of the scene's disc, given or started with."""
    given: Any = scene.background
    if not given:
        found: float = STARTS[scene.initial.kind].reference_density(scene)
        return found
    if given.surface_density is not None:
        return given.surface_density
    return float(given.file.value("Sigma", np.array([given.reference_radius]))[0])


def sound_speed(scene: Scene, r: Array, density: Array) -> Array:
    """sqrt(dP/dSigma) of the gas at radius `r` and surface density `density`, isothermal but for a polytrope."""
    return eos_of(scene).sound_speed(scene, r, density)


def thermal_speed(scene: Scene, r: Array, density: Array | None = None) -> Array:
    """sqrt(P / Sigma) of the gas at radius `r`, of a polytrope at a surface density `density`."""
    return eos_of(scene).thermal_speed(scene, r, density)


def wave_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Speed of sound waves, as the gas of a run has it: of adiabatic gas the adiabatic one."""
    return eos_of(scene).wave_speed(scene, r, density)


def kepler_omega(scene: Scene, r: Array | float) -> Array:
    """Frequency of circles of radius `r` about the star alone, softened as it is."""
    star: Any = scene.star
    return np.sqrt(central_mass(scene) / (r**3 * (1.0 + (star.softening / r) ** 2) ** 1.5))


def surface_density(scene: Scene, r: Array) -> Array:
    return scale(scene) * shape(scene.initial, r)


def pressure_acceleration(scene: Scene, r: Array) -> Array:
    """-(1/Sigma) dP/dr of the gas at radius `r`, from the smooth profile: an edge without taper gives none.

    Where a taper falls faster than over H = c_s/Omega no rotation balances it, and the gas spreads; there it is taken
    as if it fell over H.
    """
    start: Any = scene.initial
    speed2 = sound_speed(scene, r, surface_density(scene, r)) ** 2
    slope = start.surface_density_index + eos_of(scene).temperature_slope(scene.gas.eos)
    out = slope * speed2 / r
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            phase = 0.5 * np.pi * np.clip(sign * (r - edge) / width, 1e-6, 1.0)
            steepest = np.sqrt(speed2 * central_mass(scene) / r**3) if scene.star else np.inf  # c_s^2 / H
            out = out - sign * np.minimum(speed2 * np.pi / width / np.tan(phase), steepest)
    return out
