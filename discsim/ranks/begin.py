"""Several ranks take up a run: what they cannot do yet is refused, and each keeps its own part of the state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from discsim.numerics import world
from discsim.parts import SCHEMES, Lazy
from discsim.physics.grains import has_sizes
from discsim.ranks.comm import Comm
from discsim.ranks.costs import DividedCosts
from discsim.ranks.drag import DividedDrag
from discsim.ranks.sph import DividedSph
from discsim.ranks.world import Ranks

if TYPE_CHECKING:
    from discsim.run.simulation import Simulation
    from discsim.scene import Scene

gravity = Lazy("discsim.ranks.gravity")

# Tables whose effects look at no neighbours but through what is divided here.
TABLES = frozenset(
    {
        "gas", "dust", "star", "companion", "self_gravity", "external", "drag", "alpha_viscosity", "background",
        "radiation_pressure", "cooling", "damping",
    }
)  # fmt: skip


def faults(scene: Scene) -> Iterator[str]:
    """What of a scene several ranks cannot run yet, a line each."""
    for name in scene.effects:
        if name.partition(".")[0] not in TABLES:
            yield f"{name}: runs on one MPI rank only; expected no table [{name}], or no mpiexec"
    if scene.model.cells:
        yield f'drag.scheme: "{scene.drag.scheme}" runs on one MPI rank only; expected another one, or no mpiexec'
    elif scene.drag is not None and scene.gas is not None:
        yield from _faults_of_drag(scene)


def _faults_of_drag(scene: Scene) -> Iterator[str]:
    drag: Any = scene.drag
    if SCHEMES[drag.scheme].members is None:
        words = ", ".join(f'"{name}"' for name in SCHEMES if SCHEMES[name].members is not None)
        yield f'drag.scheme: "{drag.scheme}" runs on one MPI rank only; expected {words}, or no mpiexec'
    if drag.heating:
        yield "drag.heating: heat of drag runs on one MPI rank only; expected false, or no mpiexec"
    if drag.law == "constant":
        yield 'drag.law: "constant" runs on one MPI rank only; expected another one, or no mpiexec'
    for dust in scene.dust or ():
        if has_sizes(dust):
            yield "dust.grain_size: many sizes run on one MPI rank only; expected one size, or no mpiexec"


def divide(sim: Simulation, comm: Comm, alike: bool = True) -> Ranks:
    """Let each rank have its own particles of a simulation, and step on with the others.

    alike: all have made all of it, else each has a run of the rows, in the order of ranks.
    """
    ranks = Ranks(sim.scene, comm)
    ranks.divide(sim.state, alike)
    effects: Any = sim.effects
    if sim.scene.gas is not None:
        effects["gas"].sph = DividedSph(sim.scene, comm)
        if sim.scene.drag is not None:
            effects["drag"].relax_by = DividedDrag(effects["drag"], comm)
    if "self_gravity" in effects:
        effects["self_gravity"].mesh = gravity.divided(effects["self_gravity"].mesh, ranks.division)
    sim.costs = DividedCosts(sim.costs, comm.traffic)
    world.join(ranks)
    return ranks
