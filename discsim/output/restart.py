"""A start from a snapshot of ours, at any step: as it is, refined or thinned, with whatever effects; its time is 0.

Refined, a particle of mass m is replaced by k of m / k about its place, sum d_i = 0, as far apart as particles of
m / k are at its density: mean |d|^2 = (1 - 1/k) m / (6 Sigma). Velocity and energy go on linearly, v + G d_i, with the
gradient G of a least-squares fit to the neighbours, which keeps momentum and energy; what the spread of places and
velocities adds to the angular momentum, sum d_i x G d_i, a rigid turn of the whole takes out (some 1e-4 of Omega).
Thinned, every k-th particle along rings stays, with the mass of all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.initial.base import Places, Start
from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.eos import eos_of
from discsim.physics.grains import has_sizes
from discsim.scene import SceneError, load_scene
from discsim.scene.fields import Count, InputFile, Table, Words, fault

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

snapshots = Lazy("discsim.output.snapshot")  # imports h5py
Array = np.ndarray
NEAR = 12  # neighbours that a gradient is fitted to
MOST = 1000  # to refine or thin by
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
SHELLS = 40  # rings of a preview


@dataclass(frozen=True)
class SnapshotFile(InputFile):
    """A snapshot: particles of the gas (0: there is none) and of each population of dust, and whether gas has a u."""

    gas: int = field(default=0, compare=False)
    dust: tuple[int, ...] = field(default=(), compare=False)
    dimensions: int = field(default=2, compare=False)
    holds_heat: bool = field(default=False, compare=False)

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
    return SnapshotFile(found.path, found.digest, gas, tuple(map(int, numbers)), snap.dimensions, heat)


class FromSnapshot(Table):
    """A snapshot of a run: refined, thinned, with other effects; at time 0."""

    kind: Literal["snapshot"] = "snapshot"
    file: Annotated[Any, BeforeValidator(_read), Words("path of a snapshot, relative to the scene's folder")] = Field(
        description="its particles, whatever numbers of them the scene has; tables say what else there is"
    )
    refine: Count = Field(1, ge=1, le=MOST, description="particles that each is replaced by")
    thin: Count = Field(1, ge=1, le=MOST, description="of so many particles one stays, with the mass of all")

    @property
    def brings_temperature(self) -> bool:
        return self.file.holds_heat

    @property
    def counts(self) -> dict[str, list[int]]:
        """Particles of the gas, and of each population of dust."""
        gas, dust = [self.file.gas], [*self.file.dust]
        return {name: [self.refine * len(range(*_every(n, self.thin))) for n in numbers]
                for name, numbers in (("gas", gas), ("dust", dust))}  # fmt: skip


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    start: Any = scene.initial
    snap = _snapshot(start.file)
    out = {}
    for name in ("gas", "dust"):
        held = getattr(snap, name)
        if getattr(scene, name) is None or held is None:
            continue
        arrays = _in_code(scene, name, held)
        groups = [arrays]
        if start.thin > 1 or start.refine > 1:
            groups = []
            for k in range(len(scene.dust or ()) if name == "dust" else 1):
                rows = np.flatnonzero(_populations(held) == k)
                group = {key: values[rows] for key, values in arrays.items()}
                groups.append(_refined(_thinned(group, start.thin), start.refine))
        out[name] = {key: np.concatenate([group[key] for group in groups]) for key in arrays}
    return out


def _populations(held: SnapshotParticles) -> Array:
    return np.zeros(held.count, np.int64) if held.species is None else held.species.astype(np.int64)


def _in_code(scene: Scene, name: str, held: SnapshotParticles) -> dict[str, Array]:
    """The arrays that a start has, in the code units of the scene: the very ones where these are the snapshot's."""
    keys = ["pos", "vel", "mass", "immobile"]
    keys += (
        ["species", *(["size"] if any(map(has_sizes, scene.dust)) else [])]
        if name == "dust"
        else ["density", *(["u"] if eos_of(scene).holds_heat else [])]
    )
    arrays = {key: getattr(held, key) for key in keys if getattr(held, key) is not None}
    if name == "dust":
        arrays["species"] = _populations(held)
    if held.units == scene.units:
        return {key: np.array(values) for key, values in arrays.items()}
    plain = ("species", "immobile")
    return {key: values if key in plain else scene.units.to_code(held.quantity(key)) for key, values in arrays.items()}


