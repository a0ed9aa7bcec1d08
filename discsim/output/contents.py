"""Entries of a snapshot that are not arrays of the state: the box, the kernel's support, derived quantities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.parts import Lazy
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Dust, Gas, Particles
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")


class Extent(NamedTuple):
    """Corners (dimensions,) of the box of a snapshot, and the number of particles of each kind by name."""

    lower: Array
    upper: Array
    counts: dict[str, int]


def extent_of(scene: Scene, gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> Extent:
    """Return the extent of the scene's box, enlarged so that it contains all given particles.

    Particles leave the scene's box through open boundaries.
    """
    size = np.asarray(scene.space.size, dtype=float)
    lower = -size / 2 if scene.centred else np.zeros_like(size)
    upper = lower + size
    present = present_kinds(gas, dust, bodies)
    for particles in present.values():
        if particles.count:
            lower = np.minimum(lower, particles.pos.min(axis=0))
            upper = np.maximum(upper, particles.pos.max(axis=0))
    return Extent(lower, upper, {name: particles.count for name, particles in present.items()})


def support_radius(scene: Scene) -> float:
    """Return the radius of the support of the gas kernel, in units of h; 1 without gas."""
    if scene.gas is None:
        return 1.0
    from discsim.kernels.sph.smoothing import KERNELS, SUPPORT

    return SUPPORT[KERNELS[scene.gas.kernel]]


def present_kinds(gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> dict[str, Particles | Bodies]:
    """Return the kinds of particles that are not None, by name."""
    kinds: dict[str, Any] = {"gas": gas, "dust": dust, "bodies": bodies}
    return {name: particles for name, particles in kinds.items() if particles is not None}


def box_coordinates(pos: Array, lower: Array, upper: Array) -> Array:
    """Return positions as coordinates (n, 3) relative to the corner `lower` of a box, from 0 to its sides.

    `upper` is the opposite corner. Coordinates along axes that the run does not have are half the longest side.
    """
    side = upper - lower
    shifted = np.full((len(pos), 3), side.max() / 2)
    shifted[:, : pos.shape[1]] = np.clip(pos - lower, 0, side)  # against rounding errors at the upper side
    return shifted


def derived_arrays(scene: Scene, kind: str, particles: Any) -> dict[str, Array]:
    """Return arrays that a snapshot has in addition to the state, by name; only gas has some.

    They are the temperature, in physical units, and u if there is no energy equation.
    """
    if kind != "gas" or scene.gas is None:
        return {}
    per_mass = particles.pressure / particles.density
    derived, gamma = {}, eos_of(scene).index(scene.gas.eos)
    if particles.u is None:
        # Readers compute the pressure as (gamma - 1) rho u, with the adiabatic index in the file.
        derived["u"] = 1.5 * per_mass if gamma is None else per_mass / (gamma - 1.0)
    if scene.units.system == "physical":
        from discsim.scene.astropy_units import constants

        # P/rho is c_s^2 for isothermal and c_s^2/gamma for adiabatic gas: one formula for both.
        molecule = scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e).cgs.value
        specific = scene.units.cgs("specific_energy") * per_mass
        if particles.small is not None:
            specific = specific / growth.gas_fraction(scene, particles)
        derived["temperature"] = specific * molecule / constants.k_B.cgs.value
    return derived
