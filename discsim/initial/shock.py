"""Two states meeting at 0 of [-size/2, size/2]; immobile particles continue both beyond the ends.

Particles of equal mass, so their spacing follows the density; dust has the gas's velocity and a constant ratio
(DustyShock; Laibe & Price 2012).
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Start
from discsim.parts import Lazy
from discsim.scene.fields import Measure, Table, Velocity

smoothing = Lazy("discsim.kernels.smoothing")  # slow to import
MARGIN = 2.0  # of the support radius: live particles must not see where the immobile ones end


class Shock(Table):
    """Two states meeting at 0 of [-size/2, size/2]."""

    kind: Literal["shock"] = "shock"
    left: tuple[
        Annotated[float, Field(gt=0), Measure("density")],
        Annotated[float, Field(gt=0), Measure("pressure")],
        Velocity,
    ] = Field((1.0, 1.0, 0.0), description="gas [density, pressure, velocity] at x < 0")
    right: tuple[
        Annotated[float, Field(gt=0), Measure("density")],
        Annotated[float, Field(gt=0), Measure("pressure")],
        Velocity,
    ] = Field((0.125, 0.1, 0.0), description="gas [density, pressure, velocity] at x > 0")


def _side(density, mass, half, sign, margin, offset):
    """Places of one side's particles, from the jump outwards and on into the margin."""
    step = mass / density
    count = int(np.ceil((half + margin) / step))
    return np.sort(sign * (np.arange(count) + 0.5 + sign * offset) * step)


def particles(scene):
    start, half = scene.initial, 0.5 * scene.space.size[0]
    states = {-1.0: start.left, 1.0: start.right}
    total = half * sum(state[0] for state in states.values())
    eta, fixed = scene.gas.eta, scene.gas.smoothing_length
    support = smoothing.SUPPORT[smoothing.KERNELS[scene.gas.kernel]]

    def tube(count, ratio, offset):
        mass = total / count
        parts: dict[str, list[np.ndarray]] = {"pos": [], "vel": [], "density": [], "u": []}
        for sign, (density, pressure, velocity) in states.items():
            h = fixed or eta * total / scene.gas.particles / density
            x = _side(density, mass, half, sign, MARGIN * support * h, offset)
            parts["pos"].append(x)
            parts["vel"].append(np.full(len(x), velocity))
            parts["density"].append(np.full(len(x), density))
            if scene.gas.eos.kind == "adiabatic":
                parts["u"].append(np.full(len(x), pressure / (scene.gas.eos.gamma - 1.0) / density))
        out = {key: np.concatenate(values) for key, values in parts.items() if values}
        out["immobile"] = np.abs(out["pos"]) > half
        out["mass"] = np.full(len(out["pos"]), ratio * mass)
        return out | {"pos": out["pos"][:, None], "vel": out["vel"][:, None]}

    out = {"gas": tube(scene.gas.particles, 1.0, 0.0)}
    if scene.dust is not None:
        parts = []
        for number, population in enumerate(scene.dust):
            part = tube(population.particles, population.ratio, population.offset)
            parts.append(part | {"species": np.full(len(part["mass"]), number)})
        out["dust"] = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    return out


START = Start(Shock, particles)