# Thinning


def _every(count: int, step: int) -> tuple[int, int, int]:
    """The range of those that stay of `count`: from the middle of the first `step` on."""
    return min(step // 2, max(count - 1, 0)), count, step


def _thinned(arrays: dict[str, Array], step: int) -> dict[str, Array]:
    """Every `step`-th along rings as wide as those that stay are apart; the mass stays what it is."""
    if step == 1 or len(arrays["mass"]) == 0:
        return arrays
    pos, mass = arrays["pos"], arrays["mass"]
    r, angle = np.sqrt((pos**2).sum(axis=1)), np.arctan2(pos[:, 1], pos[:, 0])
    rising = np.argsort(r, kind="stable")
    held = 2.0 * np.pi * r * np.sqrt(step / _area(pos))  # particles of the ring
    ring = np.empty(len(r), np.int64)
    ring[rising] = np.floor(np.cumsum(1.0 / np.maximum(held[rising], 1.0)))
    stay = np.lexsort((angle, ring))[slice(*_every(len(r), step))]
    out = {key: values[stay] for key, values in arrays.items()}
    out["mass"] = out["mass"] * (mass.sum() / out["mass"].sum())
    return out


def _near(pos: Array, count: int) -> tuple[Array, Array]:
    """Distances and numbers (n, count + 1) of each particle and its neighbours."""
    from scipy.spatial import cKDTree  # slow to import

    found: tuple[Array, Array] = cKDTree(pos).query(pos, k=list(range(1, count + 2)))
    return found


def _area(pos: Array) -> Array:
    """Area (n,) that each particle has to itself, by its neighbours."""
    count = min(NEAR, len(pos) - 1)
    if count == 0:
        return np.ones(len(pos))
    farthest = _near(pos, count)[0][:, -1]
    return np.maximum(np.pi * farthest**2 / (count + 0.5), 1e-300)


# Refinement


def _refined(arrays: dict[str, Array], number: int) -> dict[str, Array]:
    """Each particle as `number` of them; mass, momentum, energy of heat and angular momentum to rounding."""
    count = len(arrays["mass"])
    if number == 1 or count == 0:
        return arrays
    out = {key: np.repeat(values, number, axis=0) for key, values in arrays.items()}
    out["mass"] /= number
    pos, vel = arrays["pos"], arrays["vel"]
    area = arrays["mass"] / arrays["density"] if "density" in arrays else _area(pos)
    outwards = pos / np.maximum(np.sqrt((pos**2).sum(axis=1)), 1e-300)[:, None]
    along, across = outwards, np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
    away = np.sqrt(area)[:, None, None] * (
        _pattern(number)[:, 0, None] * along[:, None, :] + _pattern(number)[:, 1, None] * across[:, None, :]
    )
    away -= away.mean(axis=1, keepdims=True)
    flat = away.reshape(-1, 2)
    fields = vel if "u" not in arrays else np.column_stack([vel, arrays["u"]])
    slopes = _gradients(pos, fields)
    change = np.einsum("nki,nif->nkf", away, slopes).reshape(len(flat), -1)
    out["pos"], out["vel"] = out["pos"] + flat, out["vel"] + change[:, :2]
    if "u" in arrays:
        out["u"] = out["u"] + np.clip(change[:, 2], -0.5 * out["u"], 0.5 * out["u"])
    _turn_back(arrays, out)
    return out


def _pattern(number: int) -> Array:
    """Places (number, 2) about 0 in spacings of the parents, with sum 0 and mean |d|^2 = (1 - 1/number) / 6.

    Few are on a ring, two of them one behind the other on their orbit; many on a spiral of even density.
    """
    k = np.arange(number)
    angle = np.pi / number * (2 * k + 1) if number <= 6 else GOLDEN * k
    away = np.ones(number) if number <= 6 else np.sqrt(k + 0.5)
    places = away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places -= places.mean(axis=0)
    return places * np.sqrt((1.0 - 1.0 / number) / 6.0 / (places**2).sum(axis=1).mean())


def _gradients(pos: Array, fields: Array) -> Array:
    """d field / d x_i (n, 2, fields) of a least-squares plane through each particle and its neighbours."""
    count = min(NEAR, len(pos) - 1)
    if count < 3:
        return np.zeros((len(pos), 2, fields.shape[1]))
    near = _near(pos, count)[1][:, 1:]
    away, change = pos[near] - pos[:, None, :], fields[near] - fields[:, None, :]
    matrix, right = np.einsum("nki,nkj->nij", away, away), np.einsum("nki,nkf->nif", away, change)
    size = np.trace(matrix, axis1=1, axis2=2)
    flat = np.linalg.det(matrix) > 1e-6 * size**2  # else on a line
    out = np.zeros_like(right)
    out[flat] = np.linalg.solve(matrix[flat], right[flat])
    return out


def _spin(arrays: dict[str, Array]) -> float:
    pos, vel = arrays["pos"], arrays["vel"]
    return float((arrays["mass"] * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum())


def _turn_back(before: dict[str, Array], after: dict[str, Array]) -> None:
    """Give `after` the angular momentum of `before` by a rigid turn about its centre of mass."""
    mass = after["mass"][:, None]
    away = after["pos"] - (mass * after["pos"]).sum(axis=0) / mass.sum()
    rate = (_spin(before) - _spin(after)) / float((mass * away**2).sum())
    after["vel"] = after["vel"] + rate * np.stack([-away[:, 1], away[:, 0]], axis=1)


# Rules


def goes_with_the_file(draft: Draft) -> Iterator[Problem]:
    file: Any = draft.initial.file
    if draft.initial.refine > 1 and draft.initial.thin > 1:
        yield ("initial", "thin"), "initial.refine is there too; expected one of the two"
    if file.dimensions != draft.dimensions:
        yield ("initial", "file"), f"has {file.dimensions} dimensions; expected {draft.dimensions}, as of space"
    if draft.has("gas") and file.gas == 0:
        yield ("gas",), "initial.file holds no gas; expected no such table"
    have, wanted = len(draft.dust or ()), len(file.dust)
    if draft.has("dust") and have != wanted:
        holds = f"{wanted} population{'s' * (wanted != 1)} of dust" if wanted else "no dust"
        yield ("dust",), f"initial.file holds {holds}; expected as many tables, or no [dust]"


# Previews


def _rings(scene: Scene) -> tuple[Array, Array]:
    """Middles of rings of as many particles each, and Sigma of the first species there."""
    snap = _snapshot(scene.initial.file)
    held = snap.gas if scene.gas is not None and snap.gas is not None else snap.dust
    assert held is not None
    arrays = _in_code(scene, "gas" if held is snap.gas and scene.gas is not None else "dust", held)
    r = np.sort(np.sqrt((arrays["pos"] ** 2).sum(axis=1)))
    edges = np.unique(np.quantile(r, np.linspace(0.0, 1.0, SHELLS + 1)))
    number = np.histogram(r, edges)[0]
    area = np.pi * np.diff(edges**2)
    filled = area > 0.0
    return 0.5 * (edges[1:] + edges[:-1])[filled], (number * arrays["mass"].mean())[filled] / area[filled]


def places(scene: Scene) -> Places:
    """Where a tenth, a half and nine tenths of the first species are within."""
    r, density = _rings(scene)
    chosen = [len(r) // 10, len(r) // 2, -1 - len(r) // 10]
    return Places([scene.units.show(x, "length") for x in r[chosen]], density[chosen], r[chosen])


def spread(scene: Scene) -> tuple[Places, Array]:
    r, density = _rings(scene)
    return Places([], density, r), np.ones_like(r)


def edges(scene: Scene) -> tuple[float, float]:
    r = _rings(scene)[0]
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
    """That of the snapshot's own scene, so that its grains stay what they are."""
    snap = _snapshot(scene.initial.file)
    try:
        return profile.reference_density(load_scene(snap.tables, folder=scene.initial.file.path.parent))
    except (SceneError, TypeError) as error:
        wrong = f"{scene.initial.file.path}: its own scene has no Sigma_ref: {str(error).splitlines()[0]}"
        raise SceneError([f'{wrong}; expected another drag.law than "{scene.drag.law}"']) from None


START = Start(
    FromSnapshot,
    particles,
    places,
    dimensions=(2,),
    boundary="open",
    rules=(goes_with_the_file,),
    kernel="quintic",  # as of the other discs
    masses=mass,
    spread=spread,
    on_lattice=False,
    edges=edges,
    reference_density=reference_density,
)
