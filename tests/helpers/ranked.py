"""For mpiexec: each scene on every rank alone, and then on all together; what differs, a line a scene.

mpiexec -n 4 python tests/helpers/ranked.py NAME ...
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from runs import DISC

from discsim import Simulation, load_scene
from discsim.numerics import world
from discsim.output.history import history_row
from discsim.ranks.begin import divide, faults
from discsim.ranks.comm import Comm
from discsim.ranks.gathering import gathered, gathered_columns
from discsim.run.runner import columns

COMPANION = {"mass": 1e-3, "semi_major_axis": 1.2, "softening": 0.05, "accretion_radius": 0.1}
MOST = 0.1  # of a step: where all is gone nothing limits it
# Changes of DISC, and steps. Of 18 steps two sort, and cut space anew where that is due.
SCENES = {
    "long": ({}, 18),
    "idic": ({"drag": {"scheme": "idic"}}, 4),
    "linear": ({"drag": {"scheme": "idic-linear", "direction": "one-way"}}, 4),
    "one-way": ({"drag": {"direction": "one-way"}}, 4),
    "off the grid": ({"space": {"size": 4.2}}, 10),
    "eaten": ({"star": {"accretion_radius": 1.9}}, 12),
    "all gone": ({"star": {"accretion_radius": 2.8}}, 4),
    "bodies": ({"companion": [COMPANION], "star": {"frame": "inertial", "grows": True}}, 4),
}


def scene_of(changes):
    tables = tomllib.loads(DISC)
    for name, change in changes.items():
        tables[name] = {**tables[name], **change} if isinstance(change, dict) else change
    return load_scene(tables)


def stepped(scene, steps, comm):
    """The row of history, arrays by name, and how many particles each rank has; `comm` None: of this rank alone."""
    world.join(world.Alone())
    sim = Simulation(scene)
    if comm is not None:
        divide(sim, comm)
    for _ in range(steps):
        dt = sim.step(most=MOST)
    state = sim.state
    row, extra = history_row(state, sim.effects, dt, sim.limited_by), columns(state, sim.effects.values())
    held = sum(p.count for p in state.species.values())
    if comm is not None:
        extra, state = gathered_columns(comm, state, extra), gathered(comm, state)
    arrays = {f"{n}.{k}": array for n, p in state.species.items() for k, array in p.arrays().items()}
    arrays |= {f"{n}.{k} of effects": array for n, p in extra.items() for k, array in p.items()}
    if state.bodies is not None:
        arrays |= {f"bodies.{k}": array for k, array in state.bodies.arrays().items()}
    return row, arrays, held


def main():
    comm = Comm()
    for name in sys.argv[1:]:
        changes, steps = SCENES[name]
        scene = scene_of(changes)
        assert not list(faults(scene))
        row, alone, _ = stepped(scene, steps, None)
        together_row, together, held = stepped(scene, steps, comm)
        held = comm.mpi.allgather(held)
        if comm.rank == 0:
            differ = [key for key in alone if not np.array_equal(alone[key], together.get(key), equal_nan=True)]
            differ += ["history"] if row != together_row else []
            print(f"{name}: {', '.join(differ) or 'the same'}; particles {min(held)} to {max(held)} a rank", flush=True)


if __name__ == "__main__":
    main()
