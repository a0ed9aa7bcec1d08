"""Additional data in a snapshot, the open step, with which a new run continues the old one to rounding.

The velocities and energies in a snapshot are those after the closing half kick of a step (`run/integrators.py`). The
run itself continues without this half kick, so the step is still open. The additional data are the velocities and
energies of the open step, the accelerations and rates predicted for the kick, and the first guess for each h. The
data also include the number of the step, which shifts the drag cells, the integration state of star and companions,
and the clock of dust growth, which acts once in several steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discsim.numerics.entries import VECTORS, EntryError, check_finite, check_ranges
from discsim.numerics.state import SubcycleClock
from discsim.output import hdf5

if TYPE_CHECKING:
    import h5py

    from discsim.numerics.state import State

Array = np.ndarray
GROUP = "OpenStep"
KICKED = ("vel", "u", "kick_acc", "kick_rate")  # arrays that a kick changes or uses
GUESSES = ("h_before", "last_heating_rate", "last_pressure_acc")  # arrays from which the forces were found
BODY_ARRAYS = ("pos", "gained", "begun")  # arrays of star and companions that are always stored


@dataclass(frozen=True)
class OpenStep:
    """State of a run between two steps, before the closing half kick.

    `lag` is the time by which velocities and energies lag behind positions; `lag` is 0 after the closing kick.
    `step` is the number of steps, including the steps of earlier runs that this run continues. `arrays` has arrays
    by species ("gas", "dust", "bodies") and name, sorted by ids: arrays that the snapshot does not have, or has
    after the closing kick. `pace` is the clock of dust growth (`State.subcycle_clock`).
    """

    lag: float
    step: int
    arrays: dict[str, dict[str, Array]] = field(default_factory=dict)
    pace: SubcycleClock | None = None


def open_step_of(state: State, joint_kick: bool) -> OpenStep:
    """Return the OpenStep of a state between two steps.

    `joint_kick` is True if an effect kicks gas and dust together; two half kicks then differ from one whole kick. With
    neither such an effect nor predicted accelerations, a run can continue from the velocities after the closing kick,
    to rounding. Then `lag` is 0, and no velocities are stored.
    """
    needs_open_kick = joint_kick or (state.gas is not None and state.gas.kick_acc is not None)
    lag = state.velocity_lag if needs_open_kick else 0.0
    names = KICKED if lag > 0.0 else ()
    arrays = {}
    for species, particles in state.species.items():
        held, order = particles.arrays(), np.argsort(particles.ids, kind="stable")
        arrays[species] = {name: held[name][order] for name in (*names, *GUESSES) if name in held}
    if state.bodies is not None:
        held = state.bodies.arrays()
        arrays["bodies"] = {name: held[name].copy() for name in (*BODY_ARRAYS, *(names[:1]))}
    return OpenStep(lag, state.step + state.earlier, arrays, state.subcycle_clock)


def write(group: h5py.Group, step: OpenStep) -> None:
    """Write an open step to a new group in `group`, the group "discsim" of a snapshot."""
    into = group.create_group(GROUP)
    into.attrs["lag"], into.attrs["step"] = step.lag, step.step
    if step.pace is not None:
        into.attrs["pace"] = step.pace
    for species, arrays in step.arrays.items():
        part = into.create_group(species)
        for name, array in arrays.items():
            hdf5.write_array(part, name, array)


def read(group: hdf5.CheckedGroup, counts: dict[str, int], dimensions: int, time: float) -> OpenStep | None:
    """Return the open step in `group`, the group "discsim" of a snapshot.

    Returns None if the group has no open step, as in old files. `counts` are the particle numbers by kind, `time` is
    the time of the snapshot. Raises EntryError.
    """
    if GROUP not in group:
        return None
    held = group.group(GROUP)
    arrays: dict[str, dict[str, Array]] = {}
    for species, count in counts.items():
        part = held.group(species)
        ends = {name: (dimensions,) if name in VECTORS else () for name in part.names}
        arrays[species] = {name: part.rows(name, count, row_shape=ends[name]) for name in part.names}
        check_finite(species, arrays[species])
        check_ranges(species, arrays[species], populations=1, time=time)
        if species == "bodies" and not {*BODY_ARRAYS} <= arrays[species].keys():
            raise EntryError(
                f"{GROUP} lacks arrays of the star and its companions; expected the arrays {', '.join(BODY_ARRAYS)}"
            )
    pace = SubcycleClock(*map(float, held.numbers("pace", (2,), finite=False))) if "pace" in held.attributes else None
    lag, step = held.number("lag"), held.whole("step")
    if lag < 0.0 or step < 0 or (pace is not None and not (pace.since >= 0.0 and pace.rate > 0.0)):
        wrong = f"{GROUP} has lag {lag:g}, step {step} and clock of growth {pace and tuple(pace)}"
        raise EntryError(f"{wrong}; expected numbers of 0 or more, and in the clock of growth a positive rate")
    return OpenStep(lag, step, arrays, pace)
