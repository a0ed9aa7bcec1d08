"""What communication costs: lines of costs.csv, the load in the log, and counts of what ranks would exchange."""

import csv
import json
from importlib import import_module as script
from pathlib import Path

import pytest
from launched import MARKS, lines_of
from runs import DISC

pytestmark = MARKS
HELPERS = Path(__file__).parents[1] / "helpers"


def test_communication_has_lines_of_its_own(tmp_path):
    (tmp_path / "disc.toml").write_text(DISC)
    lines_of(2, "-m", "discsim", "run", tmp_path / "disc.toml", "-o", tmp_path / "run", "--set", "run.until=0.25")
    with (tmp_path / "run" / "costs.csv").open(newline="") as file:
        rows = {row["effect"]: row for row in csv.DictReader(file)}
    effects = ["gas", "dust", "star", "self_gravity", "drag"]
    told = ["gas", "star", "self_gravity", "drag", "step"]  # the dust alone asks nobody
    assert list(rows) == effects + [f"{name} communication" for name in told]
    assert sum(float(row["share"]) for row in rows.values()) == pytest.approx(1, abs=1e-3)  # four digits each
    assert all(row["waiting"] == row["bytes"] == "" for name, row in rows.items() if name in effects)
    for name in told:
        row = rows[f"{name} communication"]
        assert 0.0 <= float(row["waiting"]) <= float(row["seconds"])  # a part of them, both rounded
        # Calls of all ranks are at least one message each; rows to others some hundred bytes and more.
        assert int(row["messages"]) > 0 and int(row["bytes"]) > 100 * int(row["calls"])
    assert "busiest rank 1.0" in (tmp_path / "run" / "run.log").read_text()


WAITS = """
import time
from mpi4py import MPI
from discsim.ranks.comm import Comm
comm = Comm()
comm.traffic.effect = "gas"
if comm.rank == 1:
    time.sleep(1.0)
comm.allreduce(1.0, MPI.MAX)
comm.traffic.add_waiting()
found = comm.mpi.gather(comm.traffic.sums["gas"].waiting)
if comm.rank == 0:
    print(*found)
"""


def test_who_comes_first_waits():
    """A second for another rank, which does not wait itself; half of it is room for a busy machine."""
    waited = [float(each) for each in lines_of(2, "-c", WAITS)[0].split()]
    assert waited[0] > 0.5 > waited[1]


@pytest.mark.parametrize("number", [2, 3])
def test_what_is_counted_is_what_ranks_exchange(number):
    """Rows of each exchange, and bytes and messages of the grid, to the last one."""
    lines = lines_of(number, HELPERS / "exchanged.py")
    assert len(lines) == number
    assert [line for line in lines if not line.endswith("; as counted")] == []


SENDS = """
import numpy as np
from discsim.ranks.comm import Comm, Route
comm = Comm()
n = 7 + comm.rank
rng = np.random.default_rng(comm.rank)
route = Route(comm, [rng.permutation(n)[: (comm.rank + 2 * to) % 5] for to in range(comm.size)])
arrays = [rng.random((n, 2)), rng.random(n) < 0.5, rng.integers(0, 99, n).astype(np.uint16), rng.random(n)]
expected = [route.send(array) for array in arrays]
into = [np.zeros_like(each) for each in expected]
found = route.send_all(arrays), route.send_all(arrays, into)
same = all(np.array_equal(a, b) and a.dtype == b.dtype for each in found for a, b in zip(each, expected))
told = comm.mpi.gather(same and found[1] is into and route.count == len(expected[0]))
if comm.rank == 0:
    print(*told)
"""


@pytest.mark.parametrize("number", [2, 3])
def test_arrays_of_all_kinds_go_together(number):
    """As each does alone; to some ranks no rows."""
    assert lines_of(number, "-c", SENDS) == [" ".join(["True"] * number)]


@pytest.mark.parametrize("number", [1, 2])
def test_a_step_is_measured_by_what_a_model_of_it_has(number):
    """On one rank too, which exchanges nothing."""
    scaling = script("scaling")
    beside = Path(scaling.__file__).with_name("rank_steps.py")
    (line,) = lines_of(number, beside, "--gas", "2000", "--dust", "4000", "--cells", "64")
    found = json.loads(line)
    assert len(found) == number
    for rank in found:
        seconds = rank["seconds"]
        assert set(seconds) == set(scaling.PARTS)
        assert 0.0 < seconds["transforms"] < sum(seconds.values()) < 1.05 * rank["wall"]  # of clocks of two kinds
