"""Particle arrays that the caller passes in place of [initial]: validation, and copies in code units.

Each message names the array, the expected shape or value, and the first wrong entry.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.initial import SPECIES, Given
from discsim.parts import Lazy
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_individual_sizes
from discsim.scene import SceneError, near, tomltext
from discsim.scene.fields import shown
from discsim.scene.units import UnitError

if TYPE_CHECKING:
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")
REQUIRED_ARRAYS = ("pos", "vel", "mass")
KNOWN_ARRAYS = {
    "gas": (*REQUIRED_ARRAYS, "u", "density", "small", "immobile"),
    "dust": (*REQUIRED_ARRAYS, "species", "size", "immobile"),
}
MEASURE = {"pos": "length", "size": "length", "vel": "velocity", "u": "specific_energy", "density": "density"}
NOT_NEGATIVE = ("small",)
POSITIVE = ("mass", "u", "density", "size")
LARGEST = 1e150  # bound of all values: squares do not overflow
MAX_MASS_RATIO = 1e12  # largest ratio of gas masses: beyond, sums lose light particles and time steps become tiny


class _ArrayError(Exception):
    """Error for a fault of one array."""


def read(scene: Scene, particles: Any) -> Given:
    """Check the caller's arrays, and return copies as {species: {name: array}} in code units.

    Positions are wrapped into a periodic box. Raises SceneError with all problems.
    """
    if not isinstance(particles, Mapping):
        raise SceneError([f"particles: {_type_text(particles)} is not a dict; expected one of {_quoted(SPECIES)}"])
    problems = [f"particles: {shown(name)} is unknown; expected {_quoted(SPECIES)}{near(str(name), SPECIES)}"
                for name in particles if name not in SPECIES]  # fmt: skip
    given: Given = {}
    for name in SPECIES:
        if (getattr(scene, name) is None) != (name not in particles):
            have = "no particles are given for this table" if name not in particles else "the scene has no such table"
            problems.append(f"[{name}]: {have}; expected both or neither")
        elif name in particles:
            given[name], faults = _read_species(scene, name, particles[name])
            problems += [f"particles: {name} {fault}" for fault in faults]
    if problems:
        raise SceneError(problems)
    return given


def counted(scene: Scene, given: Given) -> Scene:
    """Return the scene with its particle numbers replaced by the numbers of movable particles in the arrays `given`."""
    values: list[tuple[list[str], int]] = []
    update: dict[str, Any] = {}
    if "gas" in given:
        count = _count_movable(given["gas"])
        values.append((["gas", "particles"], count))
        update["gas"] = scene.gas.model_copy(update={"particles": count})
    if "dust" in given:
        counts = [_count_movable(given["dust"], number) for number in range(len(scene.dust))]
        update["dust"] = tuple(p.model_copy(update={"particles": n}) for p, n in zip(scene.dust, counts, strict=True))
        data = tomllib.loads(scene.text)
        listed = isinstance(data["dust"], list)
        values += [(["dust", *([str(k)] if listed else []), "particles"], n) for k, n in enumerate(counts)]
    data = tomllib.loads(scene.text)
    for path, value in values:
        tomltext.set_value(data, path, value)
    return scene.model_copy(update=update | {"text": tomltext.edit(scene.text, data, values, [])})


def _count_movable(arrays: Mapping[str, Array], species: int | None = None) -> int:
    """Count the particles that can move. species: index of a population; None: all particles."""
    chosen = np.ones(len(arrays["mass"]), bool) if species is None else arrays["species"] == species
    return int(np.count_nonzero(chosen & ~arrays.get("immobile", np.zeros(len(chosen), bool))))


def _read_species(scene: Scene, name: str, given: Any) -> tuple[dict[str, Array], list[str]]:
    if not isinstance(given, Mapping):
        return {}, [f"{_type_text(given)} is not a dict of arrays; expected {_quoted(REQUIRED_ARRAYS)}"]
    given = {key: values for key, values in given.items() if values is not None}
    known = KNOWN_ARRAYS[name]
    faults = [f"has an unknown array {shown(key)}; expected {_quoted(known)}{near(str(key), known)}"
              for key in given if key not in known]  # fmt: skip
    faults += [f"{key} is missing{why}" for key, why in _missing_arrays(scene, name, given)]
    if "u" in given and name == "gas" and not eos_of(scene).holds_heat:
        faults.append(
            f'u is given, but the gas is "{scene.gas.eos.kind}", which has no energy equation; expected no array u'
        )
    if name == "dust" and "size" in given and not has_individual_sizes(scene):
        faults.append("size is given, but dust.grain_size is not a size distribution; expected no array size")
    if "small" in given and name == "gas" and scene.table("growth") is None:
        faults.append("small is given, but there is no [growth]; expected a table [growth] too, or no array small")
    arrays: dict[str, Array] = {}
    count = None
    for key in known:
        if key not in given:
            continue
        try:
            arrays[key] = _read_array(scene, name, key, given[key], count)
        except _ArrayError as fault:
            faults.append(f"{key}{fault}")
            continue
        count = len(arrays[key]) if count is None else count
    return arrays, faults or list(_faults_between_arrays(scene, name, arrays))


def _missing_arrays(scene: Scene, name: str, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for key in REQUIRED_ARRAYS:
        if key not in given:
            yield key, f"; expected {_quoted(REQUIRED_ARRAYS)}"
    if name == "dust" and len(scene.dust) > 1 and "species" not in given:
        yield "species", f"; expected the number of each particle's population, 0 to {len(scene.dust) - 1}"
    if name == "dust" and has_individual_sizes(scene) and "size" not in given and scene.table("growth") is None:
        yield "size", "; expected the radius of each particle's grains, as dust.grain_size is a size distribution"
    eos: Any = scene.gas.eos if scene.gas else None
    if name == "gas" and eos_of(scene).holds_heat and "u" not in given and not (eos.sound_speed or eos.aspect_ratio):
        yield "u", "; expected energies, or gas.eos.sound_speed or gas.eos.aspect_ratio in the scene"


def _read_array(scene: Scene, name: str, key: str, values: Any, count: int | None) -> Array:
    """Return the checked array `key` of the species `name` in code units. Raises _ArrayError.

    count: number of particles, if another array has set it.
    """
    array = _to_numbers(scene, key, values)
    dim = scene.space.dimensions
    n = "n" if count is None else str(count)
    wanted = f"({n}, {dim})" if key in ("pos", "vel") else f"({n},)"
    if key == "density" and array.shape == ():
        array = np.full(count or 0, float(array))
    ends = (dim,) if key in ("pos", "vel") else ()
    if array.ndim < 1 or array.shape[1:] != ends or len(array) == 0 or (count is not None and len(array) != count):
        raise _ArrayError(f" has shape {array.shape}; expected {wanted}")
    if key == "immobile":
        return _require(array, (array == 0) | (array == 1), "true or false").astype(bool)
    if key == "species":
        last = len(scene.dust) - 1
        right = (array >= 0) & (array <= last) & (array == np.floor(array))
        return _require(array, right, f"a population of the scene, 0 to {last}").astype(np.int64)
    _require(array, np.isfinite(array), "a finite number")
    if key in POSITIVE:
        _require(array, array > 0.0, "a positive number")
    if key in NOT_NEGATIVE:
        _require(array, array >= 0.0, "0 or a positive number")
    _require(array, np.abs(array) < LARGEST, f"less than {LARGEST:g} code units")
    if key == "pos" and scene.space.boundary == "periodic":
        size = np.array(scene.space.size)
        array %= size
        array[array >= size] = 0.0  # a tiny negative coordinate rounds up to the edge
    return array


def _to_numbers(scene: Scene, key: str, values: Any) -> Array:
    """Return a C-ordered float copy of `values` in code units, as kernels need it. Raises _ArrayError."""
    # In 1D a mass is a column: mass over area.
    measure = MEASURE.get(key, "mass" if scene.space.dimensions == 2 else "surface_density")
    plain = key in ("species", "immobile")
    try:
        if hasattr(values, "unit") and not plain:
            values = scene.units.in_code(values, measure)
        array = np.asarray(values)
        if array.dtype.kind not in "biuf" or (array.dtype.kind == "b" and not plain):
            raise TypeError
        return np.array(array, float, order="C")
    except UnitError as error:
        raise _ArrayError(f": {error}") from None
    except (TypeError, ValueError):
        raise _ArrayError(f": {_type_text(values)} cannot be read as an array of numbers") from None


def _require(array: Array, right: Array, words: str) -> Array:
    if right.all():
        return array
    index = tuple(int(i) for i in np.argwhere(~right)[0])
    place = ", ".join(str(i) for i in index)
    raise _ArrayError(f"[{place}] is {array[index]:g}; expected {words}")


def _faults_between_arrays(scene: Scene, name: str, arrays: dict[str, Array]) -> Iterator[str]:
    """Yield problems that can be found only in all arrays of a species together.

    Adds the array `species`, with the default 0, to the arrays of dust that have none.
    """
    if name == "gas":
        mass = arrays["mass"]
        if mass.max() > MAX_MASS_RATIO * mass.min():
            heavy, light = int(mass.argmax()), int(mass.argmin())
            yield (
                f"mass[{heavy}] is {mass[heavy] / mass[light]:.3g} times mass[{light}]; expected at most "
                f"{MAX_MASS_RATIO:g} times, for accurate SPH sums"
            )
        if "small" in arrays and growth.small_dust_in_mass(scene):
            most = arrays["small"] - mass
            if most.max() >= 0.0:
                i = int(most.argmax())
                yield f"small[{i}] is {arrays['small'][i]:g}, not below mass[{i}] = {mass[i]:g}; expected less"
        if _count_movable(arrays) == 0:
            yield "immobile is true for all particles; expected some that can move"
        return
    arrays.setdefault("species", np.zeros(len(arrays["mass"]), np.int64))
    for number in range(len(scene.dust)):
        if _count_movable(arrays, number) == 0:
            yield (
                f"species {number} has no particle that can move; expected some in each population, 0 to "
                f"{len(scene.dust) - 1}"
            )


def _quoted(names: tuple[str, ...]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def _type_text(value: Any) -> str:
    return f"a {type(value).__name__}"
