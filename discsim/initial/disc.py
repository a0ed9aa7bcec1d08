"""disc: a disc with power laws of radius and tapered edges (`physics/profile.py`).

Particles of equal mass are on rings (`rings.py`). Their velocities balance the forces (`balance.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import log10
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import balance, rings, support
from discsim.initial.base import Array, SamplePoints, Start
from discsim.physics import profile
from discsim.scene.fields import LARGEST, Length, Mass, Number, SurfaceDensity, Table

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

MIN_MARGIN = 1.15  # a warning is given if half a side of space is less than MIN_MARGIN times the outer edge of the disc
PERTURBATION: Any = Field(
    0.0, ge=0, lt=0.2, description="relative amplitude in Sigma of the azimuthal modes m = 2 to 6, with random phases"
)


class Disc(balance.BalanceKeys):
    """A disc with Sigma ~ r^-p around the origin."""

    kind: Literal["disc"] = "disc"
    mass: Mass | None = Field(None, gt=0, description="mass of the gas")
    toomre_q: Number | None = Field(None, gt=0, description="minimum Toomre Q of the gas, instead of mass")
    surface_density: SurfaceDensity | None = Field(
        None, gt=0, description="surface density of the gas at reference_radius, instead of mass"
    )
    inner: Length = Field(gt=0, description="inner edge of the disc")
    outer: Length = Field(gt=0, description="outer edge of the disc")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which surface_density holds")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    inner_taper: Length = Field(0.0, ge=0, description="width of the taper at the inner edge")
    outer_taper: Length = Field(0.0, ge=0, description="width of the taper at the outer edge")
    perturbation: Number = PERTURBATION


def radial(scene: Scene) -> profile.Radial:
    """Return the radial profiles of the disc."""
    start: Any = scene.initial
    return profile.Radial(
        start.inner,
        start.outer,
        surface_density=partial(profile.surface_density, scene),
        pressure_acceleration=partial(profile.pressure_acceleration, scene),
        mass_within=lambda r: profile.sigma_ref(scene) * profile.cumulative(start, r),
    )


# Rules


def edge_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the edges are in wrong order, if the disc exceeds space, or if its tapers overlap."""
    disc = draft.initial
    if disc.outer <= disc.inner:
        yield (
            ("initial", "outer"),
            "the outer edge is not larger than the inner one; expected initial.outer > initial.inner",
        )
    elif draft.space and min(draft.space.size) < 2 * disc.outer:
        share = min(draft.space.size) / (2 * disc.outer)
        yield (
            ("space", "size"),
            f"space is smaller than the disc: half a side is {share:.3g} times initial.outer; "
            "expected a factor above 1 (with 1.3 the disc can spread)",
        )
    elif disc.inner_taper + disc.outer_taper > disc.outer - disc.inner:
        wide = (disc.inner_taper + disc.outer_taper) / (disc.outer - disc.inner)
        key = "inner_taper" if disc.inner_taper > disc.outer_taper else "outer_taper"
        yield ("initial", key), f"the tapers are {wide:.3g} times as wide as the disc; expected a factor of at most 1"


def power_law_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each power law of radius whose values overflow between the edges of the disc."""
    gas = draft.gas or draft.background
    laws = [("initial", draft.initial, "surface_density_index")]
    if draft.has("background"):
        laws.append(("background", draft.background, "surface_density_index"))
    if gas and hasattr(gas.eos, "temperature_index"):
        laws.append(("gas" if draft.gas else "background", gas.eos, "temperature_index"))
    for table, law, key in laws:
        index, where = getattr(law, key), law.reference_radius
        if max(abs(index * log10(r / where)) for r in (draft.initial.inner, draft.initial.outer)) > log10(LARGEST):
            path = (table, "eos", key) if key == "temperature_index" else (table, key)
            yield (
                path,
                f"the index {index:g} makes powers of the radius exceed {LARGEST:g}; choose an index nearer to 0",
            )


def mass_problems(draft: Draft, keys: tuple[str, ...]) -> Iterator[Problem]:
    """Yield a problem unless exactly one of `keys`, the keys of [initial] that set the mass of the disc, is given."""
    given = [key for key in keys if getattr(draft.initial, key) is not None]
    if len(given) != 1:
        wrong = f"{' and '.join(given)} are {'both' if len(given) == 2 else 'all'} given"
        wrong = wrong if given else "no mass of the disc is given"
        yield ("initial", *given[-1:]), f"{wrong}; give exactly one of the keys {', '.join(keys)}"


def centre_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if no gravity binds the disc."""
    if not draft.has("star") and not draft.has("self_gravity"):
        yield ("initial", "kind"), "no gravity binds the disc; add a table [star] or [self_gravity]"


