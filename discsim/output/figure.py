"""The figure `last_state.png`, which `discsim run` draws of the last snapshot.

In 2D the figure has maps, and radial profiles if the scene has a centre. In 1D it has density and velocity against x.
Exact solutions are drawn as lines.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from discsim.output.bins import RINGS
from discsim.output.drawing import (
    BELOW,
    COLOURS,
    COLUMN,
    EDGE,
    LEFT,
    MAP,
    PIXELS,
    RIGHT,
    ROW,
    STYLES,
    TITLE,
    TOTAL_COLOUR,
    axes_at,
    axis_unit,
    common_norm,
    draw_picture,
    figure_text,
    fit_labels,
    map_picture,
    points_1d,
    population_style,
    set_log_ticks,
)
from discsim.output.fields.binned import BinnedFields
from discsim.output.fields.names import species_text
from discsim.output.fields.values import (
    Window,
    default_window,
    fields_on_pixels,
    full_radius,
    is_centred,
    smooth_profile,
    start_of,
)
from discsim.output.snapshot import Snapshot, read_snapshot
from discsim.scene import load_scene
from discsim.scene.populations import populations_of
from discsim.version import __version__

Array = np.ndarray
DPI = 130  # pixels per inch


def last_state_figure(snapshot_path: str | os.PathLike[str], out_png: str | os.PathLike[str]) -> None:
    """Draw the snapshot in the file `snapshot_path` to the PNG file `out_png`. Raises SnapshotError, OSError."""
    snap = read_snapshot(snapshot_path).about_centre()
    figure = _figure_1d(snap) if snap.dimensions == 1 else _figure_2d(snap)
    time = f"t = {snap.time_text}"
    figure.suptitle(f"{figure_text(snap.title)}\n{time}" if snap.title else time)
    FigureCanvasAgg(figure)
    low_compression = {"compress_level": 1}  # full compression takes as long as drawing
    origin = {"Software": f"discsim {__version__}", "Comment": snap.command, "Description": snap.scene_text}
    figure.savefig(Path(out_png), dpi=DPI, metadata=origin, pil_kwargs=low_compression)


def _figure_2d(snap: Snapshot) -> Figure:
    """Return the figure of a 2D snapshot: maps, and below them profiles."""
    kinds, grains = snap.species, _grain_fields(snap)
    component = getattr(start_of(snap), "figure_velocity", None)  # of the velocity to draw, if the start gives one
    rows = ROW * (2 if component else int(is_centred(snap)))  # space for profiles
    lower = BELOW + MAP + 0.4 if grains else 0.0  # space for the maps of grains
    width = COLUMN * max(len(kinds), len(grains)) + (0.6 if grains else 0.2)  # labels of less than a decade are wide
    figure = Figure(figsize=(width, rows + lower + BELOW + MAP + TITLE), dpi=DPI)
    window = default_window(snap)
    binned = fields_on_pixels(snap, window, PIXELS)
    for column, kind in enumerate(kinds):
        axes = axes_at(figure, COLUMN * column + LEFT, rows + lower + BELOW, MAP, MAP)
        _draw_map(axes, binned, f"{kind}.surface_density", window)
        axes.set_title(
            species_text(f"{kind}.surface_density", snap), y=1.0
        )  # fixed position: matplotlib's search for space takes longer than drawing
    for column, name in enumerate(grains):
        _draw_map(axes_at(figure, COLUMN * column + LEFT, rows + BELOW, MAP, MAP), binned, name, window)
    if component:
        _draw_radial(_row_axes(figure, 1), _row_axes(figure, 0), snap, component)
    elif is_centred(snap):
        profile = _row_axes(figure, 0)
        _draw_profile(profile, snap, window[1][0] / 1.1)
        FigureCanvasAgg(figure)  # measures texts
        fit_labels([profile], LEFT - EDGE)
    return figure


def _grain_fields(snap: Snapshot) -> list[str]:
    """Return the fields of grains to draw as maps.

    Returns [] unless grains have individual sizes, and some grains have mass.
    """
    dust = snap.dust
    if dust is None or dust.size is None or not (dust.mass > 0).any():
        return []
    return [f"dust.{name}" for name in ("size", "stokes") if getattr(dust, name) is not None]


def _draw_map(axes: Axes, binned: BinnedFields, name: str, window: Window) -> None:
    picture = map_picture(binned, name, window)
    draw_picture(axes, picture, common_norm([picture]))


def _row_axes(figure: Figure, number: int) -> Axes:
    """Add axes for a profile, as wide as the figure, in row `number` from below; return them."""
    wide = figure.get_size_inches()[0] - LEFT - RIGHT
    return axes_at(figure, LEFT, ROW * number + BELOW, wide, ROW - BELOW - 0.1)


def _draw_profile(axes: Axes, snap: Snapshot, outer: float) -> None:
    """Draw the surface density of each species against radius, up to the radius `outer`."""
    length, length_unit = axis_unit(snap, "length")
    density, density_unit = axis_unit(snap, "density")
    edges, binned = smooth_profile(snap, (0.0, full_radius(snap)))  # cut off at `outer`, it would fall there
    radius = (edges[1:] + edges[:-1]) / 2 * length
    peaks, has_small = [], snap.gas is not None and snap.gas.small is not None
    names = {"dust": "grown dust"} if has_small else {}
    known = populations_of(snap.tables) if snap.dust is not None else []
    apart = [f"dust.{each.number}" for each in known] if len(known) > 1 and snap.dust.species is not None else []
    for kind in (*snap.species, *apart, *(("small_dust",) if has_small else ())):
        sigma = density * binned[f"{kind}.surface_density"]
        peaks += [sigma.max()] if kind in snap.species else []
        curve = np.where(sigma > 0, sigma, np.nan)
        style: dict[str, Any] = {"color": COLOURS.get(kind), "ls": STYLES.get(kind)}
        if kind in apart:
            style = population_style(apart.index(kind)) | {"lw": 1.0}
        elif apart and kind == "dust":
            style = {"color": TOTAL_COLOUR}
        label = names.get(kind) or species_text(f"{kind}.surface_density", snap)
        axes.plot(radius, curve, label=label, **style)
    axes.set(xlabel=f"r{length_unit}", ylabel=rf"$\langle\Sigma\rangle${density_unit}", xlim=(0, outer * length))
    if min(peaks) > 0:
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-3 * min(peaks)))  # a lone particle must not determine the scale
        set_log_ticks(axes.yaxis, *axes.get_ylim())
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _draw_radial(above: Axes, below: Axes, snap: Snapshot, component: str) -> None:
    """Draw density and velocity against the distance from the middle of the box, with the exact solution.

    The density is drawn on the axes `above`, the velocity on the axes `below`. `component` is "azimuthal" or "radial".
    """
    scene: Any = load_scene(snap.tables)
    length, length_unit = axis_unit(snap, "length")
    density, density_unit = axis_unit(snap, "density")
    velocity, velocity_unit = axis_unit(snap, "velocity")
    middle, outer = (snap.lower + snap.upper) / 2, (snap.upper - snap.lower).min() / 2
    boost = np.array(getattr(scene.initial, "velocity", (0.0, 0.0)))
    for kind, particles in snap.species.items():
        # Rings are a few particle spacings wide.
        edges = np.linspace(0, outer, int(np.clip(0.3 * particles.count**0.5, 10, RINGS)) + 1)
        away, vel = particles.pos - middle, particles.vel - boost
        if boost.any():  # the middle moves with the flow
            away = (away - boost * snap.time + outer) % (2 * outer) - outer
        r = np.sqrt((away**2).sum(axis=1))
        mass, _ = np.histogram(r, edges, weights=particles.mass)
        rings = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)
        above.stairs(density * mass / rings, length * edges, color=COLOURS[kind], label=kind)
        along = (away * vel).sum(axis=1)
        if component == "azimuthal":
            along = away[:, 0] * vel[:, 1] - away[:, 1] * vel[:, 0]
        below.plot(length * r, velocity * along / r, ".", ms=1, alpha=0.4, color=COLOURS[kind])
    _draw_exact(above, below, snap, np.linspace(0, outer, 1000))
    above.set(ylabel=rf"$\langle\Sigma\rangle${density_unit}", xlim=(0, outer * length), ylim=(0, None))
    below.set(xlabel=f"r{length_unit}", ylabel=f"{component} velocity{velocity_unit}", xlim=(0, outer * length))


def _draw_exact(above: Axes, below: Axes, snap: Snapshot, x: Array) -> None:
    """Draw the exact solution of a run, if there is one, at positions or distances `x` (n,), and a grid and a legend.

    Densities are drawn on the axes `above`, velocities on the axes `below`.
    """
    length, density, velocity = (axis_unit(snap, name)[0] for name in ("length", "density", "velocity"))
    start = start_of(snap)
    found = (
        start.exact_curves(load_scene(snap.tables), snap.time, x) if start is not None and start.exact_curves else {}
    )
    for kind, (at, rho, v) in found.items():
        style: dict[str, Any] = {"color": "black", "lw": 0.8, "ls": {"gas": "-", "dust": "--"}[kind]}
        above.plot(length * at, density * rho, label=f"{kind}, exact", **style)
        below.plot(length * at, velocity * v, **style)
    for axes in (above, below):
        axes.grid(alpha=0.3)
    above.legend(frameon=False)


def _figure_1d(snap: Snapshot) -> Figure:
    """Return the figure of a 1D snapshot: density and velocity of particles against x, with the exact solution."""
    figure = Figure(figsize=(8, 7), dpi=DPI)
    height = (7.0 - BELOW - TITLE) / 2
    below = axes_at(figure, LEFT, BELOW, 8.0 - LEFT - RIGHT, height - 0.1)
    above = axes_at(figure, LEFT, BELOW + height, 8.0 - LEFT - RIGHT, height)
    above.sharex(below)
    above.tick_params(labelbottom=False)
    length, length_unit = axis_unit(snap, "length")
    ends = []
    for kind, particles in snap.species.items():
        mobile = particles.immobile is None or ~particles.immobile
        ends += list(length * np.quantile(particles.pos[:, 0][mobile], [0, 1]))
        for axes, name in ((above, "surface_density"), (below, "v_x")):
            axes.plot(*points_1d(snap, f"{kind}.{name}"), ".", ms=3, color=COLOURS[kind], label=kind)
    _draw_exact(above, below, snap, np.linspace(snap.lower[0], snap.upper[0], 1000))
    above.set(ylabel=rf"$\rho${axis_unit(snap, 'density')[1]}")
    below.set(xlabel=f"x{length_unit}", ylabel=f"velocity{axis_unit(snap, 'velocity')[1]}")
    above.set_xlim(min(ends), max(ends))  # excludes the walls of immobile particles
    return figure
