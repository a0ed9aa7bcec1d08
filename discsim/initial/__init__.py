"""Initial conditions ("starts"), one module each, and the conversion of their arrays into a `State`.

A start makes its particles as {species: {name: array}}. The species are "gas" and "dust". The arrays of a species are
pos, vel (n, dimensions), mass (n,) and, optionally, density (n,) (of gas, a first guess for h), u (n,), species (n,)
(index of the dust population), size (n,), small (n,), immobile (n,) and across (n,) (azimuthal velocity in a shearing
box). `base.py` describes all that a start provides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.numerics.state import FOLLOWED, Dust, Gas, State
from discsim.parts import STARTS, Lazy, import_object
from discsim.physics.grains import has_sizes, sampled_sizes

if TYPE_CHECKING:
    from discsim.initial.base import Start
    from discsim.scene import Scene

growth = Lazy("discsim.physics.growth")
ParticleArrays = dict[str, dict[str, Any]]  # {species: {name: array}}
SPECIES = ("gas", "dust")


def random_stream(scene: Scene, species: str) -> np.random.Generator:
    """Return the random generator of a species. Each species has its own one, so that dust does not change the gas."""
    return np.random.default_rng([scene.run.seed, SPECIES.index(species)])


def start_of(scene: Scene) -> Start:
    """Return the `Start` that `initial.kind` of the scene names."""
    return STARTS[scene.initial.kind]


def start_time(scene: Scene) -> float:
    """Return the time at which a run of the scene begins."""
    of_start = None if scene.initial is None else start_of(scene).start_time
    return 0.0 if of_start is None else of_start(scene)


def make_particles(scene: Scene) -> ParticleArrays:
    """Return the particles of the scene's start, as {species: {name: array}}.

    Raises ValueError if no particles can be made from the numbers in the scene.
    """
    if scene.model.cells:
        return _particles_in_cells(scene)
    arrays = _with_grain_sizes(scene, start_of(scene).particles(scene))
    if scene.model.start_gas is not None and start_of(scene).radial is not None:
        arrays = arrays | {"gas": import_object(scene.model.start_gas)(scene)}
    return arrays if scene.table("growth") is None else _with_small_dust(scene, arrays)


def _particles_in_cells(scene: Scene) -> ParticleArrays:
    """Return one particle of gas and one of dust at the centre of each cell of a fixed 1D grid."""
    count, length = scene.gas.particles, scene.space.size[0]
    dx = length / count
    x = (np.arange(count) + 0.5) * dx - (0.5 * length if scene.centred else 0.0)
    cell_values = start_of(scene).cell_values
    assert cell_values is not None
    density, vel, u = cell_values(scene, x, dx)
    out: ParticleArrays = {name: {"pos": x[:, None], "vel": vel[name][:, None]} for name in SPECIES}
    out["gas"] |= {"mass": density * dx, "density": density} | ({} if u is None else {"u": u})
    out["dust"] |= {"mass": scene.dust[0].ratio * density * dx}
    return out


def _with_grain_sizes(scene: Scene, arrays: ParticleArrays) -> ParticleArrays:
    """Return the particle arrays with the grain size of each dust particle added, and its mass changed accordingly.

    Return `arrays` unchanged if no population has a size distribution, or if the start sets sizes itself.
    """
    dust = arrays.get("dust")
    if dust is None or "size" in dust or not any(map(has_sizes, scene.dust or ())):
        return arrays
    size, factor = np.empty((2, len(dust["mass"])))
    species = dust.get("species", np.zeros(len(size), np.int64))
    for number, population in enumerate(scene.dust):
        members = np.flatnonzero(species == number)
        size[members], factor[members] = sampled_sizes(population, len(members))
    return arrays | {"dust": dust | {"size": size, "mass": dust["mass"] * factor}}


def _with_small_dust(scene: Scene, arrays: ParticleArrays) -> ParticleArrays:
    """Return the particle arrays with a part of the dust mass moved to gas particles, as their array `small` (n,).

    The fraction small_ratio / dust.ratio of the dust mass is moved, to gas between the radii of the dust, in
    proportion to the dust-to-gas ratio of the start at each radius. At least the fraction SEED of the dust mass
    stays, because dust particles need a mass. The total mass of dust is conserved. Arrays from a snapshot are
    returned unchanged: they already contain `small`.
    """
    gas, dust, start = arrays["gas"], arrays["dust"], start_of(scene)
    if start.restore is not None:
        return arrays
    (population,) = scene.dust or ()
    r = np.sqrt((gas["pos"] ** 2).sum(axis=1))
    inside = (r >= (population.inner or 0.0)) & (r <= (population.outer or np.inf))
    weight = np.where(inside, gas["mass"], 0.0)
    if start.radial is not None and (share := start.radial(scene).dust_share) is not None:
        weight *= share(r)
    if not weight.sum() > 0.0:
        return arrays
    left = max(1.0 - growth.small_ratio(scene) / population.ratio, growth.SEED)
    gas = gas | {"small": weight * ((1.0 - left) * dust["mass"].sum() / weight.sum())}
    return arrays | {
        "gas": add_small_dust(gas) if growth.gas_mass_includes_small_dust(scene) else gas,
        "dust": dust | {"mass": left * dust["mass"]},
    }


def add_small_dust(gas: dict[str, Any], sign: float = 1.0) -> dict[str, Any]:
    """Return the arrays of gas with the mass of small dust, its array `small`, added to its array `mass`.

    sign: 1 to add, -1 to subtract. `density` and `u`, the energy per mass, change accordingly.
    """
    factor = 1.0 + sign * gas["small"] / gas["mass"]
    per_mass = {"u": gas["u"] / factor} if gas.get("u") is not None else {}
    return gas | {"mass": gas["mass"] * factor, "density": gas["density"] * factor} | per_mass


def particles_at_rest(pos: np.ndarray, mass: np.ndarray | float) -> dict[str, np.ndarray]:
    """Return the arrays of particles at rest at the positions `pos` (n, d). mass: masses (n,), or one mass for all."""
    return {"pos": pos, "vel": np.zeros_like(pos), "mass": np.full(len(pos), mass)}


def concatenate_groups(groups: Sequence[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the arrays of several groups of particles, concatenated by name."""
    return {key: np.concatenate([group[key] for group in groups]) for key in groups[0]}


