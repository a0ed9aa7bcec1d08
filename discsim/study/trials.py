"""Data types of the search for cheap settings: grid points, trials, and the protocol of the runner.

A knob is a parameter that the search varies. A grid point has an entry for each knob, a whole number that stands for
a value; arguments `rung` are such entries. A trial is a grid point with the results of its runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import NamedTuple, Protocol

GridPoint = tuple[int, ...]  # the rung of each knob, for numbers in half rungs; 0 is the value in the scene
UNITS_PER_RUNG = 2  # difference between two entries of a GridPoint that are one rung of a number apart


class Measured(NamedTuple):
    """Result of a run: CPU seconds of its steps, and its error."""

    cpu: float
    error: float


@dataclass
class Trial:
    """A grid point with the results of its runs, one per seed.

    stopped: the reason why a run gave no result, after which no more runs are made; "" if all runs gave results.
    """

    point: GridPoint
    runs: list[Measured] = field(default_factory=list)
    stopped: str = ""

    @property
    def cpu(self) -> float:
        """Median of the CPU seconds over the seeds."""
        return median(run.cpu for run in self.runs)

    @property
    def error(self) -> float:
        """Mean of the error over the seeds."""
        return fmean(run.error for run in self.runs)

    @property
    def scatter(self) -> float:
        """Standard deviation of the error between seeds; 0 for a single seed."""
        return stdev(run.error for run in self.runs) if len(self.runs) > 1 else 0.0


def finished_trials(trials: Mapping[GridPoint, Trial]) -> list[Trial]:
    """Return the trials that have results of runs."""
    return [trial for trial in trials.values() if trial.runs]


def finished_trial(trials: Mapping[GridPoint, Trial], point: GridPoint) -> Trial | None:
    """Return the trial of a grid point; None if it has no results of runs."""
    found = trials.get(point)
    return found if found and found.runs else None


def with_rung(point: GridPoint, knob: int, rung: int) -> GridPoint:
    """Return a copy of a grid point in which the knob with the index `knob` has the entry `rung`."""
    return (*point[:knob], rung, *point[knob + 1 :])


class BudgetError(Exception):
    """The budget of wall-clock time is used up."""


class Runner(Protocol):
    """Protocol of the code that makes the runs of a search, and collects their results in `trials`.

    `is_valid` returns whether the scene is valid with the settings of a grid point. `run` makes runs until the trial
    of each point has results for `number` seeds, or the reason why a run gave no result, such as more than `most`
    CPU seconds. `run` raises BudgetError.
    """

    trials: dict[GridPoint, Trial]

    def is_valid(self, point: GridPoint) -> bool: ...
    def run(self, points: Sequence[GridPoint], number: int = 1, most: float = math.inf) -> None: ...
