"""Tables that a run writes as it goes: history.csv and, with companions, companions.csv."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from discsim.effects.base import Effect
from discsim.numerics.state import State
from discsim.output import companions
from discsim.output.checkpoint import Values
from discsim.output.history import History, history_columns, history_row, rows_until
from discsim.scene import Scene

# For each table: name of its number of rows in a checkpoint, file and, for companions.csv, columns.
COMPANIONS = ("companion_rows", "companions.csv", companions.COLUMNS)
HISTORY = "rows", "history.csv"


class Records:
    """Tables of a run in `directory`. In a resumed run they begin with the rows written before the checkpoint."""

    def __init__(self, scene: Scene, directory: Path) -> None:
        self.directory = directory
        self.tables = [(*HISTORY, history_columns(scene))] + ([COMPANIONS] if companions.has_companions(scene) else [])
        self._rows: dict[str, list[list[str]]] = {}
        self._files: dict[str, History] = {}

    @property
    def names(self) -> str:
        """File names of the tables, as a text."""
        return ", ".join(file for _, file, _ in self.tables)

    def restore_rows(self, step: int, values: Values) -> list[str]:
        """Read the rows of all tables up to `step` for `open`, and return warnings about lost rows.

        values: single values of the checkpoint, with the number and the digest of the rows of each table.
        """
        remarks = []
        for name, file, columns in self.tables:
            digest = values.text(f"{name}_digest") if f"{name}_digest" in values else ""  # absent in earlier versions
            found = rows_until(self.directory / file, step, values.whole(name), digest, columns)
            self._rows[name] = found.rows
            remarks += found.remarks
        return remarks

    def open(self) -> None:
        """Create the files, with the rows that `restore_rows` has read."""
        for name, file, columns in self.tables:
            self._files[name] = History(self.directory / file, self._rows.get(name, []), columns)

    @property
    def counts(self) -> dict[str, int | str]:
        """Number of rows and digest of each table, for a checkpoint."""
        numbers = {name: file.count for name, file in self._files.items()}
        return {**numbers, **{f"{name}_digest": file.digest for name, file in self._files.items()}}

    def add_history(self, state: State, effects: Mapping[str, Effect], dt: float, set_by: str) -> None:
        """Add a row to history.csv; dt, set_by: length of the last step, and name of the limit that set it."""
        history = self._files[HISTORY[0]]
        history.add(history_row(state, effects, dt, set_by, history.last))

    def add_companions(self, state: State, dt: float) -> None:
        """Add the rows of companions.csv that are due after a step of dt."""
        if COMPANIONS[0] in self._files:
            self._files[COMPANIONS[0]].add(*companions.companion_rows(state, dt))

    def sync(self) -> None:
        """Write all rows to the disk."""
        for file in self._files.values():
            file.sync()

    def close(self) -> None:
        for file in self._files.values():
            file.close()
