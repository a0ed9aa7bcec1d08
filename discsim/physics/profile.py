"""The disc that a scene asks for, as functions of radius: Sigma, c_s and the pressure's pull. Numpy only.

Sigma = Sigma_ref (r / r_ref)^-p T(r) between the edges, T rising as sin^2 over the inner taper and falling as
cos^2 over the outer one; Sigma_ref from the mass, from the least Toomre Q = c_s Omega_K / (pi G Sigma), c_s the speed
of sound waves (of adiabatic gas the adiabatic one), or given.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import STARTS
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
SAMPLES = 20_001
SLOPE = 1e-4  # of r, for the slope of a start's own Sigma


def shape(start: Any, r: Array) -> Array:
    """Sigma / Sigma_ref at radius `r`, zero beyond the edges."""
    return (r / start.reference_radius) ** -start.surface_density_index * tapers(start, r)


def tapers(start: Any, r: Array) -> Array:
    """What the edges leave of Sigma at radius `r`."""
    out = 1.0 * ((r >= start.inner) & (r <= start.outer))
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            out = out * np.sin(0.5 * np.pi * np.clip(sign * (r - edge) / width, 0.0, 1.0)) ** 2
    return out


def radii(start: Any) -> Array:
    return np.linspace(start.inner, start.outer, SAMPLES)


def law(scene: Scene) -> tuple[float, Callable[[Array], Array]]:
    """Sigma_ref and, as a function of the radius, Sigma / Sigma_ref: of a disc, or as its start has it."""
    own = STARTS[scene.initial.kind].surface_density
    return (scale(scene), partial(shape, scene.initial)) if own is None else (1.0, partial(own, scene))


def enclosed(scene: Scene, r: Array) -> Array:
    """Mass up to each of the rising radii `r`, from the first of them."""
    unit, relative = law(scene)
    return unit * cumulative(relative, r)


def cumulative(relative: Callable[[Array], Array], r: Array) -> Array:
    """Integral of 2 pi r Sigma / Sigma_ref up to each of the rising radii `r`, from the first of them."""
    f = 2.0 * np.pi * r * relative(r)
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(r))])


def scale(scene: Scene) -> float:
    """Sigma_ref in code units."""
    start: Any = scene.initial
    if start.surface_density is not None:
        return start.surface_density
    r = radii(start)
    if start.mass is not None:
        return start.mass / float(cumulative(partial(shape, start), r)[-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        q = wave_speed(scene, r, shape(start, r)) * kepler_omega(scene, r) / (np.pi * shape(start, r))
    power = eos_of(scene).toomre_power(scene.gas.eos)
    return (float(np.nanmin(q)) / start.toomre_q) ** (1.0 / power)


def reference_density(scene: Scene) -> float:
    """Sigma at the reference radius of the scene's disc, given or started with."""
    return scene.background.surface_density if scene.background else STARTS[scene.initial.kind].reference_density(scene)


def sound_speed(scene: Scene, r: Array, density: Array) -> Array:
    """sqrt(dP/dSigma) of the gas at radius `r` and surface density `density`, isothermal but for a polytrope."""
    return eos_of(scene).sound_speed(scene, r, density)


def wave_speed(scene: Scene, r: Array, density: Array) -> Array:
    """Speed of sound waves, as the gas of a run has it: of adiabatic gas the adiabatic one."""
    return eos_of(scene).wave_speed(scene, r, density)


def kepler_omega(scene: Scene, r: Array | float) -> Array:
    """Frequency of circles of radius `r` about the star alone, softened as it is."""
    star: Any = scene.star
    return np.sqrt(star.mass / (r**3 * (1.0 + (star.softening / r) ** 2) ** 1.5))


def surface_density(scene: Scene, r: Array) -> Array:
    unit, relative = law(scene)
    return unit * relative(r)


def pressure_acceleration(scene: Scene, r: Array) -> Array:
    """-(1/Sigma) dP/dr of the gas at radius `r`, from the smooth profile: an edge without taper gives none.

    Where a taper falls faster than over H = c_s/Omega no rotation balances it, and the gas spreads; there it is taken
    as if it fell over H.
    """
    start: Any = scene.initial
    sigma = surface_density(scene, r)
    speed2 = sound_speed(scene, r, sigma) ** 2
    if STARTS[start.kind].surface_density is not None:
        steepest = kepler_omega(scene, r) * r / np.sqrt(speed2)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = surface_density(scene, r * (1.0 + SLOPE)) - surface_density(scene, r * (1.0 - SLOPE))
            slope = np.nan_to_num(-0.5 * rise / (SLOPE * sigma), nan=0.0)
        slope = np.clip(slope, -steepest, steepest)
        return (slope + eos_of(scene).temperature_slope(scene.gas.eos)) * speed2 / r
    slope = start.surface_density_index + eos_of(scene).temperature_slope(scene.gas.eos)
    out = slope * speed2 / r
    for edge, width, sign in ((start.inner, start.inner_taper, 1.0), (start.outer, start.outer_taper, -1.0)):
        if width > 0.0:
            phase = 0.5 * np.pi * np.clip(sign * (r - edge) / width, 1e-6, 1.0)
            steepest = np.sqrt(scene.star.mass / r**3 / speed2) if scene.star else np.inf
            out = out - sign * speed2 * np.minimum(np.pi / width / np.tan(phase), steepest)
    return out
