"""Initial conditions ("starts"), one module each, and the conversion of their arrays into a `State`.

Each start defines a function `particles(scene)`, and may define a function `settle` that sets velocities once forces
are known. `particles` returns a dict of arrays for each species: pos, vel (n, dimensions), mass (n,) and, optionally,
density (n,) (a first guess for h), u (n,), species (n,) (index of the dust population) and immobile (n,).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.state import FOLLOWED, Dust, Gas, State
from discsim.parts import STARTS, Lazy
from discsim.physics.grains import has_sizes, sampled_sizes

if TYPE_CHECKING:
    from discsim.initial.base import Start
    from discsim.scene import Scene

growth = Lazy("discsim.physics.growth")
Given = dict[str, dict[str, Any]]
SPECIES = ("gas", "dust")


def random_stream(scene: Scene, species: str) -> np.random.Generator:
    """Return the random generator of a species. Each species has its own, so that adding dust does not move the gas."""
    return np.random.default_rng([scene.run.seed, SPECIES.index(species)])


def start_of(scene: Scene) -> Start:
    """Return the scene's initial condition."""
    return STARTS[scene.initial.kind]


def start_time(scene: Scene) -> float:
    """Return the time at which a run of the scene begins."""
    begins = None if scene.initial is None else start_of(scene).begins
    return 0.0 if begins is None else begins(scene)


def make_particles(scene: Scene) -> Given:
    """Return the particle arrays of the scene's initial condition, as {species: {name: array}}.

    Raises ValueError if no particles can be made from the numbers in the scene.
    """
    if scene.model.cells:
        from discsim.initial import cells

        return cells.particles(scene)
    given = _with_grain_sizes(scene, start_of(scene).particles(scene))
    if scene.table("growth") is None:
        return given
    from discsim.initial.small import move_small_dust

    return move_small_dust(scene, given)


def _with_grain_sizes(scene: Scene, given: Given) -> Given:
    """Return `given` with grain sizes and the matching masses of dust particles added.

    Return `given` unchanged if no population has a size distribution, or if the start sets sizes itself.
    """
    dust = given.get("dust")
    if dust is None or "size" in dust or not any(map(has_sizes, scene.dust or ())):
        return given
    size, factor = np.empty((2, len(dust["mass"])))
    species = dust.get("species", np.zeros(len(size), np.int64))
    for number, population in enumerate(scene.dust):
        members = np.flatnonzero(species == number)
        size[members], factor[members] = sampled_sizes(population, len(members))
    return given | {"dust": dust | {"size": size, "mass": dust["mass"] * factor}}


def joined(parts: Sequence[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the arrays of several groups of particles, concatenated by name."""
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def populations(scene: Scene, make: Callable[[Any], dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the arrays of all dust populations, concatenated, with the index of the population as `species` (n,).

    make: function that returns the arrays of one population.
    """
    parts = [make(population) for population in scene.dust or ()]
    return joined([part | {"species": np.full(len(part["mass"]), number)} for number, part in enumerate(parts)])


def make_state(scene: Scene, given: Given) -> State:
    """Return a State with copies of the particle arrays `given`, {species: {name: array}}.

    Raises ValueError if a position, velocity or mass is not finite, or if a mass is not positive.
    """
    gas = _make_gas(scene, given["gas"]) if "gas" in given else None
    dust = None
    if "dust" in given:
        arrays = given["dust"]
        species = np.array(arrays.get("species", np.zeros(len(arrays["mass"]))), np.int64)
        size = arrays.get("size")
        if size is None and scene.table("growth") is not None:
            size = np.full(len(species), scene.dust[0].grain_size)
        dust = Dust(
            **_common_arrays("dust", arrays, gas.count if gas is not None else 0),
            species=species,
            size=size,
            immobile=arrays.get("immobile"),
        )
    return State(scene, gas, dust, None)


def _common_arrays(name: str, given: dict[str, Any], first_id: int) -> dict[str, np.ndarray]:
    arrays = {key: np.array(given[key], float, order="C") for key in ("pos", "vel", "mass")}  # kernels need C order
    if not all(np.isfinite(array).all() for array in arrays.values()) or arrays["mass"].min() <= 0.0:
        raise ValueError(
            f"the start gives {name} with values that are not finite, or without mass; expected less extreme values"
        )
    return arrays | {
        "acc": np.zeros_like(arrays["pos"]),
        "ids": np.arange(first_id, first_id + len(arrays["mass"]), dtype=np.int64),
    }


def _make_gas(scene: Scene, given: dict[str, Any]) -> Gas:
    from discsim.physics.eos import eos_of, initial_energy, radius

    common = _common_arrays("gas", given, 0)
    n, dim = common["pos"].shape
    u = given.get("u")
    small = None
    if scene.table("growth") is not None:
        small = np.array(given.get("small", np.zeros(n)), float)
    if not eos_of(scene).holds_heat:
        u = None
    elif u is not None:
        u = np.array(u, float)
    else:
        u = initial_energy(scene, radius(common["pos"]))
        if small is not None and growth.small_dust_in_mass(scene):  # u is per total mass, but only gas holds heat
            u = u * (1.0 - small / common["mass"])
    if scene.gas.smoothing_length is not None:
        h = np.full(n, scene.gas.smoothing_length)
    else:
        volume = float(np.prod(scene.space.size))
        density = np.asarray(given.get("density", common["mass"].sum() / volume))
        h = scene.gas.eta * (common["mass"] / density) ** (1.0 / dim)
    viscous = scene.alpha_viscosity is not None
    foreseen = scene.gas.viscosity is not None or viscous or u is not None
    heated = u is not None and scene.drag is not None and scene.drag.heating
    return Gas(
        **common,
        h=h,
        density=np.zeros(n),
        gradh=np.ones(n),
        pressure=np.zeros(n),
        sound_speed=np.zeros(n),
        u=u,
        heating_rate=None if u is None else np.zeros(n),
        kick_rate=None if u is None else np.zeros(n),
        kick_acc=np.zeros((n, dim)) if foreseen else None,
        pressure_acc=np.zeros((n, dim)) if heated else None,
        pressure_vel=np.zeros((n, dim)) if heated else None,
        radiated=None if scene.cooling is None else np.zeros(n),
        immobile=given.get("immobile"),
        nu=np.zeros(n) if viscous else None,
        small=small,
        **({} if scene.gas.quiet is None or scene.star is None else {name: np.zeros(n) for name in FOLLOWED}),
        h_before=h.copy() if scene.gas.smoothing_length is None and not scene.model.cells else None,
    )
