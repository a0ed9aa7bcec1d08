"""companions.csv: each companion against time, a row a step or every `companion.every`. Code units, angles in degrees.

Places and velocities are relative to the star, velocities at the time of the places; semi_major_axis, eccentricity,
pericentre (its longitude) and anomaly (true) are those of the orbit that its whole mass would be on with the star
alone. Gas and dust feel felt_mass of it, less than mass during its ramp; torques are those of all gas and dust on that
about the star, felt_mass r x a, whether it feels them or not. The star's own place and velocity are in the frame of the
run.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discsim.exact import kepler
from discsim.physics.orbits import orbital_mass

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

COLUMNS = (
    "step", "time", "number", "mass", "x", "y", "vx", "vy", "semi_major_axis", "eccentricity", "pericentre", "anomaly",
    "torque_gas", "torque_dust", "accreted_gas", "accreted_dust", "star_mass", "star_x", "star_y", "star_vx", "star_vy",
    "felt_mass",
)  # fmt: skip
EARLY = 1e-9  # of an interval, by which rounding may bring a row too early


def written_for(scene: Scene) -> bool:
    """Whether a run of a scene has the file."""
    return scene.table("companion") is not None


def companion_rows(state: State, dt: float) -> list[list[object]]:
    """Rows of the companions that are due after a step of dt, entries as in COLUMNS; at the start all of them."""
    bodies = state.bodies
    if bodies is None:
        return []
    vel = bodies.vel + state.lag * bodies.acc  # with the closing kick
    star = [float(value) for value in (bodies.mass[0], *bodies.pos[0], *vel[0])]
    rows: list[list[object]] = []
    for k, companion in enumerate(state.scene.table("companion") or (), 1):
        if state.step > 0 and not _due(companion.every, state.time, dt):
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


def _due(every: float | None, time: float, dt: float) -> bool:
    return every is None or bool(np.floor(time / every + EARLY) > np.floor((time - dt) / every + EARLY))
