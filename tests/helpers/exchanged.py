"""For mpiexec: what ranks exchange in forces and a kick of a scene, beside the counts of `analysis/rank_counts.py`.

mpiexec -n 2 python tests/helpers/exchanged.py
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "analysis"))

from rank_counts import Divided, blocks_of_drag, cells_of_gas, counts_of
from rank_sent import Sent
from runs import DISC
from shares import keep_share

from discsim import Simulation
from discsim.ranks import comm as comms
from discsim.ranks.start import divide

ORDER = {"gas": ["sph gas"], "self_gravity": ["grid gas", "grid dust"], "drag": ["drag gas", "drag dust"]}
DT = 0.05


def made(scene):
    """A simulation whose forces have been made."""
    sim = Simulation(scene)
    sim.operators.forces()
    return sim


def counted(scene, ranks):
    sim = made(scene)
    gas = cells_of_gas(sim)
    sim.operators.forces()
    return counts_of(sim, Divided.of(sim, ranks), gas, blocks_of_drag(sim))


def exchanged(scene, comm):
    """Rows that this rank sends by exchange, and bytes by effect of whole rows and of the grid."""
    routes, dealt = {}, {}

    class Route(comms.Route):
        def __init__(self, comm, to):
            super().__init__(comm, to)
            routes.setdefault(comm.traffic.effect, []).append(int(self.send_counts.sum()))

    sim = made(scene)
    keep_share(sim.state, comm)
    divide(sim, comm)
    for module in [m for m in list(sys.modules.values()) if getattr(m, "Route", None) is comms.Route]:
        module.Route = Route
    deal, swap = comm.alltoallv, comm.alltoallw

    def noted(call, *given):
        before = comm.traffic.sums.get(comm.traffic.effect, (0,) * 6)
        out = call(*given)
        spent = np.subtract(comm.traffic.sums[comm.traffic.effect], before)[4:]
        dealt.setdefault(comm.traffic.effect, []).append(tuple(int(one) for one in spent))
        return out

    comm.alltoallv, comm.alltoallw = (lambda *given: noted(deal, *given)), (lambda *given: noted(swap, *given))
    sim.operators.forces()
    sim.operators.kick(DT)
    rows = {
        name: n for effect, names in ORDER.items() for name, n in zip(names, routes[effect][-len(names) :], strict=True)
    }
    # Density to slabs, there and back, potential from slabs: the last four of the effect.
    to_slabs, there, back, to_windows = dealt["self_gravity"][-4:]
    grid = {"density": to_slabs, "rows to columns": there, "columns to rows": back, "potential": to_windows}
    return rows, grid


def main():
    comm = comms.Comm()
    scene = tomllib.loads(DISC)
    counts = counted(scene, comm.size)
    rows, grid = exchanged(scene, comm)
    r, wrong = comm.rank, []
    for name, number in rows.items():
        expected = int(Sent.of(counts.rows[name]).total[r])
        wrong += [f"{name}: {expected} for {number}"] if expected != number else []
    for name, found in grid.items():
        sent = counts.bytes[name]
        expected = int(sent.total[r]), int(sent.messages[r])
        wrong += [f"{name}: {expected} for {found}"] if expected != found else []
    lines = comm.mpi.gather(f"{rows} {grid}; {', '.join(wrong) or 'as counted'}")
    if comm.rank == 0:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
