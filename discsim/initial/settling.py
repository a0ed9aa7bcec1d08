"""An isothermal layer at rest under -Omega^2 z (`exact/settling.py`), with grains at rest all over it.

Particles of equal mass, evenly spaced in the mass below them. Beyond +-vertical_extent immobile gas bears the ends of
the layer, at the spacing of the ends, with masses that continue the Gaussian. SPH's own balance is a little off the
Gaussian: the gas is moved into it, since the sound of a layer out of balance would drown the slow fall of small grains.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import random_stream
from discsim.initial.base import Start
from discsim.parts import Lazy
from discsim.scene.fields import Default, Density, Length, Table

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

linalg = Lazy("scipy.linalg")  # slow to import, as are kernels
special = Lazy("scipy.special")
smoothing = Lazy("discsim.kernels.smoothing")
Array = np.ndarray
MARGIN = 2.0  # of the support radius: what moves must not see where the immobile gas ends
ROUNDING = 1e-12  # of Omega^2 H: a force that cannot be balanced better
BALANCED = 1e-7  # of Omega^2 H: well below the fall of grains with t_stop Omega = 1e-5
ROUNDS = 20


class Settling(Table):
    """An isothermal layer in balance with external.vertical_frequency, and dust at rest in it."""

    kind: Literal["settling"] = "settling"
    density: Density = Field(1.0, gt=0, description="of the gas in the midplane")
    vertical_extent: Annotated[Length | None, Default("half of space.size")] = Field(
        None, gt=0, description="height on both sides up to which gas moves and dust begins"
    )


def scale_height(scene: Scene) -> float:
    """H = c_s / Omega of the scene's layer."""
    given: Any = scene
    return given.gas.eos.sound_speed / given.external.vertical_frequency


def extent(scene: Scene) -> float:
    """Height of the ends of what moves."""
    start: Any = scene.initial
    return start.vertical_extent or 0.5 * scene.space.size[0]


def column(scene: Scene) -> float:
    """Mass over area of the gas between the ends."""
    start: Any = scene.initial
    height = scale_height(scene)
    return float(start.density * height * np.sqrt(2.0 * np.pi) * special.erf(extent(scene) / height / np.sqrt(2.0)))


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    given: Any = scene
    total, count = column(scene), given.gas.particles
    gas = _species(_heights(scene, (np.arange(count) + 0.5) / count), total / count)
    gas = _with_ends(scene, gas)
    gas["density"] = given.initial.density * _gaussian(scene, gas["pos"][:, 0])
    if scene.dust is None:
        return {"gas": gas}
    stream, parts = random_stream(scene, "dust"), []
    for number, population in enumerate(scene.dust):
        n = population.particles
        if population.placement == "random":
            share = stream.random(n)
        else:
            share = (np.arange(n) + 0.5) / n + population.offset / count
        part = _species(_heights(scene, share), total * population.ratio / n)
        parts.append(part | {"species": np.full(n, number)})
    return {"gas": gas, "dust": {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}}


def _species(height: Array, mass: float | Array) -> dict[str, Array]:
    return {"pos": height[:, None], "vel": np.zeros((len(height), 1)), "mass": np.full(len(height), mass)}


def _gaussian(scene: Scene, height: Array) -> Array:
    return np.exp(-0.5 * (height / scale_height(scene)) ** 2)


def _heights(scene: Scene, share: Array) -> Array:
    """Heights below which these shares of the mass between the ends are."""
    height = scale_height(scene)
    inside = special.erf(extent(scene) / height / np.sqrt(2.0))
    return np.sqrt(2.0) * height * special.erfinv((2.0 * share - 1.0) * inside)


def _with_ends(scene: Scene, gas: dict[str, Array]) -> dict[str, Array]:
    """The gas with the immobile gas beyond its ends."""
    given: Any = scene
    top, mass = extent(scene), gas["mass"][0]
    spacing = float(mass / given.initial.density / _gaussian(scene, np.array(top)))
    h = given.gas.smoothing_length or given.gas.eta * spacing
    beyond = np.arange(np.ceil(MARGIN * smoothing.SUPPORT[smoothing.KERNELS[given.gas.kernel]] * h / spacing)) + 0.5
    above = top + spacing * beyond
    ends = np.concatenate([-above[::-1], above])
    end = _species(ends, given.initial.density * _gaussian(scene, ends) * spacing)
    whole = {key: np.concatenate([gas[key], end[key]]) for key in gas}
    whole["immobile"] = np.arange(len(whole["mass"])) >= len(gas["mass"])
    return whole


def settle(state: State, effects: dict) -> None:
    """Move the gas to where its forces cancel, by Newton's method on its places."""
    scene: Any = state.scene
    gas: Any = state.gas
    free = np.flatnonzero(~gas.immobile)
    band = int(
        np.ceil(4.0 * smoothing.SUPPORT[smoothing.KERNELS[scene.gas.kernel]] * scene.gas.eta)
    )  # places that a force depends on, each way
    small = ROUNDING * scene.external.vertical_frequency**2 * scale_height(scene)

    def forces(moved: Array) -> Array:
        place = gas.pos[free].copy()
        gas.pos[free, 0] += moved
        for _ in range(2):  # h is as good as the square of what it lacked before
            for particles in state.species.values():
                particles.acc[:] = 0.0
            for name in ("gas", "external"):
                effects[name].accelerate(state)
        gas.pos[free] = place
        return gas.acc[free, 0].copy()

    for _ in range(ROUNDS):
        spacing = np.gradient(gas.pos[free, 0])
        force = forces(np.zeros(len(free)))
        if np.abs(force).max() < small:
            return
        step = _newton_step(forces, force, spacing, band)
        gas.pos[free, 0] += np.clip(step, -0.2 * spacing, 0.2 * spacing)
    left = np.abs(forces(np.zeros(len(free)))).max() / small * ROUNDING
    if left > BALANCED:
        raise ValueError(
            f"gas.kernel: forces of {left:.2g} Omega^2 H are left in the layer, whose shortest waves make none under "
            f'"{scene.gas.kernel}" with this h; expected "wendland-c4" with eta = 2, or a smaller eta'
        )


def _newton_step(forces: Callable[[Array], Array], force: Array, spacing: Array, band: int) -> Array:
    """Displacements (n,) that cancel the forces to first order, from a banded Jacobian by differences."""
    count, width = len(force), 2 * band + 1
    jacobian = np.zeros((width, count))
    for first in range(width):
        moved = np.zeros(count)
        moved[first::width] = 1e-5 * spacing[first::width]
        change = forces(moved) - force
        for column in range(first, count, width):
            rows = np.arange(max(0, column - band), min(count, column + band + 1))
            jacobian[band + rows - column, column] = change[rows] / moved[column]
    return linalg.solve_banded((band, band), jacobian, -force)


START = Start(Settling, particles, settle)
