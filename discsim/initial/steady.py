"""steady: a disc in steady viscous accretion, Sigma = Mdot / (3 pi nu(r)), with the same rate at all radii.

Gas rotates in balance with the forces (`balance.py`) and moves inwards with v_r = -3 nu / (2 r) (Lynden-Bell & Pringle
1974). The edges have the tapers of a `disc`. In the tapers v_r obeys the same formula, but the flow is not steady. With
[damping] zones over the tapers, the outer zone supplies the disc with gas, and the inner zone removes gas.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import balance, disc
from discsim.initial.base import Array
from discsim.initial.viscous_ring import viscosity_problems
from discsim.physics import profile, viscosity
from discsim.scene.fields import Length, Measure, Number, SurfaceDensity

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem


class Steady(balance.BalanceKeys):
    """A disc in steady accretion by its viscosity."""

    kind: Literal["steady"] = "steady"
    surface_density: SurfaceDensity | None = Field(
        None, gt=0, description="surface density of the gas at reference_radius"
    )
    accretion_rate: Annotated[float | None, Measure("accretion_rate")] = Field(
        None, gt=0, description="accretion rate onto the star, instead of surface_density"
    )
    inner: Length = Field(gt=0, description="inner edge of the disc")
    outer: Length = Field(gt=0, description="outer edge of the disc")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which surface_density holds")
    inner_taper: Length = Field(0.0, ge=0, description="width of the taper at the inner edge")
    outer_taper: Length = Field(0.0, ge=0, description="width of the taper at the outer edge")
    perturbation: Number = disc.PERTURBATION


def accretion_rate(scene: Scene) -> float:
    """Return the accretion rate Mdot of the disc in code units: initial.accretion_rate, or from surface_density."""
    start: Any = scene.initial
    if start.accretion_rate is not None:
        return float(start.accretion_rate)
    nu = viscosity.diffusivity(scene, np.array([start.reference_radius]))
    return float(3.0 * np.pi * nu[0] * start.surface_density)


def radial(scene: Scene) -> profile.Radial:
    """Return the radial profiles of the disc."""
    start: Any = scene.initial
    rate = accretion_rate(scene)

    def surface_density(r: Array) -> Array:
        return profile.tapered(start, r, rate / (3.0 * np.pi * viscosity.diffusivity(scene, r)))

    def inflow(r: Array) -> Array:
        return np.asarray(-1.5 * viscosity.diffusivity(scene, r) / r)

    return profile.disc_of_density(scene, start.inner, start.outer, surface_density, inflow)


def reference_density(scene: Scene) -> float:
    """Return Sigma, without the tapers, at `initial.reference_radius`."""
    start: Any = scene.initial
    nu = viscosity.diffusivity(scene, np.array([start.reference_radius]))
    return float(accretion_rate(scene) / (3.0 * np.pi * nu[0]))


def _alpha_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each key of [alpha_viscosity] that makes the viscosity zero in a part of the disc."""
    keys = draft.alpha_viscosity
    for key in ("inner_alpha", "outer_alpha", "dead_alpha"):
        if keys and getattr(keys, key) == 0.0:
            yield ("alpha_viscosity", key), "Sigma of a steady disc is infinite where nu = 0; expected a value above 0"


START = disc.disc_start(
    Steady,
    disc.sample_points,
    radial,
    eos=("isothermal", "locally-isothermal", "adiabatic"),
    rules=(
        viscosity_problems,
        disc.edge_problems,
        disc.dust_edge_problems,
        partial(disc.mass_problems, keys=("surface_density", "accretion_rate")),
        _alpha_problems,
        balance.relaxation_problems,
    ),
    reference_density=reference_density,
)
