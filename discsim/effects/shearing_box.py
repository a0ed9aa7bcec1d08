"""Shearing box: a plane of radius x and height y of a disc, with the azimuthal velocity `across` of each particle.

    dv_x/dt = 2 Omega v_y + 2 Omega b [gas only],   dv_y/dt = -(2 - q) Omega v_x                            (1)

in addition to pressure and drag. v_y, the azimuthal velocity, is relative to the shear flow -q Omega x, and b is the
headwind eta v_K (Youdin & Johansen 2007, ApJ 662, 613, eqs. (1) to (4)). The box is periodic and has no vertical
gravity, and nothing depends on the azimuth.

Let U be the steady drift of each species with drag (`exact/streaming.py`), and w = v - U. Eq. (1) is the sum of

    epicycle    dw_x/dt = 2 Omega w_y,   dw_y/dt = -(2 - q) Omega w_x                                       (2)
    source      dv_x/dt = 2 Omega (U_y + b [gas only]),   dv_y/dt = -(2 - q) Omega U_x                      (3)

Eq. (2) is solved exactly: over dt, w rotates with the epicyclic frequency kappa = Omega sqrt(2 (2 - q)). The rotation
takes place in halves, before and after the drift. Eq. (3) is part of the relaxation by drag, so that each part of a
step leaves the drift U unchanged. A uniform mixture in drift therefore stays in it to rounding, at any step. The
stopping times in U are those at the mean density of the gas. Without drag, U_x = 0, U_y = -b of gas and 0 of dust, and
the sources vanish. Drag relaxes `across` in the same cells as the other components (`drag/engine.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.base import NO_ROWS
from discsim.effects import base
from discsim.exact import streaming
from discsim.numerics.state import Particles, State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import total, totals
from discsim.parts import LAWS, SCHEMES, Lazy
from discsim.physics.shear import has_mode, mean_box
from discsim.scene.keys import ShearingBox as Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.epicycle")
PARTICLE_COST = 4.0  # CPU nanoseconds in a step, per particle
# Tables of effects that act about a star, on the height, on the azimuthal velocity or on the energy of gas.
FOREIGN = (
    "star", "companion", "background", "self_gravity", "radiation_pressure", "alpha_viscosity", "cooling", "damping",
    "growth", "dust_diffusion",
)  # fmt: skip
CELLS_IN_WAVE = 16  # least number of drag cells in a wavelength, for growth rates within 3% with the scheme tsc
PAIRS_RESIST = 0.999  # share of the mean pressure below which pairs of gas particles resist shear noticeably


def _space_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a space that is no periodic plane, of other effects, and of stratified gas."""
    where = ("shearing_box",)
    if draft.dimensions != 2 or (draft.space and draft.space.boundary != "periodic"):
        wrong = "a shearing box is a periodic plane of radius and height"
        yield where, f'{wrong}; set space.dimensions = 2 and space.boundary = "periodic"'
    for name in FOREIGN:
        if draft.has(name):
            yield (name,), f"a shearing box does not allow [{name}]; remove [{name}] or [shearing_box]"
    if draft.external is not None and draft.external.vertical_frequency > 0.0:
        wrong = "a shearing box has no vertical gravity"
        yield ("external", "vertical_frequency"), f"{wrong}; remove this key, or [shearing_box]"
    if draft.gas and draft.eos_kind is not None and draft.eos_kind != "isothermal":
        wrong = f'a shearing box needs isothermal gas, but gas.eos.kind is "{draft.eos_kind}"'
        yield ("gas", "eos", "kind"), f'{wrong}; set gas.eos.kind = "isothermal"'


