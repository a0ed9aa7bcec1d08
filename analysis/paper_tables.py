"""The tables of Stoyanovskaya et al. (2018, arXiv:1811.06506), beside what the schemes give here.

    python analysis/paper_tables.py [-o OUT]

L2 errors of the dust's velocity (their eq. 38: of the plain SPH interpolant, over the largest exact velocity) with
their integrator (forward Euler, positions with the old velocity), their steps, no heat from friction, and their
implicit Euler in the cells of `idic`, of one smoothing length:

    Table 1   DustyWave, eps = 1, 2 x 600, K = .005 and .5, cubic kernel, tau = .1 h
    Table 2   DustyShock, K = 500, eps = 1, 2 x 990, tau of MK .01 h, of IDIC .1 h
    Table 3   DustyWave, K = 500, eps = 1, 2 x 600, tau = .001, of IDIC at h = .025 .0025

It prints and writes (paper_tables.csv) each error, the printed one, and whether it is as close as it should be; what
is not, and why, is said. `interpolant` is the error of exact velocities at the same places: the measure's own.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

from measures import run_of, smoothed_error
from rich.console import Console
from rich.progress import track
from rich.table import Table
from script_helpers import some_of, write_csv

KERNELS = ("cubic", "quintic-h", "quintic")  # M4, M6-h, M6-3h
DIGIT = {1: 1e-6, 2: 1e-3, 3: 1e-3}  # of the tables, the last printed; what follows is cut off
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
    printed: float
    within: float
    printed_at: float | None = None  # the h that it is printed under, where that is another


def table_1() -> list[Entry]:
    printed = {
        (0.005, "mk"): {0.025: 0.002829, 0.01: 0.000636},
        (0.005, "idic"): {0.025: 0.002954, 0.01: 0.000653},
        (0.5, "mk"): {0.025: 0.024018, 0.01: 0.012058},
        (0.5, "idic"): {0.025: 0.004631, 0.01: 0.001237},
    }
    rows = []
    for (k, scheme), row in printed.items():
        other = dict(zip(row, reversed(row), strict=True)) if (k, scheme) == (0.5, "mk") else {}
        for h in row:
            at = other.get(h)
            rows.append(Entry(1, "wave", scheme, k, h, "cubic", 0.1 * h, row[at or h], 0.06, at))
    return rows


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
Table 1, MK at K = .5: the printed pair stands exchanged between the two h, and is compared so. Its error grows as h
falls: dust that lies exactly on gas has no drag from it (no line of sight), a share W(0) m / rho of the whole.
Table 1, K = .005 at h = .01: so weak a drag changes the dust's velocity by .003 in all, and what is seen is the error
of the interpolant itself, .00047. With IDIC ours is that; with MK the drag that is lacking makes up for some of it.
What is printed exceeds ours, at both h, by a part that depends on neither h nor tau, .0004 (IDIC) and .0005 (MK) added
in squares; beside .0029 at h = .025 it does not show. IDIC at K = .5 has no such part, to three digits, so it is not
the measure's; where it comes from we do not know.
Table 2, IDIC at h = .01: cells of h hold two particles in the low-density gas; here they grow until they hold four."""


def errors_of(entry: Entry) -> tuple[float, float]:
    """The error of a run, and that of the interpolant alone."""
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
    found, own = (smoothed_error(sim, "dust", entry.h, entry.kernel, of_exact) for of_exact in (False, True))
    return found, own


def verdict(entry: Entry, found: float) -> str:
    exchanged = f", as printed at h = {entry.printed_at}" if entry.printed_at else ""
    return closeness(entry, found) + exchanged


def closeness(entry: Entry, found: float) -> str:
    if entry.within < 0:
        return "yes" if found < -entry.within else f"NO: expected below {-entry.within:g}"
    off = abs(found / entry.printed - 1)
    close = off <= entry.within or abs(found - entry.printed) <= 0.6 * DIGIT[entry.table]
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
        found, own = errors_of(entry)
        rows.append(entry._asdict() | {"found": found, "interpolant": own, "as_expected": verdict(entry, found)})
    columns = (
        "table", "problem", "scheme", "coefficient", "h", "kernel", "step", "printed", "found", "interpolant",
        "as_expected",
    )  # fmt: skip
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
