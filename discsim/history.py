"""history.csv: totals against time, one row a step or interval.

Sums over the particles that move: momentum sum m v, angular momentum sum m (x v_y - y v_x) about the origin,
kinetic energy sum m v^2 / 2, with velocities at the time of the positions. Code units.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.eos import thermal_energy

if TYPE_CHECKING:
    from discsim.effects.base import Effect
    from discsim.state import Gas, Particles, State

Array = np.ndarray

COLUMNS = (
    "step", "time", "dt", "dt_set_by", "mass_gas", "mass_dust", "momentum_x", "momentum_y",
    "angular_momentum", "kinetic_gas", "kinetic_dust", "thermal", "potential", "accreted_gas",
    "accreted_dust", "uncoupled_dust",
)  # fmt: skip


class History:
    """The open file. It starts anew, or goes on after the row of step `after`, later rows dropped."""

    def __init__(self, path: Path, after: int | None = None) -> None:
        rows = [] if after is None else _rows_until(path, after)
        temporary = path.with_name(f".{path.name}.part")
        with temporary.open("w", newline="") as file:
            csv.writer(file).writerows([COLUMNS, *rows])
        os.replace(temporary, path)
        self._file = path.open("a", newline="")
        self._last = int(rows[-1][0]) if rows else -1

    def add(self, row: Sequence[object]) -> None:
        """Append a row, unless its step has one already."""
        if row[0] != self._last:
            csv.writer(self._file).writerow(row)
            self._file.flush()
            self._last = int(str(row[0]))

    def close(self) -> None:
        self._file.close()


def _rows_until(path: Path, step: int) -> list[list[str]]:
    """The whole rows up to `step`; a row that a crash cut short is not one."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = [row for row in csv.reader(file) if len(row) == len(COLUMNS) and row[0].isdecimal()]
    return [row for row in rows if int(row[0]) <= step]


def history_row(state: State, effects: Mapping[str, Effect], dt: float, dt_set_by: str) -> list[object]:
    """The row of a synchronised state, entries as in COLUMNS; `dt` is the step that led to it."""
    gas, dust = _totals(state.gas), _totals(state.dust)
    momentum = gas.momentum + dust.momentum
    return [
        state.step, state.time, dt, dt_set_by, gas.mass, dust.mass, float(momentum[0]), float(momentum[1]),
        gas.spin + dust.spin, gas.kinetic, dust.kinetic, _thermal(state),
        float(sum(effect.potential_energy(state) for effect in effects.values())),
        state.ledger.accreted_gas, state.ledger.accreted_dust,
        float(getattr(effects.get("drag"), "uncoupled", 0.0)),
    ]  # fmt: skip


class _Totals(NamedTuple):
    mass: float
    momentum: Array  # (2,)
    spin: float
    kinetic: float


def _totals(particles: Particles | None) -> _Totals:
    if particles is None:
        return _Totals(0.0, np.zeros(2), 0.0, 0.0)
    free = _free(particles)
    mass, pos, vel = particles.mass[free], particles.pos[free], particles.vel[free]
    momentum = np.zeros(2)
    momentum[: vel.shape[1]] = (mass[:, None] * vel).sum(axis=0)
    spin = (mass * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])).sum() if vel.shape[1] == 2 else 0.0
    kinetic = 0.5 * (mass * (vel * vel).sum(axis=1)).sum()
    return _Totals(float(mass.sum()), momentum, float(spin), float(kinetic))


def _thermal(state: State) -> float:
    gas: Gas | None = state.gas
    if gas is None:
        return 0.0
    free = _free(gas)
    u = None if gas.u is None else gas.u[free]
    return thermal_energy(state.scene, gas.mass[free], gas.density[free], u)


def _free(particles: Particles) -> Array | slice:
    """The particles that are not boundary of a shock tube: those are no part of the flow."""
    immobile = getattr(particles, "immobile", None)
    return slice(None) if immobile is None else ~immobile
