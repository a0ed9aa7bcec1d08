"""settling: an isothermal gas layer and dust, both at rest, under the acceleration -Omega^2 z (`exact/settling.py`).

The gas is a Gaussian in z. Particles have equal mass, so that each has the same mass between itself and the next.
Beyond +-vertical_extent immobile gas supports the ends of the layer. Its particles have the spacing of the last moving
ones, and masses that continue the Gaussian. The equilibrium of SPH differs slightly from the Gaussian. Gas is moved to
the equilibrium of SPH, because sound waves of a layer out of balance would be faster than the fall of small grains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import joined, populations, random_stream
from discsim.initial.base import Places, Start
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.numerics.operators import accelerate
from discsim.parts import LAWS, Lazy
from discsim.scene.fields import Default, Density, Length, Table

if TYPE_CHECKING:
    from discsim.initial.base import Curve
    from discsim.numerics.state import State
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

linalg = Lazy("scipy.linalg")  # slow to import, as are kernels
special = Lazy("scipy.special")
smoothing = Lazy("discsim.kernels.sph.smoothing")
Array = np.ndarray
MARGIN = 2.0  # thickness of the immobile gas in support radii: kernels of moving gas must not reach its outer end
FORCE_ROUNDING = 1e-12  # rounding error of forces, in Omega^2 H
MAX_RESIDUAL = 1e-7  # largest net force allowed, in Omega^2 H: well below the fall of grains with t_stop Omega = 1e-5
MAX_ITERATIONS = 20  # largest number of iterations of Newton's method
PREVIEW_SAMPLES = 20_001  # sample heights of previews


class Settling(Table):
    """An isothermal layer in balance with external.vertical_frequency, and dust at rest in it."""

    kind: Literal["settling"] = "settling"
    density: Density = Field(1.0, gt=0, description="density of the gas in the midplane")
    vertical_extent: Annotated[Length | None, Default("half of space.size")] = Field(
        None, gt=0, description="height above and below the midplane up to which gas moves and dust starts"
    )


def scale_height(scene: Scene | Draft) -> float:
    """Return the scale height H = c_s / Omega of the layer."""
    given: Any = scene
    return given.gas.eos.sound_speed / given.external.vertical_frequency


def extent(scene: Scene | Draft) -> float:
    """Return the height above and below the midplane up to which gas moves."""
    given: Any = scene
    return given.initial.vertical_extent or 0.5 * given.space.size[0]


def column(scene: Scene) -> float:
    """Return the surface density of the moving gas, between -extent and +extent."""
    start: Any = scene.initial
    height = scale_height(scene)
    return float(start.density * height * np.sqrt(2.0 * np.pi) * special.erf(extent(scene) / height / np.sqrt(2.0)))


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    given: Any = scene
    total, count = column(scene), given.gas.particles
    gas = _particles_at_rest(_heights(scene, (np.arange(count) + 0.5) / count), total / count)
    gas = _add_immobile_ends(scene, gas)
    gas["density"] = given.initial.density * _gaussian(scene, gas["pos"][:, 0])
    if scene.dust is None:
        return {"gas": gas}
    stream = random_stream(scene, "dust")

    def grains(population: Any) -> dict[str, Array]:
        n = population.particles
        if population.placement == "random":
            share = stream.random(n)
        else:
            share = (np.arange(n) + 0.5) / n + population.offset / count
        return _particles_at_rest(_heights(scene, share), total * population.ratio / n)

    return {"gas": gas, "dust": populations(scene, grains)}


def _particles_at_rest(height: Array, mass: float | Array) -> dict[str, Array]:
    return {"pos": height[:, None], "vel": np.zeros((len(height), 1)), "mass": np.full(len(height), mass)}


def _gaussian(scene: Scene, height: Array) -> Array:
    return np.exp(-0.5 * (height / scale_height(scene)) ** 2)


def _heights(scene: Scene, share: Array) -> Array:
    """Return the heights (n,) below which the fractions `share` (n,) of the moving gas lie."""
    height = scale_height(scene)
    inside = special.erf(extent(scene) / height / np.sqrt(2.0))
    return np.sqrt(2.0) * height * special.erfinv((2.0 * share - 1.0) * inside)


def _add_immobile_ends(scene: Scene, gas: dict[str, Array]) -> dict[str, Array]:
    """Return the arrays `gas` of the moving gas, followed by the immobile gas beyond both ends."""
    given: Any = scene
    top, mass = extent(scene), gas["mass"][0]
    spacing = float(mass / given.initial.density / _gaussian(scene, np.array(top)))
    h = given.gas.smoothing_length or given.gas.eta * spacing
    beyond = np.arange(np.ceil(MARGIN * smoothing.SUPPORT[smoothing.KERNELS[given.gas.kernel]] * h / spacing)) + 0.5
    above = top + spacing * beyond
    ends = np.concatenate([-above[::-1], above])
    end = _particles_at_rest(ends, given.initial.density * _gaussian(scene, ends) * spacing)
    whole = joined([gas, end])
    whole["immobile"] = np.arange(len(whole["mass"])) >= len(gas["mass"])
    return whole


def settle(state: State, effects: dict[str, Any]) -> None:
    """Move the gas to positions at which its forces cancel, by Newton's method.

    Raises ValueError if net forces above MAX_RESIDUAL remain.
    """
    with effects["gas"].sph.in_double():  # the Jacobian is from differences of forces that nearly cancel
        _settle_in_double(state, effects)


def _settle_in_double(state: State, effects: dict[str, Any]) -> None:
    scene: Any = state.scene
    gas: Any = state.gas
    free = np.flatnonzero(~gas.immobile)
    band = int(
        np.ceil(4.0 * smoothing.SUPPORT[smoothing.KERNELS[scene.gas.kernel]] * scene.gas.eta)
    )  # half bandwidth of the Jacobian: a force depends on this many particles on each side
    small = FORCE_ROUNDING * scene.external.vertical_frequency**2 * scale_height(scene)

    def forces(moved: Array) -> Array:
        place = gas.pos[free].copy()
        gas.pos[free, 0] += moved
        for _ in range(2):  # the error of h is squared in each iteration
            for particles in state.species.values():
                particles.acc[:] = 0.0
            for name in ("gas", "external"):
                accelerate(effects[name], state)
        gas.pos[free] = place
        return gas.acc[free, 0].copy()

    for _ in range(MAX_ITERATIONS):
        spacing = np.gradient(gas.pos[free, 0])
        force = forces(np.zeros(len(free)))
        if np.abs(force).max() < small:
            return
        step = _newton_step(forces, force, spacing, band)
        gas.pos[free, 0] += np.clip(step, -0.2 * spacing, 0.2 * spacing)
    left = np.abs(forces(np.zeros(len(free)))).max() / small * FORCE_ROUNDING
    if left > MAX_RESIDUAL:
        raise ValueError(
            f"gas.kernel: forces of {left:.2g} Omega^2 H are left in the layer by kernel "
            f'"{scene.gas.kernel}" with this h; expected "wendland-c4" with eta = 2, or a smaller eta'
        )


def _newton_step(forces: Callable[[Array], Array], force: Array, spacing: Array, band: int) -> Array:
    """Return the displacements (n,) that cancel the forces to first order.

    The Jacobian is banded, with `band` diagonals on each side, and computed from finite differences of `forces`.
    force, spacing (n,): forces now, and distances between particles.
    """
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


def needs_gravity(draft: Draft) -> Iterator[Problem]:
    if not (draft.external and draft.external.vertical_frequency > 0):
        path = ("external", "vertical_frequency") if draft.has("external") else ("external",)
        yield path, "missing, but a settling layer needs vertical gravity; expected external.vertical_frequency > 0"


def reaches_its_ends(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if there is no gas at the ends, or if there are too few particles.

    Particles of equal mass are far apart at the ends. At most ten e-folding lengths of the density are allowed.
    """
    if not (draft.gas and draft.space and draft.external):
        return
    if not draft.eos.one_speed or draft.external.vertical_frequency == 0.0:
        return
    height = scale_height(draft)
    top = extent(draft) / height
    if top > 30.0:
        wrong = f"a layer {2.0 * top:.3g} scale heights thick has practically no gas at its ends"
        yield ("initial", "vertical_extent"), f"{wrong}; expected a few scale heights c_s / Omega = {height:.3g}"
        return
    share = math.sqrt(2.0 * math.pi) * math.erf(top / math.sqrt(2.0))
    needed = math.ceil(0.1 * share * top * math.exp(0.5 * top * top))
    if draft.gas.particles < needed:
        wrong = f"too few particles for a layer that reaches to {top:.3g} scale heights"
        yield ("gas", "particles"), f"{wrong}; expected at least {needed}, or a smaller initial.vertical_extent"


