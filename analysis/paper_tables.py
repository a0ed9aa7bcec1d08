"""The tables of Stoyanovskaya et al. (2018, arXiv:1811.06506), beside what the schemes give here.

    python analysis/paper_tables.py [-o OUT]

L2 errors of the dust's velocity (their eq. 38: of the plain SPH interpolant, over the largest exact velocity) with
their integrator (forward Euler, positions with the old velocity), their steps, no heat from friction, and their
implicit Euler in the cells of `idic`, of one smoothing length:

    Table 1   DustyWave, eps = 1, 2 x 600, K = .005 and .5, cubic kernel, tau = .1 h
    Table 2   DustyShock, K = 500, eps = 1, 2 x 990, tau of MK .01 h, of IDIC .1 h
    Table 3   DustyWave, K = 500, eps = 1, 2 x 600, tau = .001, of IDIC at h = .025 .0025

It prints and writes (paper_tables.csv) each error, the printed one, and whether it is as close as it should be; what
is not, and why, is said.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

from common import some_of, write_csv
from measures import run_of, smoothed_error
from rich.console import Console
from rich.progress import track
from rich.table import Table

KERNELS = ("cubic", "quintic-h", "quintic")  # M4, M6-h, M6-3h
PAPERS = {"integration": "implicit", "cell": 1.0}


class Entry(NamedTuple):
    """One entry of a table: error printed, and by how much ours may differ, relatively or (below 0) up to a bound."""

    table: int
    problem: str
    scheme: str
    coefficient: float
    h: float
    kernel: str
    step: float
    printed: float | None = None
    within: float | None = None


def table_1() -> list[Entry]:
    rows = [(k, scheme, h) for k in (0.005, 0.5) for scheme in ("mk", "idic") for h in (0.025, 0.01)]
    return [Entry(1, "wave", scheme, k, h, "cubic", 0.1 * h) for k, scheme, h in rows]


def table_2() -> list[Entry]:
    printed = {
        ("mk", 0.025): (0.235, 0.143, 0.270),
        ("mk", 0.01): (0.138, 0.074, 0.156),
        ("idic", 0.025): (0.094, 0.116, 0.092),
        ("idic", 0.01): (0.051, 0.063, 0.049),
    }
    steps = {("mk", 0.025): 0.00025, ("mk", 0.01): 0.0001, ("idic", 0.025): 0.0025, ("idic", 0.01): 0.001}
    return [
        Entry(2, "shock", scheme, 500.0, h, kernel, steps[scheme, h], value, 0.15)
        for (scheme, h), row in printed.items()
        for kernel, value in zip(KERNELS, row, strict=True)
    ]


def table_3() -> list[Entry]:
    printed = {
        ("mk", 0.025): (0.217, 0.041, 0.296),
        ("mk", 0.01): (0.039, 0.005, 0.059),
        ("idic", 0.025): (0.004, 0.040, 0.003),
        ("idic", 0.01): (0.002, 0.006, 0.002),
    }
    # What is printed with one digit cannot be met closer than that.
    within = {("mk", 0.025): 0.06, ("mk", 0.01): 0.06, ("idic", 0.025): 0.3, ("idic", 0.01): -0.008}
    rows = []
    for (scheme, h), row in printed.items():
        for kernel, value in zip(KERNELS, row, strict=True):
            step = 0.0025 if (scheme, h) == ("idic", 0.025) else 0.001
            near = within[scheme, h]
            if kernel == "quintic-h" and h == 0.025:
                near = 0.06
            rows.append(Entry(3, "wave", scheme, 500.0, h, kernel, step, value, near))
    return rows


NOTES = """\
Table 1: the numbers printed there are not at hand, and nothing is claimed of them. At K = .5 the error of MK grows as h
falls: dust that lies exactly on gas has no drag from it (no line of sight), a share W(0) m / rho of the whole.
Table 2, IDIC at h = .01: cells of h hold two particles in the low-density gas; here they grow until they hold four."""


def error_of(entry: Entry) -> float:
    particles = 600 if entry.problem == "wave" else 990
    run = {"integrator": "euler", "timestep": entry.step}
    drag = PAPERS if entry.scheme == "idic" else {}
    if entry.problem == "shock":
        drag = drag | {"heating": False}
    sim = run_of(
        entry.scheme,
        entry.problem,
        entry.coefficient,
        entry.h,
        (particles, particles),
        kernel=entry.kernel,
        drag=drag,
        run=run,
    )
    sim.run()
    return smoothed_error(sim, "dust", entry.h, entry.kernel)


def verdict(entry: Entry, found: float) -> str:
    if entry.printed is None or entry.within is None:
        return "not compared"
    if entry.within < 0:
        return "yes" if found < -entry.within else f"NO: expected below {-entry.within:g}"
    off = abs(found / entry.printed - 1)
    # Numbers are printed to .001, and cut off there.
    close = off <= entry.within or abs(found - entry.printed) <= 0.0006
    return "yes" if close else f"NO: {off:.0%} off, expected {entry.within:.0%}"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("paper_tables"))
    makers = {"1": table_1, "2": table_2, "3": table_3}
    numbers = some_of(makers, "table")
    parser.add_argument("--tables", type=numbers, default="1,2,3", help="numbers of the tables, separated by commas")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    entries = [entry for name in given.tables for entry in makers[name]()]
    rows = []
    for entry in track(entries, console=Console(stderr=True)):
        found = error_of(entry)
        rows.append(entry._asdict() | {"found": found, "as_expected": verdict(entry, found)})
    columns = ("table", "problem", "scheme", "coefficient", "h", "kernel", "step", "printed", "found", "as_expected")
    table = Table(*columns)
    for row in rows:
        table.add_row(
            *("" if row[key] is None else f"{v:.4g}" if isinstance(v := row[key], float) else str(v) for key in columns)
        )
    console = Console(width=150)
    console.print(table)
    console.print(NOTES)
    write_csv(rows, columns, given.out / "paper_tables.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
