"""The start `initial.kind = "snapshot"`: particles from a snapshot of an earlier run, also with other effects.

The particles may be refined or thinned. The time of the new run starts at 0, or with `keep_time` at the time of the
snapshot. Stored times, such as the start of a companion's ramp, are shifted to the new time.

If only the start and the output of the scene differ, the new run continues the old one to rounding (`open_step.py`).
With other physics it starts from the velocities in the snapshot, which are at the time of the positions, relative to
the centre of the disc. A star and companions with unchanged keys continue along their orbits; other bodies start as in
their tables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.formulas.polar import shape_of_cells
from discsim.initial import add_small_dust, random_stream
from discsim.initial.base import SamplePoints, Start
from discsim.initial.refine import refine_particles, thin_particles, thinning_range
from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_individual_sizes
from discsim.physics.orbits import ContinuedBody, Orbits
from discsim.scene import SceneError, load_scene
from discsim.scene.differences import FREE_TO_CHANGE, differences
from discsim.scene.fields import AllowedValues, Count, InputFile, Length, Table, fault
from discsim.scene.orbits import show_plain_time

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.output.snapshot import Snapshot, SnapshotParticles
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

snapshots = Lazy("discsim.output.snapshot")  # imports h5py
growth, regrid = Lazy("discsim.physics.growth"), Lazy("discsim.initial.regrid")
Array = np.ndarray
MAX_FACTOR = 1000  # largest factor of refining or thinning
ORBIT_KEYS = ("mass", "semi_major_axis", "eccentricity", "phase", "orbit")  # keys of a companion that set its orbit
MAX_RINGS = 40  # largest number of rings for the preview (`discsim check`)
SAME_RING = 1e-9  # particles on a ring of a quiet start have the same radius, to this relative difference


@dataclass(frozen=True)
class SnapshotFile(InputFile):
    """A snapshot as an input file of a scene, with the numbers that the validation of the scene needs.

    `gas` is the number of gas particles, `dust` the number of particles of each dust population. `holds_heat` is
    True if the gas has an internal energy u, and `polar` if it is in cells of a polar grid. `time` is the snapshot's
    time in code units of the scene, `time_text` the same time as text.
    """

    gas: int = field(default=0, compare=False)
    dust: tuple[int, ...] = field(default=(), compare=False)
    dimensions: int = field(default=2, compare=False)
    holds_heat: bool = field(default=False, compare=False)
    polar: bool = field(default=False, compare=False)
    time: float = field(default=0.0, compare=False)
    time_text: str = field(default="0", compare=False)

    __str__ = InputFile.__str__


@lru_cache(maxsize=1)
def _cached_snapshot(file: SnapshotFile) -> Snapshot:
    """Return the snapshot in a file; the last one that was read is cached."""
    found: Snapshot = snapshots.read_snapshot(file.path)
    return found


def _validated_file(value: Any, info: ValidationInfo) -> SnapshotFile:
    """Return the value of `initial.file` in a scene as a SnapshotFile. Raises a `fault` if the file cannot be read."""
    found = InputFile.read(value, info)
    try:
        snap = _cached_snapshot(SnapshotFile(found.path, found.digest))
    except snapshots.SnapshotError as error:
        raise fault(f"{error}; use a snapshot of discsim") from None
    tables = snap.tables.get("dust", [])
    populations = len(tables) if isinstance(tables, list) else 1
    numbers = () if snap.dust is None else np.bincount(_population_of(snap.dust), minlength=populations)
    heat, polar = snap.gas is not None and snap.gas.u is not None, _is_polar(snap)
    if polar:
        try:
            shape_of_cells(snap.about_centre().gas.pos)
        except ValueError as error:
            raise fault(f"{found.path}: {error}, as its scene says; use a snapshot of discsim") from None
    gas = snap.gas.count if snap.gas is not None else 0
    units = (info.context or {}).get("units", snap.units)
    time = snap.time if units == snap.units else float(units.to_code(snap.quantity("time")))
    text = show_plain_time(snap.time, snap.units, snap.scene_text)
    return SnapshotFile(
        found.path, found.digest, gas, tuple(map(int, numbers)), snap.dimensions, heat, polar, time, text
    )


def _is_polar(snap: Snapshot) -> bool:
    """Return whether the gas of a snapshot is in cells of a polar grid."""
    table = snap.tables.get("gas")
    return snap.gas is not None and isinstance(table, dict) and table.get("method") == "grid"


KIND: Final = "snapshot"


class FromSnapshot(Table):
    """Particles of a snapshot, perhaps refined or thinned. Time starts at 0, or at the time of the snapshot."""

    kind: Literal["snapshot"] = KIND
    file: Annotated[
        Any, BeforeValidator(_validated_file), AllowedValues("path of a snapshot, relative to the scene's folder")
    ] = Field(description="snapshot whose particles the run starts with; the scene's particle numbers are not used")
    refine: Count = Field(1, ge=1, le=MAX_FACTOR, description="number of particles that replace each particle")
    thin: Count = Field(1, ge=1, le=MAX_FACTOR, description="number of particles merged into one")
    reference_radius: Length = Field(1.0, gt=0, description="radius at which values of power laws hold")
    keep_time: bool = Field(False, description="start at the time of the snapshot instead of t = 0")

    @property
    def sets_temperature(self) -> bool:
        return self.file.holds_heat

    @property
    def counts(self) -> dict[str, list[int]]:
        """Particle numbers of the gas, and of each dust population, after refining or thinning.

        Gas in polar cells has no number of particles.
        """
        gas, dust = [self.file.gas] if not self.file.polar else [], [*self.file.dust]
        return {name: [self.refine * len(range(*thinning_range(n, self.thin))) for n in numbers]
                for name, numbers in (("gas", gas), ("dust", dust))}  # fmt: skip


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    """Return the arrays of gas and dust at the start, by species and name, in code units of the scene."""
    start: Any = scene.initial
    snap = _cached_snapshot(start.file).about_centre()
    out = {}
    for name in ("gas", "dust"):
        held = getattr(snap, name)
        if getattr(scene, name) is None or held is None:
            continue
        arrays = _arrays_in_code_units(scene, name, held)
        if "small" in arrays:
            arrays = _with_masses_for_drag(scene, snap, arrays)
        if name == "gas" and (start.file.polar or scene.model.disc_cells is not None):
            out["gas"] = _regridded_gas(scene, snap, arrays)
            continue
        groups = [arrays]
        if start.thin > 1 or start.refine > 1:
            groups = []
            for k in range(len(scene.dust or ()) if name == "dust" else 1):
                rows = np.flatnonzero(_population_of(held) == k)
                group = {key: values[rows] for key, values in arrays.items()}
                groups.append(refine_particles(thin_particles(group, start.thin), start.refine))
        out[name] = {key: np.concatenate([group[key] for group in groups]) for key in arrays}
    return out


def _regridded_gas(scene: Scene, snap: Snapshot, gas: dict[str, Array]) -> dict[str, Array]:
    """Return the arrays `gas` of a snapshot in the cells of the scene's gas, or as particles if it has none."""
    held, cells_of = snap.gas, scene.model.disc_cells
    if not scene.initial.file.polar:
        assert held is not None and cells_of is not None
        reach = held.h * snap.support
        reach = reach if snap.units == scene.units else scene.units.to_code(snap.units.quantity(reach, "length"))
        return regrid.particles_to_cells(cells_of(scene), gas, reach)
    before = shape_of_cells(gas["pos"])
    if cells_of is not None:
        return regrid.cells_to_cells(before, cells_of(scene), gas)
    return regrid.cells_to_particles(before, gas, scene.gas.particles, random_stream(scene, "gas"))


