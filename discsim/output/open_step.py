"""Quantities of a state between two steps that a snapshot lacks, so that a new run can continue from it.

Between steps, velocities and energies lack the closing half kick of a step (`run/integrators.py`). A snapshot shows
them with that kick. A run continues without it, from the accelerations that viscosity and pressure have predicted
for it, and from the initial guesses for each h. The number of the step shifts the cells of drag. Also stored are the
integration state of star and companions, and the clock of dust growth, which acts once in several steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discsim.numerics.entries import VECTORS, EntryError, check_finite, check_ranges
from discsim.numerics.state import Pace
from discsim.output import hdf5

if TYPE_CHECKING:
    import h5py

    from discsim.numerics.state import State

Array = np.ndarray
GROUP = "OpenStep"
KICKED = ("vel", "u", "kick_acc", "kick_rate")  # arrays that a kick changes or uses
OF_BODIES = ("pos", "gained", "begun")


@dataclass(frozen=True)
class OpenStep:
    """State of a run between two steps.

    `lag` is that of the state, 0 if the closing kick is made. `step` is the number of the step, counting also the
    runs before. `arrays` holds by species (and "bodies") the arrays that the snapshot shows differently or lacks, in
    the order of the ids. `pace` is that of the state.
    """

    lag: float
    step: int
    arrays: dict[str, dict[str, Array]] = field(default_factory=dict)
    pace: Pace | None = None


def open_step_of(state: State, together: bool) -> OpenStep:
    """Return the OpenStep of a state between two steps.

    `together`: an effect kicks gas and dust together, so that two half kicks differ from one whole kick. Without
    such an effect and without predicted accelerations, the closed velocities of the snapshot suffice, to rounding.
    """
    kicked = together or (state.gas is not None and state.gas.kick_acc is not None)
    lag = state.lag if kicked else 0.0
    names = KICKED if lag > 0.0 else ()
    arrays = {}
    for species, particles in state.species.items():
        held, order = particles.arrays(), np.argsort(particles.ids, kind="stable")
        arrays[species] = {name: held[name][order] for name in (*names, "h_before") if name in held}
    if state.bodies is not None:
        held = state.bodies.arrays()
        arrays["bodies"] = {name: held[name].copy() for name in (*OF_BODIES, *(names[:1]))}
    return OpenStep(lag, state.step + state.earlier, arrays, state.pace)


def write(group: h5py.Group, step: OpenStep) -> None:
    """Write an open step to the group of a snapshot."""
    into = group.create_group(GROUP)
    into.attrs["lag"], into.attrs["step"] = step.lag, step.step
    if step.pace is not None:
        into.attrs["pace"] = step.pace
    for species, arrays in step.arrays.items():
        part = into.create_group(species)
        for name, array in arrays.items():
            hdf5.put(part, name, array)


def read(group: hdf5.CheckedGroup, counts: dict[str, int], dimensions: int, time: float) -> OpenStep | None:
    """Return the open step of a snapshot with the given particle numbers by kind.

    None if an earlier version without open steps wrote the file. Raises EntryError.
    """
    if GROUP not in group:
        return None
    held = group.group(GROUP)
    arrays: dict[str, dict[str, Array]] = {}
    for species, count in counts.items():
        part = held.group(species)
        ends = {name: (dimensions,) if name in VECTORS else () for name in part.names}
        arrays[species] = {name: part.rows(name, count, ends=ends[name]) for name in part.names}
        check_finite(species, arrays[species])
        check_ranges(species, arrays[species], populations=1, time=time)
        if species == "bodies" and not {*OF_BODIES} <= arrays[species].keys():
            raise EntryError(f"{GROUP} lacks arrays of the star and its companions; expected {', '.join(OF_BODIES)}")
    pace = Pace(*map(float, held.numbers("pace", (2,), finite=False))) if "pace" in held.attributes else None
    lag, step = held.number("lag"), held.whole("step")
    if lag < 0.0 or step < 0 or (pace is not None and not (pace.since >= 0.0 and pace.rate > 0.0)):
        raise EntryError(f"lag {lag:g} or step {step} of {GROUP} is negative; expected 0 or more")
    return OpenStep(lag, step, arrays, pace)
