"""Initial disc of a scene as functions of radius: Sigma, c_s and the pressure force. Numpy only.

Sigma = Sigma_ref (r / r_ref)^-p T(r) between the edges, with T rising as sin^2 over the inner taper and falling as
cos^2 over the outer one. The scene gives Sigma_ref, the mass, or the smallest Toomre Q = c_s Omega_K / (pi G Sigma),
where c_s is the speed of sound waves (the adiabatic one in adiabatic gas).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import STARTS
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SAMPLES = 20_001  # number of radii in numerical integrals
SLOPE = 1e-4  # relative step of r in finite differences
NEAR, FEWEST = 0.3, 3  # range in ln r of the rings in the fit of a slope, and their smallest number


@dataclass(frozen=True)
class Radial:
    """Disc as functions of radius, from which starts compute the positions and velocities of particles.

    All functions take radii (n,) and return arrays (n,) in code units.

    Attributes
    ----------
    inner, outer : float
        Radii of the edges.
    surface_density : callable (r)
        Return Sigma of the gas.
    pressure_acceleration : callable (r)
        Return -(1/Sigma) dP/dr of the gas.
    mass_within : callable (r)
        Return the mass of gas between the first radius and each radius; radii must be in rising order.
    dust_share : callable (r), optional
        Return a factor by which the dust-to-gas ratio of each population is multiplied. Default: 1.
    inflow : callable (r), optional
        Return the radial velocity that viscosity causes. Default: computed from Sigma.
    resolution : callable (r), optional
        Return the number of gas particles per mass, times any constant. Default: uniform.
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
    """Return the initial disc of a scene."""
    found: Radial = STARTS[scene.initial.kind].radial(scene)
    return found


def of_density(
    scene: Scene,
    inner: float,
    outer: float,
    surface_density: Callable[[Array], Array],
    inflow: Callable[[Array], Array] | None = None,
) -> Radial:
    """Return the disc with a given Sigma(r) and the temperature of gas.eos.

    The pressure force is limited to that of a Sigma that falls or rises over a length H.
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
    """Return Sigma / Sigma_ref (n,) at radius `r` (n,); 0 outside the edges."""
    return tapered(start, r, (r / start.reference_radius) ** -start.surface_density_index)


def tapered(start: Any, r: Array, out: Array) -> Array:
    """Return the surface density `out` (n,) at radius `r` (n,), multiplied by the tapers; 0 outside the edges."""
    out = out * ((r >= start.inner) & (r <= start.outer))
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            out = out * np.sin(0.5 * np.pi * np.clip(sign * (r - edge) / width, 0.0, 1.0)) ** 2
    return out


def radii(start: Any) -> Array:
    return np.linspace(start.inner, start.outer, SAMPLES)


def cumulative(start: Any, r: Array) -> Array:
    """Return integrals (n,) of 2 pi r Sigma / Sigma_ref from r[0] to each of the radii `r` (n,), in rising order."""
    return integral(r, shape(start, r))


def integral(r: Array, density: Array) -> Array:
    """Return integrals (n,) of 2 pi r density from r[0] to each of the radii `r` (n,), in rising order."""
    f = 2.0 * np.pi * r * density
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(r))])


def scale(scene: Scene) -> float:
    """Return Sigma_ref in code units."""
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
    """Return Sigma at the reference radius of [background], or else of the start."""
    given: Any = scene.background
    if not given:
        found: float = STARTS[scene.initial.kind].reference_density(scene)
        return found
    if given.surface_density is not None:
        return given.surface_density
    return float(given.file.value("Sigma", np.array([given.reference_radius]))[0])


def sound_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Return sqrt(dP/dSigma) (n,) of the gas at fixed temperature; for a polytrope, its sound speed."""
    return eos_of(scene).sound_speed(scene, r, density)


def thermal_speed(scene: Scene, r: Array, density: Array | None = None) -> Array:
    """Return sqrt(P / Sigma) (n,) of the gas at radius `r` (n,); polytropic particles need `density` (n,) too."""
    if scene.model.given is not None:
        found: Array = scene.model.given(scene).thermal_speed(r)
        return found
    return eos_of(scene).thermal_speed(scene, r, density)


