"""A start from a snapshot of ours, at any step: as it is, refined or thinned, with whatever effects.

Its time is 0, or with `keep_time` that of the snapshot, and what began with the start then began as long before.

Where nothing but the start and the outputs has changed it goes on as the run does, to rounding (`open_step.py`). With
other physics it begins with the closed velocities that the snapshot shows, about the centre of the disc there. Star and
companions that are the same go on along their orbits, others begin as their tables say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.initial.base import Places, Start
from discsim.initial.refine import every, refined, thinned
from discsim.initial.small import loaded
from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.eos import eos_of
from discsim.physics.grains import own_sizes
from discsim.physics.orbits import Orbits, UnderWay
from discsim.scene import SceneError, load_scene
from discsim.scene.differences import FREE_TO_CHANGE, differences
from discsim.scene.fields import Count, InputFile, Length, Table, Words, fault

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.output.snapshot import Snapshot, SnapshotParticles
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

snapshots = Lazy("discsim.output.snapshot")  # imports h5py
growth = Lazy("discsim.physics.growth")
Array = np.ndarray
MOST = 1000  # to refine or thin by
ORBIT = ("mass", "semi_major_axis", "eccentricity", "phase", "orbit")  # keys of a companion that stays on its way
SHELLS = 40  # rings of a preview
SAME_RING = 1e-9  # relative difference of radii within a ring of a start


@dataclass(frozen=True)
class SnapshotFile(InputFile):
    """A snapshot: particles of the gas (0: there is none) and of each population of dust, and whether gas has a u.

    time: in code units of the scene that names it; time_words: the same for people.
    """

    gas: int = field(default=0, compare=False)
    dust: tuple[int, ...] = field(default=(), compare=False)
    dimensions: int = field(default=2, compare=False)
    holds_heat: bool = field(default=False, compare=False)
    time: float = field(default=0.0, compare=False)
    time_words: str = field(default="0", compare=False)

    __str__ = InputFile.__str__


@lru_cache(maxsize=1)
def _snapshot(file: SnapshotFile) -> Snapshot:
    found: Snapshot = snapshots.read_snapshot(file.path)
    return found


def _read(value: Any, info: ValidationInfo) -> SnapshotFile:
    found = InputFile.read(value, info)
    try:
        snap = _snapshot(SnapshotFile(found.path, found.digest))
    except snapshots.SnapshotError as error:
        raise fault(f"{error}; expected a snapshot of discsim") from None
    tables = snap.tables.get("dust", [])
    populations = len(tables) if isinstance(tables, list) else 1
    numbers = () if snap.dust is None else np.bincount(_populations(snap.dust), minlength=populations)
    heat = snap.gas is not None and snap.gas.u is not None
    gas = snap.gas.count if snap.gas is not None else 0
    units = (info.context or {}).get("units", snap.units)
    time = snap.time if units == snap.units else float(units.to_code(snap.quantity("time")))
    words = snap.units.show_time(snap.time)
    return SnapshotFile(found.path, found.digest, gas, tuple(map(int, numbers)), snap.dimensions, heat, time, words)


KIND: Final = "snapshot"


class FromSnapshot(Table):
    """A snapshot of a run: refined, thinned, with other effects; at time 0, or at its own."""

    kind: Literal["snapshot"] = KIND
    file: Annotated[Any, BeforeValidator(_read), Words("path of a snapshot, relative to the scene's folder")] = Field(
        description="its particles, whatever numbers of them the scene has; tables say what else there is"
    )
    refine: Count = Field(1, ge=1, le=MOST, description="particles that each is replaced by")
    thin: Count = Field(1, ge=1, le=MOST, description="of so many particles one stays, with the mass of all")
    reference_radius: Length = Field(1.0, gt=0, description="where a law of the radius has its value, as of a disc")
    keep_time: bool = Field(False, description="time goes on from that of the snapshot, instead of from 0")

    @property
    def brings_temperature(self) -> bool:
        return self.file.holds_heat

    @property
    def counts(self) -> dict[str, list[int]]:
        """Particles of the gas, and of each population of dust."""
        gas, dust = [self.file.gas], [*self.file.dust]
        return {name: [self.refine * len(range(*every(n, self.thin))) for n in numbers]
                for name, numbers in (("gas", gas), ("dust", dust))}  # fmt: skip


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    start: Any = scene.initial
    snap = _snapshot(start.file).about_centre()
    out = {}
    for name in ("gas", "dust"):
        held = getattr(snap, name)
        if getattr(scene, name) is None or held is None:
            continue
        arrays = _in_code(scene, name, held)
        if "small" in arrays:
            arrays = _as_carried(scene, snap, arrays)
        groups = [arrays]
        if start.thin > 1 or start.refine > 1:
            groups = []
            for k in range(len(scene.dust or ()) if name == "dust" else 1):
                rows = np.flatnonzero(_populations(held) == k)
                group = {key: values[rows] for key, values in arrays.items()}
                groups.append(refined(thinned(group, start.thin), start.refine))
        out[name] = {key: np.concatenate([group[key] for group in groups]) for key in arrays}
    return out


def _as_carried(scene: Scene, snap: Snapshot, gas: dict[str, Array]) -> dict[str, Array]:
    """Small dust as a part of the gas's masses where drag is two-way here, beside them where it is not."""
    was = snap.tables["drag"].get("direction") != "one-way"
    if was == growth.laden(scene):
        return gas
    return loaded(gas, 1.0 if growth.laden(scene) else -1.0)