def toomre_q_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each table that `initial.toomre_q` needs and that is absent, or for a prescribed disc."""
    if draft.initial.toomre_q is None:
        return
    for table in ("gas", "star"):
        if not draft.has(table):
            wrong = f"Q = c_s kappa / (pi G Sigma) needs a table [{table}]"
            yield ("initial", "toomre_q"), f"{wrong}; add [{table}], or replace toomre_q by mass or surface_density"
    if draft.has("background"):
        wrong = "toomre_q describes a table [gas], but this scene has [background]"
        yield ("initial", "toomre_q"), f"{wrong}; replace toomre_q by mass or surface_density"


def dust_edge_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each dust population with an offset, or without gas between its edges."""
    for i, dust in enumerate(draft.dust or ()):
        if dust.offset:
            yield ("dust", i, "offset"), "particles of a disc have no uniform spacing; remove dust.offset"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            continue  # a general rule of dust reports this
        if dust.inner is not None and dust.inner >= draft.initial.outer:
            yield (
                ("dust", i, "inner"),
                "the dust begins beyond initial.outer, where there is no gas; expected less than initial.outer",
            )
        elif dust.outer is not None and dust.outer <= draft.initial.inner:
            yield (
                ("dust", i, "outer"),
                "the dust ends inside initial.inner, where there is no gas; expected more than initial.inner",
            )


# Previews


def sample_points(scene: Scene) -> SamplePoints:
    """Return the gas at the ends of both tapers and in the middle of the disc."""
    start: Any = scene.initial
    inner, outer = start.inner + start.inner_taper, start.outer - start.outer_taper
    radius = np.array([inner, (start.inner + start.outer) / 2, outer])
    names = [scene.units.show(r, "length") for r in radius]
    return SamplePoints(names, profile.radial(scene).surface_density(radius), radius)


def sample_all_gas(scene: Scene) -> tuple[SamplePoints, Array]:
    """Return sample points at radii from edge to edge, and relative gas masses r Sigma (n,)."""
    r = profile.sample_radii(scene.initial)
    density = profile.radial(scene).surface_density(r)
    r, density = r[density > 0], density[density > 0]
    return SamplePoints([], density, r), r * density


def warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning if space is hardly larger than the disc."""
    half, outer = 0.5 * min(scene.space.size), scene.initial.outer
    if half < MIN_MARGIN * outer and scene.model.given is None:
        needed = scene.units.show(2 * MIN_MARGIN * outer, "length")
        yield (
            f"space.size leaves {half / outer - 1:.2g} of the disc's radius as margin, below {MIN_MARGIN - 1:.2g}: "
            f"spreading gas leaves the grid; raise space.size to {needed}"
        )


def disc_start(
    keys: type[Table],
    sample_points: Callable[[Scene], SamplePoints],
    radial: Callable[[Scene], profile.Radial],
    **more: Any,
) -> Start:
    """Return the Start of a disc on rings with velocities in balance.

    keys, sample_points, radial: attributes of `Start`. more: further attributes, in place of the defaults here.
    """
    defaults = {"samples_of_all_gas": sample_all_gas, "warnings": warnings}
    return Start(
        keys,
        rings.particles,
        sample_points,
        radial=radial,
        settle=balance.settle,
        problems=support.problems,
        dimensions=(2,),
        boundary="open",
        kernel="wendland-c2",  # quieter for its cost (analysis/noise.py)
        region_mass=rings.gas_mass,
        on_lattice=False,
        edges=rings.edges,
        **(defaults | more),
    )


START = disc_start(
    Disc,
    sample_points,
    radial,
    rules=(
        edge_problems,
        power_law_problems,
        partial(mass_problems, keys=("mass", "toomre_q", "surface_density")),
        centre_problems,
        toomre_q_problems,
        dust_edge_problems,
        balance.relaxation_problems,
    ),
    reference_density=profile.sigma_ref,
)
