"""Star and companions at the start of a run, and the change of frame from the start to the run.

In the frame of a start the origin is the centre of the disc.
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
    """Return star and companions, with the centre of the disc at rest at the origin.

    Return None if there is no star, or if the star has a constant mass and stays at the origin.
    with_start: whether the run begins with the scene's start, in which star and companions may already move.
    """
    if is_star_at_rest(scene):
        return None
    under_way = start_of(scene).under_way if with_start else None
    return Orbits(scene).initial_bodies(under_way(scene) if under_way else None)


def enter_frame(state: State, with_particles: bool) -> None:
    """Transform star and companions from the frame of the disc's centre to the frame of the run.

    with_particles: transform gas and dust too.
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
