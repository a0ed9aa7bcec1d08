"""Positions, velocities and orbits of gas and dust."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.output.fields import base
from discsim.output.fields.frame import central_mass, omega

if TYPE_CHECKING:
    from discsim.output.snapshot import Snapshot, SnapshotParticles

Array = np.ndarray
ValuesOf = Callable[["Snapshot", "SnapshotParticles"], Array]


def _for_gas_and_dust(
    dimension: str, label: str, *needs: str, **more: Any
) -> Callable[[ValuesOf], tuple[base.Field, base.Field]]:
    """Return a decorator that makes a field of gas and a field of dust from a function (snapshot, particles).

    `needs` and `more` are attributes of `Field`; "vel" and "across" in `needs` stand for the columns of the species.
    """

    def field_of(species: str, values: ValuesOf) -> base.Field:
        def values_of_species(snap: Snapshot) -> Array:
            return values(snap, snap.species[species])

        values_of_species.__doc__ = values.__doc__
        own = tuple(f"{species}.{need}" if need in ("vel", "across") else need for need in needs)
        return base.of_particles(species, dimension, label, needs=own, **more)(values_of_species)

    return lambda values: (field_of("gas", values), field_of("dust", values))


@_for_gas_and_dust("length", "$r$", "plane", scale="linear", colours="cividis")
def _radius(snap: Snapshot, p: SnapshotParticles) -> Array:
    """distance from the centre: r"""
    return p.radius


@_for_gas_and_dust("length", "$x$", scale="linear", colours="cividis")
def _x(snap: Snapshot, p: SnapshotParticles) -> Array:
    """position: x, from the centre if there is one"""
    return p.pos[:, 0]


@_for_gas_and_dust("length", "$y$", "plane", scale="linear", colours="cividis")
def _y(snap: Snapshot, p: SnapshotParticles) -> Array:
    """position: y, from the centre if there is one"""
    return p.pos[:, 1]


@_for_gas_and_dust("velocity", "$v_{x,SPECIES}$", "vel", scale="signed", colours="RdBu_r")
def _v_x(snap: Snapshot, p: SnapshotParticles) -> Array:
    """velocity along x: v_x"""
    return p.vel[:, 0]


@_for_gas_and_dust("velocity", "$v_{y,SPECIES}$", "vel", "plane", scale="signed", colours="RdBu_r")
def _v_y(snap: Snapshot, p: SnapshotParticles) -> Array:
    """velocity along y: v_y"""
    return p.vel[:, 1]


@_for_gas_and_dust("velocity", r"$v_{\perp,SPECIES}$", "across", "plane", scale="linear", colours="viridis")
def _v_across(snap: Snapshot, p: SnapshotParticles) -> Array:
    """azimuthal velocity in a shearing box, relative to the shear flow: v_across"""
    assert p.across is not None  # by the needs of the field
    return p.across


@_for_gas_and_dust("velocity", "$v_{r,SPECIES}$", "vel", "plane", unit="m/s", scale="signed", colours="RdBu_r")
def _v_r(snap: Snapshot, p: SnapshotParticles) -> Array:
    """radial velocity: v_r = (x v_x + y v_y) / r"""
    return np.einsum("ij,ij->i", p.pos, p.vel) / _nonzero_radius(p)


@_for_gas_and_dust("velocity", r"$v_{\varphi,SPECIES}$", "vel", "plane", scale="linear", colours="viridis")
def _v_phi(snap: Snapshot, p: SnapshotParticles) -> Array:
    """azimuthal velocity: v_phi = (x v_y - y v_x) / r"""
    return _specific_angular_momentum(p) / _nonzero_radius(p)


@_for_gas_and_dust(
    "velocity", r"$v_{\varphi,SPECIES} - v_\mathrm{K}$", "vel", "plane", "star", unit="m/s", scale="signed",
    colours="PuOr_r",
)  # fmt: skip
def _v_phi_excess(snap: Snapshot, p: SnapshotParticles) -> Array:
    """azimuthal velocity minus the Keplerian velocity: v_phi - Omega_K r"""
    return _specific_angular_momentum(p) / _nonzero_radius(p) - omega(snap, p.radius) * p.radius


@_for_gas_and_dust("", "eccentricity $e_SPECIES$", "vel", "plane", "star", scale="linear", colours="cividis")
def _eccentricity(snap: Snapshot, p: SnapshotParticles) -> Array:
    """eccentricity of the orbit about the central mass: e^2 = 1 + 2 E L^2 / (G M)^2"""
    mass = central_mass(snap)
    energy = 0.5 * np.einsum("ij,ij->i", p.vel, p.vel) - mass / _nonzero_radius(p)
    ratio = _specific_angular_momentum(p) / mass
    return np.sqrt(np.maximum(1.0 + 2.0 * energy * ratio**2, 0.0))


def _specific_angular_momentum(p: SnapshotParticles) -> Array:
    """Return the angular momentum per mass (n,) about the origin."""
    return p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]


def _nonzero_radius(p: SnapshotParticles) -> Array:
    """Return the distance from the origin (n,), never 0, for divisions."""
    return np.maximum(p.radius, 1e-300)


gas_radius, dust_radius = _radius
gas_x, dust_x = _x
gas_y, dust_y = _y
gas_v_x, dust_v_x = _v_x
gas_v_y, dust_v_y = _v_y
gas_v_across, dust_v_across = _v_across
gas_v_r, dust_v_r = _v_r
gas_v_phi, dust_v_phi = _v_phi
gas_v_phi_excess, dust_v_phi_excess = _v_phi_excess
gas_eccentricity, dust_eccentricity = _eccentricity
