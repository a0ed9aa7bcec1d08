"""Star and companions at the start of a run, and the change from the reference frame of the start to that of the run.

In the frame of the start the origin is the centre of the disc, at rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.initial import start_of
from discsim.physics.orbits import Orbits, is_star_at_rest

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import State
    from discsim.scene import Scene


def make_bodies(scene: Scene, with_start: bool) -> Bodies | None:
    """Return star and companions at the start, in the frame of the start.

    Return None if there is no star, or if the star has a constant mass and stays at the origin.
    with_start: whether particles are made by the scene's start, which may continue the orbits of an earlier run.
    """
    if is_star_at_rest(scene):
        return None
    moving = start_of(scene).moving_bodies if with_start else None
    return Orbits(scene).initial_bodies(moving(scene) if moving else None)


def transform_to_run_frame(state: State, with_particles: bool) -> None:
    """Transform the star and companions of `state` in place, from the frame of the start to the frame of the run.

    with_particles: whether to transform gas and dust too.
    """
    bodies = state.bodies
    if bodies is None:
        return
    pos, vel = Orbits(state.scene).centre_of_disc(bodies)
    if not np.any([pos, vel]):
        return
    for moved in (bodies, *(state.species.values() if with_particles else ())):
        moved.pos += pos
        moved.vel += vel
