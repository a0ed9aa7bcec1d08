"""Star and companions at the start, and the frame that the run is in: starts make discs about the origin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.initial import start_of
from discsim.physics.orbits import Orbits, at_rest

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import State
    from discsim.scene import Scene


def make_bodies(scene: Scene, with_start: bool) -> Bodies | None:
    """Star and companions, the centre of the disc at rest at the origin.

    None where there is no star, or one that stays there with its mass and moves nothing. `with_start`: the scene's
    start, which may have them under way, is that of the run.
    """
    if at_rest(scene):
        return None
    under_way = start_of(scene).under_way if with_start else None
    return Orbits(scene).at_start(under_way(scene) if under_way else None)


def enter_frame(state: State, with_particles: bool) -> None:
    """Take bodies, and particles that the start has made about the centre of the disc, into the frame of the run."""
    bodies = state.bodies
    if bodies is None:
        return
    pos, vel = Orbits(state.scene).offset(bodies)
    if not np.any([pos, vel]):
        return
    for moved in (bodies, *(state.species.values() if with_particles else ())):
        moved.pos += pos
        moved.vel += vel
