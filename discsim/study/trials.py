"""Data types of the search for cheap settings: places, trials, and protocols of knobs and of the runner.

A knob is a parameter that the search varies, a rung one of its values, and a place a rung for each knob. A trial is a
place with the results of its runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import NamedTuple, Protocol

Place = tuple[int, ...]  # a rung for each knob; 0 is the value in the scene
RUNG = 2  # numbers are varied in half rungs, so a rung is 2 units of a place


class Knob(Protocol):
    """Protocol of a parameter that the search varies: a number, or a choice from a list of values.

    Rungs go from `lowest` to `highest`, for numbers in steps of `stride`, for a choice in steps of 1.
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
    """Result of a run: CPU seconds of its steps, and its error."""

    cpu: float
    error: float


@dataclass
class Trial:
    """A place with the results of its runs, one per seed; `stopped` is the reason if a run gave no result."""

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


class Runner(Protocol):
    """Protocol of the code that makes the runs of a search and collects them in `trials`.

    `allowed` returns whether the settings of a place are valid. `run` makes runs until the trial of each place has
    results for `number` seeds, or a reason why a run gave no result, such as more than `most` CPU seconds. It raises
    BudgetError.
    """

    trials: dict[Place, Trial]

    def allowed(self, place: Place) -> bool: ...
    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None: ...
