"""The figure of a snapshot: in 2D maps, with radial profiles where there is a centre; in 1D density and velocity.

Over the exact solution where there is one.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from discsim import __version__
from discsim.initial.base import Curve, Start
from discsim.output import grain_maps
from discsim.output.snapshot import Snapshot, SnapshotParticles, range_of_mass, read_snapshot
from discsim.parts import EFFECTS, STARTS
from discsim.scene import load_scene

Array = np.ndarray

COLOURS = {"gas": "tab:blue", "dust": "tab:orange", "small": "tab:green"}
MAPS = {"gas": "viridis", "dust": "inferno"}
_PIXELS = 480
_RINGS = 80

# In inches. Axes are put where they go: to let matplotlib find room for their labels takes longer than to draw them.
_LEFT, _RIGHT, _BELOW, _TITLE = 0.85, 0.25, 0.55, 0.9  # room beside and under axes; that of titles
_COLUMN, _MAP, _ROW = 5.8, 3.9, 2.9  # pitch of maps, their side, pitch of profiles
_BAR = (0.08, 0.2)  # distance and width of a colour bar


def last_state_figure(snapshot_path: str | os.PathLike[str], out_png: str | os.PathLike[str]) -> None:
    """Draw the snapshot at `snapshot_path` into the PNG `out_png`. Raises SnapshotError, OSError."""
    snap = read_snapshot(snapshot_path).about_centre()
    figure = _lines(snap) if snap.dimensions == 1 else _maps(snap)
    figure.suptitle(_title(snap))
    FigureCanvasAgg(figure)
    # Compressed least: the most takes as long as to draw it.
    little = {"compress_level": 1}
    made = {"Software": f"discsim {__version__}", "Comment": snap.command, "Description": snap.scene_text}
    figure.savefig(Path(out_png), dpi=130, metadata=made, pil_kwargs=little)


def _title(snap: Snapshot) -> str:
    time = f"t = {snap.units.show_time(snap.time)}"
    name = snap.tables.get("title", "")
    return f"{name}\n{time}" if name else time


def _in(snap: Snapshot, dimension: str) -> tuple[float, str]:
    """The factor from code units to those of the axes, and their name in brackets."""
    if snap.units.system == "code":
        return 1.0, ""
    plain = "volume_density" if dimension == "density" and snap.dimensions == 1 else dimension
    name = {"length": "au", "velocity": "km/s", "volume_density": "g/cm3"}.get(plain, "g/cm2")
    written = {"g/cm2": "g cm$^{-2}$", "g/cm3": "g cm$^{-3}$"}.get(name, name)
    return float(snap.units.quantity(1.0, dimension).to_value(name)), f" [{written}]"


def _start(snap: Snapshot) -> Start | None:
    """What the run started with; None where that was the caller's own particles."""
    return STARTS.get(snap.tables.get("initial", {}).get("kind"))


def _centred(snap: Snapshot) -> bool:
    """Whether the scene has a centre about which a radial profile says something."""
    start = _start(snap)
    return _has_centre(snap) or (start is not None and start.edges is not None)


def _has_centre(snap: Snapshot) -> bool:
    """Whether an effect makes the origin a centre."""
    return any(EFFECTS[name].marks_centre for name in snap.tables if name in EFFECTS)


def _around(snap: Snapshot) -> str | None:
    """The velocity to show against the distance from the middle of the box, where that is the centre of a start."""
    start = _start(snap)
    return start.around if start is not None else None


def _exact(snap: Snapshot, x: Array) -> dict[str, Curve]:
    """Places, densities and velocities by species, for the scenes with a known answer; empty for others."""
    start = _start(snap)
    return start.curves(load_scene(snap.tables), snap.time, x) if start is not None and start.curves else {}


def _window(snap: Snapshot) -> tuple[Array, Array]:
    """The part of the box to show: all of it, or the square about the centre that holds the disc."""
    if not _centred(snap):
        return snap.lower, snap.upper
    # All but the last half per cent: a few particles that escape must not shrink the disc.
    reach = max((np.quantile(p.radius, 0.995) for p in snap.species.values() if p.count), default=1.0)
    half = np.full(2, 1.1 * reach)
    return -half, half


