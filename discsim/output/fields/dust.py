"""Fields of the dust."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.output.fields import base

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot

Array = np.ndarray


@base.density("dust", r"$\Sigma_SPECIES$", reads=("dust.density",), colours="inferno")
def surface_density(snap: Snapshot) -> Array:
    """surface density: Sigma_d = sum m / area, of dust particles"""
    return snap.dust.mass


@base.of_particles("dust", "", "Stokes number", needs=("dust.stokes",), colours="plasma")
def stokes(snap: Snapshot) -> Array:
    """Stokes number: St = t_stop Omega_K"""
    return snap.dust.stokes


@base.of_particles("dust", "time", r"stopping time $t_\mathrm{stop}$", needs=("dust.stopping_time",), colours="plasma")
def stopping_time(snap: Snapshot) -> Array:
    """stopping time: t_stop"""
    return snap.dust.stopping_time


@base.of_particles("dust", "length", "grain size $s$", needs=("dust.size",), unit="cm", colours="cividis")
def size(snap: Snapshot) -> Array:
    """grain size: radius s"""
    return snap.dust.size


@base.density("gas", r"$\Sigma_\mathrm{small}$", needs=("gas.small",), colours="inferno")
def small_surface_density(snap: Snapshot) -> Array:
    """surface density of small dust in gas particles: Sigma_s = sum m_small / area"""
    return snap.gas.small
