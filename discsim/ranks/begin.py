"""Conversion of a simulation to one that is divided among several ranks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from discsim.numerics import world
from discsim.parts import Lazy
from discsim.ranks.comm import Comm
from discsim.ranks.costs import DividedCosts
from discsim.ranks.drag import DividedDrag
from discsim.ranks.sph import DividedSph
from discsim.ranks.world import Ranks

if TYPE_CHECKING:
    from discsim.run.simulation import Simulation

gravity = Lazy("discsim.ranks.gravity")


def divide(sim: Simulation, comm: Comm, alike: bool = True) -> Ranks:
    """Divide a simulation among ranks, and return the communication between them.

    Each rank keeps its own particles. alike: whether every rank starts with all particles. If False, each starts with a
    range of rows, in the order of ranks.
    """
    ranks = Ranks(sim.scene, comm)
    ranks.divide(sim.state, alike)
    effects: Any = sim.effects
    if sim.scene.gas is not None and not sim.scene.model.cells:
        effects["gas"].sph = DividedSph(sim.scene, comm)
        if sim.scene.drag is not None:
            drag = effects["drag"]
            drag.engine = DividedDrag(sim.scene, drag.engine.star, ranks.division)
            ranks.forgets.append(drag.engine.release)
    if "self_gravity" in effects:
        effects["self_gravity"].mesh = gravity.divided(effects["self_gravity"].mesh, ranks.division)
    sim.costs = DividedCosts(sim.costs, comm.traffic)
    world.set_processes(ranks)
    return ranks
