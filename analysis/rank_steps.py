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
from typing import Any, NamedTuple

import numpy as np
from passes import watched
from rank_cut import cut_into

from discsim import Simulation, load_scene
from discsim.numerics.grid import Grid
from discsim.ranks.comm import Comm
from discsim.ranks.gravity import Nodes
from discsim.ranks.slabs import AllToAll
from discsim.ranks.start import begin_on_root, divide
from discsim.ranks.traffic import CallCost

MAIN = Path(__file__).parents[1] / "setups" / "dusty_disc.toml"
UNCOUNTED = 2  # steps: they compile, and sort
STEPS = 8  # none of which sorts; of each part of one the least is told, as other processes may be in the way
# Methods that belong to other parts of a step than what else gravity does, which goes with the nodes of a window.
PARTS = {
    (Nodes, "sources"): "grid particles", (Grid, "extent"): "grid particles", (Grid, "deposit"): "grid particles",
    (Grid, "pull"): "grid particles", (AllToAll, "gather_second_axis"): "transforms",
    (AllToAll, "gather_first_axis"): "transforms",
}  # fmt: skip


def scene(gas: int, dust: int, cells: int, scheme: str) -> dict[str, Any]:
    """The main job's disc with other numbers, one thread a rank."""
    tables = tomllib.loads(MAIN.read_text())
    tables["gas"]["particles"], tables["dust"]["particles"] = gas, dust
    tables["space"]["cells"], tables["drag"]["scheme"], tables["run"]["threads"] = cells, scheme, 1
    return tables


class Spent(NamedTuple):
    """Seconds since the start: of CPU and of wall time; CPU seconds by effect, part of a step, loop, and of calls."""

    cpu: float
    wall: float
    effects: dict[str, float]
    parts: Counter[str]
    passes: Counter[str]
    calls: dict[str, float]

    @classmethod
    def now(cls, sim: Simulation, comm: Comm, parts: Counter[str], passes: Counter[str]) -> Spent:
        calls = {name: each.cpu_seconds for name, each in comm.traffic.sums.items()}
        effects = dict(sim.costs.seconds)
        return cls(time.process_time(), time.perf_counter(), effects, parts.copy(), passes.copy(), calls)


def _seconds(begin: Spent, end: Spent) -> tuple[dict[str, float], float]:
    """CPU seconds of a step by its parts, without those of calls, and its wall time."""
    in_calls = {name: spent - begin.calls.get(name, 0.0) for name, spent in end.calls.items()}
    out = {name: spent - begin.effects[name] - in_calls.get(name, 0.0) for name, spent in end.effects.items()}
    out["step"] = end.cpu - begin.cpu - sum(out.values()) - sum(in_calls.values())
    of_part = Counter({part: end.parts[part] - begin.parts[part] for part in PARTS.values()})  # 0: no calls
    of_part["transforms"] += end.passes["run_batches"] - begin.passes["run_batches"]
    out |= of_part
    out["windows"] = out.pop("self_gravity") - sum(of_part.values())
    return out, end.wall - begin.wall


def measure(tables: dict[str, Any], comm: Comm, parts: int = 0) -> list[dict[str, Any]]:
    """Figures of each rank: seconds by part of a step, communication by effect, memory; `parts` as of `rank_cut.py`."""
    given = load_scene(tables)
    sim = Simulation(given, begun=begin_on_root(comm, given, False))
    if comm.size > 1:
        with cut_into(parts):
            divide(sim, comm)
    of_part: Counter[str] = Counter()

    def own() -> float:
        return time.process_time() - sum(each.cpu_seconds for each in comm.traffic.sums.values())

    def timed(method: Any, part: str) -> Any:
        def counted(*given: Any, **named: Any) -> Any:
            start = own()
            found = method(*given, **named)
            of_part[part] += own() - start
            return found

        return counted

    for (kind, name), part in PARTS.items():
        setattr(kind, name, timed(getattr(kind, name), part))
    steps, walls, first = [], [], dict[str, CallCost]()
    begun_at: list[Spent] = []

    def after_step() -> bool:
        now = Spent.now(sim, comm, of_part, passes)
        if len(begun_at) >= UNCOUNTED:
            each, wall = _seconds(begun_at[-1], now)
            steps.append(each)
            walls.append(wall)
        comm.mpi.Barrier()
        begun_at.append(Spent.now(sim, comm, of_part, passes))
        if len(begun_at) == UNCOUNTED:
            first.update(comm.traffic.sums)
        return len(steps) == STEPS

    with watched() as passes:
        sim.evolve(np.inf, after_step, read_only=True)
    comm.traffic.add_waiting()
    sums = {name: each - first.get(name, CallCost()) for name, each in comm.traffic.sums.items()}
    told = {
        "gas": sim.gas.count,
        "dust": sim.dust.count,
        "seconds": {part: min(step[part] for step in steps) for part in steps[0]},
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
    parser.add_argument("--parts", type=int, default=0, help="into how many parts the disc is cut; 0: as many as ranks")
    given = parser.parse_args()
    comm = Comm()
    found = measure(scene(int(given.gas), int(given.dust), int(given.cells), given.scheme), comm, given.parts)
    if comm.rank == 0:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
