"""Progress display and user callback of a simulation that runs from Python."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import TYPE_CHECKING

from discsim.scene.fields import MAX_SNAPSHOTS

if TYPE_CHECKING:
    from discsim.run.progress import Progress
    from discsim.run.simulation import Simulation


class Watch:
    """Progress display and callback of `Simulation.run`; times are in code units.

    until, progress, every, callback: arguments of `Simulation.run`. time: time of the last step reported. target: time
    at which the present sequence of steps ends. The display is closed at the end of the context. Raises ValueError if
    `until` or `every` is wrong.
    """

    def __init__(
        self,
        sim: Simulation,
        until: float,
        progress: bool,
        every: float | None,
        callback: Callable[[Simulation], object] | None,
    ) -> None:
        if not math.isfinite(until):
            raise ValueError(f"until = {until}; expected a finite time in code units, or a Quantity")
        if every is not None:
            _check_interval(every, until - sim.time, callback)
        self.sim, self.until, self.every, self.callback = sim, until, every, callback
        self.time, self.target = sim.time, until
        self.display: Progress | None = None
        if progress:
            from discsim.run.progress import Progress  # needed only here

            run = sim.scene.run.model_copy(update={"until": until})
            self.display = Progress(sim.scene.model_copy(update={"run": run}), quiet=False)

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *fault: object) -> None:
        if self.display is not None:
            if fault[0] is None:
                self.display.line(self.sim.state, 0.0, "")
            self.display.close()

    @property
    def times(self) -> Iterator[float]:
        """Times at which a step must end: multiples of `every`, and the end of the run.

        Multiples are computed with exact fractions, so that a run in several parts has the same times.
        """
        if self.every is not None:
            every = Fraction(repr(self.every))
            number = Fraction(repr(self.time)) // every + 1
            while (time := float(every * number)) < self.until:
                self.target = time
                yield time
                number += 1
        self.target = self.until
        yield self.until

    def after_step(self) -> bool:
        """Report the last step, and call the callback if it is due; return whether the callback ends the run."""
        sim = self.sim
        if sim.time <= self.time:
            return False
        dt, self.time = sim.time - self.time, sim.time
        if self.display is not None:
            self.display.step(sim.state, dt, sim.limited_by)
        if self.callback is None or (self.every is not None and sim.time < self.target):
            return False
        with sim.synchronised():
            return bool(self.callback(sim))


def _check_interval(every: float, span: float, callback: Callable[[Simulation], object] | None) -> None:
    """Raise ValueError if `every` is not a positive time, has no callback, or gives too many calls in `span`."""
    if callback is None or not 0.0 < every < math.inf:
        raise ValueError(f"every = {every}; expected a positive time, and the argument callback")
    if span > MAX_SNAPSHOTS * every:
        wrong = f"every = {every} gives {span / every:.3g} calls, more than {MAX_SNAPSHOTS:,}"
        raise ValueError(f"{wrong}; choose every = {span / MAX_SNAPSHOTS:.3g} or more")
