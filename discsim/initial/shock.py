"""shock: a shock tube on [-size/2, size/2], with a uniform state on each side of x = 0.

Immobile particles continue both states beyond the ends. Particles have equal mass, so that their spacing is inversely
proportional to the density. Dust has the velocity of the gas, and a constant dust-to-gas ratio (DustyShock; Laibe &
Price 2012).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import concatenate_groups, make_populations
from discsim.initial.base import Array, Arrays, Curve, SamplePoints, Start
from discsim.initial.measure import ErrorMeasure, Simulated, velocity_errors
from discsim.parts import Lazy
from discsim.physics.eos import eos_of
from discsim.scene.fields import AllowedValues, Measure, Table, Velocity

if TYPE_CHECKING:
    from discsim.scene import Scene

smoothing = Lazy("discsim.kernels.sph.smoothing")  # slow to import
MARGIN = 2.0  # thickness of the immobile ends in support radii: kernels of moving particles must not reach beyond them
GasState = Annotated[
    tuple[
        Annotated[float, Field(gt=0), Measure("density")],
        Annotated[float, Field(gt=0), Measure("pressure")],
        Velocity,
    ],
    AllowedValues("density, pressure, velocity"),
]


class Shock(Table):
    """A shock tube: two uniform states separated at 0 of [-size/2, size/2]."""

    kind: Literal["shock"] = "shock"
    left: GasState = Field((1.0, 1.0, 0.0), description="gas state [density, pressure, velocity] at x < 0")
    right: GasState = Field((0.125, 0.1, 0.0), description="gas state [density, pressure, velocity] at x > 0")


def _positions_on_side(density: float, mass: float, half: float, sign: float, margin: float, offset: float) -> Array:
    """Return the sorted positions (n,) of the particles on one side of x = 0, including the immobile end.

    density, mass: density of this side and mass of a particle. half: half the length of the tube. sign: -1 for the left
    side, 1 for the right side. margin: thickness of the immobile end. offset: displacement towards positive x, in
    particle spacings.
    """
    spacing = mass / density
    count = int(np.ceil((half + margin) / spacing))
    return np.sort(sign * (np.arange(count) + 0.5 + sign * offset) * spacing)


def particles(scene: Scene) -> dict[str, Arrays]:
    start, half = scene.initial, 0.5 * scene.space.size[0]
    states = {-1.0: start.left, 1.0: start.right}
    total = half * sum(state[0] for state in states.values())
    eta, fixed = scene.gas.eta, scene.gas.smoothing_length
    support = smoothing.SUPPORT[smoothing.KERNELS[scene.gas.kernel]]

    def make_species(count: int, ratio: float, offset: float) -> Arrays:
        mass = total / count
        parts = []
        for sign, (density, pressure, velocity) in states.items():
            h = fixed or eta * total / scene.gas.particles / density
            x = _positions_on_side(density, mass, half, sign, MARGIN * support * h, offset)
            side = {"pos": x, "vel": np.full(len(x), velocity), "density": np.full(len(x), density)}
            if eos_of(scene).holds_heat:
                side["u"] = np.full(len(x), pressure / (scene.gas.eos.gamma - 1.0) / density)
            parts.append(side)
        out = concatenate_groups(parts)
        out["immobile"] = np.abs(out["pos"]) > half
        out["mass"] = np.full(len(out["pos"]), ratio * mass)
        return out | {"pos": out["pos"][:, None], "vel": out["vel"][:, None]}

    out = {"gas": make_species(scene.gas.particles, 1.0, 0.0)}
    if scene.dust is not None:
        out["dust"] = make_populations(scene, lambda dust: make_species(dust.particles, dust.ratio, dust.offset))
    return out


def cell_values(scene: Scene, x: Array, dx: float) -> tuple[Array, Arrays, Array | None]:
    """Return density, velocities and u, averaged over the grid cells; a cell at x = 0 may contain both states."""
    left, right = scene.initial.left, scene.initial.right
    share = np.clip(0.5 - x / dx, 0.0, 1.0)
    density = share * left[0] + (1.0 - share) * right[0]
    vel = (share * left[0] * left[2] + (1.0 - share) * right[0] * right[2]) / density
    u = None
    if eos_of(scene).holds_heat:
        u = (share * left[1] + (1.0 - share) * right[1]) / (scene.gas.eos.gamma - 1.0) / density
    return density, {"gas": vel, "dust": vel}, u


def sample_points(scene: Scene) -> SamplePoints:
    left, right = scene.initial.left, scene.initial.right
    return SamplePoints(["left", "right"], np.array([left[0], right[0]]), pressure=np.array([left[1], right[1]]))


def region_mass(scene: Scene, population: Any) -> float:
    return (scene.initial.left[0] + scene.initial.right[0]) * scene.space.size[0] / 2


def sample_all_gas(scene: Scene) -> tuple[SamplePoints, Array]:
    points = sample_points(scene)
    return points, points.density


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of particle velocities; None if the scene has no exact solution.

    An exact solution needs gas with an energy equation. With dust, the solution needs one population and two-way
    drag.
    """
    if scene.gas is None or not eos_of(scene).holds_heat or len(scene.dust or ()) > 1:
        return None
    if scene.dust and (scene.drag is None or scene.drag.direction == "one-way"):
        return None
    from discsim.exact import dustyshock  # imports scipy

    def exact(sim: Simulated, kind: str) -> tuple[Array, Array | float]:
        start = scene.initial
        ratio = scene.dust[0].ratio if scene.dust else 0.0
        x = sim.state.species[kind].pos[:, 0]
        flow = dustyshock.solution(x, sim.time, ratio, start.left, start.right, scene.gas.eos.gamma)
        return flow.velocity[:, None], 0.0

    limit = ", in the limit of strong drag" if scene.dust else ""
    return ErrorMeasure(f"particle velocities compared with the exact shock tube{limit}", velocity_errors(exact))


def exact_curves(scene: Scene, time: float, x: Array) -> dict[str, Curve]:
    start = scene.initial
    if not eos_of(scene).holds_heat or time == 0.0 or scene.drag is not None or scene.dust:
        return {}
    from discsim.exact import riemann  # imports scipy

    flow = riemann.solution(x, time, start.left, start.right, scene.gas.eos.gamma)
    return {"gas": (x, flow.density, flow.velocity)}


START = Start(
    Shock,
    particles,
    sample_points,
    cell_values=cell_values,
    dimensions=(1,),
    boundary="open",
    eos=("adiabatic", "isothermal"),
    sets_pressure=True,
    region_mass=region_mass,
    samples_of_all_gas=sample_all_gas,
    measure=measure,
    exact_curves=exact_curves,
)
