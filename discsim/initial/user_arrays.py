"""Particle arrays that the user passes to `Simulation` in place of [initial]: validation, and copies in code units.

Each message names the array, its first wrong entry, and the expected shape or value.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import SPECIES, ParticleArrays
from discsim.parts import Lazy
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_individual_sizes
from discsim.scene import SceneError, nearest_hint, tomltext
from discsim.scene.fields import shown
from discsim.scene.units import UnitError

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")
REQUIRED_ARRAYS = ("pos", "vel", "mass")
KNOWN_ARRAYS = {
    "gas": (*REQUIRED_ARRAYS, "u", "density", "small", "immobile", "across"),
    "dust": (*REQUIRED_ARRAYS, "species", "size", "immobile", "across"),
}
DIMENSIONS = {
    "pos": "length", "size": "length", "vel": "velocity", "across": "velocity", "u": "specific_energy",
    "density": "density",
}  # fmt: skip
NOT_NEGATIVE = ("small",)
POSITIVE = ("mass", "u", "density", "size")
LARGEST = 1e150  # bound of all values: squares do not overflow
MAX_MASS_RATIO = 1e12  # largest ratio of gas masses; above it, sums lose light particles and time steps become tiny


class _ArrayError(Exception):
    """Error for an invalid array; its text follows the name of the array in a message."""


def read_arrays(scene: Scene, particles: Any) -> ParticleArrays:
    """Check the user's particle arrays, and return copies in code units, {species: {name: array}}.

    Positions are wrapped into a periodic box. Raises SceneError with all problems.
    """
    if not isinstance(particles, Mapping):
        raise SceneError(
            [f"particles: {_type_text(particles)} is not a dict; expected arrays by species: {_quoted(SPECIES)}"]
        )
    problems = [f"particles: {shown(name)} is unknown; expected {_quoted(SPECIES)}{nearest_hint(str(name), SPECIES)}"
                for name in particles if name not in SPECIES]  # fmt: skip
    arrays: ParticleArrays = {}
    for name in SPECIES:
        if (getattr(scene, name) is None) != (name not in particles):
            if name in particles:
                wrong = f"particles are given without this table; add the table, or remove the key {name} of particles"
            else:
                wrong = f'particles has no key "{name}"; add the key, or remove the table'
            problems.append(f"[{name}]: {wrong}")
        elif name in particles:
            arrays[name], faults = _read_species(scene, name, particles[name])
            problems += [f"particles: {name} {fault}" for fault in faults]
    if problems:
        raise SceneError(problems)
    return arrays


def with_particle_counts(scene: Scene, arrays: ParticleArrays) -> Scene:
    """Return the scene with its particle numbers replaced by the numbers of movable particles in `arrays`."""
    data = tomllib.loads(scene.text)
    values: list[tuple[list[str], int]] = []
    update: dict[str, Any] = {}
    if "gas" in arrays:
        count = _count_movable(arrays["gas"])
        values.append((["gas", "particles"], count))
        update["gas"] = scene.gas.model_copy(update={"particles": count})
    if "dust" in arrays:
        counts = [_count_movable(arrays["dust"], number) for number in range(len(scene.dust))]
        update["dust"] = tuple(p.model_copy(update={"particles": n}) for p, n in zip(scene.dust, counts, strict=True))
        listed = isinstance(data["dust"], list)
        values += [(["dust", *([str(k)] if listed else []), "particles"], n) for k, n in enumerate(counts)]
    for path, value in values:
        tomltext.set_value(data, path, value)
    return scene.model_copy(update=update | {"text": tomltext.edit(scene.text, data, values, [])})


def _count_movable(arrays: Mapping[str, Array], species: int | None = None) -> int:
    """Return the number of particles that can move. species: index of the population to count; None: all particles."""
    chosen = np.ones(len(arrays["mass"]), bool) if species is None else arrays["species"] == species
    return int(np.count_nonzero(chosen & ~arrays.get("immobile", np.zeros(len(chosen), bool))))


def _read_species(scene: Scene, name: str, given: Any) -> tuple[dict[str, Array], list[str]]:
    """Return the arrays of the species `name` in code units, and the problems of the user's arrays `given`, as text."""
    if not isinstance(given, Mapping):
        return {}, [f"is {_type_text(given)}; expected a dict with the arrays {_quoted(REQUIRED_ARRAYS)}"]
    given = {key: values for key, values in given.items() if values is not None}
    known = KNOWN_ARRAYS[name]
    faults = [f"has an unknown array {shown(key)}; expected {_quoted(known)}{nearest_hint(str(key), known)}"
              for key in given if key not in known]  # fmt: skip
    faults += [f"{key} is missing{why}" for key, why in _missing_arrays(scene, name, given)]
    if "u" in given and name == "gas" and not eos_of(scene).holds_heat:
        faults.append(
            f'u is given, but the gas is "{scene.gas.eos.kind}", which has no energy equation; remove the array "u"'
        )
    if name == "dust" and "size" in given and not has_individual_sizes(scene):
        faults.append('size is given, but dust.grain_size is not a size distribution; remove the array "size"')
    if "small" in given and name == "gas" and scene.table("growth") is None:
        faults.append('small is given, but there is no table [growth]; add [growth], or remove the array "small"')
    in_box = scene.table("shearing_box") is not None
    if "across" in given and not in_box:
        faults.append('across is given, but there is no table [shearing_box]; add it, or remove the array "across"')
    if "immobile" in given and in_box:
        faults.append("immobile is given, but particles of a [shearing_box] all move; remove the array")
    arrays: dict[str, Array] = {}
    count = None
    for key in (key for key in known if key in given):
        try:
            arrays[key] = _read_array(scene, name, key, given[key], count)
        except _ArrayError as fault:
            faults.append(f"{key}{fault}")
            continue
        count = len(arrays[key]) if count is None else count
    return arrays, faults or list(_problems_between_arrays(scene, name, arrays))