def _with_masses_for_drag(scene: Scene, snap: Snapshot, gas: dict[str, Array]) -> dict[str, Array]:
    """Return the arrays `gas` of a snapshot with the masses of gas particles that the drag of the scene needs.

    With two-way drag, the masses include small dust; with one-way drag they do not. If the directions of drag of
    snapshot and scene differ, the mass of small dust is added or removed.
    """
    was_included = snap.tables["drag"].get("direction") != "one-way"
    is_included = growth.gas_mass_includes_small_dust(scene)
    return gas if was_included == is_included else add_small_dust(gas, 1.0 if is_included else -1.0)


def _population_of(held: SnapshotParticles) -> Array:
    """Return the index (n,) of the population of each dust particle; 0 if the snapshot stores none."""
    return np.zeros(held.count, np.int64) if held.species is None else held.species.astype(np.int64)


def _arrays_in_code_units(scene: Scene, name: str, held: SnapshotParticles) -> dict[str, Array]:
    """Return the arrays of the particles `held` that a start uses, in code units of the scene.

    `name` is their species, "gas" or "dust". If scene and snapshot have the same units, the values are copied bit for
    bit.
    """
    keys = ["pos", "vel", "mass", "immobile"]
    if name == "dust":
        keys += ["size"] if has_individual_sizes(scene) else []
    else:
        keys += ["density", *(["small"] if scene.table("growth") else []), *(["u"] if eos_of(scene).holds_heat else [])]
    arrays = {key: getattr(held, key) for key in keys if getattr(held, key) is not None}
    if name == "dust":
        arrays["species"] = _population_of(held)
    if held.units == scene.units:
        return {key: np.array(values) for key, values in arrays.items()}
    plain = ("species", "immobile")
    return {key: values if key in plain else scene.units.to_code(held.quantity(key)) for key, values in arrays.items()}