def _populations(held: SnapshotParticles) -> Array:
    return np.zeros(held.count, np.int64) if held.species is None else held.species.astype(np.int64)


def _in_code(scene: Scene, name: str, held: SnapshotParticles) -> dict[str, Array]:
    """The arrays that a start has, in the code units of the scene: the very ones where these are the snapshot's."""
    keys = ["pos", "vel", "mass", "immobile"]
    keys += (
        ["species", *(["size"] if own_sizes(scene) else [])]
        if name == "dust"
        else ["density", "small", *(["u"] if eos_of(scene).holds_heat else [])]
    )
    arrays = {key: getattr(held, key) for key in keys if getattr(held, key) is not None}
    if name == "dust":
        arrays["species"] = _populations(held)
    if name == "gas" and scene.table("growth") is None:
        arrays.pop("small", None)
    if held.units == scene.units:
        return {key: np.array(values) for key, values in arrays.items()}
    plain = ("species", "immobile")
    return {key: values if key in plain else scene.units.to_code(held.quantity(key)) for key, values in arrays.items()}


# Going on


def _before(scene: Scene) -> Scene | None:
    """The snapshot's own scene, but with the start of this one; None where it has no meaning here."""
    path: Path = scene.initial.file.path
    start = {"kind": scene.initial.kind, "file": str(path)}
    try:
        return load_scene(_snapshot(scene.initial.file).tables | {"initial": start}, folder=path.parent)
    except SceneError:
        return None


def goes_on(scene: Scene) -> bool:
    """Whether nothing has changed that a step could notice."""
    start, before = scene.initial, _before(scene)
    if _snapshot(start.file).open_step is None or before is None or start.refine > 1 or start.thin > 1:
        return False
    return not any(_matters(key) for key in differences(before, scene))


def _matters(key: str) -> bool:
    table, _, last = key.rpartition(".")
    of_run = table == "run" and last != "integrator"
    return key not in FREE_TO_CHANGE and not of_run and table != "initial" and last not in ("particles", "every")


def begins(scene: Scene) -> float:
    return float(scene.initial.file.time) if scene.initial.keep_time else 0.0


def take_up(state: State) -> None:
    """Give the state what the snapshot's run would go on with, where it can, and the time at which it begins."""
    if goes_on(state.scene):
        _go_on(state)
    state.time = begins(state.scene)
    if state.bodies is not None:
        state.bodies.begun += state.time


def _go_on(state: State) -> None:
    scene = state.scene
    snap = _snapshot(scene.initial.file)
    step = snap.open_step
    assert step is not None
    state.lag, state.earlier = step.lag, step.step
    state.pace = step.pace or state.pace
    held = {**state.species, **({} if state.bodies is None else {"bodies": state.bodies})}
    for name, particles in held.items():
        shown: Any = getattr(snap, name)
        for key, array in {"pos": shown.pos, "vel": shown.vel, "ids": shown.ids, **step.arrays[name]}.items():
            if hasattr(particles, key):
                getattr(particles, key)[:] = array
    if state.gas is not None and state.gas.h_before is not None:
        state.gas.h[:] = state.gas.h_before
    if state.bodies is not None:
        state.bodies.begun -= snap.time
        Orbits(scene).place(state.bodies, 0.0)


def under_way(scene: Scene) -> dict[int, UnderWay]:
    """Star and companions, by number, that are those of the snapshot."""
    snap, before = _snapshot(scene.initial.file), _before(scene)
    if snap.bodies is None or snap.open_step is None or before is None or snap.units != scene.units:
        return {}
    assert before.star is not None and scene.star is not None
    pos, vel, past = snap.bodies.pos, snap.bodies.vel, snap.open_step.arrays["bodies"]
    same = [before.star.mass == scene.star.mass]
    for old, new in zip(before.companion or (), scene.companion or (), strict=False):
        same.append(all(getattr(old, key) == getattr(new, key) for key in ORBIT))
    return {
        k: UnderWay(pos[k] - pos[0], vel[k] - vel[0], past["gained"][k], past["begun"][k] - snap.time)
        for k in np.flatnonzero(same).tolist()
    }


# Rules


def goes_with_the_file(draft: Draft) -> Iterator[Problem]:
    file: Any = draft.initial.file
    if draft.initial.refine > 1 and draft.initial.thin > 1:
        yield ("initial", "thin"), "initial.refine is there too; expected one of the two"
    if draft.initial.keep_time and draft.run is not None and draft.run.until <= file.time:
        wrong = "is not after the snapshot, whose time the run keeps"
        yield ("run", "until"), f"{wrong}; expected more than {file.time_words}, or no initial.keep_time"
    if file.dimensions != draft.dimensions:
        yield ("initial", "file"), f"has {file.dimensions} dimensions; expected {draft.dimensions}, as of space"
    if draft.has("gas") and file.gas == 0:
        yield ("gas",), "initial.file holds no gas; expected no such table"
    have, wanted = len(draft.dust or ()), len(file.dust)
    if draft.has("dust") and have != wanted:
        holds = f"{wanted} population{'s' * (wanted != 1)} of dust" if wanted else "no dust"
        yield ("dust",), f"initial.file holds {holds}; expected as many tables, or no [dust]"


