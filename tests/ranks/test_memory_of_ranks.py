"""What a rank holds between steps."""

from pathlib import Path

import pytest
from launched import MARKS, lines_of

pytestmark = MARKS

HOLDS = f"""
import sys, tracemalloc
import numpy as np
sys.path[:0] = [{str(Path(__file__).parents[2] / "analysis")!r}, {str(Path(__file__).parents[1] / "helpers")!r}]
from rank_steps import scene
from shares import keep_share
from discsim import Simulation
from discsim.ranks.start import divide
from discsim.ranks.comm import Comm
comm, sim, held = Comm(), Simulation(scene(20000, 100000, 256, "tsc")), []
keep_share(sim.state, comm)
own = divide(sim, comm)
def note():
    held.append(tracemalloc.get_traced_memory()[0])
    return len(held) == 3
sim.evolve(np.inf, lambda: True)  # loads the kernels
tracemalloc.start()
for name, p in sim.state.species.items():
    for key, array in p.arrays().items():
        setattr(p, key, array.copy())
sim.evolve(np.inf, note)
with_room = sum(a.nbytes * (1 + p.spare / p.count) for p in sim.state.species.values() for a in p.arrays().values())
found = comm.mpi.gather(held[-1] / with_room)
if comm.rank == 0:
    print(*found)
"""


@pytest.mark.parametrize("number", [2, 3])
def test_a_rank_holds_its_particles_between_steps(number):
    """With their room for others', and a tenth more: accelerations that gas and dust do not share, and Python's own."""
    (line,) = lines_of(number, "-c", HOLDS)
    for held in map(float, line.split()):
        assert held < 1.1, line