# Continuing a run


def _stored_scene(scene: Scene) -> Scene | None:
    """Return the scene stored in the snapshot from which `scene` starts, with the table [initial] of `scene`.

    None if the stored scene is invalid in this version of discsim.
    """
    path: Path = scene.initial.file.path
    start = {"kind": scene.initial.kind, "file": str(path)}
    try:
        return load_scene(_cached_snapshot(scene.initial.file).tables | {"initial": start}, folder=path.parent)
    except SceneError:
        return None


def continues_run(scene: Scene) -> bool:
    """Return whether a run of `scene` continues the run of its snapshot to rounding.

    The result is True if the snapshot has an open step, if its particles are neither refined nor thinned, if cells of
    the gas have the same number, and if no key that affects a step has changed.
    """
    start, before = scene.initial, _stored_scene(scene)
    if _cached_snapshot(start.file).open_step is None or before is None or start.refine > 1 or start.thin > 1:
        return False
    cells_of = scene.model.disc_cells
    if cells_of is not None and cells_of(scene).cells != start.file.gas:
        return False
    return not any(_affects_step(key) for key in differences(before, scene))


def _affects_step(key: str) -> bool:
    """Return whether a change of the key (like "gas.eta") affects a step."""
    table, _, last = key.rpartition(".")
    of_run = table == "run" and last != "integrator"
    return key not in FREE_TO_CHANGE and not of_run and table != "initial" and last not in ("particles", "every")


def start_time(scene: Scene) -> float:
    """Return the time at which the run begins."""
    return float(scene.initial.file.time) if scene.initial.keep_time else 0.0


def restore_open_step(state: State) -> None:
    """Set the time of `state`; if the run continues the snapshot's run, restore its arrays and clocks too."""
    if continues_run(state.scene):
        _restore_arrays(state)
    state.time = start_time(state.scene)
    if state.bodies is not None:
        state.bodies.begun += state.time


def _restore_arrays(state: State) -> None:
    """Set arrays and clocks of `state` to those of the snapshot's run between two steps (`open_step.py`)."""
    scene = state.scene
    snap = _cached_snapshot(scene.initial.file)
    step = snap.open_step
    state.velocity_lag, state.earlier = step.lag, step.step
    state.subcycle_clock = step.pace or state.subcycle_clock
    held = {**state.species, **({} if state.bodies is None else {"bodies": state.bodies})}
    for name, particles in held.items():
        shown: Any = getattr(snap, name)
        for key, array in {"pos": shown.pos, "vel": shown.vel, "ids": shown.ids, **step.arrays[name]}.items():
            if hasattr(particles, key):
                getattr(particles, key)[:] = array
    if state.gas is not None and state.gas.h_before is not None:
        state.gas.h[:] = state.gas.h_before
    if state.gas is not None and state.gas.last_pressure_acc is not None:
        state.gas.heating_rate[:] = state.gas.last_heating_rate
        state.gas.pressure_acc[:] = state.gas.last_pressure_acc
    if state.bodies is not None:
        state.bodies.begun -= snap.time
        Orbits(scene).set_bodies(state.bodies, 0.0)


