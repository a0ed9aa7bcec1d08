"""Prescribed gas disc (`[background]`) and one-way drag of dust in it, without SPH, drag cells or grid.

Sigma and temperature are functions of radius (`physics/given_disc.py`). The gas rotates in radial balance, Omega_g^2 r
= GM r / (r^2 + s^2)^(3/2) + (1/Sigma) dP/dr, with the star's softening s. The kick integrates the relaxation of each
particle to the steady drift at its position exactly, and sets no time-step limit. The drift keeps radial velocity and
angular momentum constant, so that circular orbits stay circular. Equations are in `kernels/dust/background.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.effects import base, dust
from discsim.effects.drag import OF_CELLS
from discsim.effects.drag_base import DragEffect
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import EOS, Lazy
from discsim.physics.centre import central_mass
from discsim.physics.given_disc import PrescribedDisc
from discsim.physics.laws import SceneLaw
from discsim.physics.radiation import gravity_factor
from discsim.scene.keys import Background as Keys
from discsim.scene.rules import Draft, Problem, missing_tables, quoted

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.background")
GRAIN_COST = 150.0  # CPU nanoseconds in a step, per particle


# Reasons why a [background] needs other tables, for messages.
NEEDS = {"dust": "is useful only with dust", "star": "orbits a star", "drag": "acts on dust only by drag"}


def _scene_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a [background] with [gas], without dust, star or drag, or in an unsuitable space."""
    if draft.has("gas"):
        yield ("background",), "[gas] is also given; keep [gas] (gas that moves) or [background] (prescribed disc)"
    yield from missing_tables(draft, ("background",), {name: f"a [background] {why}" for name, why in NEEDS.items()})
    if draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        yield ("space",), '[background] is a 2D disc; set space.dimensions = 2 and space.boundary = "open"'
    if draft.run and draft.run.integrator != "kdk":
        yield ("run", "integrator"), 'the integrator does not support [background]; set run.integrator = "kdk"'
    if draft.drag and draft.drag.direction != "one-way":
        yield ("drag", "direction"), 'dust cannot act on a [background]; set drag.direction = "one-way"'


def _density_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a [background] with no density or two, and of columns of its file that have no meaning."""
    given = draft.background
    if given.file is None:
        if given.surface_density is None:
            yield ("background",), "no surface density is given; add the key surface_density, or file"
        return
    for key in ("surface_density", "surface_density_index"):
        if draft.gives("background", key):
            yield ("background", key), f"background.file is also given; keep file or {key}"
    if given.file.has("resolution"):
        wrong = "the file has a column resolution, but [background] has no particles"
        yield ("background", "file"), f"{wrong}; remove the column"
    usable = [name for name in EOS if EOS[name].takes_temperature and not EOS[name].holds_heat]
    if given.file.has("T") and given.eos.kind not in usable:
        wrong = f'the file has a column T, but background.eos.kind "{given.eos.kind}" does not use it'
        yield ("background", "file"), f"{wrong}; set background.eos.kind = {quoted(usable)}, or remove the column T"


class Background(base.Effect):
    """Effect of the table [background], which only configures drag and dust."""

    keys = Keys
    role = base.Role(table_only=True)
    rules = (_scene_problems, _density_problems)


class Dust(dust.Effect):
    """Dust that moves with constant radial velocity and angular momentum."""

    def drift(self, state: State, dt: float) -> None:
        parallel_for(kernels.drift_dust, state.dust.count, state.dust.pos, state.dust.vel, dt)


class Drag(DragEffect):
    """One-way drag of the dust by the prescribed disc. stopping_times (n,): of the dust at the last kick."""

    def __init__(self, scene: Scene, state: State) -> None:
        self.law = SceneLaw(scene)
        self.ratios = np.array([population.ratio for population in scene.dust])
        self.pull = gravity_factor(scene)
        self.scene, self.star = scene, scene.star
        self.disc = PrescribedDisc(scene)
        self.gas = self.disc.laws, *self.disc.table()
        self.stopping_times = np.empty(0)

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return GRAIN_COST * counts.dust

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return OF_CELLS

    def operators(self, state: State) -> list[base.Operator]:
        return [base.Operator("drag.kick", base.Slot.KICK, self.kick)]

    def kick(self, state: State, dt: float) -> None:
        """Kick the dust over dt, and store its stopping times."""
        self.stopping_times = self._relax(state, state.dust.vel, dt)

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Return the stopping times (n,) of the dust at its present positions. Velocities do not change."""
        return self._relax(state, state.dust.vel.copy(), 0.0)

    def steady_drift(self, pos: np.ndarray, species: np.ndarray, size: np.ndarray | None = None) -> np.ndarray:
        """Return the velocities (n, 2) of the steady drift: radial, and azimuthal relative to the Keplerian velocity.

        pos (n, 2): positions. species (n,): populations. size (n,): grain sizes, if they differ within a population.
        The star has its initial mass.
        """
        out = np.empty_like(pos)
        row, disc = self._rows_and_disc(central_mass(self.scene), species, size)
        parallel_for(kernels.path_velocities, len(pos), pos, row, disc, out)
        return out

    def kernel_disc(self, central_mass: float) -> Any:
        """Return the parameters of drag law, radiation pressure, star and gas for the kernels.

        The parameters of drag law and radiation pressure have a row for each population.
        """
        law = self.law.code, self.law.grains, self.law.nonlinear, self.ratios, self.pull
        return kernels.Disc(*law, central_mass, self.star.softening, *self.gas)

    def _rows_and_disc(
        self, central_mass: float, species: np.ndarray, size: np.ndarray | None
    ) -> tuple[np.ndarray, Any]:
        """Return (row, disc) for the kernels, from the populations `species` (n,) and sizes `size` (n,) of grains.

        row (n,): index of each grain's parameters in `disc`. disc: result of `kernel_disc` with a row for each
        population or, if grain sizes are given, for each grain.
        """
        disc = self.kernel_disc(central_mass)
        if size is None:
            return species, disc
        grains = self.law.rows(species, size)
        return np.arange(len(size)), disc._replace(grains=grains, ratios=self.ratios[species], pull=self.pull[species])

    def _relax(self, state: State, vel: np.ndarray, dt: float) -> np.ndarray:
        """Kick the dust velocities `vel` (n, 2) in place over dt, and return the stopping times (n,)."""
        p = state.dust
        times = np.empty(p.count)
        row, disc = self._rows_and_disc(state.central_mass, p.species, p.size)
        parallel_for(kernels.kick_dust, p.count, p.pos, vel, p.acc, row, disc, state.velocity_lag, dt, times)
        return times
