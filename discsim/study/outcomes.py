"""Results of a finished run for sweeps: numbers by name, read from its directory.

    accreted_dust, kinetic_gas, ...    a column of history.csv, in its last row
    dust-peak, dust-peak-radius        the highest surface density of the profile, and its radius
    dust-r10, dust-r50, dust-r90       the radii that contain 10%, 50% and 90% of the mass
    dust-modes, dust-clumps            largest amplitude of m = 1..4, mass fraction in clumps (`measures.py`)
    dust.0-peak, dust.pebbles-r50, ... the same of one population of dust, if there are several
    cpu                                CPU seconds of the effects, of all threads

Results with a hyphen are from the last snapshot of a disc; such results exist for gas and for dust. Values are in
UNITS, but in code units for a scene in code units and in 1D, where masses are column densities.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from discsim.output.costtable import read_costs
from discsim.output.history import TEXT_COLUMNS, history_columns, read_history
from discsim.output.populations import only_population
from discsim.output.snapshot import SnapshotParticles, read_snapshot
from discsim.scene import Scene, nearest_hint
from discsim.scene.populations import populations_of
from discsim.study.errors import is_disc
from discsim.study.measures import clump_fraction, mode_amplitudes
from discsim.study.points import StudyError

Array = np.ndarray
QUANTILES = (0.1, 0.5, 0.9)
RINGS, SMOOTHING_RINGS = 80, 2.0  # rings of a profile; standard deviation of the smoothing, in rings
UNITS = {
    "length": "au", "mass": "Msun", "time": "yr", "surface_density": "g/cm2", "accretion_rate": "Msun/yr",
    "momentum": "Msun km/s", "angular_momentum": "Msun au km/s", "energy": "erg",
}  # fmt: skip
# Dimensions of columns of history.csv by the first part of their names; other columns are plain numbers.
COLUMNS = {
    "time": "time", "dt": "time", "mass_": "mass", "accreted_": "mass", "accretion_rate_": "accretion_rate",
    "momentum_": "momentum", "angular_momentum": "angular_momentum", "kinetic_": "energy", "thermal": "energy",
    "potential": "energy", "radiated": "energy",
}  # fmt: skip
SNAPSHOT_RESULTS = {
    "peak": "surface_density", "peak-radius": "length", **{f"r{100 * q:.0f}": "length" for q in QUANTILES},
    "modes": "", "clumps": "",
}  # fmt: skip


class Outcome(NamedTuple):
    """A kind of result: name, unit ("" for a plain number), and factor from code units to this unit."""

    name: str
    unit: str
    factor: float

    @property
    def head(self) -> str:
        """The name with the unit, for heads of tables."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def outcomes_of(scene: Scene) -> dict[str, Outcome]:
    """Return all kinds of results that runs of the scene have, by name."""
    dimensions: dict[str, str] = {}
    for column in history_columns(scene):
        if column not in TEXT_COLUMNS:
            found = [dimension for start, dimension in COLUMNS.items() if column.startswith(start)]
            dimensions[column] = found[0] if found else ""
    if is_disc(scene):
        kinds = [kind for kind in ("dust", "gas") if getattr(scene, kind) is not None]
        for kind in [*kinds, *_populations(tomllib.loads(scene.text))]:
            dimensions |= {f"{kind}-{what}": dimension for what, dimension in SNAPSHOT_RESULTS.items()}
    plain = scene.units.system == "code" or scene.space.dimensions == 1
    made = {name: _describe_outcome(scene, name, "" if plain else dimension) for name, dimension in dimensions.items()}
    return made | {"cpu": Outcome("cpu", "s", 1.0)}


def _populations(tables: Mapping[str, Any]) -> list[str]:
    """Return "dust.NAME" for each dust population of a scene with several, given as its tables."""
    found = populations_of(tables)
    return [f"dust.{each.name}" for each in found] if len(found) > 1 else []


def _describe_outcome(scene: Scene, name: str, dimension: str) -> Outcome:
    """Return a kind of result with the dimension `dimension`, "" for a plain number."""
    unit = UNITS.get(dimension, "")
    return Outcome(name, unit, float(scene.units.quantity(1.0, dimension).to_value(unit)) if unit else 1.0)


