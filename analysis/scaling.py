"""What a disc would take on many MPI ranks: real states cut by the code that runs on ranks, and a model of the step.

    python analysis/scaling.py -o OUT [--scheme tsc] [--size 1e6,1e7,2048] [--measure 1e6,1e7,2048]

A state of the main job's disc is cut for 2 to 4096 ranks (`rank_counts.py`), which gives for each rank its particles,
those that it fetches, its part of the grid, and what it sends to how many others. A step is predicted from that:

    T = sum over the parts of a step of max over ranks (a units + g fetched + c)
        + calls latency log2 N + messages latency
        + sum over exchanges of (max over machines bytes / link + max over ranks bytes copied / memory) + runs s (1)

a: CPU seconds of a unit: of own particles, of rows of the transforms (n log n), of nodes of a window. g: of a fetched
particle, or of one at a border. c: of calls. Where ranks do two parts between the same exchanges, BESIDE, these count
as one. a, g and c are fitted to short runs on 2 ranks of one thread (`rank_steps.py`), each on a core of its own as on
a cluster: of a fourth and of a sixteenth of the size, each cut into 2 parts and into 16 (`rank_cut.py`), and so with
few borders and many. They are compared with runs on 2 and 4 ranks; what one rank takes is measured. Each run is made in
ROUNDS, all in turn, and the least of each part is taken: other work may share the machine. Bytes: of rows that are
sent, and of the runs of cells that all ranks say they need, in which each looks for its own, s seconds a run. A machine
has 32 ranks, next to each other on the curve: what they send to others shares its link, and what they send each other
is copied in memory, as is all that MPI packs, PACKED. Network: two examples, NETWORKS.

A larger state, 1e8 + 1e9 particles on 16384^2, is that sample with more particles in each place: those that are fetched
lie along the same borders within a reach that falls as n^-1/2; the weak scaling is made so too. Transforms are those of
its grid. Windows of nodes that particles touch are counted on both grids: those of the finer one hold for it and finer
ones, those of the sample's for coarser ones; the weak scaling has a small step between the two.

OUT gets scaling.json and scaling.png. What was measured and counted is not made again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rank_sent import EXCHANGES, PER_MACHINE, Sent, of_transforms
from scipy.optimize import nnls

if TYPE_CHECKING:
    from rank_counts import Counts  # which needs mpi4py

Array = np.ndarray
RANKS = (1, *(2**k for k in range(1, 13)))
FITTED, CUT_INTO = 2, (2, 16)  # ranks, each with a core of its own (more would look slower than they are), and parts
CHECKED = (2, 4)
ROUNDS = 3
SOME = 7  # a step
RUN = 16  # bytes of one
SEARCH = 1e-7  # CPU seconds of a run
BIG = (100.0, 16384)  # times the particles, and cells along a side


class Network(NamedTuple):
    """Seconds of a message, and bytes a second of a machine's link."""

    name: str
    latency: float
    link: float


NETWORKS = (Network("InfiniBand 200 Gb/s", 2e-6, 25e9), Network("Ethernet 25 Gb/s", 20e-6, 3.1e9))
MEMORY = 2e9  # bytes a second of a rank to others of its machine while all 32 send: assumed; two alone do 5e9
PACKED = ("rows to columns", "columns to rows")  # exchanges of which MPI packs and unpacks what is not contiguous
# Of each part of a step: the species and the exchange that bring its units. Who is at a border also comes and goes.
PARTS = {
    "gas": (("gas",), "sph"), "drag": (("gas", "dust"), "drag"), "grid particles": (("gas", "dust"), "grid"),
    "star": (("gas", "dust"), "drag"), "dust": (("dust",), None), "step": (("gas", "dust"), "drag"),
    "transforms": ((), None), "windows": ((), None),
}  # fmt: skip

# Parts that have no exchange between them: a rank's seconds of one are added to those of the other, and then the
# slowest is taken. Both lie before the transforms, and again after them.
BESIDE = {"windows": "grid particles"}


