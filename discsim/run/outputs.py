"""Times of the snapshots of a run."""

from fractions import Fraction

import numpy as np

from discsim.scene.tables import Run


def output_times(run: Run) -> list[float]:
    """Return the times of the snapshots after the initial one; the last is the end of the run.

    Multiples are taken of the decimal numbers, so that runs of different lengths share the same floats.
    """
    until = Fraction(repr(run.until))
    if run.every is None:
        return [float(until * k / run.snapshots) for k in range(1, run.snapshots + 1)]
    every = Fraction(repr(run.every))
    # An end that is a multiple but for rounding is that multiple, as a longer run would land there as well.
    whole = int(until / every + Fraction(1, 10**9))
    times = [float(every * k) for k in range(1, whole + 1)]
    return times if times and np.isclose(times[-1], run.until, rtol=1e-9, atol=0.0) else [*times, run.until]


def due_times(run: Run, reached: float, put_out: float) -> list[float]:
    """Return the times of the snapshots still to come at time `reached`; `put_out` is the time of the last one.

    A checkpoint may be of the step that landed on an output, before its snapshot. That snapshot is then due at once.
    """
    near = 1e-9 * reached
    later = [t for t in output_times(run) if t >= reached - near and t > put_out * (1.0 + 1e-9)]
    return [reached if abs(t - reached) <= near else t for t in later]
