"""blast: heat in the middle of uniform gas at rest (Sedov 1959), and dust at rest in the gas.

The energy per mass falls off as (1 - r^2/R^2)^2 within R = `initial.radius`; its sum over all particles is exactly
`initial.energy`. The surrounding gas has the sound speed of `gas.eos`, or almost no pressure without this key.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from discsim.initial.base import Array, Arrays, Curve, Places, Start
from discsim.initial.lattice import everywhere, uniform
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.physics.eos import initial_energy
from discsim.scene.fields import Density, Length, Measure, Table

if TYPE_CHECKING:
    from discsim.numerics.state import Particles
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
    out = uniform(scene, start.density)
    middle = 0.5 * np.array(scene.space.size)
    gas = out["gas"]
    r2 = ((gas["pos"] - middle) ** 2).sum(axis=1)
    weight = np.maximum(0.0, 1.0 - r2 / start.radius**2) ** 2
    if not weight.any():
        raise ValueError("initial.radius: no gas particle lies within this radius; expected several particle spacings")
    if eos.sound_speed is None and eos.aspect_ratio is None:
        around = COLD_ENERGY * start.energy / gas["mass"].sum()
    else:
        around = initial_energy(scene, np.sqrt(r2))
    gas["u"] = around + start.energy * weight / (gas["mass"] * weight).sum()
    if scene.centred:
        for arrays in out.values():
            arrays["pos"] -= middle
    return out


def places(scene: Scene) -> Places:
    return everywhere(scene.initial.density)


def later(scene: Scene, time: float) -> Places:
    """Return the gas that limits the time step at `time`: the hottest gas, in the middle, and the gas behind the shock.

    The shock is at the radius (E t^2 / rho)^(1/4), about, and the entropy of gas in the middle is constant. A shock in
    SPH is several h wide, and so compresses gas by less than (gamma + 1) / (gamma - 1).
    """
    start, gamma = scene.initial, scene.gas.eos.gamma
    density = start.density * (1.0 + (_coupled_dust_ratio(scene) or 0.0))
    hottest = 3.0 * (gamma - 1.0) * start.energy / (np.pi * start.radius**2)  # the pressure at the start
    speed = 0.5 * (start.energy / density) ** 0.25 * max(time, 1e-300) ** -0.5
    behind = 2.0 / (gamma + 1.0) * start.density * speed**2
    pressure = min(hottest, CENTRAL_PRESSURE * behind)
    thinned = start.density * (pressure / hottest) ** (1.0 / gamma)
    if behind > hottest:  # there is no shock yet
        return Places(["the middle"], np.array([thinned]), pressure=np.array([pressure]))
    squeezed = start.density * min((gamma + 1.0) / (gamma - 1.0), MAX_COMPRESSION)
    jumps = np.array([0.0, 2.0 / (gamma + 1.0) * speed])
    names = ["the middle", "the shock"]
    return Places(names, np.array([thinned, squeezed]), pressure=np.array([pressure, behind]), jump=jumps)


def _coupled_dust_ratio(scene: Scene) -> float | None:
    """Return the dust-to-gas ratio of all populations together; None if dust does not act on the gas.

    Dust without drag or with one-way drag does not. The exact solution is for dust that moves with the gas.
    """
    ratio = sum(dust.ratio for dust in scene.dust or ())
    return None if ratio and (scene.drag is None or scene.drag.direction == "one-way") else ratio


def measure(scene: Scene) -> ErrorMeasure | None:
    ratio = _coupled_dust_ratio(scene)
    if ratio is None:
        return None
    from discsim.exact import sedov  # imports scipy

    def errors(sim: Simulated) -> dict[str, float]:
        start = scene.initial
        exact = sedov.shock_radius(sim.time, start.energy, start.density * (1.0 + ratio), scene.gas.eos.gamma)
        width = min(scene.space.size) * sim.gas.count**-0.5
        return {kind: abs(shock_front(p, width) / exact - 1.0) for kind, p in sim.state.species.items()}

    return ErrorMeasure("shock radius compared with the exact one", errors)


def shock_front(particles: Particles, width: float) -> float:
    """Return the radius of the shock of a blast, at which the density is the mean of its peak and of the gas outside.

    width: width of the rings over which the density is averaged.
    """
    r = np.sqrt((particles.pos**2).sum(axis=1))
    edges = np.arange(0.0, np.abs(particles.pos).max(), width)
    middle = 0.5 * (edges[1:] + edges[:-1])
    density = np.histogram(r, edges, weights=particles.mass)[0] / np.pi / (edges[1:] ** 2 - edges[:-1] ** 2)
    ahead = density[-3:].mean()
    peak = int(np.argmax(density))
    out = peak + int(np.argmax(density[peak:] < 0.5 * (density[peak] + ahead)))
    return float(np.interp(0.5 * (density[peak] + ahead), density[[out, out - 1]], middle[[out, out - 1]]))


def curves(scene: Scene, time: float, r: Array) -> dict[str, Curve]:
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
    places,
    dimensions=(2,),
    boundary=None,
    eos=("adiabatic",),
    brings_pressure=True,
    reach=("radius", 1.0),
    later=later,
    measure=measure,
    curves=curves,
    around="radial",
)