def units(counts: dict[str, Any], part: str, particles: float = 1.0, side: int | None = None) -> Array:
    """Units (2, ranks) of a part of a step, own ones and those that are fetched, where there are `particles` times as
    many and the grid has a side.
    """
    side, none = side or counts["side"], np.zeros(len(counts["window"]))
    if part == "transforms":
        return np.stack([of_transforms((side, side), False, len(none))[1] * side * np.log2(2 * side), none])
    if part == "windows":
        of_grid, more = on_grid(counts, side)
        return np.stack([np.array(of_grid["window"]) * more, none])
    species, exchange = PARTS[part]
    own = sum(particles * np.array(counts["particles"][name], float) for name in species)
    if exchange is None:
        return np.stack([own, none])
    fetched = sum(np.sqrt(particles) * np.array(counts["received"][f"{exchange} {name}"]) for name in species)
    return np.stack([own, fetched])


def on_grid(counts: dict[str, Any], side: int) -> tuple[dict[str, Any], float]:
    """Counts that hang on the grid, of the finer one from its side on, and how many times as many nodes a grid has."""
    fine = counts.get("fine", counts)  # none of states that were run
    found = fine if side >= fine["side"] else counts
    return found, (side / found["side"]) ** 2


def fit(runs: list[tuple[list[Any], Any]]) -> dict[str, tuple[float, float, float]]:
    """a, g and c of each part, none below 0, by what was measured and counted of some runs."""
    out = {}
    for part in PARTS:
        rows, seconds = [], []
        for measured, counts in runs:
            own = [rank["seconds"][part] for rank in measured]
            rows.append(np.column_stack([*units(counts, part), np.ones(len(own))]) / np.mean(own))
            seconds.append(np.array(own) / np.mean(own))
        matrix = np.concatenate(rows)
        scale = np.abs(matrix).max(axis=0)
        scale[scale == 0.0] = 1.0
        found = nnls(matrix / scale, np.concatenate(seconds))[0] / scale
        out[part] = tuple(map(float, found))
    return out


def alone(measured: dict[int, Any], counts: dict[int, Any]) -> dict[str, tuple[float, float, float]]:
    """The same for one rank, by its run."""
    return {part: (t / float(units(counts[1], part)[0, 0]), 0.0, 0.0) for part, t in measured[1][0]["seconds"].items()}


def _all(counts: dict[str, Any]) -> int:
    return int(sum(np.sum(each) for each in counts["particles"].values()))


def slowest(seconds: dict[str, Any]) -> float:
    """Seconds of a step, by those of its parts (ranks,): after each all wait for the slowest, unless BESIDE another."""
    of_wait: dict[str, Any] = {}
    for part, each in seconds.items():
        name = BESIDE.get(part, part)
        of_wait[name] = of_wait.get(name, 0.0) + np.array(each)
    return float(sum(each.max() for each in of_wait.values()))


def predict(
    counts: dict[str, Any],
    costs: dict[str, Any],
    network: Network | None,
    particles: float = 1.0,
    side: int | None = None,
) -> dict[str, float]:
    """Seconds of a step by what takes them; `costs`: the fit, the calls of a step and bytes of a row."""
    size, more = len(counts["window"]), np.sqrt(particles)
    own = fetched = calls = 0.0
    of_part: dict[str, Array] = {}
    for part, (a, g, c) in costs["fit" if size > 1 else "alone"].items():
        of_own, of_fetched = np.array([[a], [g]]) * units(counts, part, particles, side)
        of_part[part] = of_own + of_fetched + c
        own += of_own.mean()
        fetched += of_fetched.mean()
        calls += c
    runs = more * sum(np.sum(each) for each in counts["runs"].values()) if size > 1 else 0.0
    out = {"own work": own, "fetched particles": fetched, "calls": calls, "lists of cells": SEARCH * runs}
    out["uneven load"] = slowest(of_part) - own - fetched - calls
    if network is not None and size > 1:
        sent = _sent(counts, costs, more, side or counts["side"])
        machines = np.arange(0, size, PER_MACHINE)
        out["bandwidth"] = sum(
            np.add.reduceat(each.away, machines).max() / network.link
            + (each.total - (0.0 if name in PACKED else each.away)).max() / MEMORY
            for name, each in sent.items()
        )
        out["lists of cells"] += RUN * runs * (1 / network.link + 1 / MEMORY)
        messages = sum(costs["sends"].get(name.split()[0], 1) * each.messages for name, each in sent.items())
        out["latency"] = network.latency * (float(messages.max()) + costs["calls"] * np.log2(size))
    return out


