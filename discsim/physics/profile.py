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
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SAMPLES = 20_001
SLOPE = 1e-4  # of r, over which the slope of a Sigma of no known power is taken
NEAR, FEWEST = 0.3, 3  # in ln r, of rings of particles through which a slope is taken, and their least number


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
    """sqrt(P / Sigma) of the gas at radius `r`, of a polytrope of particles at a surface density `density`."""
    if scene.model.given is not None:
        found: Array = scene.model.given(scene).thermal_speed(r)
        return found
    return eos_of(scene).thermal_speed(scene, r, density)


def wave_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Speed of sound waves, as the gas of a run has it: of adiabatic gas the adiabatic one."""
    return eos_of(scene).wave_speed(scene, r, density)


def pressure_slopes(scene: Scene, r: Array) -> tuple[Array, Array] | None:
    """-d ln P / d ln r of the gas at radii (n,): of P integrated over height, which moves a disc of two dimensions, and
    of that in the midplane, P / (sqrt(2 pi) H), of a disc with a thickness. None where the scene is no disc.
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
        with np.errstate(divide="ignore", invalid="ignore"):  # a polytrope is cold where it ends
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
    """Slope at `x` of noisy `values` (n,) at sorted `places` (n,): that of a line through those within NEAR of x."""
    distance = np.abs(places - x)
    weight = np.maximum(1.0 - distance / max(NEAR, np.sort(distance)[: FEWEST + 1][-1]), 0.0)
    middle = np.average(places, weights=weight)
    return float((weight * (places - middle)) @ values / (weight @ (places - middle) ** 2))


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
            steepest = np.sqrt(speed2) * kepler_omega(scene, r) if scene.star else np.inf  # c_s^2 / H
            out = out - sign * np.minimum(speed2 * np.pi / width / np.tan(phase), steepest)
    return out
