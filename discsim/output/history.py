"""history.csv: totals against time, one row a step or interval.

Sums over the particles that move: momentum sum m v, angular momentum sum m (x v_y - y v_x) about the origin,
kinetic energy sum m v^2 / 2, with velocities at the time of the positions. Code units.
"""

from __future__ import annotations

import csv
import itertools
import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.output.files import written
from discsim.parts import Lazy
from discsim.physics.eos import thermal_energy

if TYPE_CHECKING:
    from discsim.effects.base import Effect
    from discsim.numerics.state import Gas, Particles, State
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")

COLUMNS = (
    "step", "time", "dt", "dt_set_by", "mass_gas", "mass_dust", "momentum_x", "momentum_y",
    "angular_momentum", "kinetic_gas", "kinetic_dust", "thermal", "potential", "accreted_gas",
    "accreted_dust", "uncoupled_dust", "accretion_rate_gas", "accretion_rate_dust", "radiated",
)  # fmt: skip
OF_GROWTH = ("mass_small", "accreted_small")  # small dust, where dust grows; "gas" is then without it
WORDS = ("dt_set_by",)  # columns that are no numbers


def columns_of(scene: Scene) -> tuple[str, ...]:
    """The columns of a run of a scene."""
    return COLUMNS if scene.table("growth") is None else (*COLUMNS, *OF_GROWTH)


class HistoryError(Exception):
    """A history.csv that a run cannot go on with; the message says where it is wrong."""


class History:
    """The open file of some `columns`, the step first. It starts with `rows`, earlier ones up to a checkpoint."""

    def __init__(self, path: Path, rows: Sequence[Sequence[str]] = (), columns: Sequence[str] = COLUMNS) -> None:
        with written(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([columns, *rows])
        self._file = path.open("a", newline="", encoding="utf-8")
        self.count = len(rows)
        self.last: Sequence[object] | None = rows[-1] if rows else None

    def add(self, *rows: Sequence[object]) -> None:
        """Append the rows of a step, unless it has some already."""
        if rows and (self.last is None or rows[0][0] != int(str(self.last[0]))):
            csv.writer(self._file).writerows(rows)
            self._file.flush()
            self.last = rows[-1]
            self.count += len(rows)

    def sync(self) -> None:
        """Have the rows on the disk: a checkpoint says how many there are."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


def rows_until(path: Path, step: int, count: int, columns: Sequence[str] = COLUMNS) -> list[list[str]]:
    """The rows of a file up to `step`, `count` of them or fewer where some are lost. Raises HistoryError.

    A crash may cut the last line short, later than those rows: what is no row among them is damage.
    """
    if not path.exists():
        return []
    head, *table = [line.split(",") for line in path.read_text(encoding="utf-8", errors="replace").splitlines()] or [[]]
    whole = list(itertools.takewhile(partial(_is_row, columns), table)) if head == [*columns] else []
    rows = [row for row in whole if int(row[0]) <= step]
    if len(rows) < count and len(whole) < len(table):
        line = len(whole) + 2 if head == [*columns] else 1
        wrong = f"no row of a history; expected {len(columns)} entries" if line > 1 else "not the header of a history"
        raise HistoryError(f"{path}:{line}: {wrong}. Mend it, or move the file away to go on without its rows")
    return rows


def read_history(path: Path, scene: Scene) -> list[dict[str, str]]:
    """The rows of a run of the scene by the names of columns, up to the first that is not whole."""
    names = columns_of(scene)
    return [dict(zip(names, row, strict=True)) for row in rows_until(path, sys.maxsize, 0, names)]


def _is_row(columns: Sequence[str], entries: list[str]) -> bool:
    try:
        for name, entry in zip(columns, entries, strict=True):
            if name not in WORDS:
                float(entry)
    except ValueError:
        return False
    return entries[0].isdecimal() and ",".join(entries).isascii()


def history_row(
    state: State, effects: Mapping[str, Effect], dt: float, dt_set_by: str, before: Sequence[object] | None = None
) -> list[object]:
    """The row of a synchronised state, entries as in `columns_of`; `dt` is the step that led to it.

    Rates of accretion are means since the row `before`; without one they are 0.
    """
    gas, dust = _totals(state.gas), _totals(state.dust)
    momentum = gas.momentum + dust.momentum
    mass_gas, small = gas.mass, []
    if state.gas is not None and state.gas.small is not None:
        small = [float(state.gas.small.sum()), state.ledger.accreted_small]
        mass_gas = float((state.gas.mass * growth.gas_share(state.scene, state.gas)).sum())
    return [
        state.step, state.time, dt, dt_set_by, mass_gas, dust.mass, float(momentum[0]), float(momentum[1]),
        gas.spin + dust.spin, gas.kinetic, dust.kinetic, _thermal(state),
        float(sum(effect.potential_energy(state) for effect in effects.values())),
        state.ledger.accreted_gas, state.ledger.accreted_dust,
        float(max((effect.uncoupled for effect in effects.values()), default=0.0)),
        *_accretion_rates(state, before), _radiated(state.gas), *small,
    ]  # fmt: skip


def _accretion_rates(state: State, before: Sequence[object] | None) -> tuple[float, float]:
    """Of gas and dust by the star, since the row `before`."""
    if before is None:
        return 0.0, 0.0
    then = dict(zip(columns_of(state.scene), before, strict=True))
    dt = state.time - float(str(then["time"]))
    if dt <= 0.0:
        return 0.0, 0.0
    taken = state.ledger.accreted_gas, state.ledger.accreted_dust
    gas, dust = (now - float(str(then[f"accreted_{n}"])) for n, now in zip(("gas", "dust"), taken, strict=True))
    return gas / dt, dust / dt


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
    mass, density = gas.mass[free], gas.density[free]
    if gas.u is None and gas.small is not None:  # small dust has no pressure
        share = growth.gas_share(state.scene, gas)
        mass, density = mass * share, density * share
    return thermal_energy(state.scene, mass, density, None if gas.u is None else gas.u[free])


def _radiated(gas: Gas | None) -> float:
    """Energy that the gas there is has lost by cooling since the start."""
    return 0.0 if gas is None or gas.radiated is None else float((gas.mass * gas.radiated).sum())


def _free(particles: Particles) -> Array | slice:
    """The particles that are not boundary of a shock tube: those are no part of the flow."""
    immobile = getattr(particles, "immobile", None)
    return slice(None) if immobile is None else ~immobile
