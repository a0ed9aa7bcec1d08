"""Helpers for analysis scripts: options with lists, compilation before timing, CSV tables, large figures."""

from __future__ import annotations

import csv
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import isotonic_regression

from discsim import Simulation

# Colours of Okabe & Ito (2008), which colour-blind readers can distinguish.
BLUE, RED, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
FROM_AFAR = {
    "font.size": 18,
    "axes.titlesize": 18,
    "figure.titlesize": 21,
    "axes.linewidth": 1.3,
    "lines.markersize": 9,
}


def some_of(known: Collection[str], what: str, separator: str = ",") -> Callable[[str], list[str]]:
    """Return an argparse type that parses a list of names from `known`. what: a name in words, for messages."""

    def names(text: str) -> list[str]:
        given = text.split(separator)
        for name in given:
            if name not in known:
                raise ArgumentTypeError(f"unknown {what} {name!r}; expected some of {f'{separator} '.join(known)}")
        return given

    return names


def whole_numbers(least: int) -> Callable[[str], list[int]]:
    """Return an argparse type that parses a list of whole numbers from `least`, like 64,128 or 1e5,1e6."""

    def numbers(text: str) -> list[int]:
        try:
            given = [float(part) for part in text.split(",")]
        except ValueError:
            given = []
        if not given or not all(number >= least and number.is_integer() for number in given):
            raise ArgumentTypeError(f"{text!r}; expected whole numbers from {least}, separated by commas")
        return [int(number) for number in given]

    return numbers


def warm_up(sim: Simulation) -> None:
    """Make two steps of `sim`, which compile the kernels of a similar run."""
    for _ in range(2):
        sim.step()


def write_csv(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], file: Path) -> None:
    """Write rows to a CSV file; entries of a row outside `columns` are ignored."""
    with file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def name_ends(axes: Axes, ends: Sequence[tuple[str, float, float, str]], gap: float = 0.062) -> None:
    """Write names of lines to the right of `axes`, each next to the end (x, y) of its line, at least `gap` apart.

    `ends` are (name, x, y, colour); the axes have their scales and data already. `gap` is a fraction of their height.
    A thin line leads from the end of a line to its name.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    found = [(*to_axes.transform((x, y)), name, colour) for name, x, y, colour in ends]
    found.sort(key=lambda end: end[1])
    heights = np.array([end[1] for end in found])
    offsets = gap * np.arange(len(found))
    targets = isotonic_regression(heights - offsets).x  # least squares, with neighbours at least `gap` apart
    places = np.clip(targets, 0.0, 1.0 - offsets[-1]) + offsets
    for (x, y, name, colour), place in zip(found, places, strict=True):
        axes.plot([x, 1.0, 1.02], [y, place, place], color=colour, lw=0.8, transform=axes.transAxes, clip_on=False)
        axes.text(1.03, place, name, color=colour, va="center", fontsize="small", transform=axes.transAxes)
