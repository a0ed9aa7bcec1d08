"""A uniform periodic box with a velocity of its own for gas and dust (DustyBox; Laibe & Price 2011)."""

from typing import Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Start
from discsim.initial.lattice import uniform
from discsim.scene.fields import Density, Table, VelocityVector


class Box(Table):
    """A uniform periodic box (DustyBox)."""

    kind: Literal["box"] = "box"
    density: Density = Field(1.0, gt=0, description="of the gas")
    gas_velocity: VelocityVector = Field(0, validate_default=True, description="a number (along x) or [x, y]")
    dust_velocity: VelocityVector = Field(0, validate_default=True, description="a number (along x) or [x, y]")


def particles(scene):
    start = scene.initial
    out = uniform(scene, start.density)
    for name, arrays in out.items():
        arrays["vel"] += np.array(getattr(start, f"{name}_velocity"))
    return out


START = Start(Box, particles)
