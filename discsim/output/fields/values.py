"""Fields of a snapshot on Cartesian pixels, on polar pixels and in rings, and the region to show by default."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discsim.output.bins import FINE_BINS, Bins, Rings, SmoothRings, polar_window, square_window
from discsim.output.fields.binned import Binned, Optics
from discsim.parts import EFFECTS, STARTS

if TYPE_CHECKING:
    from discsim.initial.base import Start
    from discsim.output.snapshot import Snapshot

Array = np.ndarray
Window = tuple[Array, Array]


def on_pixels(snap: Snapshot, window: Window, pixels: int, optics: Optics | None = None) -> Binned:
    """Return the fields [ix, iy] on square pixels of a window; `snap` is relative to the disc's centre."""
    periodic = is_periodic(snap) and np.array_equal(window, (snap.lower, snap.upper))
    return Binned(snap, lambda kind: square_window(snap.species[kind].pos, window, pixels, periodic), optics)


def on_polar_pixels(snap: Snapshot, inner: float, outer: float, pixels: int, optics: Optics | None = None) -> Binned:
    """Return the fields [phi, r] on polar pixels between two radii."""
    return Binned(snap, lambda kind: polar_window(snap.species[kind].pos, inner, outer, pixels), optics)


def in_rings(snap: Snapshot, edges: Array, optics: Optics | None = None) -> Binned:
    """Return the fields in rings with these edges (in 1D in bins of x)."""
    return Binned(snap, partial(_bins_of, snap, np.asarray(edges, dtype=float)), optics)


def smooth_profile(snap: Snapshot, ends: tuple[float, float], optics: Optics | None = None) -> tuple[Array, Binned]:
    """Return smoothed fields in fine rings between two radii (in 1D in bins of x); edges of the rings come first."""

    def bins_of(kind: str) -> Bins:
        p = snap.species[kind]
        return SmoothRings(p.radius if snap.dimensions == 2 else p.pos[:, 0], ends, snap.dimensions)

    return np.linspace(*ends, FINE_BINS + 1), Binned(snap, bins_of, optics)


def _bins_of(snap: Snapshot, edges: Array, kind: str) -> Bins:
    p = snap.species[kind]
    return Rings(p.pos[:, 0], edges, np.diff(edges)) if snap.dimensions == 1 else Rings(p.radius, edges)


def start_of(snap: Snapshot) -> Start | None:
    """Return the initial condition of the run; None if a caller set the particles instead."""
    return STARTS.get(snap.tables.get("initial", {}).get("kind"))


def has_centre(snap: Snapshot) -> bool:
    """Return whether an effect of the scene, such as the star, makes the origin a centre."""
    return any(EFFECTS[name].role.centre for name in snap.tables if name in EFFECTS)


def centred(snap: Snapshot) -> bool:
    """Return whether the scene has a centre for radial profiles, from an effect or its start."""
    start = start_of(snap)
    return has_centre(snap) or (start is not None and start.edges is not None)


def is_periodic(snap: Snapshot) -> bool:
    """Return whether maps of the snapshot are periodic: the box is, and there is no centre."""
    return snap.tables["space"].get("boundary") == "periodic" and not centred(snap)


def inner_radius(snap: Snapshot) -> float:
    """Return the inner radius of the disc: the radius that contains 0.5% of a species, for the innermost one."""
    return min((float(np.quantile(p.radius, 0.005)) for p in snap.species.values() if p.count), default=0.0)


def outer_radius(snap: Snapshot) -> float:
    """Return the outer radius of the disc: the radius that contains 99.5% of a species, for the outermost one."""
    return max((float(np.quantile(p.radius, 0.995)) for p in snap.species.values() if p.count), default=1.0)


def default_window(snap: Snapshot) -> Window:
    """Return the corners of the region to show: the box, or if there is a centre a square that contains the disc."""
    if not centred(snap):
        return snap.lower, snap.upper
    half = np.full(2, 1.1 * outer_radius(snap))
    return -half, half