def _sent(counts: dict[str, Any], costs: dict[str, Any], more: float, side: int) -> dict[str, Sent]:
    """Bytes by exchange, where `more` times as many rows are sent and the grid has a side."""
    out = of_transforms((side, side), False, len(counts["window"]))[0]
    of_grid, nodes = on_grid(counts, side)
    for name in counts["sent"]:
        of_rows = name in EXCHANGES
        factor = more * costs["row"][name.split()[0]] if of_rows else nodes
        total, away, messages = (np.array(one) for one in (counts if of_rows else of_grid)["sent"][name])
        out[name] = Sent(factor * total, factor * away, messages)
    return out


def counted(counts: Counts, side: int) -> dict[str, Any]:
    """`Counts` as numbers that JSON takes."""
    sent = {name: Sent.of(rows) for name, rows in counts.rows.items()}
    sent |= {name: counts.bytes[name] for name in ("density", "potential")}
    return {
        "side": side,
        "particles": {name: each.tolist() for name, each in counts.particles.items()},
        "runs": {name: each.tolist() for name, each in counts.runs.items()},
        "received": {name: counts.received(name).tolist() for name in counts.rows},
        "window": counts.window.tolist(),
        "sent": _listed(sent),
    }


def count(
    gas: int, dust: int, side: int, scheme: str, ranks: tuple[int, ...], parts: int = 0, fine: int | None = None
) -> dict[int, Any]:
    """Counts of the disc at its start, for each number of ranks; and of a `fine` grid, of so many cells a side."""
    from rank_counts import Divided, blocks_of_drag, cells_of_gas, counts_of, of_nodes
    from rank_steps import scene

    from discsim import Simulation

    sim = Simulation(scene(gas, dust, side, scheme))
    cells = cells_of_gas(sim)
    sim.operators.forces()
    sim.state.step = SOME  # at the start blocks begin where tiles do
    blocks = blocks_of_drag(sim)
    out = {}
    for number in ranks:
        cut = Divided.of(sim, number, parts)
        out[number] = counted(counts_of(sim, cut, cells, blocks), side)
        if fine is not None:
            _, sent, window = of_nodes(sim, cut, fine)
            out[number]["fine"] = {"side": fine, "window": window.tolist(), "sent": _listed(sent)}
    return out


def _listed(sent: dict[str, Sent]) -> dict[str, Any]:
    return {name: [one.tolist() for one in each] for name, each in sent.items()}


class Run(NamedTuple):
    """Of `rank_steps.py`: gas, dust and cells of the disc, ranks, and into how many parts it is cut (0: as many)."""

    size: tuple[int, int, int]
    ranks: int
    parts: int = 0


def measure(run: Run, scheme: str) -> list[Any]:
    """What the run tells of each rank."""
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else shutil.which("mpiexec")
    gas, dust, side = map(str, run.size)
    command = [launcher, "-n", str(run.ranks), sys.executable, str(Path(__file__).with_name("rank_steps.py"))]
    command += ["--gas", gas, "--dust", dust, "--cells", side, "--scheme", scheme, "--parts", str(run.parts)]
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    return list(json.loads(done.stdout))


