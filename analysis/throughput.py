"""What a step costs: nanoseconds a particle of whole integrated steps, and what each effect adds.

    python analysis/throughput.py [-o OUT] [--json] [--sizes N,...] [--threads 1,2] [--cases gas,gravity,...]
                                  [--parts cases,growth,effects,steps,sizes] [--scheme tsc] [--precision single]

A Sigma ~ 1/r disc about a star takes sixteen steps of the real loop (outputs, and the first steps, which compile,
apart) in a process of its own for every line:

    gas            the star and SPH with about 25 neighbours (cubic), artificial viscosity
    box            the same SPH of isothermal gas in a periodic box, a sound wave, without a star
    gravity        the disc with self-gravity on 2.7 cells a particle
    dust one-way   ten dust particles for each of gas, drag by the default or `--scheme`, gravity of the gas
    dust two-way   the same, both ways
    mix            the same with the dust's gravity, at ten times the dust
    main           setups/dusty_disc.toml as it is, whatever the sizes, drag by `--scheme` where that is given

    ns, wall  CPU time of all threads, and wall time, a step, over the particles of both kinds, in nanoseconds
    1e6/s     millions of particles a second and core
    grain     ns that the line takes beyond the same scene without its dust, over the dust particles
    triads    the CPU time of a particle in those of one element of a[i] = b[i] + s c[i] (24 bytes) in the same process
    FFTs      the CPU time of self-gravity, deposit and gather too, in bare zero-padded FFTW transforms of its grid,
              there and back
    bytes     the most memory that the process held, less what it held before the scene, over the particles

Lines on several numbers of threads are also set beside each other, with the minimum and the median of repeated ones:
`--threads 1,2,1,2,1,2` measures in turn, so that other work on the machine disturbs both alike.

For `mix` and `main` a table says where a step's time goes by pass: each loop, by its kernel.

`growth` takes gas from 1e4 to 1e6, dust to 1e7 and cells to 2048^2 and draws the cost of each against its number;
`effects` adds effect by effect to one disc, and sets what the whole step became dearer by beside what the ledger
(`costs.csv`) says; `steps` says where the shipped discs have their shortest steps, and what steps of each particle's
own would save; `sizes` sets a kick of the drag and a step of dust of eight sizes, classes of their own, beside those of
one size, at two and ten dust particles for each of gas, in `tsc` and `idic-linear` or the `--scheme` given.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from passes import table_of
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from script_helpers import some_of, whole_numbers
from step_cost import STEPS, apart, case, scene, without_dust

from discsim.parts import DEFAULT_SCHEME, SCHEMES

ORDER = ("gas", "star", "self_gravity", "dust", "drag")
CASES = ("gas", "box", "gravity", "dust one-way", "dust two-way", "mix", "main")
BY_PASS = ("mix", "main")  # cases of which passes are shown
PARTS = ("cases", "growth", "effects", "steps", "sizes")
SIZES = 8
STOKES = (0.04, 0.2, 1.2)  # at r = 1: of the smallest of the sizes, of the one and of the largest
ADDED = {
    "gas": {},
    "self_gravity": {"self_gravity": {"softening": 0.1}},
    "dust": {"dust": {"ratio": 0.01}},
    "drag": {"drag": {"law": "stokes-number", "stokes": 0.1}},
}


def line_of(name: str, size: int, threads: int, scheme: str | None = None, precision: str = "double") -> dict[str, Any]:
    tables = case(name, size, threads, scheme)
    tables["gas"]["precision"] = precision
    row: dict[str, Any] = {"case": name, **apart(tables)}
    if row["dust"]:
        bare = apart(without_dust(tables))
        row["cpu_of_dust"] = row["cpu"] - bare["cpu"]
    return row


def short(count: int) -> str:
    """10000 as 1e4, and nothing for none."""
    return f"{count:.0e}".replace("e+0", "e") if count else ""


def show_cases(rows: list[dict[str, Any]], console: Console) -> None:
    heads = ("case", "gas", "dust", "cores", "ns", "wall", "1e6/s", "grain", "triads", "FFTs", "bytes")
    table = Table(*heads, caption=f"{rows[0]['neighbours']:.0f} neighbours", box=SIMPLE)
    names = [name for name in ORDER if any(name in row["effects"] for row in rows)]
    shares = Table("case", "gas", "dust", "cores", *names, title="shares of the time", box=SIMPLE)
    for row in rows:
        count = row["gas"] + row["dust"]
        ns = 1e9 * row["cpu"] / count
        fft = row["effects"].get("self_gravity")
        start = (row["case"], short(row["gas"]), short(row["dust"]), str(row["threads"]))
        table.add_row(
            *start, f"{ns:.0f}", f"{1e9 * row['wall'] / count:.0f}", f"{1e3 / ns:.2f}",
            f"{1e9 * row['cpu_of_dust'] / row['dust']:.1f}" if row["dust"] else "",
            f"{row['cpu'] / count / row['triad']:.0f}", f"{fft / row['fft']:.2f}" if fft else "", f"{row['bytes']:.0f}",
        )  # fmt: skip
        parts = {name: f"{seconds / row['cpu']:.0%}" for name, seconds in row["effects"].items()}
        shares.add_row(*start, *(parts.get(name, "") for name in names))
    console.print(table)
    console.print(shares)
    show_threads(rows, console)
    for row in rows:
        if row["case"] in BY_PASS:
            what = f"{row['case']}, {short(row['gas'])} of gas, {short(row['dust'])} of dust, cores: {row['threads']}"
            console.print(table_of(what, row["passes"], row["cpu"], row["gas"] + row["dust"]))


def show_threads(rows: list[dict[str, Any]], console: Console) -> None:
    """What more threads take beside the first number of each line, and how many of them work at a time."""
    heads = ("case", "gas", "dust", "cores", "lines", "CPU ns", "wall ns", "CPU / wall", "CPU ratio", "wall ratio")
    caption = "minimum, median; ratios: to the first number of cores"
    table = Table(*heads, caption=caption, box=SIMPLE, padding=0)
    lines: dict[Any, dict[int, list[Any]]] = {}
    for row in rows:
        of = row["case"], short(row["gas"]), short(row["dust"])
        lines.setdefault(of, {}).setdefault(row["threads"], []).append(
            1e9 * np.array([row["cpu"], row["wall"]]) / (row["gas"] + row["dust"])
        )
    for of, by_threads in lines.items():
        first: Any = None
        for threads, taken in by_threads.items():
            cpu, wall = np.array(taken).T
            both = np.array([(each.min(), np.median(each)) for each in (cpu, wall)])
            first = both if first is None else first
            told = (f"{least:.2f}, {median:.2f}" for least, median in both / first)
            times = (f"{least:.0f}, {median:.0f}" for least, median in both)
            if len(by_threads) > 1:
                table.add_row(*of, str(threads), str(len(cpu)), *times, f"{np.median(cpu / wall):.2f}", *told)
    if table.row_count:
        console.print(table)


def show_effects(gas: int, console: Console) -> list[dict[str, Any]]:
    """The disc with effects added one by one: what the step became dearer by, what of it the new effect takes itself,
    and what the others take more, which have its particles to serve, or no kick to make of their own beside drag.
    """
    rows: list[dict[str, Any]] = []
    tables: dict[str, Any] = {}
    table = Table("added", "ms a step", "dearer by", "itself", "more for others", "outside the effects", box=SIMPLE)
    for name, more in ADDED.items():
        tables |= more
        row = {"added": name, **apart(scene(gas, 2 * gas, tables))}
        former = rows[-1] if rows else {"cpu": 0.0, "effects": {}}
        own = row["effects"][name]
        others = sum(row["effects"].values()) - own - sum(former["effects"].values())
        row |= {"dearer": row["cpu"] - former["cpu"], "own": own, "others": others}
        row["outside"] = row["cpu"] - sum(row["effects"].values())
        rows.append(row)
        figures = (row[key] for key in ("cpu", "dearer", "own", "others", "outside"))
        table.add_row(name, *(f"{1e3 * seconds:.1f}" for seconds in figures))
    console.print(table)
    return rows


def growth(largest: int) -> list[dict[str, Any]]:
    sizes = [("gas", n) for n in (10_000, 100_000, 1_000_000) if n <= largest]
    sizes += [("dust two-way", n) for n in (100_000, 1_000_000, 10_000_000) if n <= 10 * largest]
    rows = [line_of(name, size, 1) for name, size in sizes]
    for cells in (128, 256, 512, 1024, 2048):
        tables = scene(10_000, 0, ADDED["self_gravity"])
        tables["space"]["cells"] = cells
        rows.append({"case": "cells", **apart(tables)})
    return rows


def show_steps(console: Console) -> list[dict[str, Any]]:
    """What sets the steps of the shipped discs, and what steps of each particle's own, in powers of two, would save."""
    from discsim import Simulation, load_scene
    from discsim.physics.local import longest_step

    rows = []
    table = Table("disc", "set by", "at r", "r of the edges", "gas updates saved", "at most, of a step", box=SIMPLE)
    for path in sorted((Path(__file__).parents[1] / "setups").glob("*_disc.toml")):
        sim = Simulation(load_scene(path))
        left = [4]

        def enough(left: list[int] = left) -> bool:
            left[0] -= 1
            return left[0] == 0

        sim.evolve(np.inf, enough)
        gas, own = sim.gas, longest_step(sim.scene, sim.gas.h, sim.gas.sound_speed)
        first = int(own.argmin())
        halvings = np.floor(np.log2(own / own[first]))
        saved = 1.0 / np.mean(0.5**halvings)
        share = sim.costs.shares["gas"]
        whole = 1.0 / (1.0 - share + share / saved)
        r, edges = np.sqrt((gas.pos[first] ** 2).sum()), (sim.scene.initial.inner, sim.scene.initial.outer)
        rows.append({"disc": path.stem, "set_by": sim.limited_by, "saved": saved, "whole": whole, "radius": float(r)})
        table.add_row(
            path.stem, sim.limited_by, f"{r:.3g}", f"{edges[0]:.3g}, {edges[1]:.3g}", f"{saved:.2g} times",
            f"{whole:.2g} times",
        )  # fmt: skip
    console.print(table)
    return rows


