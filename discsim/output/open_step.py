"""What a snapshot lacks of a state between two steps, so that a start from it goes on as the run does.

Between steps velocities and energies await the closing kick of a step (`run/integrators.py`). A snapshot shows them
with it; the run goes on without it, from what viscosity and pressure have foreseen of it, and from where the search for
each h began. The number of the step shifts cells of drag; star and companions have a past, and dust that grows does so
once in some steps.
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
KICKED = ("vel", "u", "kick_acc", "kick_rate")  # what a kick changes of particles, and a run goes on from
OF_BODIES = ("pos", "gained", "begun")


@dataclass(frozen=True)
class OpenStep:
    """lag: as of the state, 0 where the kick is made. step: number of it, with those of runs that it went on from.

    arrays: by species, "bodies" too, those that the snapshot shows otherwise or lacks, in the order of the ids.
    pace: as of the state.
    """

    lag: float
    step: int
    arrays: dict[str, dict[str, Array]] = field(default_factory=dict)
    pace: Pace | None = None


def left_open(state: State, together: bool) -> OpenStep:
    """That of a state between two steps; `together`: an effect kicks gas and dust, whose kicks do not add up to one.

    Where nothing foresees a kick either, the closed velocities go on to rounding, and are there already.
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
    into = group.create_group(GROUP)
    into.attrs["lag"], into.attrs["step"] = step.lag, step.step
    if step.pace is not None:
        into.attrs["pace"] = step.pace
    for species, arrays in step.arrays.items():
        part = into.create_group(species)
        for name, array in arrays.items():
            hdf5.put(part, name, array)


def read(group: hdf5.Held, counts: dict[str, int], dimensions: int, time: float) -> OpenStep | None:
    """The open step of a snapshot with so many particles of each kind; None where an earlier version wrote the file.

    Raises EntryError.
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
        raise EntryError(f"the lag {lag:g} or the step {step} of {GROUP} is below 0; expected 0 or more")
    return OpenStep(lag, step, arrays, pace)
