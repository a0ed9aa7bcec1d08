"""Values of fields: of particles, on pixels of a window or of a ring, and in rings."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discsim.output.bins import FINE, Bins, Rings, SmoothRings, polar_window, square_window
from discsim.output.fields.binned import Binned, Optics
from discsim.parts import EFFECTS, STARTS

if TYPE_CHECKING:
    from discsim.initial.base import Start
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
Window = tuple[Array, Array]


def on_pixels(snap: Snapshot, window: Window, pixels: int, optics: Optics | None = None) -> Binned:
    """Fields [ix, iy] of a snapshot about its centre."""
    periodic = repeats(snap) and np.array_equal(window, (snap.lower, snap.upper))
    return Binned(snap, lambda kind: square_window(snap.species[kind].pos, window, pixels, periodic), optics)


def on_polar_pixels(snap: Snapshot, inner: float, outer: float, pixels: int, optics: Optics | None = None) -> Binned:
    """Fields [phi, r]."""
    return Binned(snap, lambda kind: polar_window(snap.species[kind].pos, inner, outer, pixels), optics)


def in_rings(snap: Snapshot, edges: Array, optics: Optics | None = None) -> Binned:
    """Fields in rings, or in 1D between places: densities, and means over mass."""
    return Binned(snap, partial(_rings, snap, np.asarray(edges, dtype=float)), optics)


def smooth_profile(snap: Snapshot, ends: tuple[float, float], optics: Optics | None = None) -> tuple[Array, Binned]:
    """Edges of fine rings (in 1D of bins of x) between two radii, and fields in them, smoothed over neighbours."""

    def bins_of(kind: str) -> Bins:
        p = snap.species[kind]
        return SmoothRings(p.radius if snap.dimensions == 2 else p.pos[:, 0], ends, snap.dimensions)

    return np.linspace(*ends, FINE + 1), Binned(snap, bins_of, optics)


def _rings(snap: Snapshot, edges: Array, kind: str) -> Bins:
    p = snap.species[kind]
    return Rings(p.pos[:, 0], edges, np.diff(edges)) if snap.dimensions == 1 else Rings(p.radius, edges)


def start_of(snap: Snapshot) -> Start | None:
    """What the run started with; None where that was the caller's own particles."""
    return STARTS.get(snap.tables.get("initial", {}).get("kind"))


def has_centre(snap: Snapshot) -> bool:
    """Whether an effect makes the origin a centre."""
    return any(EFFECTS[name].marks_centre for name in snap.tables if name in EFFECTS)


def centred(snap: Snapshot) -> bool:
    """Whether the scene has a centre about which a radial profile says something."""
    start = start_of(snap)
    return has_centre(snap) or (start is not None and start.edges is not None)


def repeats(snap: Snapshot) -> bool:
    return snap.tables["space"].get("boundary") == "periodic" and not centred(snap)


def hole(snap: Snapshot) -> float:
    """The radius within which there is hardly anything: a two-hundredth of either species."""
    return min((float(np.quantile(p.radius, 0.005)) for p in snap.species.values() if p.count), default=0.0)


def reach(snap: Snapshot) -> float:
    """The radius that holds all but the last half per cent: a few that escape must not shrink the disc."""
    return max((float(np.quantile(p.radius, 0.995)) for p in snap.species.values() if p.count), default=1.0)


def shown_window(snap: Snapshot) -> Window:
    """The part of the box to show: all of it, or the square about the centre that holds the disc."""
    if not centred(snap):
        return snap.lower, snap.upper
    half = np.full(2, 1.1 * reach(snap))
    return -half, half
