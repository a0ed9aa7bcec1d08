"""Fields of the gas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.output.fields import base
from discsim.output.fields.frame import omega

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


@base.density("gas", r"$\Sigma_SPECIES$", reads=("gas.small", "gas.density"))
def surface_density(snap: Snapshot) -> Array:
    """surface density: Sigma = sum m / area, without small dust"""
    return snap.gas.mass * _gas_fraction(snap)


@base.of_particles("gas", "density", r"$\Sigma_\mathrm{SPH}$", needs=("gas.density",))
def density(snap: Snapshot) -> Array:
    """SPH density: Sigma_a = sum_b m_b W(r_ab, h_a), with small dust; in 1D rho"""
    return snap.gas.density


@base.of_particles("gas", "temperature", "temperature $T$", needs=("gas.temperature",), colours="magma")
def temperature(snap: Snapshot) -> Array:
    """temperature: T = (P / Sigma) mu m_H / k_B"""
    return snap.gas.temperature


@base.of_particles("gas", "pressure", "pressure $P$", needs=("gas.pressure",))
def pressure(snap: Snapshot) -> Array:
    """pressure, integrated over height: P"""
    return snap.gas.pressure


@base.of_particles("gas", "velocity", "sound speed $c_s$", needs=("gas.sound_speed",), colours="magma")
def sound_speed(snap: Snapshot) -> Array:
    """sound speed: c_s, adiabatic if gas has an energy equation"""
    return snap.gas.sound_speed


@base.of_particles(
    "gas",
    "",
    "aspect ratio $H/r$",
    needs=("gas.pressure", "gas.density", "plane", "star"),
    reads=("gas.small",),
    scale="linear",
    colours="cividis",
)
def aspect_ratio(snap: Snapshot) -> Array:
    """aspect ratio: H / r = sqrt(P / Sigma) / (Omega_K r), without small dust"""
    r = snap.gas.radius
    return np.sqrt(snap.gas.pressure / (snap.gas.density * _gas_fraction(snap))) / (omega(snap, r) * r)


@base.of_particles(
    "gas", "", "Toomre $Q$", needs=("gas.sound_speed", "gas.density", "plane", "star"), colours="cividis_r"
)
def toomre_q(snap: Snapshot) -> Array:
    """Toomre's Q: Q = c_s Omega_K / (pi G Sigma)"""
    return snap.gas.sound_speed * omega(snap, snap.gas.radius) / (np.pi * snap.gas.density)


@base.of_particles("gas", "length", "smoothing length $h$", needs=("gas.h",), colours="cividis")
def h(snap: Snapshot) -> Array:
    """smoothing length: h"""
    return snap.gas.h


def _gas_fraction(snap: Snapshot) -> Array | float:
    """Return the fraction (n,) of gas in each particle's mass; 1.0 if this mass does not include small dust."""
    small = snap.gas.small
    one_way = snap.tables.get("drag", {}).get("direction") == "one-way"
    return 1.0 if small is None or one_way else 1.0 - small / snap.gas.mass
