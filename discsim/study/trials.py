"""Data of a search: places, trials with the results of runs, and the protocols of knobs and of the runner."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import NamedTuple, Protocol

Place = tuple[int, ...]  # a rung for each knob, 0 for the scene's value
RUNG = 2  # half rungs per rung; places count half rungs


class Knob(Protocol):
    """Protocol of a knob for the search.

    Rungs go from `lowest` to `highest` in steps of `stride`; a choice uses every one of them.
    """

    @property
    def choice(self) -> bool: ...
    @property
    def lowest(self) -> int: ...
    @property
    def highest(self) -> int: ...
    @property
    def stride(self) -> int: ...


class Measured(NamedTuple):
    cpu: float
    error: float


@dataclass
class Trial:
    """A place with the results of its runs, one per seed; `stopped` has the reason if it has none."""

    place: Place
    runs: list[Measured] = field(default_factory=list)
    stopped: str = ""

    @property
    def cpu(self) -> float:
        """Median CPU seconds over the seeds."""
        return median(run.cpu for run in self.runs)

    @property
    def error(self) -> float:
        """Mean error over the seeds."""
        return fmean(run.error for run in self.runs)

    @property
    def scatter(self) -> float:
        """Standard deviation of the error between seeds."""
        return stdev(run.error for run in self.runs) if len(self.runs) > 1 else 0.0


class BudgetError(Exception):
    """The budget of wall-clock time is used up."""


class Bench(Protocol):
    """Protocol of the runner of a search.

    `run` gives each place `number` results, or the reason for none. Raises BudgetError.
    """

    trials: dict[Place, Trial]

    def allowed(self, place: Place) -> bool: ...
    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None: ...