def _drag_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of drag whose azimuthal component cannot be relaxed by itself."""
    if draft.drag is None:
        return
    scheme, law = draft.drag.scheme, LAWS[draft.drag.law]
    if not SCHEMES[scheme].by_component:
        wrong = f'drag.scheme "{scheme}" acts along the line between two particles, which has no azimuthal component'
        yield ("drag", "scheme"), f"{wrong}; choose another scheme, or remove [shearing_box]"
    if draft.drag.supersonic or law.needs_mean_free_path:
        key = "supersonic" if draft.drag.supersonic else "law"
        wrong = "the stopping time depends on the slip, whose azimuthal component drag cells do not have"
        yield ("drag", key), f'{wrong}; set drag.supersonic = false and drag.law = "stopping-time" or "constant"'


class Effect(base.Effect):
    """Rotation and shear of a disc in a small periodic box. drift: steady drift U by species, (populations, 2)."""

    keys = Keys
    rules = (_space_problems, _drag_problems)
    from_start = ("drift",)

    def __init__(self, scene: Scene, state: State) -> None:
        self.box = scene.table("shearing_box")
        self.drift: dict[str, np.ndarray] = {}
        self.kappa = self.box.omega * math.sqrt(2.0 * (2.0 - self.box.shear))

    def begin(self, state: State, effects: Mapping[str, base.Effect]) -> None:
        """Find the drift U, and set the azimuthal part of eq. (3), `across_acc`, of all particles."""
        found = streaming.drift(mean_box(state.scene, *_mean_densities(state)))
        self.drift = {"gas": found[:1], "dust": found[1:]}
        for name, p in state.species.items():
            rate = -(2.0 - self.box.shear) * self.box.omega * self.drift[name][:, 0]
            p.across_acc[:] = rate[_populations(p)] if name == "dust" else rate[0]

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return PARTICLE_COST * (counts.gas + counts.dust)

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        return base.Expected(1.0 / scene.table("shearing_box").omega, "from shearing_box.omega")

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(_report_rows(scene, at), _report_warnings(scene, at))

    def operators(self, state: State) -> list[base.Operator]:
        species = base.arrays("dust", "species") if state.dust is not None else frozenset()
        acc = base.arrays(state.species, "acc_unshared")
        return [
            base.Operator("shearing_box.push", base.Slot.FORCE, self.accelerate, species, acc),
            base.Operator("shearing_box.limit", base.Slot.LIMIT, self.limit),
            base.Operator("shearing_box.epicycle", base.Slot.AROUND_DRIFT, self.rotate),
        ]

    def accelerate(self, view: base.View) -> None:
        """Add the radial part of eq. (3) to `acc_unshared` of gas and dust."""
        for name, p in view.species.items():
            push = 2.0 * self.box.omega * (self.drift[name][:, 1] + (self.box.headwind if name == "gas" else 0.0))
            acc = p.acc_unshared
            acc[:, 0] += push[p.species] if name == "dust" else push[0]

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        # The rotation is exact, but steps beyond 1 / Omega do not resolve its coupling to drag and pressure.
        return {base.ALL: base.Limit(1.0 / self.box.omega, math.inf)}

    def rotate(self, state: State, dt: float) -> None:
        """Rotate velocities over dt, eq. (2)."""
        angle, ratio = self.kappa * dt, 2.0 * self.box.omega / self.kappa
        turn = math.cos(angle), ratio * math.sin(angle), math.sin(angle) / ratio
        for name, p in state.species.items():
            parallel_for(kernels.rotate, p.count, _populations(p), self.drift[name], *turn, p.vel, p.across, light=True)


def _populations(particles: Particles) -> np.ndarray:
    """Return the population (n,) of each dust particle; an empty array for gas."""
    return getattr(particles, "species", NO_ROWS)


def _mean_densities(state: State) -> tuple[float, np.ndarray]:
    """Return the mean density of the gas, and the mass of each population of dust divided by that of the gas."""
    gas, dust, count = state.gas, state.dust, len(state.scene.dust or ())
    if gas is None or dust is None:
        return 1.0, np.zeros(count)
    mass = total(gas.mass)
    of_dust = totals(np.where(dust.species[:, None] == np.arange(count), dust.mass[:, None], 0.0))
    return mass / float(np.prod(state.scene.space.size)), of_dust / mass


def _report_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield the drift of gas and dust, and the growth rate of a wave with the given numbers of wavelengths."""
    density = 1.0 if at.density is None else float(at.density[0])
    box = mean_box(scene, density, [dust.ratio for dust in scene.dust or ()])
    for name, (radial, azimuthal) in zip(["gas", *scene.dust_phrases], streaming.drift(box), strict=True):
        if name != "gas" or scene.gas is not None:
            speeds = (scene.units.show(float(v), "velocity") for v in (radial, azimuthal))
            yield f"steady drift of {name}", "radial {}, azimuthal {}".format(*speeds)
    if has_mode(scene) and scene.dust and scene.gas:
        waves = _wavelengths(scene)
        rate = streaming.fastest_mode(box, *2.0 * np.pi * waves / np.array(scene.space.size)).rate
        text = f"{rate.real / box.omega:.5g} Omega, frequency {rate.imag / box.omega:.5g} Omega"
        yield f"growth rate of {waves[0]:g} x {waves[1]:g} waves", text


def _wavelengths(scene: Scene) -> np.ndarray:
    """Return the numbers of wavelengths along radius and height: those of the start, or 1 each."""
    return np.array(getattr(scene.initial, "wavelengths", (1, 1)), float)


def _report_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield warnings about gas whose pairs resist shear, and about waves with few drag cells."""
    quiet = scene.gas.quiet if scene.gas is not None else None
    if scene.gas is not None and (quiet is None or quiet.share < PAIRS_RESIST):
        yield (
            "pairs of gas particles with the full mean pressure resist shear like a crystal, and growth rates in a "
            "shearing box are wrong: set gas.quiet = {share = 1}"
        )
    found = at.in_drag_cells() if scene.dust and scene.drag else None
    if found is None or not any(_wavelengths(scene)):
        return
    waves = np.maximum(_wavelengths(scene), 1e-300)
    cells = float((np.array(scene.space.size) / waves).min() / found[0][0])
    if cells < CELLS_IN_WAVE:
        yield (
            f"{cells:.3g} drag cells in a wavelength, below {CELLS_IN_WAVE}: growth rates are wrong by more than 3%: "
            f"raise gas.particles and dust.particles by a factor of {(CELLS_IN_WAVE / cells) ** 2:.3g}"
        )