def make_populations(scene: Scene, make: Callable[[Any], dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the arrays of all dust populations, concatenated, with the index of the population as `species` (n,).

    make: function that returns the arrays of the particles of one population.
    """
    groups = [make(population) for population in scene.dust or ()]
    return concatenate_groups([group | {"species": np.full(len(group["mass"]), k)} for k, group in enumerate(groups)])


def make_state(scene: Scene, arrays: ParticleArrays) -> State:
    """Return a State with copies of the particle arrays, {species: {name: array}}.

    Raises ValueError if a position, velocity or mass is not finite, or if a mass is not positive.
    """
    gas = _make_gas(scene, arrays["gas"]) if "gas" in arrays else None
    dust = _make_dust(scene, arrays["dust"], gas.count if gas is not None else 0) if "dust" in arrays else None
    return State(scene, gas, dust, None)


def _make_dust(scene: Scene, given: dict[str, Any], first_id: int) -> Dust:
    """Return the dust with copies of the arrays `given`; its ids begin at `first_id`."""
    species = np.array(given.get("species", np.zeros(len(given["mass"]))), np.int64)
    size = given.get("size")
    if size is None and scene.table("growth") is not None:
        size = np.full(len(species), scene.dust[0].grain_size)
    return Dust(
        **_common_arrays(scene, "dust", given, first_id), species=species, size=size, immobile=given.get("immobile")
    )


def _common_arrays(scene: Scene, name: str, given: dict[str, Any], first_id: int) -> dict[str, np.ndarray]:
    """Return the arrays that gas and dust have in common: copies of pos, vel and mass, and acc and ids.

    name: name of the species, for the message of the ValueError. first_id: id of the first particle.
    """
    arrays = {key: np.array(given[key], float, order="C") for key in ("pos", "vel", "mass")}  # kernels need C order
    if not all(np.isfinite(array).all() for array in arrays.values()) or arrays["mass"].min() <= 0.0:
        raise ValueError(
            f"the start makes {name} with positions, velocities or masses that are not finite, or masses that are not "
            "positive; choose less extreme values in the scene"
        )
    ids = np.arange(first_id, first_id + len(arrays["mass"]), dtype=np.int64)
    arrays |= {"acc": np.zeros_like(arrays["pos"]), "ids": ids}
    if scene.table("shearing_box") is None:
        return arrays
    rest = np.zeros(len(ids))
    return arrays | {"across": np.array(given.get("across", rest), float), "across_acc": rest.copy()}


def _make_gas(scene: Scene, given: dict[str, Any]) -> Gas:
    """Return the gas with copies of the arrays `given`, and with all arrays that the effects of the scene need."""
    from discsim.physics.eos import eos_of, initial_energy, radius

    common = _common_arrays(scene, "gas", given, 0)
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
        if small is not None and growth.gas_mass_includes_small_dust(
            scene
        ):  # u is per total mass, but only gas holds heat
            u = u * (1.0 - small / common["mass"])
    if scene.gas.smoothing_length is not None:
        h = np.full(n, scene.gas.smoothing_length)
    else:
        volume = float(np.prod(scene.space.size))
        density = np.asarray(given.get("density", common["mass"].sum() / volume))
        h = scene.gas.eta * (common["mass"] / density) ** (1.0 / dim)
    viscous = scene.alpha_viscosity is not None
    of_model = scene.model.arrays
    has_kick_acc = scene.gas.viscosity is not None or viscous or u is not None or "kick_acc" in of_model
    extrapolated = u is not None and "last_pressure_acc" in of_model
    by_drag = u is not None and scene.drag is not None and scene.drag.heating
    return Gas(
        **common,
        h=h,
        density=np.zeros(n),
        pressure=np.zeros(n),
        sound_speed=np.zeros(n),
        u=u,
        heating_rate=None if u is None else np.zeros(n),
        kick_rate=None if u is None else np.zeros(n),
        kick_acc=np.zeros((n, dim)) if has_kick_acc else None,
        pressure_acc=np.zeros((n, dim)) if extrapolated or by_drag else None,
        pressure_vel=np.zeros((n, dim)) if by_drag else None,
        last_heating_rate=np.zeros(n) if extrapolated else None,
        last_pressure_acc=np.zeros((n, dim)) if extrapolated else None,
        radiated=None if scene.cooling is None else np.zeros(n),
        immobile=given.get("immobile"),
        nu=np.zeros(n) if viscous else None,
        small=small,
        **({} if scene.gas.quiet is None or scene.star is None else {name: np.zeros(n) for name in FOLLOWED}),
        gradh=np.ones(n) if "gradh" in of_model else None,
        h_before=h.copy() if "h_before" in of_model and scene.gas.smoothing_length is None else None,
    )
