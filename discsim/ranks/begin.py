"""Several ranks take up a run: each keeps its own part of the state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from discsim.numerics import world
from discsim.ranks.comm import Comm
from discsim.ranks.drag import DividedDrag
from discsim.ranks.sph import DividedSph
from discsim.ranks.world import Ranks

if TYPE_CHECKING:
    from discsim.run.simulation import Simulation


def divide(sim: Simulation, comm: Comm) -> Ranks:
    """Let each rank keep its own particles of a simulation that all have made alike, and step on with the others."""
    ranks = Ranks(sim.scene, comm)
    ranks.divide(sim.state)
    effects: Any = sim.effects
    if sim.scene.gas is not None and not sim.scene.model.cells:
        effects["gas"].sph = DividedSph(sim.scene, comm)
        if sim.scene.drag is not None:
            drag = effects["drag"]
            drag.relax_by = divided = DividedDrag(drag, comm)
            drag.limit_by = divided.limit if drag.limit_by is not None else None
    world.join(ranks)
    return ranks
