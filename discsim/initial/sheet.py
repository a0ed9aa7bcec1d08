"""A periodic sheet at rest with Sigma = Sigma_0 (1 + A sin(k x)): sound against self-gravity."""

from typing import Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Start
from discsim.initial.lattice import stretch, uniform
from discsim.scene.fields import Count, Number, SurfaceDensity, Table


class Sheet(Table):
    """A periodic sheet with a standing density wave."""

    kind: Literal["sheet"] = "sheet"
    surface_density: SurfaceDensity = Field(1.0, gt=0, description="mean")
    amplitude: Number = Field(1e-3, gt=-1, lt=1, description="relative amplitude of the density wave")
    wavenumber: Count = Field(1, ge=1, description="whole waves on the side")


def particles(scene):
    start = scene.initial
    size = np.array(scene.space.size)
    wavevector = np.zeros(len(size))
    wavevector[0] = 2.0 * np.pi * start.wavenumber / size[0]
    out = uniform(scene, start.surface_density)
    for arrays in out.values():
        stretch(arrays["pos"], wavevector, start.amplitude)
        arrays["pos"] %= size
    return out


START = Start(Sheet, particles)