def measure_in_turn(runs: dict[str, Run], scheme: str) -> dict[str, list[Any]]:
    """The runs by name, in ROUNDS of all of them: of each part of a step on each rank the least."""
    found: dict[str, list[Any]] = {}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            ranks = measure(run, scheme)
            for rank, before in zip(ranks, found.get(name, ranks), strict=True):
                rank["seconds"] = {part: min(t, before["seconds"][part]) for part, t in rank["seconds"].items()}
                rank["wall"] = min(rank["wall"], before["wall"])
            found[name] = ranks
    return found


def costs_of(measured: dict[int, Any], counts: dict[int, Any], fitted: list[tuple[list[Any], Any]]) -> dict[str, Any]:
    """What `predict` takes, of short runs and the counts of the same states; `fitted`: those for a, g and c."""
    two, at_two = measured[2], counts[2]
    effects = {"sph": "gas", "drag": "drag", "grid": "self_gravity"}
    row, sends = {}, {}
    for exchange, effect in effects.items():
        rows = sum(np.sum(each[0]) for name, each in at_two["sent"].items() if name.startswith(exchange))
        total = sum(rank["communication"][effect][4] for rank in two)
        if exchange == "grid":
            of_grid = of_transforms((at_two["side"],) * 2, False, 2)[0].values()
            total -= sum(each.total.sum() for each in of_grid)
            total -= sum(np.sum(at_two["sent"][name][0]) for name in ("density", "potential"))
        total -= RUN * sum(np.sum(each) for name, each in at_two["runs"].items() if name.startswith(exchange))
        row[exchange] = total / rows  # with the little that other calls have
        sends[exchange] = two[0]["communication"][effect][5] / (1 if exchange == "sph" else 2)
    calls = sum(each[0] for each in two[0]["communication"].values())
    return {"fit": fit(fitted), "alone": alone(measured, counts), "row": row, "sends": sends, "calls": calls}


def check(measured: dict[int, Any], counts: dict[int, Any], costs: dict[str, Any]) -> dict[int, tuple[float, float]]:
    """CPU seconds of a step, of each part on the slowest rank, predicted and measured, of the runs CHECKED."""
    out = {}
    for n in CHECKED:
        found = predict(counts[n], costs, None)
        del found["lists of cells"]  # what was measured has it in its parts
        out[n] = sum(found.values()), slowest({part: [rank["seconds"][part] for rank in measured[n]] for part in PARTS})
    return out


def kept(path: Path, make: Any) -> dict[Any, Any]:
    """What was made before, or is now; keys that are numbers as such."""
    if not path.exists():
        path.write_text(json.dumps(make()))
    found = json.loads(path.read_text())
    return {int(name) if name.isdigit() else name: each for name, each in found.items()}