def _missing_arrays(scene: Scene, name: str, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield (name, what is expected as text) for each required array of a species that is not in `given`."""
    for key in REQUIRED_ARRAYS:
        if key not in given:
            yield key, f"; give all of the arrays {_quoted(REQUIRED_ARRAYS)}"
    if name == "dust" and len(scene.dust) > 1 and "species" not in given:
        yield "species", f"; add an array of the index of each particle's population, 0 to {len(scene.dust) - 1}"
    if name == "dust" and has_individual_sizes(scene) and "size" not in given and scene.table("growth") is None:
        yield (
            "size",
            "; add an array of the radius of each particle's grains, as dust.grain_size is a size distribution",
        )
    eos: Any = scene.gas.eos if scene.gas else None
    if name == "gas" and eos_of(scene).holds_heat and "u" not in given and not (eos.sound_speed or eos.aspect_ratio):
        yield "u", "; add an array of energies, or gas.eos.sound_speed or gas.eos.aspect_ratio to the scene"


def _read_array(scene: Scene, name: str, key: str, values: Any, count: int | None) -> Array:
    """Return the array `key` of the species `name` in code units, after checks. Raises _ArrayError.

    values: array of the user. count: number of particles in the arrays read before; None: this is the first.
    """
    array = _to_numbers(scene, key, values)
    dim = scene.space.dimensions
    if key == "density" and array.shape == ():
        array = np.full(count or 0, float(array))
    ends = (dim,) if key in ("pos", "vel") else ()
    if array.ndim < 1 or array.shape[1:] != ends or len(array) == 0 or (count is not None and len(array) != count):
        expected = ", ".join(map(str, ("n" if count is None else count, *ends)))
        raise _ArrayError(f" has shape {array.shape}; expected ({expected}{'' if ends else ','})")
    if key == "immobile":
        return _require_valid(array, (array == 0) | (array == 1), "true or false").astype(bool)
    if key == "species":
        last = len(scene.dust) - 1
        valid = (array >= 0) & (array <= last) & (array == np.floor(array))
        return _require_valid(array, valid, f"a population of the scene, 0 to {last}").astype(np.int64)
    _require_valid(array, np.isfinite(array), "a finite number")
    if key in POSITIVE:
        _require_valid(array, array > 0.0, "a positive number")
    if key in NOT_NEGATIVE:
        _require_valid(array, array >= 0.0, "0 or a positive number")
    _require_valid(array, np.abs(array) < LARGEST, f"less than {LARGEST:g} code units")
    if key == "pos" and scene.space.boundary == "periodic":
        size = np.array(scene.space.size)
        array %= size
        array[array >= size] = 0.0  # a tiny negative coordinate rounds up to the edge
    return array


def _to_numbers(scene: Scene, key: str, values: Any) -> Array:
    """Return a C-ordered float copy of `values` in code units, as kernels need it. Raises _ArrayError."""
    # In 1D the mass of a particle is a mass per area.
    dimension = DIMENSIONS.get(key, "mass" if scene.space.dimensions == 2 else "surface_density")
    plain = key in ("species", "immobile")
    try:
        if hasattr(values, "unit") and not plain:
            values = scene.units.in_code(values, dimension)
        array = np.asarray(values)
        if array.dtype.kind not in "biuf" or (array.dtype.kind == "b" and not plain):
            raise TypeError
        return np.array(array, float, order="C")
    except UnitError as error:
        raise _ArrayError(f": {error}") from None
    except (TypeError, ValueError):
        raise _ArrayError(f": {_type_text(values)} cannot be read as an array of numbers") from None


def _require_valid(array: Array, valid: Array, expected: str) -> Array:
    """Return `array` if all entries of the mask `valid` are True. Raises _ArrayError for the first invalid entry.

    expected: description of valid entries, for the message.
    """
    if valid.all():
        return array
    index = tuple(int(i) for i in np.argwhere(~valid)[0])
    raise _ArrayError(f"[{', '.join(map(str, index))}] is {array[index]:g}; expected {expected}")


def _problems_between_arrays(scene: Scene, name: str, arrays: dict[str, Array]) -> Iterator[str]:
    """Yield problems of the arrays of a species that a single array does not show.

    If `arrays` of dust have no array `species`, an array of zeros is added.
    """
    if name == "gas":
        mass = arrays["mass"]
        if mass.max() > MAX_MASS_RATIO * mass.min():
            heavy, light = int(mass.argmax()), int(mass.argmin())
            yield (
                f"mass[{heavy}] is {mass[heavy] / mass[light]:.3g} times mass[{light}]; expected at most "
                f"{MAX_MASS_RATIO:g} times, for accurate SPH sums"
            )
        if "small" in arrays and growth.gas_mass_includes_small_dust(scene):
            excess = arrays["small"] - mass
            if excess.max() >= 0.0:
                i = int(excess.argmax())
                yield (
                    f"small[{i}] is {arrays['small'][i]:g}, not below mass[{i}] = {mass[i]:g}; expected "
                    f"less than the particle's mass"
                )
        if _count_movable(arrays) == 0:
            yield "immobile is true for all particles; set immobile to false for some particles"
        return
    arrays.setdefault("species", np.zeros(len(arrays["mass"]), np.int64))
    for number in range(len(scene.dust)):
        if _count_movable(arrays, number) == 0:
            yield (
                f"species {number} has no particle that can move; expected such particles in each population, 0 to "
                f"{len(scene.dust) - 1}"
            )


def _quoted(names: tuple[str, ...]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def _type_text(value: Any) -> str:
    return f"a {type(value).__name__}"
