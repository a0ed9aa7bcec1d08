"""A blast: heat in the middle of uniform gas at rest (Sedov 1959), and dust at rest in it.

The energy falls off as (1 - r^2/R^2)^2 within the radius R; its sum over the particles is exact. The gas around has the
eos's sound speed, or next to no pressure where it gives none.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Start
from discsim.initial.lattice import uniform
from discsim.physics.eos import initial_energy
from discsim.scene.fields import Density, Length, Measure, Table

COLD = 1e-8  # of the blast's energy over the mass of the box, per mass of gas whose temperature nobody named


class Blast(Table):
    """Heat in the middle of uniform gas at rest (Sedov)."""

    kind: Literal["blast"] = "blast"
    density: Density = Field(1.0, gt=0, description="of the gas")
    energy: Annotated[float, Measure("energy")] = Field(1.0, gt=0, description="of the blast")
    radius: Length = Field(gt=0, description="within which it is put")


def particles(scene):
    start, eos = scene.initial, scene.gas.eos
    out = uniform(scene, start.density)
    middle = 0.5 * np.array(scene.space.size)
    gas = out["gas"]
    r2 = ((gas["pos"] - middle) ** 2).sum(axis=1)
    weight = np.maximum(0.0, 1.0 - r2 / start.radius**2) ** 2
    if not weight.any():
        raise ValueError("initial.radius: no gas particle is within it; expected some spacings of the gas")
    if eos.sound_speed is None and eos.aspect_ratio is None:
        around = COLD * start.energy / gas["mass"].sum()
    else:
        around = initial_energy(scene, np.sqrt(r2))
    gas["u"] = around + start.energy * weight / (gas["mass"] * weight).sum()
    if scene.centred:
        for arrays in out.values():
            arrays["pos"] -= middle
    return out


START = Start(Blast, particles)