def samples(size: tuple[int, int, int], scheme: str, out: Path) -> tuple[Any, Any, list[tuple[list[Any], Any]]]:
    """By ranks what runs of a size take and their counts, and the same of those that a, g and c are fitted to."""
    few, (gas, dust, side) = sorted({1, *CHECKED}), size
    less = [(gas // 4**k, dust // 4**k, side // 2**k) for k in (1, 2)]
    runs = {str(n): Run(size, n) for n in few}
    fitted = {f"{each[0]} in {parts}": Run(each, FITTED, parts) for each in less for parts in CUT_INTO}
    told = kept(out / f"measured_{scheme}.json", lambda: measure_in_turn(runs | fitted, scheme))
    counts = kept(out / f"counts_measured_{scheme}.json", lambda: count(*size, scheme, tuple(few)))
    of_fitted = kept(
        out / f"counts_fitted_{scheme}.json",
        lambda: {name: count(*run.size, scheme, (run.ranks,), run.parts)[run.ranks] for name, run in fitted.items()},
    )
    return {n: told[n] for n in few}, counts, [(told[name], of_fitted[name]) for name in fitted]


def draw(found: dict[str, Any], path: Path) -> None:
    figure = Figure((13, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for k, (title, rows) in enumerate(found["strong"].items()):
        total = {int(n): sum(each.values()) for n, each in rows.items()}
        ranks = np.array([*total])
        left.loglog(ranks, [*total.values()], "o-" if k % 2 == 0 else "s--", color=f"C{k // 2}", ms=4, label=title)
        if k % 2 == 0:
            left.loglog(ranks, total[1] / ranks, ":", color=f"C{k // 2}", lw=1)
    left.set(xlabel="ranks", ylabel="seconds of a step", title="strong scaling (dotted: ideal)")
    left.legend(fontsize=7)
    title, rows = [*found["strong"].items()][2]
    names = [*rows["2"]]
    share = np.array([[rows[n].get(name, 0.0) for n in rows] for name in names])
    middle.stackplot([int(n) for n in rows], share / share.sum(axis=0), labels=names)
    middle.set(xscale="log", xlabel="ranks", ylabel="share of a step", ylim=(0, 1), xlim=(1, RANKS[-1]))
    middle.set_title(title, fontsize=9)
    middle.legend(fontsize=7, loc="lower left")
    for k, (title, rows) in enumerate(found["weak"].items()):
        total = [sum(each.values()) for each in rows.values()]
        ranks = [int(n) for n in rows]
        right.loglog(ranks, total, "o-" if k % 2 == 0 else "s--", color=f"C{k // 2}", ms=4, label=title)
    right.set(xlabel="ranks", ylabel="seconds of a step", title="weak scaling")
    right.margins(y=0.25)
    right.legend(fontsize=7, loc="upper left")
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--scheme", default="tsc")
    parser.add_argument("--size", default="1e6,1e7,2048", help="gas, dust and cells of the state that is cut")
    parser.add_argument("--measure", default="1e6,1e7,2048", help="the same of the runs on 1 to 4 ranks")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    small, size = (tuple(int(float(part)) for part in text.split(",")) for text in (given.measure, given.size))
    out, scheme = given.out, given.scheme
    measured, counts, fitted = samples(small, scheme, out)
    at_size = kept(out / f"counts_{scheme}_{BIG[1]}.json", lambda: count(*size, scheme, RANKS, fine=BIG[1]))
    costs = costs_of(measured, counts, fitted)
    ns = {part: [1e9 * each for each in found] for part, found in costs["fit"].items()}
    about = "ns of a unit, of a fetched one, and of a step"
    found: dict[str, Any] = {about: ns, "bytes of a row": costs["row"]}
    found["seconds of a step, predicted and measured"] = check(measured, counts, costs)
    words = {1.0: "1e6 + 1e7, 2048$^2$", BIG[0]: "1e8 + 1e9, 16384$^2$"}
    of_all = 1.1e7 / _all(at_size[1])  # where a smaller sample is cut
    sides = {1.0: 2048, BIG[0]: BIG[1]}
    found["strong"] = {
        f"{words[more]}, {network.name}": {
            n: predict(each, costs, network, more * of_all, sides[more]) for n, each in at_size.items()
        }
        for more in words for network in NETWORKS
    }  # fmt: skip
    found["weak"] = {}
    for each_has in (1e6, 1e7):
        for network in NETWORKS:
            rows = {}
            for n, each in at_size.items():
                more = n * each_has / _all(each)
                rows[n] = predict(each, costs, network, more, 2 ** round(np.log2(2048 * np.sqrt(n * each_has / 1.1e7))))
            found["weak"][f"{each_has:.0e} particles a rank, {network.name}"] = rows
    text = json.dumps(found, indent=1)
    (out / f"scaling_{scheme}.json").write_text(text + "\n")
    found = json.loads(text)
    for title, rows in found["strong"].items():
        one = sum(rows["1"].values())
        print(title)
        for n, each in rows.items():
            total = sum(each.values())
            most = max((name for name in each if name != "own work"), key=lambda name: each[name])
            print(f"{n:>6} ranks  {total:9.4g} s  efficiency {one / total / int(n):.2f}  most beside own work: {most}")
    print(json.dumps({name: found[name] for name in [*found][:3]}, indent=1))
    draw(found, out / f"scaling_{scheme}.png")


if __name__ == "__main__":
    main()