def moving_bodies(scene: Scene) -> dict[int, ContinuedBody]:
    """Return the star (number 0) and the companions (from 1) whose keys are unchanged, by number.

    Each body has its position and velocity relative to the star, the mass that it has gained, and the time when its
    ramp began, relative to the time of the snapshot.
    """
    snap, before = _cached_snapshot(scene.initial.file), _stored_scene(scene)
    if snap.bodies is None or snap.open_step is None or before is None or snap.units != scene.units:
        return {}
    pos, vel, past = snap.bodies.pos, snap.bodies.vel, snap.open_step.arrays["bodies"]
    same = [before.star.mass == scene.star.mass]
    for old, new in zip(before.companion or (), scene.companion or (), strict=False):
        same.append(all(getattr(old, key) == getattr(new, key) for key in ORBIT_KEYS))
    return {
        k: ContinuedBody(pos[k] - pos[0], vel[k] - vel[0], past["gained"][k], past["begun"][k] - snap.time)
        for k in np.flatnonzero(same).tolist()
    }


# Rules


def check_snapshot_fits(draft: Draft) -> Iterator[Problem]:
    """Yield a key and a message for each contradiction between a scene and its snapshot."""
    file: Any = draft.initial.file
    if draft.initial.refine > 1 and draft.initial.thin > 1:
        yield ("initial", "thin"), "initial.refine is also given; keep initial.refine or initial.thin"
    if draft.initial.keep_time and draft.run is not None and draft.run.until <= file.time:
        wrong = "the end time is not later than the snapshot"
        yield ("run", "until"), f"{wrong}; choose a time after {file.time_text}, or remove initial.keep_time"
    if file.dimensions != draft.dimensions:
        yield (
            ("initial", "file"),
            f"the snapshot has {file.dimensions} dimensions, but space.dimensions is {draft.dimensions}; use "
            f"another snapshot, or change space.dimensions",
        )
    if draft.has("gas") and file.gas == 0:
        yield ("gas",), "initial.file contains no gas; remove the table [gas]"
    have, wanted = len(draft.dust or ()), len(file.dust)
    if draft.has("dust") and have != wanted:
        holds = f"{wanted} population{'s' * (wanted != 1)} of dust" if wanted else "no dust"
        yield ("dust",), f"initial.file contains {holds}; give {wanted or 'no'} [[dust]] table{'s' * (wanted != 1)}"


# Previews


def _ring_samples(scene: Scene) -> SamplePoints:
    """Return surface density, mid radius and relative particle mass in rings with about equal particle numbers.

    The particles are the gas if scene and snapshot have gas, else the dust. If all particles have the same mass,
    or the gas is in cells, `relative_mass` is None.
    """
    snap = _cached_snapshot(scene.initial.file).about_centre()
    name = "gas" if scene.gas is not None and snap.gas is not None else "dust"
    arrays = _arrays_in_code_units(scene, name, snap.species[name])
    r = np.sqrt((arrays["pos"] ** 2).sum(axis=1))
    edges = _ring_edges(np.sort(r))
    number, mean = np.histogram(r, edges)[0], arrays["mass"].mean()
    area = np.pi * np.diff(edges**2)
    filled = (area > 0.0) & (number > 0)
    middle, density = 0.5 * (edges[1:] + edges[:-1])[filled], (number * mean)[filled] / area[filled]
    if np.ptp(arrays["mass"]) == 0.0:
        return SamplePoints([], density, middle)
    mass = np.histogram(r, edges, weights=arrays["mass"])[0][filled]
    # Cells of a grid become particles of equal mass.
    relative_mass = None if name == "gas" and scene.initial.file.polar else mass / (number[filled] * mean)
    return SamplePoints([], mass / area[filled], middle, relative_mass=relative_mass)


