"""Rows of companions.csv: the orbits of companions, and the torques on them, against time.

The file has one row per companion and step, or per companion and interval `companion.every`. Values are in code units,
angles in degrees. x, y, vx, vy are relative to the star, at the time of the row. semi_major_axis, eccentricity,
pericentre (its longitude) and anomaly (true anomaly) describe the two-body orbit about the star with the companion's
full mass.

During the ramp of its mass, a companion attracts gas and dust with felt_mass, which is smaller than mass. Its torque
about the star is felt_mass r x a, with the acceleration a by all gas or by all dust; the torque is computed even if
the companion does not react to gas and dust. star_x ... star_vy are in the frame of the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from discsim.exact import kepler
from discsim.output.history import HistoryError, read_rows
from discsim.physics.orbits import orbital_mass

if TYPE_CHECKING:
    from pathlib import Path

    from discsim.numerics.state import State
    from discsim.scene import Scene

Array = np.ndarray
COLUMNS = (
    "step", "time", "number", "mass", "x", "y", "vx", "vy", "semi_major_axis", "eccentricity", "pericentre", "anomaly",
    "torque_gas", "torque_dust", "accreted_gas", "accreted_dust", "star_mass", "star_x", "star_y", "star_vx", "star_vy",
    "felt_mass",
)  # fmt: skip
TIME_TOLERANCE = 1e-9  # tolerance for rounding errors of the time, relative to `companion.every`


def has_companions(scene: Scene) -> bool:
    """Return whether a run of the scene writes companions.csv."""
    return scene.table("companion") is not None


def read_companions(directory: Path, names: Sequence[str]) -> dict[str, Array]:
    """Return columns (rows,) of the companions.csv of a run by name, up to the first incomplete row.

    Raises HistoryError if the file is missing, has no rows, or a number in these columns is not finite, and OSError.
    """
    path = directory / "companions.csv"
    if not path.exists():
        raise HistoryError(f"{path}: file not found; expected the directory of a run with a companion")
    rows = read_rows(path, COLUMNS)
    if not rows:
        raise HistoryError(f"{path}: no rows of companions; expected the companions.csv of a run")
    columns = {name: np.array([float(row[name]) for row in rows]) for name in names}
    for name, column in columns.items():
        if not np.isfinite(column).all():
            line = int(np.flatnonzero(~np.isfinite(column))[0]) + 2
            raise HistoryError(f"{path}:{line}: {name} is not finite; expected numbers")
    return columns


def companion_rows(state: State, dt: float) -> list[list[object]]:
    """Return the rows, with the entries COLUMNS, of the companions that are due after a step of length `dt`.

    A companion is due after the steps in which a multiple of its `every` lies. At step 0 all companions are due.
    """
    bodies = state.bodies
    if bodies is None:
        return []
    vel = bodies.vel + state.velocity_lag * bodies.acc  # includes the closing half kick
    star = [float(value) for value in (bodies.mass[0], *bodies.pos[0], *vel[0])]
    rows: list[list[object]] = []
    for k, companion in enumerate(state.scene.table("companion") or (), 1):
        if state.step > 0 and not _is_due(companion.every, state.time, dt):
            continue
        r, v = bodies.pos[k] - bodies.pos[0], vel[k] - vel[0]
        mass = orbital_mass(state.scene, float(bodies.mass[0]), float(bodies.mass[k]))
        orbit = kepler.elements(mass, *r.tolist(), *v.tolist())
        torques = bodies.felt[k] * (r[0] * bodies.pulled[k, :, 1] - r[1] * bodies.pulled[k, :, 0])
        rows.append(
            [
                state.step, state.time, k, float(bodies.mass[k]), *r.tolist(), *v.tolist(), orbit.semi_major_axis,
                orbit.eccentricity, math.degrees(orbit.pericentre), math.degrees(orbit.anomaly), *torques.tolist(),
                *bodies.accreted[k].tolist(), *star, float(bodies.felt[k]),
            ]
        )  # fmt: skip
    return rows


def _is_due(every: float | None, time: float, dt: float) -> bool:
    """Return whether a multiple of `every` lies in the step of length `dt` that ends at `time`.

    If `every` is None, every step counts.
    """
    return every is None or bool(
        np.floor(time / every + TIME_TOLERANCE) > np.floor((time - dt) / every + TIME_TOLERANCE)
    )
