"""Stopping times and Stokes numbers in snapshots, for any model of the gas."""

import numpy as np

from discsim.numerics.state import State


def stopping_columns(state: State, times: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Return arrays for snapshots by species and name: stopping times of the dust and, about a star, Stokes numbers.

    times (n,): stopping times. The Stokes number is t_stop Omega_K.
    """
    found = {"stopping_time": times}
    if state.scene.star is not None and state.dust is not None:
        away = np.sqrt((state.from_centre(state.dust.pos) ** 2).sum(axis=1))
        found["stokes"] = times * state.kepler_omega(away)
    return {"dust": found}