def _maps(snap: Snapshot) -> Figure:
    kinds, grains = snap.species, grain_maps.shown(snap)
    around = _around(snap)
    below = 2 if around else int(_centred(snap))
    # Bars of less than a decade have wide labels.
    width, rows = _COLUMN * max(len(kinds), len(grains)) + (0.6 if grains else 0.2), _ROW * below
    lower = _BELOW + _MAP + 0.4 if grains else 0.0  # room of the maps of grains
    figure = Figure(figsize=(width, rows + lower + _BELOW + _MAP + _TITLE))
    window = _window(snap)
    for column, (kind, particles) in enumerate(kinds.items()):
        axes = _axes(figure, _COLUMN * column + _LEFT, rows + lower + _BELOW, _MAP, _MAP)
        _map(figure, axes, snap, kind, particles, window)
    for column, name in enumerate(grains):
        axes = _axes(figure, _COLUMN * column + _LEFT, rows + _BELOW, _MAP, _MAP)
        mean, label = grain_maps.mean_map(snap, name, window, _PIXELS, _repeats(snap))
        _bar(
            figure, axes, _image(axes, snap, mean.T, window, grain_maps.colours(mean), grain_maps.COLOURS[name]), label
        )
    if around:
        _radial(_row(figure, 1), _row(figure, 0), snap, around == "azimuthal")
    elif _centred(snap):
        _profile(_row(figure, 0), snap, window[1][0] / 1.1)
    return figure


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes with their lower left corner at a place of the figure; all in inches."""
    across, up = figure.get_size_inches()
    axes = figure.add_axes((left / across, bottom / up, width / across, height / up))
    axes.ticklabel_format(useOffset=False, scilimits=(-3, 4))  # never wider than there is room
    return axes


def _row(figure: Figure, number: int) -> Axes:
    """Axes of a profile as wide as the figure, rows counted from below."""
    wide = figure.get_size_inches()[0] - _LEFT - _RIGHT
    return _axes(figure, _LEFT, _ROW * number + _BELOW, wide, _ROW - _BELOW - 0.1)


def _map(
    figure: Figure,
    axes: Axes,
    snap: Snapshot,
    kind: str,
    particles: SnapshotParticles,
    window: tuple[Array, Array],
) -> None:
    density, density_unit = _in(snap, "density")
    sigma = density * particles.surface_density_map(*window, _PIXELS, _repeats(snap)).T
    image = _image(axes, snap, np.maximum(sigma, 1e-300), window, LogNorm(*range_of_mass(sigma), clip=True), MAPS[kind])
    if _has_centre(snap):
        length = _in(snap, "length")[0]
        bodies = np.zeros((1, 2)) if snap.bodies is None else snap.bodies.pos
        inside = np.all((bodies >= window[0]) & (bodies <= window[1]), axis=1)
        for number in np.flatnonzero(inside):
            mark, size = ("*", 11) if number == 0 else ("o", 6)
            x, y = length * bodies[number]
            axes.plot(x, y, marker=mark, color="white", markeredgecolor="black", markersize=size)
    axes.set_title(kind, y=1.0)  # there: to look for room above takes longer than to draw the labels
    _bar(figure, axes, image, rf"$\Sigma_\mathrm{{{kind}}}${density_unit}")


def _repeats(snap: Snapshot) -> bool:
    return snap.tables["space"].get("boundary") == "periodic" and not _centred(snap)


def _image(
    axes: Axes, snap: Snapshot, values: Array, window: tuple[Array, Array], norm: LogNorm, colours: str
) -> AxesImage:
    """Pixels (y, x) over the window, with the axes' names."""
    length, length_unit = _in(snap, "length")
    (left, bottom), (right, top) = (length * corner for corner in window)
    image = axes.imshow(
        values,
        origin="lower",
        extent=(left, right, bottom, top),
        norm=norm,
        cmap=colours,
        interpolation="bilinear",
    )
    axes.set(xlabel=f"x{length_unit}", ylabel=f"y{length_unit}")
    return image


def _bar(figure: Figure, axes: Axes, image: AxesImage, label: str) -> None:
    beside = axes.inset_axes((1.0 + _BAR[0] / _MAP, 0.0, _BAR[1] / _MAP, 1.0))
    figure.colorbar(image, cax=beside, label=label)


