"""blast: heat in the middle of uniform gas at rest (Sedov 1959), and dust at rest in the gas.

The added energy per mass is proportional to (1 - r^2/R^2)^2 within R = `initial.radius`; its sum over all gas particles
is exactly `initial.energy`. The surrounding gas has the sound speed that `gas.eos` gives, or else almost no pressure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Array, Arrays, Curve, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.physics.eos import initial_energy
from discsim.scene.fields import Density, Length, Measure, Table

if TYPE_CHECKING:
    from discsim.scene import Scene

CENTRAL_PRESSURE = 0.4  # central pressure of a blast over that behind the shock (Sedov 1959)
MAX_COMPRESSION = 3.0  # largest compression of SPH gas in the shock, which is several h wide
COLD_ENERGY = 1e-8  # u of gas without a given temperature, in units of the blast's energy over the mass in the box


class Blast(Table):
    """Heat in the middle of uniform gas at rest (Sedov)."""

    kind: Literal["blast"] = "blast"
    density: Density = Field(1.0, gt=0, description="surface density of the gas")
    energy: Annotated[float, Measure("energy")] = Field(1.0, gt=0, description="energy of the blast")
    radius: Length = Field(gt=0, description="radius of the region that receives the energy")


def particles(scene: Scene) -> dict[str, Arrays]:
    start, eos = scene.initial, scene.gas.eos
    out = uniform_particles(scene, start.density)
    middle = 0.5 * np.array(scene.space.size)
    gas = out["gas"]
    r2 = ((gas["pos"] - middle) ** 2).sum(axis=1)
    weight = np.maximum(0.0, 1.0 - r2 / start.radius**2) ** 2
    if not weight.any():
        raise ValueError("initial.radius: no gas particle is within this radius; expected several particle spacings")
    if eos.sound_speed is None and eos.aspect_ratio is None:
        around = COLD_ENERGY * start.energy / gas["mass"].sum()
    else:
        around = initial_energy(scene, np.sqrt(r2))
    gas["u"] = around + start.energy * weight / (gas["mass"] * weight).sum()
    if scene.centred:
        for arrays in out.values():
            arrays["pos"] -= middle
    return out


def sample_points(scene: Scene) -> SamplePoints:
    return sample_uniform_gas(scene.initial.density)


def limiting_gas(scene: Scene, time: float) -> SamplePoints:
    """Return sample points in the gas that limits the time step at `time`: in the middle, and behind the shock.

    Gas in the middle is hottest, and its entropy is constant. The radius of the shock is about (E t^2 / rho)^(1/4). A
    shock in SPH is several h wide, and so compresses gas by less than (gamma + 1) / (gamma - 1).
    """
    start, gamma = scene.initial, scene.gas.eos.gamma
    density = start.density * (1.0 + (_coupled_dust_ratio(scene) or 0.0))
    hottest = 3.0 * (gamma - 1.0) * start.energy / (np.pi * start.radius**2)  # the pressure at the start
    speed = 0.5 * (start.energy / density) ** 0.25 * max(time, 1e-300) ** -0.5
    behind = 2.0 / (gamma + 1.0) * start.density * speed**2
    pressure = min(hottest, CENTRAL_PRESSURE * behind)
    thinned = start.density * (pressure / hottest) ** (1.0 / gamma)
    if behind > hottest:  # there is no shock yet
        return SamplePoints(["the middle"], np.array([thinned]), pressure=np.array([pressure]))
    squeezed = start.density * min((gamma + 1.0) / (gamma - 1.0), MAX_COMPRESSION)
    jumps = np.array([0.0, 2.0 / (gamma + 1.0) * speed])
    names = ["the middle", "the shock"]
    return SamplePoints(names, np.array([thinned, squeezed]), pressure=np.array([pressure, behind]), jump=jumps)


def _coupled_dust_ratio(scene: Scene) -> float | None:
    """Return the dust-to-gas ratio of all populations together, 0 without dust; None if dust does not act on the gas.

    Dust does not act on gas without drag or with one-way drag. The exact solution assumes that dust moves with the gas.
    """
    ratio = sum(dust.ratio for dust in scene.dust or ())
    return None if ratio and (scene.drag is None or scene.drag.direction == "one-way") else ratio


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of the shock radius; None if dust does not act on the gas."""
    ratio = _coupled_dust_ratio(scene)
    if ratio is None:
        return None
    from discsim.exact import sedov  # imports scipy

    def errors(sim: Simulated) -> dict[str, float]:
        start = scene.initial
        exact = sedov.shock_radius(sim.time, start.energy, start.density * (1.0 + ratio), scene.gas.eos.gamma)
        width = min(scene.space.size) * sim.gas.count**-0.5
        middle = 0.0 if scene.centred else 0.5 * np.array(scene.space.size)
        radii = {kind: shock_radius(p.pos - middle, p.mass, width) for kind, p in sim.state.species.items()}
        return {kind: abs(radius / exact - 1.0) for kind, radius in radii.items()}

    return ErrorMeasure("shock radius compared with the exact one", errors)


def shock_radius(pos: Array, mass: Array, width: float) -> float:
    """Return the radius of the shock about the origin, from positions (n, 2) and masses (n,) of the particles.

    At this radius the surface density is the mean of its peak and of its value outside the shock. width: width of the
    rings in which the surface density is measured.
    """
    r = np.sqrt((pos**2).sum(axis=1))
    edges = np.arange(0.0, np.abs(pos).max(), width)
    middle = 0.5 * (edges[1:] + edges[:-1])
    density = np.histogram(r, edges, weights=mass)[0] / np.pi / (edges[1:] ** 2 - edges[:-1] ** 2)
    ahead = density[-3:].mean()
    peak = int(np.argmax(density))
    out = peak + int(np.argmax(density[peak:] < 0.5 * (density[peak] + ahead)))
    return float(np.interp(0.5 * (density[peak] + ahead), density[[out, out - 1]], middle[[out, out - 1]]))


def exact_curves(scene: Scene, time: float, r: Array) -> dict[str, Curve]:
    start, ratio = scene.initial, _coupled_dust_ratio(scene)
    if time == 0.0 or ratio is None:
        return {}
    from discsim.exact import sedov  # imports scipy

    heavy = sedov.solution(r, time, start.energy, start.density * (1.0 + ratio), scene.gas.eos.gamma)
    gas = {"gas": (r, heavy.density / (1.0 + ratio), heavy.velocity)}
    return gas | ({"dust": (r, heavy.density * ratio / (1.0 + ratio), heavy.velocity)} if ratio else {})


START = Start(
    Blast,
    particles,
    sample_points,
    dimensions=(2,),
    boundary=None,
    eos=("adiabatic",),
    sets_pressure=True,
    min_half_side=("radius", 1.0),
    limiting_gas=limiting_gas,
    measure=measure,
    exact_curves=exact_curves,
    figure_velocity="radial",
)
