"""Estimated errors of a scene, from the measurements in `docs/accuracy.md` and from earlier runs of `discsim cost`.

    pressure    relative error of the mean force, about 0.02 (h / 0.32 H)^2            (`analysis/drift.py`)
    alpha       alpha of artificial viscosity and noise: eq. (5) of
                `physics/viscosity.py`                                                 (`analysis/noise.py`)
    step        relative change of a disc's energy over three orbits, about
                3e-3 (C / 0.8)^2.4 with the Courant factor C                           (`analysis/cost_of_accuracy.py`)
    gravity     relative error of forces, up to 0.003 (2 cells / softening)^2          (`analysis/forces.py`)
    precision   rms error of gas forces over the rms of these forces                   (docs/physics/gas.md)
    drag        relative error of the dust drift with the default scheme, about
                0.02 (s / H)^7 for cells of side s                                     (`analysis/drift_cells.py`)

h: smoothing length. H: scale height. Each formula is fitted to one ring or disc at full resolution, and gives the
order of magnitude for other scenes. `discsim cost --error` stores the errors of its runs (`store_error`). These errors
are shown for scenes with the same values of all keys that affect the result.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np

from discsim.drag.width import drift_error
from discsim.initial import start_of, start_time
from discsim.parts import DEFAULT_SCHEME, Lazy
from discsim.physics import viscosity
from discsim.physics.local import GasSamples
from discsim.preview import stored_runs
from discsim.preview.derived import drag_cell_sides, gas_at_start
from discsim.scene import Scene
from discsim.scene.differences import FREE_TO_CHANGE

self_gravity = Lazy("discsim.effects.self_gravity")
MAX_STORED = 300  # largest number of stored errors


def accuracy_rows(scene: Scene) -> list[tuple[str, str]]:
    """Return a row (name, value as text) for each estimated error of the scene."""
    if scene.initial is None:
        return []
    with np.errstate(all="ignore"):  # infinities are shown as they are
        return list(_error_rows(scene, gas_at_start(scene)))


def _error_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    """Yield the rows of `accuracy`: stored errors of runs with the same settings, then estimates."""
    for run in _stored_errors():
        if run["scene"] == digest(scene):
            error, cpu = 100.0 * run["error"], run["cpu"]
            yield f"measured error ({run['measure']})", f"{error:.2g}%, in {cpu:.3g} s of CPU"
    yield from _disc_rows(scene, at)
    if scene.self_gravity is not None and at.cell and scene.space.dimensions == 2:
        length = self_gravity.kernel_length(scene)
        yield (
            "largest error of self-gravity",
            f"{0.003 * (2.0 * at.cell / length) ** 2:.1g} of the force, from the grid",
        )
    if scene.gas is not None and scene.gas.precision == "single":
        yield "error of gas forces", "3e-7 of the rms force, from single precision; too large only for weak waves"
    start = start_of(scene)
    if start.measure is not None and not set(scene.named) - {"gas", "dust", "drag", *start.exact_effects}:
        yield "exact solution", "may exist; compare with: discsim cost SCENE --error 1%"


def _disc_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    """Yield the estimates for a disc with gas particles, from the properties `at` of its gas."""
    if at.scale_height is None or at.resolution is None or scene.gas is None or at.omega is None:
        return
    if not scene.model.is_sph:
        yield from _drag_rows(scene, at)
        return
    ratios, fractions = at.by_mass()
    ratio = float(np.interp(0.5, fractions, ratios))
    yield "median h/H of the gas", f"{ratio:.2g}"
    yield "error of the pressure force", f"{0.02 * (ratio / 0.32) ** 2:.1%}"
    numerical_nu = viscosity.artificial_nu(scene, at) + viscosity.noise_nu(scene, at)
    relative_nu = numerical_nu / (at.resolution * at.thermal_speed)
    alpha = ratio * float(np.median(relative_nu))
    yield "alpha by SPH viscosity and noise", f"{float(f'{alpha:.1g}'):g}"
    if scene.run.timestep is None:
        orbits = (scene.run.until - start_time(scene)) * float(np.median(at.omega)) / (2.0 * np.pi)
        energy = 3e-3 * (scene.run.courant / 0.8) ** 2.4 * orbits / 3.0
        yield "energy error of the whole run", f"{energy:.1g}"
    yield from _drag_rows(scene, at)


def _drag_rows(scene: Scene, at: GasSamples) -> Iterator[tuple[str, str]]:
    """Yield the estimated error of the dust drift, if the drag scheme is the default one."""
    sides = drag_cell_sides(scene, at)
    if sides is None or scene.drag is None or scene.drag.scheme != DEFAULT_SCHEME:
        return
    widths = sides / at.scale_height
    worst = int(np.argmax(widths))
    error, where = drift_error(widths[worst]), f"in drag cells of {widths[worst]:.2g} H {at.where(worst)}"
    if error < 1.0:
        yield "error of the dust drift", f"{error:.1g} at St = 0.01, {where}; smaller for larger St"
    else:
        yield "error of the dust drift", f"100% or more at St = 0.01, {where}"


# Stored errors


def digest(scene: Scene) -> str:
    """Return a hash of all keys of a scene on which its results depend, except the random seed."""
    data: dict[str, Any] = tomllib.loads(scene.text)
    for name in (*FREE_TO_CHANGE, "run.seed"):
        table, _, key = name.rpartition(".")
        if name != "run.until":
            (data.get(table, {}) if table else data).pop(key, None)
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def _stored_errors() -> list[dict[str, Any]]:
    """Return the stored errors, each as a dict with the keys scene (a `digest`), measure, error and cpu."""
    types = {"scene": str, "measure": str, "error": int | float, "cpu": int | float}
    return stored_runs.read_list("errors", lambda run: all(isinstance(run.get(key), types[key]) for key in types))


def store_error(scene: Scene, measure: str, error: float, cpu: float) -> None:
    """Store the error of a run of the scene for later calls of `accuracy`. Do nothing if the cache cannot be written.

    measure: name of the error measure. error: relative error. cpu: CPU seconds of the run.
    """
    own = {"scene": digest(scene), "measure": measure, "error": error, "cpu": cpu}
    others = [run for run in _stored_errors() if (run["scene"], run["measure"]) != (own["scene"], measure)]
    stored_runs.write_list("errors", [*others[1 - MAX_STORED :], own])
