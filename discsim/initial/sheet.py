"""sheet: a periodic sheet at rest with Sigma = Sigma_0 (1 + A sin(k x)), in which pressure opposes self-gravity.

Sigma_0: mean surface density. A: relative amplitude. k: wavenumber along x.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Arrays, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, stretch_lattice, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.physics.eos import eos_of
from discsim.scene.fields import Count, Number, SurfaceDensity, Table

if TYPE_CHECKING:
    from discsim.scene import Scene


class Sheet(Table):
    """A periodic sheet with a standing density wave."""

    kind: Literal["sheet"] = "sheet"
    surface_density: SurfaceDensity = Field(1.0, gt=0, description="mean surface density")
    amplitude: Number = Field(1e-3, gt=-1, lt=1, description="relative amplitude of the density wave")
    wavenumber: Count = Field(1, ge=1, description="number of wavelengths in the box")


def particles(scene: Scene) -> dict[str, Arrays]:
    start = scene.initial
    size = np.array(scene.space.size)
    wavevector = np.zeros(len(size))
    wavevector[0] = 2.0 * np.pi * start.wavenumber / size[0]
    out = uniform_particles(scene, start.surface_density)
    for arrays in out.values():
        stretch_lattice(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
    return out


def sample_points(scene: Scene) -> SamplePoints:
    return sample_uniform_gas(scene.initial.surface_density)


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of the wave's amplitude; None if the scene has no exact solution.

    An exact solution needs gas with a single sound speed, no dust, and no self-gravity or the kernel "plummer".
    """
    if scene.dust or not scene.gas or not eos_of(scene).one_speed:
        return None
    if scene.self_gravity and scene.self_gravity.kernel != "plummer":
        return None
    from discsim.exact import sheet  # imports scipy

    def errors(sim: Simulated) -> dict[str, float]:
        start, gravity = scene.initial, scene.self_gravity
        k = 2.0 * np.pi * start.wavenumber / scene.space.size[0]
        pull = (start.surface_density, scene.gas.eos.sound_speed) + ((gravity.softening,) if gravity else (0.0, 0.0))
        # The growth rate or the frequency is 0, so one factor is 1.
        grown = np.cosh(sheet.growth_rate(k, *pull) * sim.time) * np.cos(sheet.frequency(k, *pull) * sim.time)
        exact = start.amplitude * float(grown)
        mode = 2.0 * (np.exp(-1j * k * sim.gas.pos[:, 0]) * sim.gas.mass).sum() / sim.gas.mass.sum()
        return {"gas": float(abs(mode * 1j - exact) / max(abs(exact), start.amplitude))}

    return ErrorMeasure("amplitude of the density wave compared with the exact one", errors)


START = Start(
    Sheet, particles, sample_points, has_surface_density=True, measure=measure, exact_effects=("self_gravity",)
)
