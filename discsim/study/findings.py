"""Tables of a cost study for the terminal: runs, costs of given errors, and orders of convergence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from discsim.printable import printable
from discsim.study.points import Point, Varied, label_of, number_in, short_names

if TYPE_CHECKING:
    from discsim.study.cost import Study

GOALS = (0.1, 0.01, 0.001)  # errors whose cheapest settings are printed
MAX_EXTRAPOLATION = 1e8  # largest ratio of an extrapolated cost to the cost of the most accurate run
LEAST_FALL = 0.1  # smallest q of a fit error ~ cost^-q that is extrapolated; half the error then costs 1000 times
EQUAL_VALUES = 1e-9  # relative difference below which two values of x are equal to rounding


def fitted_power(x: Sequence[float], y: Sequence[float]) -> float | None:
    """Return the power p of a least-squares fit y ~ x^p in logarithms.

    None if fewer than two values of x differ, or if a number is not positive.
    """
    if len(x) < 2 or min(*x, *y) <= 0.0 or max(x) <= (1.0 + EQUAL_VALUES) * min(x):
        return None
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def fall_of_error(cost: Sequence[float], errors: Sequence[float]) -> float | None:
    """Return the power q of a least-squares fit error ~ cost^-q; None if the error does not clearly fall.

    It falls clearly if q is at least LEAST_FALL, and either each dearer run is more accurate, or q is more than twice
    its standard error.
    """
    power = fitted_power(cost, errors)
    if power is None or -power < LEAST_FALL:
        return None
    x, y = np.log(cost) - np.mean(np.log(cost)), np.log(errors) - np.mean(np.log(errors))
    variance = ((y - power * x) ** 2).sum() / (x**2).sum() / max(len(x) - 2, 1)
    falls_each_time = bool((np.diff(y[np.argsort(x)]) < 0.0).all())
    return -power if falls_each_time or -power > 2.0 * float(np.sqrt(variance)) else None


def cost_of_error(points: Sequence[Point], goal: float, cost: Callable[[Point], float]) -> tuple[float, bool] | None:
    """Return the cost at which the error is `goal`, and whether the cost is extrapolated.

    cost: returns the cost of a point. Between points, ln cost is linear in ln error. Below the smallest error, the
    cost is extrapolated from the two most accurate points. None if this is impossible, or if the result is
    MAX_EXTRAPOLATION times the cost of the most accurate point or more.
    """
    known = sorted((point.error or np.inf, cost(point)) for point in points)
    known = [(error, paid) for k, (error, paid) in enumerate(known) if all(paid < other for _, other in known[:k])]
    if len(known) < 2:
        return (known[0][1], False) if known and known[0][0] <= goal else None
    errors, paid = np.log([k[0] for k in known]), np.log([k[1] for k in known])
    if goal >= known[-1][0]:
        return known[-1][1], False  # the cheapest run is accurate enough
    if goal >= known[0][0]:
        return float(np.exp(np.interp(np.log(goal), errors, paid))), False
    more = (np.log(goal) - errors[0]) * (paid[1] - paid[0]) / (errors[1] - errors[0])
    return (float(np.exp(paid[0] + more)), True) if more < np.log(MAX_EXTRAPOLATION) else None


def print_results(study: Study, console: Console) -> None:
    """Print a table of the runs, the cheapest settings for each error in GOALS, and a table of the lines.

    A line consists of runs that differ only in the keys `study.axis`.
    """
    if study.exact_error:
        console.print(f"error: {study.exact_error}")
    elif study.reference is not None:
        label = label_of(study.reference.settings, whole=True)
        console.print(f"error: mass displaced relative to the run with {label} (no exact solution)")
    front = {id(point) for point in study.front()}
    drifts = [point.runs[0]["drifts"] for point in study.points if point.done]
    conserved = [name for name in ("momentum", "energy") if any(each[name] is not None for each in drifts)]
    runs = Table("", *short_names(study.keys), "error", "CPU s", "steps", "updates", *conserved, box=SIMPLE)
    for point in study.points:
        values = [printable(point.settings[key]) for key in study.keys]
        if not point.done:
            runs.add_row("", *values, point.runs[0]["stopped"] if point.runs else "not run")
            continue
        first = point.runs[0]
        changes = (first["drifts"][name] for name in conserved)
        runs.add_row(
            "*" if id(point) in front else "", *values,
            f"{point.error:.2g}" if point.error is not None else "reference", f"{point.cpu:.3g}", str(first["steps"]),
            f"{first['updates']:.2g}", *("" if change is None else f"{change:.0e}" for change in changes),
        )  # fmt: skip
    console.print(runs)
    console.print("* Pareto-optimal: no other setting is both cheaper and at least as accurate")
    for goal in GOALS:
        good = [point for point in study.points if point.error and point.error <= goal]
        if good:
            cheapest = min(good, key=lambda point: point.cpu)
            console.print(f"error {goal:.3g}: {label_of(cheapest.settings, whole=True)}, {cheapest.cpu:.3g} s of CPU")
        else:
            console.print(f"error {goal:.3g}: no setting reaches this error")
    if study.axis is None:
        return
    console.print(f"\nerror ~ {study.axis.keys[0]}^p; CPU seconds, and particle updates, for an error of")
    orders = Table("line", "p", "half the error", box=SIMPLE)
    for goal in GOALS:
        orders.add_column(f"{goal:.3g}", justify="right")
        orders.add_column("updates", justify="right")
    for name, points in study.lines().items():
        orders.add_row(name, *_order_cells(study.axis, points))
    console.print(orders)
    console.print("~ extrapolated from the fit")


def _order_cells(axis: Varied, points: Sequence[Point]) -> Iterator[str]:
    """Yield the table cells for a line of runs: order, factor in cost for half the error, cost of each goal.

    The factor and extrapolated costs are empty if the error does not clearly fall with the CPU time.
    """
    values = [number_in(point.settings[axis.keys[0]]) or np.nan for point in points]
    errors = [point.error or np.nan for point in points]
    order = fitted_power(values, errors)
    yield "" if order is None else f"{order:.2f}"
    fall = fall_of_error([point.cpu for point in points], errors)
    yield "" if fall is None else f"costs {2.0 ** (1.0 / fall):.2g} times"
    for goal in GOALS:
        for cost in (lambda point: point.cpu, lambda point: float(point.runs[0]["updates"])):
            paid = cost_of_error(points, goal, cost)
            known = paid is not None and (fall is not None or not paid[1])
            yield f"{'~' if paid[1] else ''}{paid[0]:.2g}" if paid and known else ""