def _ring_edges(r: Array) -> Array:
    """Return the edges of at most MAX_RINGS rings with about equal numbers of particles at sorted radii `r` (n,).

    An edge never separates particles with the same radius to rounding, as on a ring of a quiet start.
    """
    first = np.flatnonzero(np.diff(r) > SAME_RING * r[1:]) + 1  # first index of each distinct radius but the innermost
    if len(first) == 0:
        return np.unique(r[[0, -1]])
    wanted = np.linspace(0, len(r), MAX_RINGS + 1)[1:-1]
    cuts = np.unique(first[np.clip(np.searchsorted(first, wanted), 0, len(first) - 1)])
    between = 0.5 * (r[cuts - 1] + r[cuts])
    inner = max(0.0, 1.5 * r[0] - 0.5 * r[first[0]])  # edges half a spacing beyond the extreme radii
    return np.concatenate([[inner], between, [1.5 * r[-1] - 0.5 * r[first[-1] - 1]]])


def sample_points(scene: Scene) -> SamplePoints:
    """Return the rings at 10%, 50% and 90% of the particles (see `_ring_samples`), for the preview."""
    rings = _ring_samples(scene)
    r, relative = rings.radius, rings.relative_mass
    chosen = [len(r) // 10, len(r) // 2, -1 - len(r) // 10]
    names = [scene.units.show(x, "length") for x in r[chosen]]
    own = None if relative is None else relative[chosen]
    return SamplePoints(names, rings.density[chosen], r[chosen], relative_mass=own)


def sample_all_gas(scene: Scene) -> tuple[SamplePoints, Array]:
    """Return all rings (see `_ring_samples`), and the relative mass of a particle in each, for the preview."""
    rings = _ring_samples(scene)
    return rings, np.ones_like(rings.density) if rings.relative_mass is None else rings.relative_mass


def edges(scene: Scene) -> tuple[float, float]:
    """Return the edges of a polar grid, or the mid radii of the innermost and the outermost ring of particles."""
    if scene.initial.file.polar:
        gas: Any = _cached_snapshot(scene.initial.file).about_centre().gas
        shape = shape_of_cells(_arrays_in_code_units(scene, "gas", gas)["pos"])
        return shape.inner, shape.outer
    r = _ring_samples(scene).radius
    return float(r[0]), float(r[-1])


def mass(scene: Scene, population: Any) -> float:
    """Return the mass of gas in the region of a dust population: the mass of its dust over its dust-to-gas ratio.

    With `population` None, return the mass of all gas; in a scene without gas, the largest mass of the populations.
    """
    snap = _cached_snapshot(scene.initial.file)
    if population is None and scene.gas is not None and snap.gas is not None:
        return float(_arrays_in_code_units(scene, "gas", snap.gas)["mass"].sum())
    arrays = _arrays_in_code_units(scene, "dust", snap.dust)
    masses = np.bincount(arrays["species"], arrays["mass"], len(scene.dust))
    shares = [total / dust.ratio for total, dust in zip(masses, scene.dust, strict=True)]
    return float(max(shares) if population is None else shares[[p is population for p in scene.dust].index(True)])


def reference_density(scene: Scene) -> float:
    """Return the surface density to which drag laws refer in the snapshot's run, in code units of `scene`.

    With this density, grains keep their stopping times. Raises SceneError if the snapshot's run had no such density.
    """
    snap, path = _cached_snapshot(scene.initial.file), scene.initial.file.path
    found = snap.reference_density
    if found is None:
        try:  # written by an earlier version, or the start has none
            if snap.tables["initial"]["kind"] == scene.initial.kind:
                raise SceneError(["the run of the snapshot started from a snapshot itself"])
            return profile.reference_density(load_scene(snap.tables, folder=path.parent))
        except (SceneError, KeyError, TypeError):
            wrong = f"{path}: the run of this snapshot had no Sigma_ref, the reference density of drag laws"
            raise SceneError([f'{wrong}; choose a drag.law other than "{scene.drag.law}"']) from None
    return found if snap.units == scene.units else float(scene.units.to_code(snap.units.quantity(found, "density")))


START = Start(
    FromSnapshot,
    particles,
    sample_points,
    dimensions=(2,),
    boundary="open",
    rules=(check_snapshot_fits,),
    kernel="wendland-c2",  # as for the other discs
    region_mass=mass,
    samples_of_all_gas=sample_all_gas,
    on_lattice=False,
    edges=edges,
    reference_density=reference_density,
    start_time=start_time,
    restore=restore_open_step,
    moving_bodies=moving_bodies,
)