def wave_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Return the speed (n,) of sound waves in the gas of a run; for adiabatic gas, the adiabatic sound speed."""
    return eos_of(scene).wave_speed(scene, r, density)


def pressure_slopes(scene: Scene, r: Array) -> tuple[Array, Array] | None:
    """Return two slopes -d ln P / d ln r (n,) of the gas at radii `r` (n,); None if the scene is not a disc.

    P is the pressure integrated over height for the first slope, which acts in two-dimensional discs, and the midplane
    pressure P / (sqrt(2 pi) H) for the second.
    """
    start = None if scene.initial is None else STARTS[scene.initial.kind]
    ends: tuple[float, float] = (0.0, np.inf)
    density: Callable[[Array], Array]
    given = None if scene.model.given is None else scene.model.given(scene)
    if given is not None:
        slope = given.pressure_slope(r)
    elif scene.gas is None or start is None or scene.star is None:
        return None
    elif start.radial is not None:
        disc = start.radial(scene)
        ends, density = (disc.inner, disc.outer), disc.surface_density
        with np.errstate(divide="ignore", invalid="ignore"):  # the temperature of a polytrope is 0 at its edge
            slope = np.nan_to_num(disc.pressure_acceleration(r) * r / thermal_speed(scene, r, density(r)) ** 2)
    else:
        rings = start.all_over(scene)[0]
        if rings.radius is None or len(rings.radius) < FEWEST:
            return None
        log = np.log(rings.radius)
        pressure = rings.density * thermal_speed(scene, rings.radius, rings.density) ** 2
        slope = np.array([-_slope_at(x, log, np.log(pressure)) for x in np.log(r)])

        def between_rings(radius: Array) -> Array:
            return np.exp(np.interp(np.log(radius), log, np.log(rings.density)))

        density = between_rings

    def height(radius: Array) -> Array:
        speed = given.thermal_speed(radius) if given is not None else thermal_speed(scene, radius, density(radius))
        return speed / kepler_omega(scene, radius)

    near, far = (np.clip(r * (1.0 + step), *ends) for step in (-SLOPE, SLOPE))
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = np.log(height(far) / height(near)) / np.log(far / near)
    return slope, slope + np.nan_to_num(rise, posinf=0.0, neginf=0.0)


def _slope_at(x: float, places: Array, values: Array) -> float:
    """Return the slope of a line fitted to noisy `values` (n,) at sorted `places` (n,) within about NEAR of x."""
    distance = np.abs(places - x)
    weight = np.maximum(1.0 - distance / max(NEAR, np.sort(distance)[: FEWEST + 1][-1]), 0.0)
    middle = np.average(places, weights=weight)
    return float((weight * (places - middle)) @ values / (weight @ (places - middle) ** 2))


def surface_density(scene: Scene, r: Array) -> Array:
    return scale(scene) * shape(scene.initial, r)


def pressure_acceleration(scene: Scene, r: Array) -> Array:
    """Return -(1/Sigma) dP/dr (n,) of the gas at radius `r` (n,), without the jumps of Sigma at the edges.

    The force of a taper is limited to that of a Sigma that changes over a length H = c_s/Omega. No rotation balances a
    steeper taper, and its gas spreads.
    """
    start: Any = scene.initial
    speed2 = sound_speed(scene, r, surface_density(scene, r)) ** 2
    slope = start.surface_density_index + eos_of(scene).temperature_slope(scene.gas.eos)
    out = slope * speed2 / r
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            phase = 0.5 * np.pi * np.clip(sign * (r - edge) / width, 1e-6, 1.0)
            steepest = np.sqrt(speed2) * kepler_omega(scene, r) if scene.star else np.inf  # c_s^2 / H
            out = out - sign * np.minimum(speed2 * np.pi / width / np.tan(phase), steepest)
    return out
