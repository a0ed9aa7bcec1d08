"""settling: an isothermal gas layer and dust, both at rest, under the acceleration -Omega^2 z (`exact/settling.py`).

The density of the gas is a Gaussian in z. Particles have equal mass. Beyond +-vertical_extent immobile gas supports the
ends of the layer. Its particles have the spacing of the outermost moving particles, and masses that continue the
Gaussian. The equilibrium of SPH differs slightly from the Gaussian. Gas is moved to the equilibrium of SPH, because
sound waves of a layer out of balance would be faster than the fall of small grains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from discsim.initial import concatenate_groups, make_populations, particles_at_rest, random_stream
from discsim.initial.base import Array, Curve, SamplePoints, Start
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.numerics.operators import accelerate
from discsim.parts import LAWS, Lazy
from discsim.scene.fields import Default, Density, Length, Table

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

linalg = Lazy("scipy.linalg")  # slow to import, as are `special` and `smoothing`
special = Lazy("scipy.special")
smoothing = Lazy("discsim.kernels.sph.smoothing")
MARGIN = 2.0  # thickness of the immobile gas in support radii: kernels of moving gas must not reach beyond it
FORCE_ROUNDING = 1e-12  # rounding error of forces, in Omega^2 H
MAX_RESIDUAL = (
    1e-7  # largest net force allowed, in Omega^2 H: well below the drag on falling grains of t_stop Omega 1e-5
)
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


def layer_top(scene: Scene | Draft) -> float:
    """Return the largest height |z| of moving gas: `initial.vertical_extent`, or by default half of space."""
    given: Any = scene
    return given.initial.vertical_extent or 0.5 * given.space.size[0]


def moving_surface_density(scene: Scene) -> float:
    """Return the surface density of the moving gas."""
    start: Any = scene.initial
    height = scale_height(scene)
    return float(start.density * height * np.sqrt(2.0 * np.pi) * special.erf(layer_top(scene) / height / np.sqrt(2.0)))


def particles(scene: Scene) -> dict[str, dict[str, Array]]:
    given: Any = scene
    total, count = moving_surface_density(scene), given.gas.particles
    gas = particles_at_rest(_heights_of_fractions(scene, (np.arange(count) + 0.5) / count)[:, None], total / count)
    gas = _add_immobile_ends(scene, gas)
    gas["density"] = given.initial.density * _gaussian(scene, gas["pos"][:, 0])
    if scene.dust is None:
        return {"gas": gas}
    stream = random_stream(scene, "dust")

    def make_dust(population: Any) -> dict[str, Array]:
        n = population.particles
        if population.placement == "random":
            fraction = stream.random(n)
        else:
            fraction = (np.arange(n) + 0.5) / n + population.offset / count
        return particles_at_rest(_heights_of_fractions(scene, fraction)[:, None], total * population.ratio / n)

    return {"gas": gas, "dust": make_populations(scene, make_dust)}


def _gaussian(scene: Scene, height: Array) -> Array:
    """Return the density of the gas at the heights (n,), divided by its density in the midplane."""
    return np.exp(-0.5 * (height / scale_height(scene)) ** 2)


def _heights_of_fractions(scene: Scene, fraction: Array) -> Array:
    """Return the heights z (n,) below which the given mass fractions (n,) of the moving gas are."""
    height = scale_height(scene)
    inside = special.erf(layer_top(scene) / height / np.sqrt(2.0))
    return np.sqrt(2.0) * height * special.erfinv((2.0 * fraction - 1.0) * inside)


def _add_immobile_ends(scene: Scene, gas: dict[str, Array]) -> dict[str, Array]:
    """Return the arrays `gas` of the moving gas, followed by the immobile gas beyond both ends."""
    given: Any = scene
    top, mass = layer_top(scene), gas["mass"][0]
    spacing = float(mass / given.initial.density / _gaussian(scene, np.array(top)))
    h = given.gas.smoothing_length or given.gas.eta * spacing
    beyond = np.arange(np.ceil(MARGIN * smoothing.SUPPORT[smoothing.KERNELS[given.gas.kernel]] * h / spacing)) + 0.5
    above = top + spacing * beyond
    ends = np.concatenate([-above[::-1], above])
    end = particles_at_rest(ends[:, None], given.initial.density * _gaussian(scene, ends) * spacing)
    whole = concatenate_groups([gas, end])
    whole["immobile"] = np.arange(len(whole["mass"])) >= len(gas["mass"])
    return whole


def settle(state: State, effects: dict[str, Any]) -> None:
    """Move the gas of `state` to positions at which the forces on it cancel, by Newton's method.

    Raises ValueError if net forces above MAX_RESIDUAL remain.
    """
    with effects["gas"].sph.in_double():  # the Jacobian is from differences of forces that nearly cancel
        _settle_in_double(state, effects)


def _settle_in_double(state: State, effects: dict[str, Any]) -> None:
    scene: Any = state.scene
    gas: Any = state.gas
    free = np.flatnonzero(~gas.immobile)
    # Half bandwidth of the Jacobian: the force on a particle depends on this many particles on each side.
    band = int(np.ceil(4.0 * smoothing.SUPPORT[smoothing.KERNELS[scene.gas.kernel]] * scene.gas.eta))
    small = FORCE_ROUNDING * scene.external.vertical_frequency**2 * scale_height(scene)

    def forces(shift: Array) -> Array:
        before = gas.pos[free].copy()
        gas.pos[free, 0] += shift
        for _ in range(2):  # the error of h is squared in each iteration
            for particles in state.species.values():
                particles.acc[:] = 0.0
            for name in ("gas", "external"):
                accelerate(effects[name], state)
        gas.pos[free] = before
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
            f'gas.kernel: with kernel "{scene.gas.kernel}" and eta = {scene.gas.eta:g}, net forces of {left:.2g} '
            'Omega^2 H remain in the layer; set gas.kernel = "wendland-c4" and gas.eta = 2, or lower gas.eta'
        )


def _newton_step(forces: Callable[[Array], Array], force: Array, spacing: Array, band: int) -> Array:
    """Return the displacements (n,) of the particles that cancel the forces on them to first order.

    forces: function that returns the forces (n,) after given displacements (n,). force (n,): forces at the present
    positions. spacing (n,): distances between particles. band: number of diagonals of the Jacobian on each side of its
    main diagonal. The Jacobian is computed from finite differences.
    """
    count, width = len(force), 2 * band + 1
    jacobian = np.zeros((width, count))
    for first in range(width):
        shift = np.zeros(count)
        shift[first::width] = 1e-5 * spacing[first::width]
        change = forces(shift) - force
        for column in range(first, count, width):
            rows = np.arange(max(0, column - band), min(count, column + band + 1))
            jacobian[band + rows - column, column] = change[rows] / shift[column]
    return linalg.solve_banded((band, band), jacobian, -force)


def gravity_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the scene has no vertical gravity."""
    if not (draft.external and draft.external.vertical_frequency > 0):
        path = ("external", "vertical_frequency") if draft.has("external") else ("external",)
        yield path, "a settling layer needs vertical gravity; expected external.vertical_frequency > 0"