# Previews


def _rings(scene: Scene) -> Places:
    """Middles of rings of as many particles each, with Sigma and masses of the first species there."""
    snap = _snapshot(scene.initial.file).about_centre()
    held = snap.gas if scene.gas is not None and snap.gas is not None else snap.dust
    assert held is not None
    arrays = _in_code(scene, "gas" if held is snap.gas and scene.gas is not None else "dust", held)
    r = np.sqrt((arrays["pos"] ** 2).sum(axis=1))
    edges = _ring_edges(np.sort(r))
    number, mean = np.histogram(r, edges)[0], arrays["mass"].mean()
    area = np.pi * np.diff(edges**2)
    filled = (area > 0.0) & (number > 0)
    middle, density = 0.5 * (edges[1:] + edges[:-1])[filled], (number * mean)[filled] / area[filled]
    if np.ptp(arrays["mass"]) == 0.0:
        return Places([], density, middle)
    mass = np.histogram(r, edges, weights=arrays["mass"])[0][filled]
    return Places([], mass / area[filled], middle, relative_mass=mass / (number[filled] * mean))


def _ring_edges(r: Array) -> Array:
    """Edges of SHELLS rings of about as many particles each, at sorted radii (n,); none divides a ring of the start,
    whose particles have one radius to rounding.
    """
    first = np.flatnonzero(np.diff(r) > SAME_RING * r[1:]) + 1  # of each radius but the innermost
    if len(first) == 0:
        return np.unique(r[[0, -1]])
    wanted = np.linspace(0, len(r), SHELLS + 1)[1:-1]
    cuts = np.unique(first[np.clip(np.searchsorted(first, wanted), 0, len(first) - 1)])
    between = 0.5 * (r[cuts - 1] + r[cuts])
    inner = max(0.0, 1.5 * r[0] - 0.5 * r[first[0]])  # half a spacing beyond the outermost radii
    return np.concatenate([[inner], between, [1.5 * r[-1] - 0.5 * r[first[-1] - 1]]])


def places(scene: Scene) -> Places:
    """Where a tenth, a half and nine tenths of the first species are within."""
    rings = _rings(scene)
    r, relative = rings.radius, rings.relative_mass
    assert r is not None
    chosen = [len(r) // 10, len(r) // 2, -1 - len(r) // 10]
    names = [scene.units.show(x, "length") for x in r[chosen]]
    own = None if relative is None else relative[chosen]
    return Places(names, rings.density[chosen], r[chosen], relative_mass=own)


def spread(scene: Scene) -> tuple[Places, Array]:
    rings = _rings(scene)
    return rings, np.ones_like(rings.density) if rings.relative_mass is None else rings.relative_mass


def edges(scene: Scene) -> tuple[float, float]:
    r = _rings(scene).radius
    assert r is not None
    return float(r[0]), float(r[-1])


def mass(scene: Scene, population: Any) -> float:
    """Mass of the gas, or what a population's ratio refers to."""
    snap = _snapshot(scene.initial.file)
    if population is None and scene.gas is not None and snap.gas is not None:
        return float(_in_code(scene, "gas", snap.gas)["mass"].sum())
    assert snap.dust is not None and scene.dust is not None
    arrays = _in_code(scene, "dust", snap.dust)
    masses = np.bincount(arrays["species"], arrays["mass"], len(scene.dust))
    shares = [total / dust.ratio for total, dust in zip(masses, scene.dust, strict=True)]
    return float(max(shares) if population is None else shares[[p is population for p in scene.dust].index(True)])


def reference_density(scene: Scene) -> float:
    """That of the start that the snapshot's run began with, so that its grains stay what they are."""
    snap, path = _snapshot(scene.initial.file), scene.initial.file.path
    found = snap.reference_density
    if found is None:
        try:  # of an earlier version, or one whose start has none
            if snap.tables["initial"]["kind"] == scene.initial.kind:
                raise SceneError(["a start from a start"])
            return profile.reference_density(load_scene(snap.tables, folder=path.parent))
        except (SceneError, KeyError, TypeError):
            wrong = f"{path}: its run began with no Sigma_ref"
            raise SceneError([f'{wrong}; expected another drag.law than "{scene.drag.law}"']) from None
    return found if snap.units == scene.units else float(scene.units.to_code(snap.units.quantity(found, "density")))


START = Start(
    FromSnapshot,
    particles,
    places,
    dimensions=(2,),
    boundary="open",
    rules=(goes_with_the_file,),
    kernel="wendland-c2",  # as of the other discs
    masses=mass,
    spread=spread,
    on_lattice=False,
    edges=edges,
    reference_density=reference_density,
    begins=begins,
    take_up=take_up,
    under_way=under_way,
)
