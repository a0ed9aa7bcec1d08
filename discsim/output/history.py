"""Writing and reading of history.csv: totals over the particles against time, in code units.

The file has a row for every step, or in large runs for every 16 steps, and one for every snapshot. Totals are sums over
mobile particles: momentum sum m v, angular momentum sum m (x v_y - y v_x) about the origin, kinetic energy
sum m v^2 / 2, where v includes the azimuthal velocity in a shearing box. Velocities and positions are at the same time.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.effects.base import KickEffect
from discsim.numerics.totals import total, totals
from discsim.output.files import open_to_append, replace_atomically
from discsim.parts import Lazy
from discsim.physics.eos import thermal_energy
from discsim.printable import UserError
from discsim.userfiles import read_text, system_message

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
GROWTH_COLUMNS = ("mass_small", "accreted_small")  # additional columns of a scene with [growth]
MAX_BYTES = 2**31  # largest size of a file in bytes
TEXT_COLUMNS = ("dt_set_by",)  # columns that contain text instead of numbers


def history_columns(scene: Scene) -> tuple[str, ...]:
    """Return the names of the columns in history.csv for a scene. With [growth], columns of gas exclude small dust."""
    return COLUMNS if scene.table("growth") is None else (*COLUMNS, *GROWTH_COLUMNS)


class HistoryError(UserError):
    """A damaged or unreadable table, with which a run cannot be resumed; the message has the line and a remedy."""


class History:
    """A CSV table with the given `columns`, open for appending; the first column is the number of the step.

    The table replaces an existing file at `path`. It starts with `rows`: in a resumed run, the rows up to the
    checkpoint. `count` is the number of rows, `last` the last row.
    """

    def __init__(self, path: Path, rows: Sequence[Sequence[str]] = (), columns: Sequence[str] = COLUMNS) -> None:
        self._digest = hashlib.sha256(_csv_text(rows).encode())
        with replace_atomically(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            file.write(_csv_text([columns, *rows]))
        self._file = open_to_append(path, buffering=0)
        self.count = len(rows)
        self.last: Sequence[object] | None = rows[-1] if rows else None

    def add(self, *rows: Sequence[object]) -> None:
        """Append rows of one step, unless the table has rows of this step already."""
        if rows and (self.last is None or rows[0][0] != int(str(self.last[0]))):
            lines = _csv_text(rows).encode()
            self._append(lines)
            self._digest.update(lines)
            self.last = rows[-1]
            self.count += len(rows)

    @property
    def digest(self) -> str:
        """The SHA-256 digest of all rows so far."""
        return self._digest.hexdigest()

    def _append(self, lines: bytes) -> None:
        """Write `lines` at the end of the file; if this fails, for example on a full disk, restore its length."""
        size, left = os.fstat(self._file.fileno()).st_size, memoryview(lines)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            with suppress(OSError):  # the first error is the one to report
                self._file.truncate(size)
            raise

    def sync(self) -> None:
        """Synchronise the file to disk; called before a checkpoint, which records the number of rows."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


class RestoredRows(NamedTuple):
    """Rows of a table up to a checkpoint, and warnings about missing or removed rows."""

    rows: list[list[str]]
    remarks: list[str]


def rows_until(path: Path, step: int, count: int, digest: str, columns: Sequence[str] = COLUMNS) -> RestoredRows:
    """Return the rows of the table at `path` up to the checkpoint at `step`, without later rows.

    `count` and `digest` are the number of these rows and their SHA-256 digest, from the checkpoint. Missing rows cause
    a warning. With `digest` "" the content is not compared. Raises HistoryError if the file cannot be read, or if a row
    up to the checkpoint is damaged.
    """
    remedy = "repair the file, or move it away to continue without its rows"
    try:
        head, table, complete = _read_table(path, columns)
    except OSError as fault:
        raise HistoryError(f"{system_message(fault, 'read', path)}; {remedy}") from None
    rows = [row for row in complete[:count] if int(row[0]) <= step]
    line = len(complete) + 2 if head == [*columns] else 1
    if len(rows) < count and len(complete) < len(table):
        wrong = (
            f"not a row of history.csv, with {len(columns)} numbers" if line > 1 else "not the header of history.csv"
        )
        raise HistoryError(f"{path}:{line}: {wrong}; {remedy}")
    if len(complete) >= count and digest not in ("", hashlib.sha256(_csv_text(complete[:count]).encode()).hexdigest()):
        raise HistoryError(
            f"{path}:2: the {count} rows from this line on differ from the rows that the run wrote; {remedy}"
        )
    remarks = []
    if len(rows) != count:
        remarks.append(f"{path} has {len(rows)} rows up to step {step}, but the run wrote {count} rows")
    if len(complete) < len(table):
        remarks.append(f"{path}:{line}: an incomplete row after the checkpoint is removed; the run writes it again")
    return RestoredRows(rows, remarks)


def _csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV text."""
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue()


def read_history(path: Path, scene: Scene) -> list[dict[str, str]]:
    """Return the rows of the history.csv at `path` as dicts by column, up to the first incomplete row."""
    return read_rows(path, history_columns(scene))


def read_rows(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Return the rows of a table with these columns as dicts by column, up to the first incomplete row."""
    return [dict(zip(columns, row, strict=True)) for row in _read_table(path, columns)[2]]


