"""Eccentricity of the gas of a disc in time: the m = 1 part of its radial velocity, and how fast that grows.

    python analysis/eccentricity.py DIR [--inner R] [--outer R] [--from E] [--to E]

DIR is the output directory of a run with gas. Between the two radii (default: all gas), for each snapshot,

    v_1 = 2 |<v_r exp(i phi)>|,     e = v_1 / <v_K>,

means over particles of one mass; v_K is Kepler's speed about the star. On orbits of one small eccentricity that are
aligned v_r is e v_K sin of the angle from pericentre, so that v_1 is its amplitude. Prints both in time, in the scene's
units, and the time in which v_1 grows by a factor of e: the slope of a line through ln v_1, over the snapshots after
the last one with e below `--from` and before the first above `--to` (default 1e-4 and 1e-2).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from discsim import open_run
from discsim.output.snapshot import Snapshot
from discsim.physics.centre import kepler_omega
from discsim.printable import UserError
from discsim.scene import Scene
from discsim.scene.orbits import show_plain_time

LEAST = 3  # snapshots through which a line is put


class InputError(UserError):
    """A run or an option that does not suit the measurement; the message has the reason."""


class Mode(NamedTuple):
    """The m = 1 part of v_r in one snapshot, in code units, and over Kepler's speed."""

    time: float
    speed: float
    eccentricity: float


def mode_of(snap: Snapshot, scene: Scene, inner: float, outer: float) -> Mode:
    """Return the mode of the gas between two radii. Raises InputError."""
    gas = snap.gas
    if gas is None or not scene.star:
        raise InputError("the run has no gas about a star; expected a run with [gas] and [star]")
    chosen = (gas.radius > inner) & (gas.radius < outer)
    if not chosen.any():
        raise InputError(
            f"t = {snap.time:g}: no gas from {inner:g} to {outer:g} (code units); expected other --inner and --outer"
        )
    r, pos, vel = gas.radius[chosen], gas.pos[chosen], gas.vel[chosen]
    radial = (pos * vel).sum(axis=1) / r
    speed = 2.0 * abs(np.mean(radial * (pos[:, 0] + 1j * pos[:, 1]) / r))
    return Mode(snap.time, speed, speed / float(np.mean(kepler_omega(scene, r) * r)))


def growth_time(modes: list[Mode], low: float, high: float) -> float | None:
    """The time in which the mode grows by a factor of e between two eccentricities; None where too few snapshots do."""
    below = [k for k, mode in enumerate(modes) if mode.eccentricity <= low]
    begin = below[-1] + 1 if below else 0
    rising = []
    for mode in modes[begin:]:
        if mode.eccentricity > high:
            break
        rising.append(mode)
    if len(rising) < LEAST:
        return None
    slope = np.polyfit([mode.time for mode in rising], np.log([mode.speed for mode in rising]), 1)[0]
    return float(1.0 / slope)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument("--inner", type=float, default=0.0, metavar="R", help="in code units (default 0)")
    parser.add_argument("--outer", type=float, default=np.inf, metavar="R")
    parser.add_argument("--from", type=float, default=1e-4, metavar="E", dest="low", help="eccentricity (default 1e-4)")
    parser.add_argument("--to", type=float, default=1e-2, metavar="E", dest="high", help="eccentricity (default 1e-2)")
    given = parser.parse_args(arguments)
    try:
        run = open_run(given.directory)
        modes = [mode_of(snap, run.scene, given.inner, given.outer) for snap in run]
    except (UserError, OSError) as error:
        print(f"eccentricity: {error}", file=sys.stderr)
        return 2
    show = run.units.show
    table = Table("time", "v_1", "e")
    for mode in modes:
        table.add_row(
            show_plain_time(mode.time, run.units, run.scene.text),
            show(mode.speed, "velocity"),
            f"{mode.eccentricity:.2e}",
        )
    Console(width=100).print(table)
    grows = growth_time(modes, given.low, given.high)
    if grows is None:
        print(f"no {LEAST} snapshots between e = {given.low:g} and {given.high:g}: no growth time")
    else:
        print(f"{'grows' if grows > 0.0 else 'falls'} by a factor of e in {show(abs(grows), 'time')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