def places(scene: Scene) -> Places:
    start: Any = scene.initial
    ends = start.density * math.exp(-0.5 * (extent(scene) / scale_height(scene)) ** 2)
    return Places(["midplane", "ends"], np.array([start.density, ends]))


def spread(scene: Scene) -> tuple[Places, Array]:
    weight = _gaussian(scene, np.linspace(0.0, extent(scene), PREVIEW_SAMPLES))
    return Places([], scene.initial.density * weight), weight


def mass(scene: Scene, population: Any) -> float:
    return column(scene)


def measure(scene: Scene) -> ErrorMeasure | None:
    known = LAWS[scene.drag.law].uniform_time if scene.drag else None
    if known is None or len(scene.dust or ()) > 1:
        return None
    from discsim.exact import settling  # imports scipy

    def errors(sim: Simulated) -> dict[str, float]:
        given: Any = scene
        start = particles(scene)["dust"]["pos"][:, 0]
        time, frequency = known(given.drag), given.external.vertical_frequency
        height, _ = settling.trajectories(sim.time, start, lambda z: np.full_like(z, time), frequency)
        where = np.argsort(sim.dust.ids)
        way = np.abs(height - start)
        return {"dust": float(np.sqrt(((sim.dust.pos[where, 0] - height) ** 2).mean()) / way.max())}

    return ErrorMeasure("heights of the grains compared with their equation of motion, over the longest path", errors)


