"""A disc with power laws and tapers: particles of equal mass on rings, turning in balance.

Gas: v_phi^2 / r = GM/r^2 (softened) + g_self + (1/Sigma) dP/dr; with two-way drag gas and dust start at the
velocities of Nakagawa, Sekiya & Hayashi (1986) for the local Stokes numbers and dust-to-gas ratios of all populations;
one-way dust at those for a ratio of zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import log10
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from discsim.exact import nsh
from discsim.initial import SPECIES, populations, random_stream
from discsim.initial.base import Places, Start
from discsim.physics import profile
from discsim.scene.fields import LARGEST, Length, Mass, Number, SurfaceDensity, Table

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

Array = np.ndarray
ROOM = 1.15  # half of space over the outer radius of a disc


class Disc(Table):
    """A disc with Sigma ~ r^-p around the origin."""

    kind: Literal["disc"] = "disc"
    mass: Mass | None = Field(None, gt=0, description="of the gas")
    toomre_q: Number | None = Field(None, gt=0, description="least Toomre Q of the gas, instead of its mass")
    surface_density: SurfaceDensity | None = Field(
        None, gt=0, description="of the gas at reference_radius, instead of its mass"
    )
    inner: Length = Field(gt=0, description="inner edge")
    outer: Length = Field(gt=0, description="outer edge")
    reference_radius: Length = Field(1.0, gt=0, description="where surface_density holds")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    inner_taper: Length = Field(0.0, ge=0, description="width of the inner taper")
    outer_taper: Length = Field(0.0, ge=0, description="width of the outer taper")
    perturbation: Number = Field(
        0.0, ge=0, lt=0.2, description="amplitude in Sigma of each of the azimuthal modes 2 to 6, of random phases"
    )


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    start: Any = scene.initial
    out = {}
    if scene.gas is not None:
        stream = random_stream(scene, "gas")
        out["gas"] = _species(scene, stream, scene.gas.particles, start.inner, start.outer, 1.0, "even")
    if scene.dust is not None:
        own = random_stream(scene, "dust")
        out["dust"] = populations(
            scene,
            lambda dust: _species(scene, own, dust.particles, *_range(start, dust), dust.ratio, dust.placement),
        )
    return out


def _range(start: Any, population: Any) -> tuple[float, float]:
    """Radii between which a population of dust is."""
    return max(population.inner or 0.0, start.inner), min(population.outer or np.inf, start.outer)


def _species(
    scene: Scene, stream: np.random.Generator, count: int, inner: float, outer: float, ratio: float, placement: str
) -> dict[str, Array]:
    r = np.linspace(inner, outer, profile.SAMPLES)
    mass = profile.enclosed(scene, r)
    if placement == "random":
        radius = np.interp(stream.random(count) * mass[-1], mass, r)
        angle = 2.0 * np.pi * stream.random(count)
    else:
        radius, angle = rings(r, mass / mass[-1] * count, stream)
    if scene.initial.perturbation > 0.0:
        angle = perturbed(scene, radius, angle)
    pos = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return {
        "pos": pos,
        "vel": np.zeros_like(pos),
        "mass": np.full(count, ratio * mass[-1] / count),
        "density": profile.surface_density(scene, radius),
    }


def rings(r: Array, number: Array, stream: np.random.Generator) -> tuple[Array, Array]:
    """Radius and angle of particles, as far apart along rings as the rings are from each other.

    `number` is the number of particles within each of the rising radii `r`; ring k holds those between two of
    its values, at the radius that halves them, evenly spaced from a random angle.
    """
    count = round(number[-1])
    per_area = np.gradient(number, r) / (2.0 * np.pi * r)
    ring = np.concatenate([[0.0], np.cumsum(np.diff(r) * np.sqrt(0.5 * (per_area[1:] + per_area[:-1])))])
    total = max(1, round(ring[-1]))
    edges = np.round(np.interp(np.arange(total + 1) * ring[-1] / total, ring, number)).astype(int)
    edges[0], edges[-1] = 0, count
    held = np.diff(edges)
    radius = np.interp(0.5 * (edges[1:] + edges[:-1]), number, r)
    phase = stream.random(total)
    place = np.arange(count) - np.repeat(edges[:-1], held)
    angle = 2.0 * np.pi * (place + np.repeat(phase, held)) / np.repeat(held, held)
    return np.repeat(radius, held), angle


def perturbed(scene: Scene, radius: Array, angle: Array) -> Array:
    """Angles (n,) moved so that their density is 1 + A sum_m cos(m phi + phase_m(r)) to first order, m = 2 to 6.

    The seeds of spiral arms, leading and trailing: phases are random, ten from edge to edge and smooth
    between. On quiet rings nothing else breaks the symmetry. Gas and dust share them.
    """
    from scipy.interpolate import make_interp_spline  # slow to import

    start: Any = scene.initial
    stream = np.random.default_rng([scene.run.seed, len(SPECIES)])
    nodes = np.linspace(start.inner, start.outer, 10)
    moved = angle.copy()
    for m in range(2, 7):
        phase = make_interp_spline(nodes, 2.0 * np.pi * stream.random(len(nodes)), k=3)(radius)
        moved -= start.perturbation / m * np.sin(m * angle + phase)
    return moved


def settle(state: State, effects: dict[str, Any]) -> None:
    """Give gas and dust the velocities of a disc in balance with the forces of `effects`."""
    scene = state.scene
    gravity = _mean_gravity(state, effects)
    for name, particles in state.species.items():
        r = np.sqrt((particles.pos**2).sum(axis=1))
        # Where gravity points outwards nothing can turn in balance; a start at rest is as good as any.
        keplerian = np.sqrt(np.maximum(gravity(r) * r, 1e-300))
        radial, lag = np.zeros(len(r)), np.zeros(len(r))
        if scene.model.given is not None:
            radial, lag = effects["drag"].drift(state).T
        elif scene.gas is not None:
            headwind = 0.5 * profile.pressure_acceleration(scene, r) * r / keplerian  # eta v_K
            headwind[keplerian <= 1e-100] = 0.0
            if "drag" in effects and (name == "dust" or scene.drag.direction == "two-way"):
                radial, lag = _drift(scene, effects["drag"], name, particles, r, keplerian / r, headwind)
            elif name == "gas":
                # Alone its balance is exact, not to first order in the headwind.
                lag = np.sqrt(np.maximum(keplerian**2 - 2.0 * headwind * keplerian, 0.0)) - keplerian
        direction = particles.pos / r[:, None]
        across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
        particles.vel[:] = radial[:, None] * direction + (keplerian + lag)[:, None] * across


def _drift(
    scene: Scene, drag: Any, name: str, particles: Any, r: Array, omega: Array, headwind: Array
) -> tuple[Array, Array]:
    """Radial and azimuthal velocity (n,) relative to Keplerian of one species, with the populations that there are."""
    density = profile.surface_density(scene, r)
    sound = profile.sound_speed(scene, r, density)
    stokes, loads = np.empty((2, len(scene.dust), len(r)))
    for k, population in enumerate(scene.dust):
        # Beyond an edge there is no gas: a limit keeps what is infinite from meeting what is 0.
        stokes[k] = np.minimum(omega * drag.stopping_time(k, density, sound, omega, population.ratio), 1e100)
        there = (r >= (population.inner or 0.0)) & (r <= (population.outer or np.inf))
        loads[k] = np.where(there & (scene.drag.direction == "two-way"), population.ratio, 0.0)
    found = nsh.of_populations(stokes, loads, headwind)
    if name == "gas":
        return found.gas_radial, found.gas_azimuthal
    own = particles.species, np.arange(len(r))
    return found.dust_radial[own], found.dust_azimuthal[own]


def _mean_gravity(state: State, effects: dict[str, Any]) -> Callable[[Array], Array]:
    """Inward acceleration by the star and self-gravity, averaged in azimuth, as a function of radius.

    Taken at the limiting particles: one-way dust must not change the gas.
    """
    star = state.scene.star

    def pull(radius: Array) -> Array:
        return star.mass * radius / (radius**2 + star.softening**2) ** 1.5 if star else np.zeros(len(radius))

    if "self_gravity" not in effects:
        return pull
    r = np.concatenate([np.sqrt((p.pos**2).sum(axis=1)) for p in state.limiting])
    for p in state.species.values():
        p.acc[:] = 0.0
    effects["self_gravity"].accelerate(state)
    inward = -np.concatenate([(p.acc * p.pos).sum(axis=1) for p in state.limiting]) / r
    edges = np.linspace(r.min(), r.max(), max(2, int(np.ptp(r) / state.grid.cell)) + 1)
    number, _ = np.histogram(r, edges)
    total, _ = np.histogram(r, edges, weights=inward)
    filled = number > 0
    centre, mean = 0.5 * (edges[1:] + edges[:-1])[filled], total[filled] / number[filled]
    return lambda radius: pull(radius) + np.interp(radius, centre, mean)


# Rules


def has_edges_in_space(draft: Draft) -> Iterator[Problem]:
    disc = draft.initial
    if disc.outer <= disc.inner:
        yield ("initial", "outer"), "the outer edge is not outside the inner one; expected outer > inner"
    elif draft.space and min(draft.space.size) < 2 * disc.outer:
        share = min(draft.space.size) / (2 * disc.outer)
        yield (
            ("space", "size"),
            f"the grid is smaller than the disc: its half side is {share:.3g} of initial.outer; "
            "expected more than 1 (1.3 leaves room to spread)",
        )
    elif disc.inner_taper + disc.outer_taper > disc.outer - disc.inner:
        wide = (disc.inner_taper + disc.outer_taper) / (disc.outer - disc.inner)
        key = "inner_taper" if disc.inner_taper > disc.outer_taper else "outer_taper"
        yield ("initial", key), f"the tapers are {wide:.3g} times as wide as the disc; expected 1 at most"


def has_finite_powers(draft: Draft) -> Iterator[Problem]:
    """Powers of the radius stay within floats all over a disc."""
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
            yield path, f"{index:g} takes powers of the radius beyond {LARGEST:g} in the disc; expected a lesser slope"


def has_one_mass(draft: Draft) -> Iterator[Problem]:
    scales = ("mass", "toomre_q", "surface_density")
    given = [key for key in scales if getattr(draft.initial, key) is not None]
    if len(given) != 1:
        wrong = "{} are there together".format(" and ".join(given)) if given else "the disc has no mass"
        yield ("initial", *given[-1:]), f"{wrong}; expected exactly one of {', '.join(scales)}"


def needs_a_centre(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star") and not draft.has("self_gravity"):
        yield (
            ("initial", "kind"),
            "nothing holds the disc together; expected a table [star] or [self_gravity]",
        )


def has_a_q(draft: Draft) -> Iterator[Problem]:
    if draft.initial.toomre_q is None:
        return
    for table in ("gas", "star"):
        if not draft.has(table):
            yield ("initial", "toomre_q"), f"Q = c_s kappa / (pi G Sigma) needs a table [{table}]"
    if draft.has("background"):
        yield ("initial", "toomre_q"), "there is no [gas] to have a Q; expected mass or surface_density"


def has_dust_within(draft: Draft) -> Iterator[Problem]:
    for i, dust in enumerate(draft.dust or ()):
        if dust.offset:
            yield ("dust", i, "offset"), "a disc has no gas spacing; expected another kind"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            continue  # that is told of any dust
        if dust.inner is not None and dust.inner >= draft.initial.outer:
            yield ("dust", i, "inner"), "beyond the disc, where there is no gas; expected less than initial.outer"
        elif dust.outer is not None and dust.outer <= draft.initial.inner:
            yield ("dust", i, "outer"), "in the disc's hole, where there is no gas; expected more than initial.inner"


# Previews


def edges(scene: Scene) -> tuple[float, float]:
    start: Any = scene.initial
    return start.inner, start.outer


def places(scene: Scene) -> Places:
    """Where the tapers end, and the middle."""
    start: Any = scene.initial
    inner, outer = start.inner + start.inner_taper, start.outer - start.outer_taper
    radius = np.array([inner, (start.inner + start.outer) / 2, outer])
    names = [scene.units.show(r, "length") for r in radius]
    return Places(names, profile.surface_density(scene, radius), radius)


def spread(scene: Scene) -> tuple[Places, Array]:
    r = profile.radii(scene.initial)
    weight = r * profile.law(scene)[1](r)
    r, weight = r[weight > 0], weight[weight > 0]
    return Places([], profile.surface_density(scene, r), r), weight


def mass(scene: Scene, population: Any) -> float:
    inner, outer = edges(scene) if population is None else _range(scene.initial, population)
    radius = np.linspace(inner, max(inner, outer), profile.SAMPLES)
    return float(profile.enclosed(scene, radius)[-1])


def warnings(scene: Scene) -> Iterator[str]:
    half, outer = 0.5 * min(scene.space.size), scene.initial.outer
    if half < ROOM * outer and scene.model.given is None:
        wanted = scene.units.show(2 * ROOM * outer, "length")
        yield (
            f"space.size leaves {half / outer - 1:.2g} of the disc's radius about it, below {ROOM - 1:.2g}: "
            f"what spreads leaves the grid; raise it to {wanted}"
        )


START = Start(
    Disc,
    particles,
    places,
    settle=settle,
    dimensions=(2,),
    boundary="open",
    rules=(has_edges_in_space, has_finite_powers, has_one_mass, needs_a_centre, has_a_q, has_dust_within),
    kernel="quintic",  # quieter for its cost (analysis/noise.py)
    masses=mass,
    spread=spread,
    on_lattice=False,
    edges=edges,
    reference_density=profile.scale,
    warnings=warnings,
)
