"""Rows of a simulation that is the same on all ranks, as they are before particles are sent to their owners."""

import numpy as np


def keep_share(state, comm):
    """Remove all particles but a range of rows of this rank, in the order of ranks."""
    for name, p in state.species.items():
        rows = np.array_split(np.arange(p.count), comm.size)[comm.rank]
        p.take(rows)
        if len(state.acc_unshared.get(name, ())) > 0:
            state.acc_unshared[name] = state.acc_unshared[name][rows]
