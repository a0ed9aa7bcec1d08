"""Entries of a snapshot file that are no arrays of the state: its box, the kernel's reach, temperatures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.parts import Lazy
from discsim.physics.eos import eos_of

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Dust, Gas, Particles
    from discsim.scene import Scene
    from discsim.scene.units import Units

Array = np.ndarray
growth = Lazy("discsim.physics.growth")


class Extent(NamedTuple):
    """Corners (dimensions,) of the box that holds all particles of a run, and how many there are of each kind."""

    lower: Array
    upper: Array
    counts: dict[str, int]


def extent_of(scene: Scene, gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> Extent:
    """The scene's box, widened to hold what has left it through an open boundary."""
    size = np.asarray(scene.space.size, dtype=float)
    lower = -size / 2 if scene.centred else np.zeros_like(size)
    upper = lower + size
    present = present_kinds(gas, dust, bodies)
    for particles in present.values():
        if particles.count:
            lower = np.minimum(lower, particles.pos.min(axis=0))
            upper = np.maximum(upper, particles.pos.max(axis=0))
    return Extent(lower, upper, {name: particles.count for name, particles in present.items()})


def unit_texts(units: Units) -> tuple[str, str, str]:
    return units.system, units.length_text, units.mass_text


def support_radius(scene: Scene) -> float:
    """Radius of the kernel's support in units of h."""
    if scene.gas is None:
        return 1.0
    from discsim.kernels.sph.smoothing import KERNELS, SUPPORT

    return SUPPORT[KERNELS[scene.gas.kernel]]


def present_kinds(gas: Gas | None, dust: Dust | None, bodies: Bodies | None) -> dict[str, Particles | Bodies]:
    kinds: dict[str, Any] = {"gas": gas, "dust": dust, "bodies": bodies}
    return {name: particles for name, particles in kinds.items() if particles is not None}


def into_box(pos: Array, lower: Array, upper: Array) -> Array:
    """Three columns in [0, BoxSize]; dimensions that the run does not have are in the middle."""
    side = upper - lower
    shifted = np.full((len(pos), 3), side.max() / 2)
    shifted[:, : pos.shape[1]] = np.clip(pos - lower, 0, side)  # else rounding may put one just outside
    return shifted


def derived_arrays(scene: Scene, kind: str, particles: Any) -> dict[str, Array]:
    """Entries of the layout that are no part of the state."""
    if kind != "gas" or scene.gas is None:
        return {}
    per_mass = particles.pressure / particles.density
    derived, gamma = {}, eos_of(scene).index(scene.gas.eos)
    if particles.u is None:
        # What readers make the pressure of, (gamma - 1) rho u, with the index that the file tells them.
        derived["u"] = 1.5 * per_mass if gamma is None else per_mass / (gamma - 1.0)
    if scene.units.system == "physical":
        from discsim.scene.astropy_units import constants

        # P/rho is c_s^2 of isothermal gas and c_s^2/gamma of adiabatic: one formula for both.
        molecule = scene.gas.eos.mean_molecular_weight * (constants.m_p + constants.m_e).cgs.value
        specific = scene.units.cgs("specific_energy") * per_mass
        if particles.small is not None:
            specific = specific / growth.gas_share(scene, particles)
        derived["temperature"] = specific * molecule / constants.k_B.cgs.value
    return derived
