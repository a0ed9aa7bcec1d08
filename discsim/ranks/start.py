"""Start of a run on several ranks.

Rank 0 makes the initial state with all particles. The other ranks get the same effects, but no particles until `divide`
sends all particles to their owners.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from discsim.effects import load_effects
from discsim.numerics import world
from discsim.numerics.state import Dust, Gas, State
from discsim.numerics.threads import set_threads
from discsim.parts import Lazy
from discsim.ranks.comm import Comm
from discsim.ranks.costs import DividedCosts
from discsim.ranks.drag import DividedDrag
from discsim.ranks.world import ParallelComm
from discsim.run.simulation import Simulation
from discsim.run.start import InitialState, begin
from discsim.scene import Scene

gravity = Lazy("discsim.ranks.gravity")
PARTICLE_TYPES: dict[str, Any] = {"gas": Gas, "dust": Dust}
# Fields of a state that are the same on all ranks.
SHARED_FIELDS = ("time", "step", "earlier", "velocity_lag", "ledger", "subcycle_clock", "bodies")


def begin_on_root(comm: Comm, scene: Scene, to_restore: bool) -> InitialState:
    """Return the start of a scene, as `run.start.begin`, with all particles on rank 0. Collective."""
    set_threads(scene.run.threads)
    made: list[InitialState] = []

    def make() -> Any:
        made.append(begin(scene, to_restore=to_restore))
        return shared_data(made[0])

    shared = comm.on_root(make)
    return made[0] if made else begin_without_particles(scene, shared)


def shared_data(begun: InitialState) -> dict[str, Any]:
    """Return the data of a start that the other ranks need: shapes and types of arrays, and values of the state."""
    state = begun.state
    return {
        "arrays": {
            name: {key: (array.shape, array.dtype) for key, array in p.arrays().items()}
            for name, p in state.species.items()
        },
        "state": {name: getattr(state, name) for name in SHARED_FIELDS},
        "effects": {
            name: {key: getattr(effect, key) for key in effect.from_start} for name, effect in begun.effects.items()
        },
    }


def begin_without_particles(scene: Scene, shared: dict[str, Any]) -> InitialState:
    """Return the start on a rank other than 0: state and effects as on rank 0, but arrays without particles.

    shared: result of `shared_data` on rank 0.
    """
    # Effects need a state with as many particles: zeros, which take no memory until they are written.
    species: dict[str, Any] = {
        name: PARTICLE_TYPES[name](**{key: np.zeros(*like) for key, like in arrays.items()})
        for name, arrays in shared["arrays"].items()
    }
    state = State(scene, species.get("gas"), species.get("dust"), None)
    for name, value in shared["state"].items():
        setattr(state, name, value)
    effects = load_effects(scene, state)
    for name, effect in effects.items():
        for key, value in shared["effects"][name].items():
            setattr(effect, key, value)
        if not effect.from_start:
            effect.begin(state, effects)
    state.subcycle_clock = shared["state"]["subcycle_clock"]  # which an effect may have reset
    for p in species.values():
        for key, array in p.arrays().items():
            setattr(p, key, array[:0].copy())
    return InitialState(state, effects)


def divide(sim: Simulation, comm: Comm) -> ParallelComm:
    """Send the particles of a simulation to their owners, and return the communication between the ranks. Collective.

    Before the call, each rank has a range of the rows of all particles, in the order of ranks. The communication
    becomes that of `numerics/world.py`, and effects with neighbours, a grid or cells get their implementation for
    several ranks.
    """
    ranks = ParallelComm(sim.scene, comm)
    ranks.distribute(sim.state)
    effects: Any = sim.effects
    if sim.scene.gas is not None and not sim.scene.model.cells:
        ranks.division.divide_gas(effects["gas"])
        if sim.scene.drag is not None:
            drag = effects["drag"]
            drag.engine = DividedDrag(sim.scene, drag.engine.star, ranks.division)
            ranks.drop_functions.append(drag.engine.release)
    if "self_gravity" in effects:
        effects["self_gravity"].mesh = gravity.divided_mesh(effects["self_gravity"].mesh, ranks.division)
    sim.costs = DividedCosts(sim.costs, comm.traffic)
    world.set_processes(ranks)
    return ranks
