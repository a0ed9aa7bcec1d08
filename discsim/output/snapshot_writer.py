"""Writing of snapshots in the layout of `output/snapshot.py`: the box, derived quantities, the file."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from discsim.output import hdf5, open_step
from discsim.output.layout import write_layout, write_particles
from discsim.parts import STARTS, Lazy
from discsim.physics.eos import eos_of
from discsim.physics.profile import reference_density
from discsim.scene import SceneError

if TYPE_CHECKING:
    import h5py

    from discsim.effects.base import Column
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import Dust, Gas, Particles
    from discsim.output.open_step import OpenStep
    from discsim.scene import Scene

Array = np.ndarray
growth = Lazy("discsim.physics.growth")


class Extent(NamedTuple):
    """Corners (dimensions,) of the box of a snapshot, and the number of particles of each kind by name."""

    lower: Array
    upper: Array
    counts: dict[str, int]


def write_snapshot(
    path: str | os.PathLike[str], scene: Scene, time: float, gas: Gas | None, dust: Dust | None,
    extra: dict[str, dict[str, Array | Column]] | None = None, bodies: Bodies | None = None,
    step: OpenStep | None = None, extent: Extent | None = None,
    create: Callable[[Any], AbstractContextManager[h5py.File]] = hdf5.create,
) -> None:  # fmt: skip
    """Write a snapshot of the particles at `time` to `path`; the file appears when it is complete. Raises OSError.

    `extra` has additional arrays by kind and name, such as {"dust": {"stokes": ...}}, in the order of the particles.
    `step` has the data with which a new run can continue this run. `extent` has the box around the particles of all
    ranks and their numbers; by default it is computed from the given particles. `create` is the context manager that
    creates the file.
    """
    extra, present = extra or {}, present_kinds(gas, dust, bodies)
    lower, upper, counts = extent or extent_of(scene, gas, dust, bodies)
    support = support_radius(scene)
    with create(path) as file:
        hdf5.write_provenance(file, "snapshot")
        write_layout(file, scene, time, upper - lower, counts)
        own = file.create_group("discsim")
        own.attrs["origin"] = lower
        own.attrs["size"] = upper - lower
        own.attrs["dimensions"] = scene.space.dimensions
        own.attrs["support"] = support
        own.attrs["energy_equation"] = gas is not None and gas.u is not None
        units = scene.units
        own.attrs["units"] = [np.bytes_(t.encode()) for t in (units.system, units.length_text, units.mass_text)]
        hdf5.write_array(own, "Scene", np.frombuffer(scene.text.encode(), np.uint8))
        if step is not None:
            open_step.write(own, step)
        with suppress(SceneError):  # the original start of the snapshot in [initial] is unknown
            if scene.initial is not None and STARTS[scene.initial.kind].reference_density is not None:
                own.attrs["reference_density"] = reference_density(scene)
        for name, particles in present.items():
            arrays: dict[str, Any] = particles.arrays() | derived_arrays(scene, name, particles) | extra.get(name, {})
            arrays.setdefault("ids", np.arange(particles.count))
            arrays["pos"] = box_coordinates(particles.pos, lower, upper)
            if name == "gas":
                arrays["h"] = arrays["h"] * support
            write_particles(file, name, arrays, units)


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

    The additional arrays are the temperature, in physical units, and u if there is no energy equation.
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