def layer_end_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the layer has practically no gas at its ends, or too few particles there.

    Particles of equal mass are farthest apart at the ends. Their spacing there may be at most ten times the length over
    which the density falls by a factor e.
    """
    if not (draft.gas and draft.space and draft.external):
        return
    if not draft.eos.one_speed or draft.external.vertical_frequency == 0.0:
        return
    height = scale_height(draft)
    top = layer_top(draft) / height
    if top > 30.0:
        wrong = f"a layer {2.0 * top:.3g} scale heights thick has practically no gas at its ends"
        yield (
            ("initial", "vertical_extent"),
            f"{wrong}; expected a few scale heights H = c_s / Omega, where H is {height:.3g}",
        )
        return
    share = math.sqrt(2.0 * math.pi) * math.erf(top / math.sqrt(2.0))
    needed = math.ceil(0.1 * share * top * math.exp(0.5 * top * top))
    if draft.gas.particles < needed:
        wrong = f"{draft.gas.particles} particles are too few for a layer that reaches to {top:.3g} scale heights"
        yield ("gas", "particles"), f"{wrong}; choose at least {needed} particles, or lower initial.vertical_extent"


def sample_points(scene: Scene) -> SamplePoints:
    start: Any = scene.initial
    ends = start.density * math.exp(-0.5 * (layer_top(scene) / scale_height(scene)) ** 2)
    return SamplePoints(["midplane", "ends"], np.array([start.density, ends]))


def sample_all_gas(scene: Scene) -> tuple[SamplePoints, Array]:
    weight = _gaussian(scene, np.linspace(0.0, layer_top(scene), PREVIEW_SAMPLES))
    return SamplePoints([], scene.initial.density * weight), weight


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of the heights of grains.

    Return None unless the scene has a single dust population, with a stopping time that is the same everywhere.
    """
    known = LAWS[scene.drag.law].uniform_time if scene.drag else None
    if known is None or len(scene.dust or ()) > 1:
        return None
    from discsim.exact import settling  # imports scipy

    def errors(sim: Simulated) -> dict[str, float]:
        given: Any = scene
        start = particles(scene)["dust"]["pos"][:, 0]
        time, frequency = known(given, given.dust[0]), given.external.vertical_frequency
        height, _ = settling.trajectories(sim.time, start, lambda z: np.full_like(z, time), frequency)
        by_id = np.argsort(sim.dust.ids)
        path = np.abs(height - start)
        return {"dust": float(np.sqrt(((sim.dust.pos[by_id, 0] - height) ** 2).mean()) / path.max())}

    return ErrorMeasure("heights of the grains compared with their equation of motion, over the longest path", errors)


def exact_curves(scene: Scene, time: float, x: Array) -> dict[str, Curve]:
    """Return the exact curves of the gas at rest and of dust.

    There is no curve of dust for several populations, or if its stopping time is not the same everywhere.
    """
    from discsim.exact import settling  # imports scipy

    given: Any = scene
    height, midplane = scale_height(scene), given.initial.density
    x = np.linspace(-layer_top(scene), layer_top(scene), len(x))
    exact = {"gas": (x, settling.gas_density(x, midplane, height), np.zeros_like(x))}
    known = LAWS[given.drag.law].uniform_time if given.drag else None
    if known is None or len(given.dust) > 1:
        return exact
    times = np.full_like(x, known(given, given.dust[0]))
    z, u = settling.trajectories(time, x, lambda at: times[: len(at)], given.external.vertical_frequency)
    # Grains conserve mass: the density is inversely proportional to their spacing.
    rho = given.dust[0].ratio * settling.gas_density(x, midplane, height) / np.abs(np.gradient(z, x))
    return exact | {"dust": (z, rho, u)}


START = Start(
    Settling,
    particles,
    sample_points,
    settle=settle,
    dimensions=(1,),
    boundary="open",
    eos=("isothermal",),
    min_half_side=("vertical_extent", 1.0),
    rules=(gravity_problems, layer_end_problems),
    kernel="wendland-c4",  # its forces oppose waves of any length, so that an equilibrium exists
    region_mass=lambda scene, population: moving_surface_density(scene),
    samples_of_all_gas=sample_all_gas,
    measure=measure,
    exact_effects=("external",),
    exact_curves=exact_curves,
)
