"""What a search turns, and what it is told: knobs, places of them, trials with what runs found, who makes runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import NamedTuple, Protocol

Place = tuple[int, ...]  # a rung for each knob, 0 as the scene has it
RUNG = 2  # half rungs, of which places are made


class Knob(Protocol):
    """What a search has to know of a knob. stride: of its rungs; a choice has each value from lowest to highest."""

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
    """A place with what its runs found, one for each seed; `stopped` says why it has none."""

    place: Place
    runs: list[Measured] = field(default_factory=list)
    stopped: str = ""

    @property
    def cpu(self) -> float:
        return median(run.cpu for run in self.runs)

    @property
    def error(self) -> float:
        """The mean of the seeds'."""
        return fmean(run.error for run in self.runs)

    @property
    def scatter(self) -> float:
        """Of the error from seed to seed."""
        return stdev(run.error for run in self.runs) if len(self.runs) > 1 else 0.0


class Spent(Exception):
    """The budget is used up."""


class Bench(Protocol):
    """Who makes the runs. run: so that each place has `number` of them, in turn, or says why not. Raises Spent."""

    trials: dict[Place, Trial]

    def allowed(self, place: Place) -> bool: ...
    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None: ...