def of_sizes(dust: int, per_gas: int, sizes: int, scheme: str) -> dict[str, Any]:
    """The disc with grains of one or SIZES sizes, `per_gas` particles of them for each of gas."""
    tables = scene(dust // per_gas, dust, {"dust": {"ratio": 0.1, "grain_density": 1.0}})
    start = tables["initial"]
    of_stokes = start["mass"] / np.pi**2 / (start["outer"] - start["inner"])  # St = (pi/2) s / Sigma
    smallest, one, largest = (stokes * of_stokes for stokes in STOKES)
    many = {"smallest": smallest, "largest": largest, "bins": sizes}
    tables["dust"]["grain_size"] = one if sizes == 1 else many
    return tables | {"drag": {"law": "epstein", "scheme": scheme}}


def show_sizes(dust: int, schemes: list[str], console: Console) -> list[dict[str, Any]]:
    """CPU time of kicks and steps of one size and of SIZES, one after the other; medians of STEPS steps."""
    from discsim import Simulation

    rows = []
    table = Table("scheme", "dust a gas", "sizes", "kick, ns", "step, ns", "kick, times", "step, times", box=SIMPLE)
    for scheme in schemes:
        for per_gas in (2, 10):
            sims = [Simulation(of_sizes(dust, per_gas, sizes, scheme)) for sizes in (1, SIZES)]
            taken: list[list[tuple[float, float]]] = [[] for _ in sims]
            for _ in range(2 + STEPS):  # the first two compile
                for sim, found in zip(sims, taken, strict=True):
                    kick, cpu = sim.costs.seconds["drag"], time.process_time()
                    sim.step()
                    found.append((sim.costs.seconds["drag"] - kick, time.process_time() - cpu))
            medians = [np.median(found[2:], axis=0) for found in taken]
            for sizes, median in zip((1, SIZES), medians, strict=True):
                kick, step = 1e9 * median / (dust + dust // per_gas)
                more = median / medians[0]
                rows.append({"scheme": scheme, "per_gas": per_gas, "sizes": sizes, "kick": kick, "step": step})
                figures = (f"{kick:.0f}", f"{step:.0f}", *(f"{times:.2f}" for times in more))
                table.add_row(scheme, str(per_gas), str(sizes), *figures)
    console.print(table)
    return rows


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Cost and memory a particle against the number of particles, cost of a cell against the number of cells."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    FigureCanvasAgg(figure)
    cost, memory, field = figure.subplots(1, 3)
    labels = {"gas": "gas, 25 neighbours", "dust two-way": "1 of gas, 10 of dust, drag and gravity"}
    for name, label in labels.items():
        found = [row for row in rows if row["case"] == name]
        count = [row["gas"] + row["dust"] for row in found]
        cost.plot(count, [1e9 * row["cpu"] / n for row, n in zip(found, count, strict=True)], "o-", label=label)
        memory.plot(count, [row["bytes"] for row in found], "o-", label=label)
    grids = [row for row in rows if row["case"] == "cells"]
    count = [row["cells"] for row in grids]
    taken = {"self-gravity of 10,000 particles": [row["effects"]["self_gravity"] for row in grids]}
    taken["a bare zero-padded FFTW pair"] = [row["fft"] for row in grids]
    for label, seconds in taken.items():
        field.plot(count, [1e9 * t / n for t, n in zip(seconds, count, strict=True)], "o-", label=label)
    for axes, number, text in (
        (cost, "particles", "CPU time a particle and step [ns]"),
        (memory, "particles", "memory a particle [bytes]"),
        (field, "cells", "CPU time a cell and step [ns]"),
    ):
        axes.set(xscale="log", yscale="log", xlabel=number, ylabel=text)
        axes.grid(alpha=0.3, which="both")
    cost.set_ylim(100, 3000)
    field.set_ylim(10, 300)
    field.legend(frameon=False, fontsize="small")
    cost.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("throughput"), help="folder for JSON and figure")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON and nothing else")
    sizes = "particles: gas of gas, gravity and mix, dust of the others"
    parser.add_argument("--sizes", type=whole_numbers(1000), default="1e5,1e6", help=sizes)
    parser.add_argument("--threads", type=whole_numbers(1), default="1,2", help="numbers of threads")
    parser.add_argument("--parts", type=some_of(PARTS, "part"), default=",".join(PARTS))
    parser.add_argument("--cases", type=some_of(CASES, "case"), default=",".join(CASES))
    parser.add_argument("--scheme", choices=list(SCHEMES), help=f"of the drag [{DEFAULT_SCHEME}; main: its own]")
    parser.add_argument(
        "--precision", choices=("double", "single"), default="double", help="of gas in `cases` [double]"
    )
    options = parser.parse_args()
    sizes, parts = options.sizes, options.parts
    console = Console(stderr=options.json, width=100)
    options.output.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    if "cases" in parts:
        found["cases"] = []
        for name in options.cases:
            for size in sizes[:1] if name == "main" else sizes:
                for number in options.threads:
                    console.print(f"{name}, {number} threads{'' if name == 'main' else f', {size:,} particles'} ...")
                    found["cases"].append(line_of(name, size, number, options.scheme, options.precision))
        show_cases(found["cases"], console)
    if "growth" in parts:
        found["growth"] = growth(max(sizes))
        show_cases([row for row in found["growth"] if row["case"] != "cells"], console)
        draw(found["growth"], options.output / "throughput.png")
    if "effects" in parts:
        found["effects"] = show_effects(min(sizes), console)
    if "steps" in parts:
        found["steps"] = show_steps(console)
    if "sizes" in parts:
        schemes = [options.scheme] if options.scheme else ["tsc", "idic-linear"]
        found["sizes"] = show_sizes(min(sizes), schemes, console)
    text = json.dumps(found, indent=1)
    (options.output / "throughput.json").write_text(text + "\n")
    if options.json:
        print(text)


if __name__ == "__main__":
    main()
