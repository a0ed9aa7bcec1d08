"""What a step takes on ranks, for mpiexec: `measure` prints a line of JSON from rank 0.

    mpiexec -n 2 python analysis/rank_steps.py --gas 1e5 --dust 1e6 --cells 512 --scheme tsc

Seconds are CPU seconds of a rank and step, without those of MPI calls, which are apart: where more processes than
cores run, or others, only these say what a rank has to do.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from passes import watched

from discsim import Simulation, load_scene
from discsim.numerics.grid import Grid
from discsim.ranks.begin import divide
from discsim.ranks.comm import Comm
from discsim.ranks.gravity import Nodes
from discsim.ranks.slabs import Turn
from discsim.ranks.start import begun
from discsim.ranks.traffic import Sum

MAIN = Path(__file__).parents[1] / "setups" / "dusty_disc.toml"
STEPS = 8  # none of which sorts; of each part of one the least is told, as other processes may be in the way
# Methods that belong to other parts of a step than what else gravity does, which goes with the nodes of a window.
PARTS = {
    (Nodes, "about"): "grid particles", (Grid, "extent"): "grid particles", (Grid, "deposit"): "grid particles",
    (Grid, "pull"): "grid particles", (Turn, "forth"): "transforms", (Turn, "back"): "transforms",
}  # fmt: skip


def scene(gas: int, dust: int, cells: int, scheme: str) -> dict[str, Any]:
    """The main job's disc with other numbers, one thread a rank."""
    tables = tomllib.loads(MAIN.read_text())
    tables["gas"]["particles"], tables["dust"]["particles"] = gas, dust
    tables["space"]["cells"], tables["drag"]["scheme"], tables["run"]["threads"] = cells, scheme, 1
    return tables


def measure(tables: dict[str, Any], comm: Comm) -> list[dict[str, Any]]:
    """Figures of each rank: seconds by part of a step, communication by effect, memory."""
    given = load_scene(tables)
    sim = Simulation(given, begun=begun(comm, given, False))
    if comm.size > 1:
        divide(sim, comm, alike=False)
    of_part: Counter[str] = Counter()

    def own() -> float:
        return time.process_time() - sum(each.cpu_seconds for each in comm.traffic.sums.values())

    def timed(method: Any, part: str) -> Any:
        def watched(*given: Any, **named: Any) -> Any:
            start = own()
            found = method(*given, **named)
            of_part[part] += own() - start
            return found

        return watched

    for (kind, name), part in PARTS.items():
        setattr(kind, name, timed(getattr(kind, name), part))
    left = [2]

    def enough() -> bool:
        left[0] -= 1
        return left[0] == 0

    sim.evolve(np.inf, enough, only_looks=True)  # compiles, and sorts
    first, steps, walls = dict(comm.traffic.sums), [], []
    for _ in range(STEPS):
        of_part.clear()
        start, spent = sim.costs.copy(), dict(comm.traffic.sums)
        comm.mpi.Barrier()
        cpu, wall = time.process_time(), time.perf_counter()
        with watched() as passes:
            sim.evolve(np.inf, lambda: True, only_looks=True)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        in_calls = {
            name: each.cpu_seconds - spent.get(name, Sum()).cpu_seconds for name, each in comm.traffic.sums.items()
        }
        found = {name: sim.costs.seconds[name] - start.seconds[name] - in_calls.get(name, 0.0) for name in sim.effects}
        found["step"] = cpu - sum(found.values()) - sum(in_calls.values())
        of_part["transforms"] += passes["each"]
        steps.append(found | of_part | {"windows": found["self_gravity"] - sum(of_part.values())})
        walls.append(wall)
    comm.traffic.fold()
    sums = {name: each - first.get(name, Sum()) for name, each in comm.traffic.sums.items()}
    told = {
        "gas": sim.gas.count,
        "dust": sim.dust.count,
        "seconds": {part: min(step[part] for step in steps) for part in steps[0] if part != "self_gravity"},
        "wall": min(walls),
        "communication": {name or "step": [each / STEPS for each in total] for name, total in sums.items()},
        "bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }
    return comm.mpi.allgather(told)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, usual in (("gas", 1e5), ("dust", 1e6), ("cells", 512)):
        parser.add_argument(f"--{name}", type=float, default=usual)
    parser.add_argument("--scheme", default="tsc")
    given = parser.parse_args()
    comm = Comm()
    found = measure(scene(int(given.gas), int(given.dust), int(given.cells), given.scheme), comm)
    if comm.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
