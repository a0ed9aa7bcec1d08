"""steady: a disc in steady viscous accretion, Sigma = Mdot / (3 pi nu(r)), with the same rate at all radii.

Gas rotates in balance with the forces (`balance.py`) and moves inwards with v_r = -3 nu / (2 r) (Lynden-Bell & Pringle
1974). The edges have the tapers of a `disc`. In the tapers v_r is the same, but the flow is not steady. With [damping]
zones over the tapers, the outer taper supplies the disc with gas, and the inner taper removes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import balance, disc, rings
from discsim.initial.base import Array, Start
from discsim.initial.viscous_ring import needs_a_viscosity
from discsim.physics import profile, viscosity
from discsim.scene.fields import Length, Measure, Number, SurfaceDensity

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem


class Steady(balance.Settled):
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
    perturbation: Number = Field(
        0.0,
        ge=0,
        lt=0.2,
        description="relative amplitude in Sigma of the azimuthal modes m = 2 to 6, with random phases",
    )


def accretion_rate(scene: Scene) -> float:
    """Return the accretion rate Mdot in code units, from its key or from surface_density."""
    start: Any = scene.initial
    if start.accretion_rate is not None:
        return float(start.accretion_rate)
    nu = viscosity.diffusivity(scene, np.array([start.reference_radius]))
    return float(3.0 * np.pi * nu[0] * start.surface_density)


def radial(scene: Scene) -> profile.Radial:
    """Return the disc as functions of radius."""
    start: Any = scene.initial
    rate = accretion_rate(scene)

    def surface_density(r: Array) -> Array:
        return profile.tapered(start, r, rate / (3.0 * np.pi * viscosity.diffusivity(scene, r)))

    def inflow(r: Array) -> Array:
        return np.asarray(-1.5 * viscosity.diffusivity(scene, r) / r)

    return profile.disc_of_density(scene, start.inner, start.outer, surface_density, inflow)


def reference_density(scene: Scene) -> float:
    start: Any = scene.initial
    nu = viscosity.diffusivity(scene, np.array([start.reference_radius]))
    return float(accretion_rate(scene) / (3.0 * np.pi * nu[0]))


def _has_one_scale(draft: Draft) -> Iterator[Problem]:
    scales = ("surface_density", "accretion_rate")
    given = [key for key in scales if getattr(draft.initial, key) is not None]
    if len(given) != 1:
        wrong = "both are given" if given else "no mass of the disc is given"
        yield ("initial", *given[-1:]), f"{wrong}; expected exactly one of {', '.join(scales)}"


def _is_viscous_everywhere(draft: Draft) -> Iterator[Problem]:
    keys = draft.alpha_viscosity
    for key in ("inner_alpha", "outer_alpha", "dead_alpha"):
        if keys and getattr(keys, key) == 0.0:
            yield ("alpha_viscosity", key), "Sigma of a steady disc is infinite where nu = 0; expected more than 0"


START = Start(
    Steady,
    rings.particles,
    disc.places,
    radial=radial,
    settle=balance.settle,
    faults=balance.faults,
    dimensions=(2,),
    boundary="open",
    eos=("isothermal", "locally-isothermal", "adiabatic"),
    rules=(
        needs_a_viscosity,
        disc.has_edges_in_space,
        disc.has_dust_within,
        _has_one_scale,
        _is_viscous_everywhere,
        balance.relaxes_gas,
    ),
    kernel="wendland-c2",
    masses=rings.mass,
    spread=disc.spread,
    on_lattice=False,
    edges=rings.edges,
    reference_density=reference_density,
    warnings=disc.warnings,
)
