"""Fields of a snapshot on Cartesian pixels, on polar pixels and in rings, and the region to show by default."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discsim.output.bins import Bins, Rings, SmoothRings, polar_pixels, smooth_edges, square_pixels
from discsim.output.cells import CellRings, polar_cell_pixels, polar_grid, square_cell_pixels
from discsim.output.fields.binned import BinnedFields, Optics
from discsim.parts import EFFECTS, STARTS

if TYPE_CHECKING:
    from discsim.initial.base import Start
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
Window = tuple[Array, Array]
FAINT = 0.1  # fraction of the typical surface density below which figures need not show the outskirts of a disc
SHOWN_MASS = 0.9  # fraction of the mass of each species that figures show at least


def fields_on_pixels(snap: Snapshot, window: Window, pixels: int, optics: Optics | None = None) -> BinnedFields:
    """Return the fields [ix, iy] of `snap` on square pixels in a window, with `pixels` along its longer side.

    `snap` is relative to the disc's centre. `optics` is for the fields emission and optical_depth.
    """
    periodic = is_periodic(snap) and np.array_equal(window, (snap.lower, snap.upper))

    def bins_of(p: SnapshotParticles) -> Bins:
        if (grid := polar_grid(p.pos)) is not None:
            return square_cell_pixels(grid, window, pixels)
        return square_pixels(p.pos, window, pixels, periodic)

    return BinnedFields(snap, bins_of, optics)


def fields_on_polar_pixels(
    snap: Snapshot, inner: float, outer: float, pixels: int, optics: Optics | None = None, log: bool = False
) -> BinnedFields:
    """Return the fields [phi, r] of `snap` on polar pixels between two radii, with `log` equally spaced in log r."""

    def bins_of(p: SnapshotParticles) -> Bins:
        if (grid := polar_grid(p.pos)) is not None:
            return polar_cell_pixels(grid, inner, outer, pixels, log)
        return polar_pixels(p.pos, inner, outer, pixels, log)

    return BinnedFields(snap, bins_of, optics)


def fields_in_rings(snap: Snapshot, edges: Array, optics: Optics | None = None) -> BinnedFields:
    """Return the fields of `snap` in rings, or in 1D in bins of x, with these edges."""
    return BinnedFields(snap, partial(_bins_of, np.asarray(edges, dtype=float)), optics)


def smooth_profile(
    snap: Snapshot,
    ends: tuple[float, float],
    optics: Optics | None = None,
    log: bool = False,
    width: float | None = None,
) -> tuple[Array, BinnedFields]:
    """Return the edges of fine rings between the radii `ends`, or in 1D of bins in x, and smoothed fields in them.

    The edges are equally spaced, with `log` in the logarithm. `width` is the standard deviation of the smoothing in
    code units, by default that of `SmoothRings`; gas in polar cells is smoothed only by a given width.
    """

    def bins_of(p: SnapshotParticles) -> Bins:
        if (grid := polar_grid(p.pos)) is not None:
            return CellRings(grid, smooth_edges(ends, log, width), width)
        return SmoothRings(p.radius if snap.dimensions == 2 else p.pos[:, 0], ends, snap.dimensions, log, width)

    return smooth_edges(ends, log, width), BinnedFields(snap, bins_of, optics)


def _bins_of(edges: Array, p: SnapshotParticles) -> Bins:
    """Return the rings, or in 1D the bins of x, with the particles `p`."""
    if (grid := polar_grid(p.pos)) is not None:
        return CellRings(grid, edges)
    return Rings(p.pos[:, 0], edges, np.diff(edges)) if p.pos.shape[1] == 1 else Rings(p.radius, edges)


def start_of(snap: Snapshot) -> Start | None:
    """Return the initial condition that the scene of a run gives; None if a caller set the particles instead."""
    return STARTS.get(snap.tables.get("initial", {}).get("kind"))


def has_centre(snap: Snapshot) -> bool:
    """Return whether an effect of the scene, such as the star, makes the origin the centre of the disc."""
    return any(EFFECTS[name].role.centre for name in snap.tables if name in EFFECTS)


def is_centred(snap: Snapshot) -> bool:
    """Return whether the scene has a centre for radial profiles: that of an effect, or of its start."""
    start = start_of(snap)
    return has_centre(snap) or (start is not None and start.edges is not None)


def is_periodic(snap: Snapshot) -> bool:
    """Return whether maps of the snapshot are periodic: its box is periodic, and it has no centre."""
    return snap.tables["space"].get("boundary") == "periodic" and not is_centred(snap)


def inner_radius(snap: Snapshot) -> float:
    """Return the inner radius of the disc.

    For each species, 0.5% of its particles are within some radius; the smallest of these radii is returned.
    """
    return min((float(np.quantile(p.radius, 0.005)) for p in snap.species.values() if p.count), default=0.0)


def full_radius(snap: Snapshot) -> float:
    """Return the radius of the disc with its outskirts.

    For each species, 99.5% of its particles are within some radius; the largest of these radii is returned.
    """
    return max((_full_radius(p) for p in snap.species.values() if p.count), default=1.0)


def outer_radius(snap: Snapshot) -> float:
    """Return the outer radius of the disc that figures show; it is at most `full_radius`.

    Each species has at least SHOWN_MASS of its mass within this radius. Outside, its mean surface density is less than
    FAINT times the typical one: the value that half of its mass exceeds.
    """
    return max((_outer_radius(p) for p in snap.species.values() if p.count), default=1.0)


def polar_range(snap: Snapshot) -> tuple[float, float]:
    """Return the radii between which polar maps show the disc."""
    return 0.9 * inner_radius(snap), outer_radius(snap)


def _full_radius(p: SnapshotParticles) -> float:
    return float(np.quantile(p.radius, 0.995))


def _outer_radius(p: SnapshotParticles) -> float:
    full = _full_radius(p)
    if full <= 0.0 or not p.mass.any():
        return full
    rings = SmoothRings(p.radius, (0.0, full), dimensions=2)
    mass = rings.sum(p.mass)
    sigma, within = mass / rings.measure, np.cumsum(mass)
    typical = np.quantile(sigma, 0.5, weights=mass, method="inverted_cdf")
    shown = (sigma >= FAINT * typical) | (within - mass < SHOWN_MASS * within[-1])
    return float(rings.edges[np.flatnonzero(shown)[-1] + 1])


def default_window(snap: Snapshot) -> Window:
    """Return the corners of the region that figures show: the box, or around a centre a square with the disc in it."""
    if not is_centred(snap):
        return snap.lower, snap.upper
    half = np.full(2, 1.1 * outer_radius(snap))
    return -half, half