def curves(scene: Scene, time: float, x: Array) -> dict[str, Curve]:
    """Return the exact curves of the gas at rest and, for a single population with a known stopping time, of dust."""
    from discsim.exact import settling  # imports scipy

    given: Any = scene
    height, midplane = scale_height(scene), given.initial.density
    x = np.linspace(-extent(scene), extent(scene), len(x))
    exact = {"gas": (x, settling.gas_density(x, midplane, height), np.zeros_like(x))}
    known = LAWS[given.drag.law].uniform_time if given.drag else None
    if known is None or len(given.dust) > 1:
        return exact
    times = np.full_like(x, known(given.drag))
    z, u = settling.trajectories(time, x, lambda at: times[: len(at)], given.external.vertical_frequency)
    # Grains conserve mass: the density is inversely proportional to their spacing.
    rho = given.dust[0].ratio * settling.gas_density(x, midplane, height) / np.abs(np.gradient(z, x))
    return exact | {"dust": (z, rho, u)}


START = Start(
    Settling,
    particles,
    places,
    settle=settle,
    dimensions=(1,),
    boundary="open",
    eos=("isothermal",),
    reach=("vertical_extent", 1.0),
    rules=(needs_gravity, reaches_its_ends),
    kernel="wendland-c4",  # it responds to every wave of a stretched layer, so that an equilibrium exists
    masses=mass,
    spread=spread,
    measure=measure,
    exact_with=("external",),
    curves=curves,
)
