"""disc: power laws with tapers (`physics/profile.py`), particles of equal mass on rings (`rings.py`), and velocities
in balance with the forces (`balance.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import log10
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import balance, rings
from discsim.initial.base import Places, Start
from discsim.physics import profile
from discsim.scene.fields import LARGEST, Length, Mass, Number, SurfaceDensity

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

Array = np.ndarray
MIN_ROOM = 1.15  # a warning is given if half a side of space is less than MIN_ROOM times the outer radius of the disc


class Disc(balance.Settled):
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
    perturbation: Number = Field(
        0.0,
        ge=0,
        lt=0.2,
        description="relative amplitude in Sigma of the azimuthal modes m = 2 to 6, with random phases",
    )


def radial(scene: Scene) -> profile.Radial:
    """Return the disc as functions of radius."""
    start: Any = scene.initial
    return profile.Radial(
        start.inner,
        start.outer,
        surface_density=partial(profile.surface_density, scene),
        pressure_acceleration=partial(profile.pressure_acceleration, scene),
        mass_within=lambda r: profile.sigma_ref(scene) * profile.cumulative(start, r),
    )


# Rules


def has_edges_in_space(draft: Draft) -> Iterator[Problem]:
    disc = draft.initial
    if disc.outer <= disc.inner:
        yield ("initial", "outer"), "outer is not larger than inner; expected outer > inner"
    elif draft.space and min(draft.space.size) < 2 * disc.outer:
        share = min(draft.space.size) / (2 * disc.outer)
        yield (
            ("space", "size"),
            f"the space is smaller than the disc: half a side is {share:.3g} of initial.outer; "
            "expected more than 1 (1.3 leaves room to spread)",
        )
    elif disc.inner_taper + disc.outer_taper > disc.outer - disc.inner:
        wide = (disc.inner_taper + disc.outer_taper) / (disc.outer - disc.inner)
        key = "inner_taper" if disc.inner_taper > disc.outer_taper else "outer_taper"
        yield ("initial", key), f"the tapers are {wide:.3g} times as wide as the disc; expected at most 1"


def has_finite_powers(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each power law of radius that overflows within the disc."""
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
            yield path, f"{index:g} gives powers of the radius beyond {LARGEST:g}; expected a smaller index"


def has_one_mass(draft: Draft) -> Iterator[Problem]:
    scales = ("mass", "toomre_q", "surface_density")
    given = [key for key in scales if getattr(draft.initial, key) is not None]
    if len(given) != 1:
        wrong = "{} are all given".format(" and ".join(given)) if given else "no mass of the disc is given"
        yield ("initial", *given[-1:]), f"{wrong}; expected exactly one of {', '.join(scales)}"


def needs_a_centre(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star") and not draft.has("self_gravity"):
        yield (
            ("initial", "kind"),
            "the disc is not bound by gravity; expected a table [star] or [self_gravity]",
        )


def has_tables_for_q(draft: Draft) -> Iterator[Problem]:
    if draft.initial.toomre_q is None:
        return
    for table in ("gas", "star"):
        if not draft.has(table):
            yield ("initial", "toomre_q"), f"Q = c_s kappa / (pi G Sigma) needs a table [{table}]"
    if draft.has("background"):
        yield ("initial", "toomre_q"), "Toomre Q needs gas; expected a table [gas], or mass or surface_density"


def has_dust_within(draft: Draft) -> Iterator[Problem]:
    for i, dust in enumerate(draft.dust or ()):
        if dust.offset:
            yield ("dust", i, "offset"), "a disc has no uniform gas spacing; expected no offset"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            continue  # a general rule of dust reports this
        if dust.inner is not None and dust.inner >= draft.initial.outer:
            yield ("dust", i, "inner"), "there is no gas outside the disc; expected less than initial.outer"
        elif dust.outer is not None and dust.outer <= draft.initial.inner:
            yield ("dust", i, "outer"), "there is no gas inside the inner edge; expected more than initial.inner"


# Previews


def places(scene: Scene) -> Places:
    """Return the gas at the ends of both tapers and in the middle of the disc."""
    start: Any = scene.initial
    inner, outer = start.inner + start.inner_taper, start.outer - start.outer_taper
    radius = np.array([inner, (start.inner + start.outer) / 2, outer])
    names = [scene.units.show(r, "length") for r in radius]
    return Places(names, profile.radial(scene).surface_density(radius), radius)


def spread(scene: Scene) -> tuple[Places, Array]:
    r = profile.sample_radii(scene.initial)
    density = profile.radial(scene).surface_density(r)
    r, density = r[density > 0], density[density > 0]
    return Places([], density, r), r * density


def warnings(scene: Scene) -> Iterator[str]:
    half, outer = 0.5 * min(scene.space.size), scene.initial.outer
    if half < MIN_ROOM * outer and scene.model.given is None:
        wanted = scene.units.show(2 * MIN_ROOM * outer, "length")
        yield (
            f"space.size leaves {half / outer - 1:.2g} of the disc's radius as margin, below {MIN_ROOM - 1:.2g}: "
            f"spreading gas leaves the grid; raise space.size to {wanted}"
        )


START = Start(
    Disc,
    rings.particles,
    places,
    radial=radial,
    settle=balance.settle,
    faults=balance.faults,
    dimensions=(2,),
    boundary="open",
    rules=(
        has_edges_in_space,
        has_finite_powers,
        has_one_mass,
        needs_a_centre,
        has_tables_for_q,
        has_dust_within,
        balance.relaxes_gas,
    ),
    kernel="wendland-c2",  # quieter for its cost (analysis/noise.py)
    masses=rings.mass,
    spread=spread,
    on_lattice=False,
    edges=rings.edges,
    reference_density=profile.sigma_ref,
    warnings=warnings,
)
