"""viscous-ring: the spreading ring of Lynden-Bell & Pringle (1974) at a viscous time tau = 12 nu t / R^2.

R: radius of the infinitely narrow ring at tau = 0. Gas rotates in balance with the forces (`balance.py`), and viscosity
drives its radial velocity. If nu is uniform, `exact/spreading_ring.py` has the exact solution.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from discsim.exact import spreading_ring
from discsim.initial import balance, disc
from discsim.initial.base import Array, Curve, SamplePoints
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.physics import profile, viscosity
from discsim.scene.fields import Length, Mass, Number

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

MIN_RELATIVE_DENSITY = 1e-5  # Sigma over its maximum at which the edges of the ring are cut off
MAX_VARIATION = 1e-6  # largest relative variation of nu that counts as uniform
ERROR_BINS = 40  # number of radial bins in the error measure


class ViscousRing(balance.BalanceKeys):
    """The ring of Lynden-Bell & Pringle, spread by a viscosity."""

    kind: Literal["viscous-ring"] = "viscous-ring"
    radius: Length = Field(gt=0, description="radius of the ring at tau = 0")
    mass: Mass = Field(gt=0, description="mass of the gas")
    tau: Number = Field(0.016, ge=1e-4, le=1.0, description="viscous time 12 nu t / radius^2 at t = 0")

    perturbation: ClassVar[float] = 0.0
    inner_taper: ClassVar[float] = 0.0
    outer_taper: ClassVar[float] = 0.0

    @property
    def reference_radius(self) -> float:
        return self.radius

    @property
    def inner(self) -> float:
        return self._edges()[0]

    @property
    def outer(self) -> float:
        return self._edges()[1]

    def _edges(self) -> tuple[float, float]:
        x = np.linspace(0.02, 1.0 + 4.0 * self.tau**0.5, 2001)
        bright = x[(sigma := spreading_ring.surface_density(x, self.tau)) > MIN_RELATIVE_DENSITY * sigma.max()]
        return self.radius * float(bright[0]), self.radius * float(bright[-1])


def radial(scene: Scene) -> profile.Radial:
    """Return the radial profiles of the ring at t = 0."""
    start: Any = scene.initial
    inner, outer = start.inner, start.outer

    def surface_density(r: Array) -> Array:
        inside = (r >= inner) & (r <= outer)
        return np.where(inside, spreading_ring.surface_density(r, start.tau, start.mass, start.radius), 0.0)

    return profile.disc_of_density(scene, inner, outer, surface_density)


def sample_points(scene: Scene) -> SamplePoints:
    """Return sample points at the ring's radius, and at two other radii where Sigma is about half as large."""
    start: Any = scene.initial
    radius = start.radius * np.clip(1.0 + np.array([-0.8, 0.0, 0.8]) * start.tau**0.5, 0.2, None)
    names = [scene.units.show(r, "length") for r in radius]
    return SamplePoints(names, profile.radial(scene).surface_density(radius), radius)


def uniform_viscosity(scene: Scene) -> float | None:
    """Return the viscosity nu if it is uniform in space and constant in time, else None."""
    start: Any = scene.initial
    keys, gas = scene.table("alpha_viscosity"), scene.gas
    if keys.nu is None and (gas is None or gas.eos.kind == "adiabatic"):
        return None
    nu = viscosity.diffusivity(scene, start.radius * np.linspace(0.1, 3.0, 30))
    return float(nu.mean()) if np.ptp(nu) <= MAX_VARIATION * nu.mean() else None


def _viscous_time(scene: Scene, time: float, nu: float) -> float:
    """Return the viscous time tau of the ring at `time`."""
    return float(scene.initial.tau + 12.0 * nu * time / scene.initial.radius**2)


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of Sigma, if nu is uniform and the scene has no dust, else None."""
    nu = uniform_viscosity(scene)
    if nu is None or scene.dust:
        return None

    def errors(sim: Simulated) -> dict[str, float]:
        start: Any = scene.initial
        edges = np.linspace(0.2, 2.0, ERROR_BINS + 1) * start.radius
        found = scene.model.mass_in_rings(scene, sim.gas, edges)
        fine = np.linspace(edges[0], edges[-1], 50 * ERROR_BINS + 1)
        sigma = spreading_ring.surface_density(fine, _viscous_time(scene, sim.time, nu), start.mass, start.radius)
        mass = np.pi * np.diff(fine**2) * 0.5 * (sigma[1:] + sigma[:-1])
        exact = mass.reshape(ERROR_BINS, -1).sum(axis=1)
        return {"gas": float(np.abs(found - exact).sum() / exact.sum())}

    return ErrorMeasure("fraction of the gas mass displaced relative to the exact solution", errors)


def exact_curves(scene: Scene, time: float, r: Array) -> dict[str, Curve]:
    """Return the exact Sigma and radial velocity of the gas, if nu is uniform and the scene has no dust, else {}."""
    nu = uniform_viscosity(scene)
    if nu is None or scene.dust:
        return {}
    start: Any = scene.initial
    r, tau = r[r > 0.0], _viscous_time(scene, time, nu)
    sigma = spreading_ring.surface_density(r, tau, start.mass, start.radius)
    return {"gas": (r, sigma, spreading_ring.radial_velocity(r, tau, nu, start.radius))}


def viscosity_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if [alpha_viscosity] or [star] is absent."""
    for table, need in (("alpha_viscosity", "viscosity"), ("star", "a star")):
        if not draft.has(table):
            yield ("initial", "kind"), f"a {draft.kind} needs {need}; add a table [{table}]"


def warnings(scene: Scene) -> Iterator[str]:
    """Yield the warnings of a disc, and one if nu is not uniform."""
    yield from disc.warnings(scene)
    if uniform_viscosity(scene) is None:
        yield (
            "nu is not uniform in space and constant in time, so this ring has no known exact solution: set "
            "alpha_viscosity.nu, or set alpha_viscosity.index to q - 1.5, where q is gas.eos.temperature_index or 0"
        )


START = disc.disc_start(
    ViscousRing,
    sample_points,
    radial,
    eos=("isothermal", "locally-isothermal", "adiabatic"),
    rules=(viscosity_problems, disc.edge_problems, disc.dust_edge_problems, balance.relaxation_problems),
    reference_density=lambda scene: float(profile.radial(scene).surface_density(np.array([scene.initial.radius]))[0]),
    warnings=warnings,
    measure=measure,
    exact_effects=("star", "alpha_viscosity"),
    exact_curves=exact_curves,
    figure_velocity="radial",
)