def select_outcomes(scene: Scene, names: Sequence[str] = ()) -> list[Outcome]:
    """Return the kinds of results `names`; without names, the default results of the scene. Raises StudyError."""
    known = outcomes_of(scene)
    for name in names:
        if name not in known:
            raise StudyError(
                f"--measure {name}: unknown; expected one of {', '.join(known)}{nearest_hint(name, tuple(known))}"
            )
    return [known[name] for name in names or _default_names(scene)]


def _default_names(scene: Scene) -> list[str]:
    """Return the names of the default results of a scene."""
    kinds = [kind for kind in ("gas", "dust") if getattr(scene, kind) is not None]
    if not is_disc(scene):
        return [f"kinetic_{kind}" for kind in kinds] + (["thermal"] if "gas" in kinds else [])
    taken = [f"accreted_{kind}" for kind in kinds] if scene.star is not None and scene.star.accretion_radius else []
    return [*taken, *(f"{kinds[-1]}-{what}" for what in ("peak", "r50"))]


class Results(NamedTuple):
    """Results of a run: the time of its end in code units, and values by name, each in the unit of its `Outcome`."""

    time: float
    values: dict[str, float]


def read_results(directory: Path, scene: Scene, wanted: Sequence[Outcome]) -> Results:
    """Read the results `wanted` of a run of the scene from the run's directory. Raises OSError, UserError."""
    rows = read_history(directory / "history.csv", scene)
    if not rows:
        raise StudyError(f"{directory / 'history.csv'}: the file has no rows; expected the history.csv of a run")
    values = {name: float(value) for name, value in rows[-1].items() if name not in TEXT_COLUMNS}
    values["cpu"] = sum(row.seconds for row in read_costs(directory / "costs.csv"))
    if any("-" in each.name for each in wanted):
        values |= _snapshot_values(directory / "snapshots")
    return Results(values["time"], {each.name: each.factor * values[each.name] for each in wanted})


def _snapshot_values(folder: Path) -> dict[str, float]:
    """Return the results from the last snapshot of a disc, in code units; `folder` contains the snapshots.

    Results that come from a radial profile use radii up to 1.1 times the outer radius of the species in the first
    snapshot.
    """
    paths = sorted(folder.glob("*.h5"))
    first, last = (read_snapshot(path).about_centre() for path in (paths[0], paths[-1]))
    values: dict[str, float] = {}
    names = _populations(last.tables)
    apart = {
        name: tuple(only_population(snap, name.removeprefix("dust.")).dust for snap in (first, last)) for name in names
    }
    both = {kind: (first.species[kind], p) for kind, p in last.species.items()} | apart
    for kind, (start, p) in both.items():
        reach = 1.1 * float(np.quantile(start.radius, 0.999)) if start.count else 1.0
        values |= {f"{kind}-{what}": value for what, value in _species_values(p, reach, last.upper[0]).items()}
    return values


def _species_values(p: SnapshotParticles, reach: float, half: float) -> dict[str, float]:
    """Return the results of one species, in code units.

    reach: radius to which the profile extends. half: radius within which modes and clumps are measured.
    """
    edges = np.linspace(0.0, reach, RINGS + 1)
    profile = smoothed(p.radial_profile(edges), SMOOTHING_RINGS)
    top = int(profile.argmax())
    values = {"peak": float(profile[top]), "peak-radius": float(0.5 * (edges[top] + edges[top + 1]))}
    values |= {f"r{100 * q:.0f}": r for q, r in zip(QUANTILES, quantile_radii(p.radius, p.mass), strict=True)}
    return values | {
        "modes": max(mode_amplitudes(p.pos, p.mass, half)),
        "clumps": clump_fraction(p.pos, p.mass, half)[0],
    }


def quantile_radii(radius: Array, mass: Array) -> list[float]:
    """Return the radii that contain the fractions QUANTILES of the mass; NaN without particles.

    radius, mass (n,): radii and masses of the particles.
    """
    if len(mass) == 0:
        return [float("nan")] * len(QUANTILES)
    order = np.argsort(radius)
    within = np.cumsum(mass[order])
    return [float(radius[order][np.searchsorted(within, q * within[-1])]) for q in QUANTILES]


def smoothed(sigma: Array, rings: float) -> Array:
    """Smooth the profiles `sigma` (..., number of rings) by a Gaussian whose standard deviation is `rings` rings.

    Particles of a quiet start lie on rings, which would otherwise show.
    """
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(sigma, rings, mode="nearest", axis=-1)
