"""Snapshot times of a run."""

from fractions import Fraction

import numpy as np

from discsim.scene.tables import Run


def output_times(run: Run) -> list[float]:
    """Return the times of all snapshots after the initial one; the last is the end of the run.

    Multiples of `run.every` are computed with exact fractions, so that runs of different lengths have bitwise equal
    times.
    """
    until = Fraction(repr(run.until))
    if run.every is None:
        return [float(until * k / run.snapshots) for k in range(1, run.snapshots + 1)]
    every = Fraction(repr(run.every))
    # An end within rounding of a multiple counts as the multiple, at which a longer run would have a snapshot too.
    whole = int(until / every + Fraction(1, 10**9))
    times = [float(every * k) for k in range(1, whole + 1)]
    return times if times and np.isclose(times[-1], run.until, rtol=1e-9, atol=0.0) else [*times, run.until]


def due_times(run: Run, reached: float, put_out: float) -> list[float]:
    """Return the times of the snapshots that are still to be written.

    reached: present time of the run. put_out: time of the last snapshot written. If a checkpoint was written at an
    output time before the snapshot, that snapshot is due at once.
    """
    near = 1e-9 * reached
    later = [t for t in output_times(run) if t >= reached - near and t > put_out * (1.0 + 1e-9)]
    return [reached if abs(t - reached) <= near else t for t in later]
