"""Helpers for analysis scripts: command-line options with lists, compilation before timing, and CSV tables."""

from __future__ import annotations

import csv
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from discsim import Simulation


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
