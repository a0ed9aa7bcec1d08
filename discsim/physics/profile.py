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
STEP = 1e-4  # relative step of r in finite differences
FIT_RANGE, MIN_RINGS = 0.3, 3  # rings in the fit of a slope: largest distance in ln r, and smallest number


@dataclass(frozen=True)
class Radial:
    """Disc as functions of radius, from which starts compute the positions and velocities of particles.

    All functions take radii (n,) and return arrays (n,) in code units.

    Attributes
    ----------
    inner, outer : float
        Radii of the edges.
    surface_density : callable (r)
        Returns Sigma of the gas.
    pressure_acceleration : callable (r)
        Returns -(1/Sigma) dP/dr of the gas.
    mass_within : callable (r)
        Returns the mass of gas between the first of the radii and each radius; radii must be in rising order.
    dust_share : callable (r), optional
        Returns a factor by which the dust-to-gas ratio of each population is multiplied. Default: 1.
    inflow : callable (r), optional
        Returns the radial velocity that viscosity causes. Default: computed from Sigma.
    resolution : callable (r), optional
        Returns the number of gas particles per mass, times any constant. Default: uniform.
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
    return STARTS[scene.initial.kind].radial(scene)


def disc_of_density(
    scene: Scene,
    inner: float,
    outer: float,
    surface_density: Callable[[Array], Array],
    inflow: Callable[[Array], Array] | None = None,
) -> Radial:
    """Return the disc with a given Sigma(r) and the temperature of gas.eos.

    The pressure force is limited to the force of a Sigma that falls or rises over a length H.
    """

    def pressure_acceleration(r: Array) -> Array:
        sigma = surface_density(r)
        speed2 = sound_speed(scene, r, sigma) ** 2
        steepest = kepler_omega(scene, r) * r / np.sqrt(speed2)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = surface_density(r * (1.0 + STEP)) - surface_density(r * (1.0 - STEP))
            slope = np.clip(np.nan_to_num(-0.5 * rise / (STEP * sigma), nan=0.0), -steepest, steepest)
        return (slope + eos_of(scene).temperature_slope(scene.gas.eos)) * speed2 / r

    def mass_within(r: Array) -> Array:
        return integral(r, surface_density(r))

    return Radial(inner, outer, surface_density, pressure_acceleration, mass_within, inflow=inflow)


def relative_density(start: Any, r: Array) -> Array:
    """Return Sigma / Sigma_ref (n,) at radius `r` (n,); 0 outside the edges."""
    return tapered(start, r, (r / start.reference_radius) ** -start.surface_density_index)


def tapered(start: Any, r: Array, out: Array) -> Array:
    """Return the surface density `out` (n,) at radius `r` (n,), multiplied by the tapers; 0 outside the edges."""
    out = out * ((r >= start.inner) & (r <= start.outer))
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            out = out * np.sin(0.5 * np.pi * np.clip(sign * (r - edge) / width, 0.0, 1.0)) ** 2
    return out


def sample_radii(start: Any) -> Array:
    """Return equidistant radii (SAMPLES,) from edge to edge of a disc."""
    return np.linspace(start.inner, start.outer, SAMPLES)


def cumulative(start: Any, r: Array) -> Array:
    """Return integrals (n,) of 2 pi r Sigma / Sigma_ref from r[0] to each of the radii `r` (n,), in rising order."""
    return integral(r, relative_density(start, r))


def integral(r: Array, density: Array) -> Array:
    """Return integrals (n,) of 2 pi r density from r[0] to each of the radii `r` (n,), in rising order."""
    f = 2.0 * np.pi * r * density
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(r))])


def sigma_ref(scene: Scene) -> float:
    """Return the initial surface density Sigma_ref at the reference radius, in code units."""
    start: Any = scene.initial
    if start.surface_density is not None:
        return start.surface_density
    r = sample_radii(start)
    if start.mass is not None:
        return start.mass / float(cumulative(start, r)[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        density = relative_density(start, r)
        q = eos_of(scene).wave_speed(scene, r, density) * kepler_omega(scene, r) / (np.pi * density)
    power = eos_of(scene).toomre_power(scene.gas.eos)
    return (float(np.nanmin(q)) / start.toomre_q) ** (1.0 / power)


def reference_density(scene: Scene) -> float:
    """Return Sigma at the reference radius of [background], or else of the start."""
    given = scene.background
    if given is None:
        return STARTS[scene.initial.kind].reference_density(scene)
    if given.surface_density is not None:
        return given.surface_density
    return float(given.file.value("Sigma", np.array([given.reference_radius]))[0])


def sound_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Return sqrt(dP/dSigma) (n,) of the gas, at a fixed temperature unless the gas is polytropic."""
    return eos_of(scene).sound_speed(scene, r, density)


def initial_thermal_speed(scene: Scene, r: Array, density: Array | None = None) -> Array:
    """Return sqrt(P / Sigma) (n,) of the gas at radius `r` (n,) from the temperature of the scene.

    density (n,): surface density, needed for polytropic SPH gas only.
    """
    if scene.model.given is not None:
        return scene.model.given(scene).thermal_speed(r)
    return eos_of(scene).thermal_speed(scene, r, density)


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
            slope = np.nan_to_num(disc.pressure_acceleration(r) * r / initial_thermal_speed(scene, r, density(r)) ** 2)
    else:
        rings = start.sample_all_gas(scene)[0]
        if rings.radius is None or len(rings.radius) < MIN_RINGS:
            return None
        log = np.log(rings.radius)
        pressure = rings.density * initial_thermal_speed(scene, rings.radius, rings.density) ** 2
        slope = np.array([-_slope_at(x, log, np.log(pressure)) for x in np.log(r)])

        def between_rings(radius: Array) -> Array:
            return np.exp(np.interp(np.log(radius), log, np.log(rings.density)))

        density = between_rings

    def height(radius: Array) -> Array:
        """Return the scale height (n,) at `radius` (n,)."""
        sigma = density(radius) if given is None else None
        return initial_thermal_speed(scene, radius, sigma) / kepler_omega(scene, radius)

    near, far = (np.clip(r * (1.0 + step), *ends) for step in (-STEP, STEP))
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = np.log(height(far) / height(near)) / np.log(far / near)
    return slope, slope + np.nan_to_num(rise, posinf=0.0, neginf=0.0)


def _slope_at(x: float, points: Array, values: Array) -> float:
    """Return the slope at `x` of noisy `values` (n,) at sorted `points` (n,), from a weighted fit of a line.

    Points farther than FIT_RANGE from x do not count, unless MIN_RINGS points need a larger range.
    """
    distance = np.abs(points - x)
    weight = np.maximum(1.0 - distance / max(FIT_RANGE, np.sort(distance)[: MIN_RINGS + 1][-1]), 0.0)
    middle = np.average(points, weights=weight)
    return float((weight * (points - middle)) @ values / (weight @ (points - middle) ** 2))


def surface_density(scene: Scene, r: Array) -> Array:
    """Return Sigma (n,) of the initial disc at radius `r` (n,)."""
    return sigma_ref(scene) * relative_density(scene.initial, r)


def pressure_acceleration(scene: Scene, r: Array) -> Array:
    """Return -(1/Sigma) dP/dr (n,) of the gas at radius `r` (n,), without the jumps of Sigma at the edges.

    The force of a taper is limited to the force of a Sigma that changes over a length H = c_s/Omega. No rotation
    balances a steeper taper, and the gas of a steeper taper spreads.
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
