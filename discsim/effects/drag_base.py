"""Base class of the effects of the table [drag], for any model of the gas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.warnings import drag_warnings
from discsim.effects import base
from discsim.numerics.state import State

if TYPE_CHECKING:
    from discsim.scene import Scene


class DragEffect(base.KickEffect):
    """Drag, with its warnings, and with stopping times and Stokes numbers in snapshots."""

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(warnings=drag_warnings(scene, at))

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Return the stopping times (n,) of the dust at its present positions. The state does not change."""
        raise NotImplementedError

    def columns(self, state: State) -> dict[str, dict[str, np.ndarray]]:
        return stopping_columns(state, self.current_stopping_times(state))


def stopping_columns(state: State, times: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Return arrays for snapshots by species and name: stopping times of the dust and, about a star, Stokes numbers.

    times (n,): stopping times. The Stokes number is t_stop Omega_K.
    """
    found = {"stopping_time": times}
    if state.scene.star is not None and state.dust is not None:
        away = np.sqrt((state.from_centre(state.dust.pos) ** 2).sum(axis=1))
        found["stokes"] = times * state.kepler_omega(away)
    return {"dust": found}
