"""Values of fields on Cartesian pixels, on polar pixels, and in rings; and the part of a snapshot to show."""

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
    """Return the fields [ix, iy] of a snapshot, which is in the frame of its centre."""
    periodic = repeats(snap) and np.array_equal(window, (snap.lower, snap.upper))
    return Binned(snap, lambda kind: square_window(snap.species[kind].pos, window, pixels, periodic), optics)


def on_polar_pixels(snap: Snapshot, inner: float, outer: float, pixels: int, optics: Optics | None = None) -> Binned:
    """Return the fields [phi, r] of a snapshot between two radii."""
    return Binned(snap, lambda kind: polar_window(snap.species[kind].pos, inner, outer, pixels), optics)


def in_rings(snap: Snapshot, edges: Array, optics: Optics | None = None) -> Binned:
    """Return the fields in rings (in 1D in bins of x): densities and mass-weighted means."""
    return Binned(snap, partial(_rings, snap, np.asarray(edges, dtype=float)), optics)


def smooth_profile(snap: Snapshot, ends: tuple[float, float], optics: Optics | None = None) -> tuple[Array, Binned]:
    """Return the edges of fine rings (in 1D of bins of x) between two radii, and smoothed fields in them."""

    def bins_of(kind: str) -> Bins:
        p = snap.species[kind]
        return SmoothRings(p.radius if snap.dimensions == 2 else p.pos[:, 0], ends, snap.dimensions)

    return np.linspace(*ends, FINE + 1), Binned(snap, bins_of, optics)


def _rings(snap: Snapshot, edges: Array, kind: str) -> Bins:
    p = snap.species[kind]
    return Rings(p.pos[:, 0], edges, np.diff(edges)) if snap.dimensions == 1 else Rings(p.radius, edges)


def start_of(snap: Snapshot) -> Start | None:
    """Return the start of the run; None if the caller set the particles."""
    return STARTS.get(snap.tables.get("initial", {}).get("kind"))


def has_centre(snap: Snapshot) -> bool:
    """Return whether an effect makes the origin a centre."""
    return any(EFFECTS[name].role.centre for name in snap.tables if name in EFFECTS)


def centred(snap: Snapshot) -> bool:
    """Return whether the scene has a centre for radial profiles."""
    start = start_of(snap)
    return has_centre(snap) or (start is not None and start.edges is not None)


def repeats(snap: Snapshot) -> bool:
    """Return whether the fields of a snapshot are periodic."""
    return snap.tables["space"].get("boundary") == "periodic" and not centred(snap)


def hole(snap: Snapshot) -> float:
    """Return the inner radius of the disc: 0.5% of the particles of a species are within it."""
    return min((float(np.quantile(p.radius, 0.005)) for p in snap.species.values() if p.count), default=0.0)


def reach(snap: Snapshot) -> float:
    """Return the outer radius of the disc, which excludes 0.5% of the particles: escapers must not shrink the map."""
    return max((float(np.quantile(p.radius, 0.995)) for p in snap.species.values() if p.count), default=1.0)


def shown_window(snap: Snapshot) -> Window:
    """Return the part of the box to show: all of it, or a square about the centre that contains the disc."""
    if not centred(snap):
        return snap.lower, snap.upper
    half = np.full(2, 1.1 * reach(snap))
    return -half, half