def _profile(axes: Axes, snap: Snapshot, outer: float) -> None:
    length, length_unit = _in(snap, "length")
    density, density_unit = _in(snap, "density")
    edges = np.linspace(0, outer, _RINGS + 1)
    radius = (edges[1:] + edges[:-1]) / 2 * length
    peaks, small = [], grain_maps.small_dust(snap)
    names = {"dust": "grown dust" if small is not None else "dust", "small": "small dust"}
    for kind, particles in (snap.species | ({"small": small} if small is not None else {})).items():
        sigma = density * particles.radial_profile(edges)
        peaks += [sigma.max()] if kind in snap.species else []
        axes.plot(radius, np.where(sigma > 0, sigma, np.nan), color=COLOURS[kind], label=names.get(kind, kind))
    axes.set(xlabel=f"r{length_unit}", ylabel=rf"$\langle\Sigma\rangle${density_unit}", xlim=(0, outer * length))
    if min(peaks) > 0:
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-3 * min(peaks)))  # a lone particle must not set the scale
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _radial(above: Axes, below: Axes, snap: Snapshot, turns: bool) -> None:
    """Density and velocity, azimuthal where it `turns`, else radial, of the particles against the distance from the
    middle; over the exact solution where there is one."""
    scene: Any = load_scene(snap.tables)
    length, length_unit = _in(snap, "length")
    density, density_unit = _in(snap, "density")
    velocity, velocity_unit = _in(snap, "velocity")
    middle, outer = (snap.lower + snap.upper) / 2, (snap.upper - snap.lower).min() / 2
    boost = np.array(getattr(scene.initial, "velocity", (0.0, 0.0)))
    for kind, particles in snap.species.items():
        # Rings some spacings wide.
        edges = np.linspace(0, outer, int(np.clip(0.3 * particles.count**0.5, 10, _RINGS)) + 1)
        away, vel = particles.pos - middle, particles.vel - boost
        if boost.any():  # the middle moves with it
            away = (away - boost * snap.time + outer) % (2 * outer) - outer
        r = np.sqrt((away**2).sum(axis=1))
        mass, _ = np.histogram(r, edges, weights=particles.mass)
        rings = np.pi * (edges[1:] ** 2 - edges[:-1] ** 2)
        above.stairs(density * mass / rings, length * edges, color=COLOURS[kind], label=kind)
        across = away[:, 0] * vel[:, 1] - away[:, 1] * vel[:, 0] if turns else (away * vel).sum(axis=1)
        below.plot(length * r, velocity * across / r, ".", ms=1, alpha=0.4, color=COLOURS[kind])
    x = np.linspace(0, outer, 1000)
    _plot_exact(above, below, snap, x)
    above.set(ylabel=rf"$\langle\Sigma\rangle${density_unit}", xlim=(0, outer * length), ylim=(0, None))
    name = "azimuthal" if turns else "radial"
    below.set(xlabel=f"r{length_unit}", ylabel=f"{name} velocity{velocity_unit}", xlim=(0, outer * length))
    for axes in (above, below):
        axes.grid(alpha=0.3)
    above.legend(frameon=False)


def _plot_exact(above: Axes, below: Axes, snap: Snapshot, x: Array) -> None:
    """Exact densities and velocities at places or distances x (n,)."""
    length, density, velocity = (_in(snap, name)[0] for name in ("length", "density", "velocity"))
    for kind, (at, rho, v) in _exact(snap, x).items():
        style: dict[str, Any] = {"color": "black", "lw": 0.8, "ls": {"gas": "-", "dust": "--"}[kind]}
        above.plot(length * at, density * rho, label=f"{kind}, exact", **style)
        below.plot(length * at, velocity * v, **style)


def _lines(snap: Snapshot) -> Figure:
    """Density and velocity of the particles against x, over the exact solution where there is one."""
    figure = Figure(figsize=(8, 7))
    height = (7.0 - _BELOW - _TITLE) / 2
    below = _axes(figure, _LEFT, _BELOW, 8.0 - _LEFT - _RIGHT, height - 0.1)
    above = _axes(figure, _LEFT, _BELOW + height, 8.0 - _LEFT - _RIGHT, height)
    above.sharex(below)
    above.tick_params(labelbottom=False)
    length, length_unit = _in(snap, "length")
    velocity, velocity_unit = _in(snap, "velocity")
    density, density_unit = _in(snap, "density")
    ends = []
    for kind, particles in snap.species.items():
        mobile = particles.immobile is None or ~particles.immobile
        ends += list(length * np.quantile(particles.pos[:, 0][mobile], [0, 1]))
        x, rho = _density_1d(particles)
        above.plot(length * x, density * rho, ".", ms=3, color=COLOURS[kind], label=kind)
        points = length * particles.pos[:, 0]
        below.plot(points, velocity * particles.vel[:, 0], ".", ms=3, color=COLOURS[kind], label=kind)
    _plot_exact(above, below, snap, np.linspace(snap.lower[0], snap.upper[0], 1000))
    above.set(ylabel=rf"$\rho${density_unit}")
    below.set(xlabel=f"x{length_unit}", ylabel=f"velocity{velocity_unit}")
    above.set_xlim(min(ends), max(ends))  # walls of immobile particles are beyond
    for axes in (above, below):
        axes.grid(alpha=0.3)
    above.legend(frameon=False)
    return figure


def _density_1d(particles: SnapshotParticles) -> tuple[Array, Array]:
    """Places and densities: the stored ones, or the mass between fourth neighbours over their distance."""
    x = particles.pos[:, 0]
    if particles.density is not None:
        return x, particles.density
    order = np.argsort(x)
    x, mass = x[order], np.cumsum(particles.mass[order])
    return x[4:-4], (mass[7:-1] - np.append(0.0, mass[:-9])) / (x[8:] - x[:-8])
