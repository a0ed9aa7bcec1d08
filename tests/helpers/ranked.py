"""For mpiexec: each scene on one rank, and then on all together; what differs, a line a scene.

mpiexec -n 4 python tests/helpers/ranked.py NAME ...     scenes of `ranked_scenes.py`, or "few" of them, or "all"
"""

import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from ranked_scenes import FEW_SCENES, SCENES
from shares import keep_share

from discsim import Simulation, load_scene
from discsim.numerics import threads, world
from discsim.output.history import history_row
from discsim.ranks.comm import Comm
from discsim.ranks.output import gather_columns, gather_state
from discsim.ranks.start import divide
from discsim.run.outputs import effect_columns
from discsim.scene import SceneError

MOST = 0.1  # of a step: where all is gone nothing limits it
PIECES = 50  # particles that loops are cut at, so that few particles have several threads


def stepped(scene, steps, most, comm):
    """The rows of history, arrays by name, and how many particles each rank has; `comm` None: of this rank alone."""
    world.set_processes(world.SerialComm())
    sim = Simulation(scene)
    if comm is not None:
        keep_share(sim.state, comm)
        divide(sim, comm)
    rows = []
    for _ in range(steps):
        dt = sim.step(most=most)
        rows.append(history_row(sim.state, sim.effects, dt, sim.limited_by))
    state, extra = sim.state, effect_columns(sim.state, sim.effects.values())
    held = sum(p.count for p in state.species.values())
    if comm is not None:
        extra, state = gather_columns(comm, state, extra), gather_state(comm, state)
    world.set_processes(world.SerialComm())
    arrays = {f"{n}.{k}": array for n, p in state.species.items() for k, array in p.arrays().items()}
    arrays |= {f"{n}.{k} of effects": np.asarray(a) for n, p in extra.items() for k, a in plain(p).items()}
    arrays |= {f"ledger.{k}": np.asarray(v) for k, v in asdict(state.ledger).items()}
    if state.subcycle_clock is not None:
        arrays["pace"] = np.array(state.subcycle_clock)
    if state.bodies is not None:
        arrays |= {f"bodies.{k}": array for k, array in state.bodies.arrays().items()}
    return rows, arrays, held


def plain(columns):
    return {name: getattr(column, "values", column) for name, column in columns.items()}


def differences(alone, together):
    (rows, arrays, _), (other_rows, others, _) = alone, together
    differ = [key for key in arrays if not np.array_equal(arrays[key], others.get(key), equal_nan=True)]
    return differ + (["history"] if repr(rows) != repr(other_rows) else [])


def wait_for(comm, act):
    """What `act` returns on the first rank, while the others leave it the cores."""
    found = act() if comm.rank == 0 else None
    request = comm.mpi.Ibarrier()
    while not request.Test():
        time.sleep(0.01)
    return found


def tell(comm, name):
    source, changes, steps, most = SCENES[name]
    made = source()
    scene = made if changes is None else load_scene(made, changes)
    alone = wait_for(comm, lambda: stepped(scene, steps, most, None))
    together = stepped(scene, steps, most, comm)
    held = comm.mpi.allgather(together[2])
    if comm.rank > 0:
        return ""
    return (
        f"{name}: {', '.join(differences(alone, together)) or 'the same'}; particles {min(held)} to {max(held)} a rank"
    )


def main():
    pieces = threads.chunks
    threads.chunks = lambda count, least, number: pieces(count, min(least, PIECES), number)
    comm, names = Comm(), sys.argv[1:]
    for name in {"all": SCENES, "few": FEW_SCENES}.get(names[0], names):
        told = tell(comm, name)
        if comm.rank == 0:
            print(told, flush=True)


if __name__ == "__main__":
    try:
        main()
    except SceneError as fault:
        sys.exit(str(fault))
    except BaseException:
        import traceback

        from mpi4py import MPI

        traceback.print_exc()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
