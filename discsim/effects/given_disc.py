"""The gas as a given disc (`[background]`), and dust in it with one-way drag: no SPH, no cells, no grid.

Sigma ~ r^-p, c_s^2 ~ r^-q, turning in balance, Omega_g^2 r = GM r / (r^2 + s^2)^(3/2) + (1/Sigma) dP/dr. The kick
relaxes each particle exactly to its steady drift there (`kernels/background.py`), and limits no step. Dust moves with
its radial velocity and angular momentum (eq. 1 there), so that circles stay circles.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from discsim.drag import cautions
from discsim.effects import base, dust
from discsim.effects.drag import OF_CELLS
from discsim.effects.stopping import stopping_columns
from discsim.numerics.state import State
from discsim.numerics.threads import share
from discsim.parts import EOS, Lazy
from discsim.physics.given_disc import GivenDisc
from discsim.physics.laws import SceneLaw
from discsim.scene.fields import Length, Number, SurfaceDensity, Table, kinds_of
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.physics.local import Local
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.background")
KICKED = 150.0  # CPU nanoseconds of a particle in a step
EosWithoutHeat: Any = kinds_of(eos for eos in EOS.values() if not eos.holds_heat)


class Keys(Table):
    """The gas as a given disc in balance about the star, instead of [gas]; it drags the dust and nothing moves it."""

    surface_density: SurfaceDensity = Field(gt=0, description="Sigma at reference_radius")
    surface_density_index: Number = Field(1.0, description="p in Sigma ~ r^-p")
    reference_radius: Length = Field(1.0, gt=0, description="where surface_density holds")
    eos: EosWithoutHeat = Field(description="equation of state")


def _alone_about_a_star(draft: Draft) -> Iterator[Problem]:
    if draft.has("gas"):
        yield ("background",), "[gas] is there too; expected one of the two: SPH gas, or gas as a given disc"
    for table, why in (("dust", "moves in it"), ("star", "it turns about"), ("drag", "couples dust to it")):
        if not draft.has(table):
            yield ("background",), f"nothing {why}; expected a table [{table}] too"
    if draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        yield ("space",), 'a [background] is a disc; expected dimensions = 2 and boundary = "open"'
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), 'dust in a [background] needs "kdk"'
    if draft.drag and draft.drag.direction != "one-way":
        yield ("drag", "direction"), 'nothing moves a [background]; expected direction = "one-way"'


class Background(base.Effect):
    """The table alone: it says of what the drag is made, and moves nothing."""

    keys = Keys
    rules = (_alone_about_a_star,)
    runs = False


class Dust(dust.Effect):
    def move(self, state: State, dt: float) -> None:
        share(kernels.drift_dust, state.dust.count, state.dust.pos, state.dust.vel, dt)


class Drag(base.Effect):
    is_kick = True
    acts_on = ()

    def __init__(self, scene: Scene, state: State) -> None:
        self.law = SceneLaw(scene)
        self.ratios = np.array([population.ratio for population in scene.dust])
        self.star = scene.star
        self.disc = GivenDisc(scene)

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return KICKED * counts.dust

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return OF_CELLS

    @classmethod
    def warnings(cls, scene: Scene, at: Local) -> Iterator[str]:
        return cautions.warnings(scene, at)

    def kick(self, state: State, dt: float) -> None:
        self._relax(state, state.dust.vel, dt)

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Stopping times of the dust where it is now (n,); changes no velocity."""
        return self._relax(state, state.dust.vel.copy(), 0.0)

    def columns(self, state: State) -> dict[str, dict[str, np.ndarray]]:
        return stopping_columns(state, self.current_stopping_times(state))

    def drift(self, state: State) -> np.ndarray:
        """Radial and azimuthal velocity (n, 2) of the dust's steady drift, the latter beyond Kepler's."""
        grains, out = state.dust, np.empty_like(state.dust.vel)
        share(kernels.path_velocities, grains.count, grains.pos, grains.species, self._disc(state), out)
        return out

    def _disc(self, state: State) -> Any:
        """What kernels take of the law, the star and the gas."""
        law = self.law.code, self.law.grains, self.law.nonlinear, self.ratios
        return kernels.Disc(*law, state.star_mass, self.star.softening, self.disc.laws)

    def _relax(self, state: State, vel: np.ndarray, dt: float) -> np.ndarray:
        p = state.dust
        times = np.empty(p.count)
        share(kernels.kick_dust, p.count, p.pos, vel, p.acc, p.species, self._disc(state), state.lag, dt, times)
        return times