def read_checked_table(path: Path, columns: Sequence[str]) -> list[list[str]]:
    """Return the rows of a table with these columns, without a last row that is still being written.

    Raises HistoryError if the file cannot be read, or if its header or an earlier row is damaged.
    """
    try:
        head, table, complete = _read_table(path, columns)
    except OSError as fault:
        raise HistoryError(system_message(fault, "read", path)) from None
    if head != [*columns]:
        raise HistoryError(f"{path}:1: not the header of {path.name}; expected {','.join(columns)}")
    if len(complete) < len(table) - 1:
        wrong = f"not a row of {path.name}; expected {len(columns)} entries"
        raise HistoryError(f"{path}:{len(complete) + 2}: {wrong}")
    return complete


def _read_table(path: Path, columns: Sequence[str]) -> tuple[list[str], list[list[str]], list[list[str]]]:
    """Return the header, all lines after it, and the complete rows before the first incomplete line.

    If the header differs from `columns`, no row counts as complete. A missing file counts as empty.
    """
    text = read_text(path, "replace", most=MAX_BYTES) if path.exists() else ""
    head, *table = [line.split(",") for line in text.splitlines()] or [[]]
    return head, table, list(itertools.takewhile(partial(_is_row, columns), table)) if head == [*columns] else []


def _is_row(columns: Sequence[str], entries: list[str]) -> bool:
    """Return whether `entries` are a complete row: a step number, then a number or text for each column."""
    try:
        for name, entry in zip(columns, entries, strict=True):
            if name not in TEXT_COLUMNS:
                float(entry)
    except ValueError:
        return False
    return entries[0].isdecimal() and ",".join(entries).isascii()


def history_row(
    state: State, effects: Mapping[str, Effect], dt: float, dt_set_by: str, before: Sequence[object] | None = None
) -> list[object]:
    """Return the row of a synchronised state, with one entry for each name in `history_columns`.

    `dt` is the length of the last step, `dt_set_by` the name of the limit that set it. `before` is the previous row;
    the accretion rates in the new row are means since then, or 0 without a previous row.
    """
    gas, dust = _totals_of_species(state.gas), _totals_of_species(state.dust)
    momentum = gas.momentum + dust.momentum
    mass_gas, small = gas.mass, []
    if state.gas is not None and state.gas.small is not None:
        small = [total(state.gas.small), state.ledger.accreted_small]
        mass_gas = total(state.gas.mass * growth.gas_fraction(state.scene, state.gas))
    return [
        state.step, state.time, dt, dt_set_by, mass_gas, dust.mass, float(momentum[0]), float(momentum[1]),
        gas.spin + dust.spin, gas.kinetic, dust.kinetic, _thermal_energy(state),
        float(sum(effect.potential_energy(state) for effect in effects.values())),
        state.ledger.accreted_gas, state.ledger.accreted_dust,
        float(max((e.uncoupled for e in effects.values() if isinstance(e, KickEffect)), default=0.0)),
        *_accretion_rates(state, before), _radiated_energy(state.gas), *small,
    ]  # fmt: skip


def _accretion_rates(state: State, before: Sequence[object] | None) -> tuple[float, float]:
    """Return the mean accretion rates of gas and of dust onto the star since the row `before`."""
    if before is None:
        return 0.0, 0.0
    then = dict(zip(history_columns(state.scene), before, strict=True))
    dt = state.time - float(str(then["time"]))
    if dt <= 0.0:
        return 0.0, 0.0
    taken = state.ledger.accreted_gas, state.ledger.accreted_dust
    gas, dust = (now - float(str(then[f"accreted_{n}"])) for n, now in zip(("gas", "dust"), taken, strict=True))
    return gas / dt, dust / dt


class _Totals(NamedTuple):
    """Totals over the mobile particles of a species; `spin` is the angular momentum about the origin."""

    mass: float
    momentum: Array  # (2,)
    spin: float
    kinetic: float


def _totals_of_species(particles: Particles | None) -> _Totals:
    """Return the totals of a species; all are 0 if the run has no such species."""
    if particles is None:
        return _Totals(0.0, np.zeros(2), 0.0, 0.0)
    free = _mobile_rows(particles)
    mass, pos, vel = particles.mass[free], particles.pos[free], particles.vel[free]
    plane = vel.shape[1] == 2
    spin = mass * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]) if plane else np.zeros_like(mass)
    across = mass * vel[:, 1] if plane else spin
    kinetic = mass * (vel * vel).sum(axis=1)
    if particles.across is not None:
        kinetic += mass * particles.across[free] ** 2
    found = totals(np.stack([mass, mass * vel[:, 0], across, spin, kinetic], axis=1)).tolist()
    return _Totals(found[0], np.array(found[1:3]), found[3], 0.5 * found[4])


def _thermal_energy(state: State) -> float:
    """Return the thermal energy of the mobile gas, without small dust."""
    gas: Gas | None = state.gas
    if gas is None:
        return 0.0
    free = _mobile_rows(gas)
    mass, density = gas.mass[free], gas.density[free]
    if gas.u is None and gas.small is not None:  # small dust adds mass but no pressure
        share = growth.gas_fraction(state.scene, gas)
        mass, density = mass * share, density * share
    return thermal_energy(state.scene, mass, density, None if gas.u is None else gas.u[free])


def _radiated_energy(gas: Gas | None) -> float:
    """Return the energy that the present gas has radiated since the start."""
    return 0.0 if gas is None or gas.radiated is None else total(gas.mass * gas.radiated)


def _mobile_rows(particles: Particles) -> Array | slice:
    """Return a mask or slice of the mobile particles; the boundary particles of a shock tube are immobile."""
    immobile = getattr(particles, "immobile", None)
    return slice(None) if immobile is None else ~immobile
