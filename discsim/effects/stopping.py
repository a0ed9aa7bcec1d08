"""Columns of the drag in snapshots, for any model of the gas."""

import numpy as np

from discsim.numerics.state import State


def stopping_columns(state: State, times: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Return stopping times (n,) of the dust and, about a star, Stokes numbers t_stop Omega_K (n,), by species and
    name.
    """
    found = {"stopping_time": times}
    if state.scene.star is not None and state.dust is not None:
        away = np.sqrt((state.from_centre(state.dust.pos) ** 2).sum(axis=1))
        found["stokes"] = times * state.kepler_omega(away)
    return {"dust": found}
