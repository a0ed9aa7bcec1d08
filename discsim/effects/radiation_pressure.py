"""Radiation pressure on dust: a = beta G M r / (r^2 + s^2)^(3/2), beta = F_rad / F_grav of a population.

M and s are mass and softening of the star, the only source of radiation. Gas does not feel this force, so the drag
solution includes it as an acceleration of dust alone. If dust drifts on Kepler orbits, which needs a scene without
drag, the central mass of these orbits is (1 - beta) M, and there is no step limit. Otherwise the step limit is half of
sqrt((r^2 + s^2)^(3/2) / (beta G M)) of the innermost grain; in a prescribed disc it is twice as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.effects.star import expected_orbit_limit, orbit_limit
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy
from discsim.physics.orbits import IN_KICKS, star_acts_in_drift
from discsim.physics.radiation import gravity_factor
from discsim.scene.keys import RadiationPressure as Keys
from discsim.scene.rules import Draft, Problem, missing_tables

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.radiation")
stars = Lazy("discsim.kernels.gravity.point_masses")
GRAIN_COST = 6.0  # CPU nanoseconds in a step, per grain


def _scene_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene without a star, or without dust particles."""
    reasons = {"dust": "radiation pressure acts on dust", "star": "radiation pressure needs a star"}
    yield from missing_tables(draft, ("radiation_pressure",), reasons)
    yield from base.grid_scheme_problems(draft, "radiation_pressure", "radiation pressure")


def _beta_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a wrong number of betas, and of grains with beta >= 1 that start on circular orbits."""
    beta, populations = draft.radiation_pressure.beta, len(draft.dust or ())
    if draft.dust and len(beta) not in (1, populations):
        wrong = f"{len(beta)} numbers for {populations} populations of dust"
        yield (
            ("radiation_pressure", "beta"),
            f"{wrong}; give one number, or one number for each population",
        )
    if max(beta) < 1.0 or not draft.start or draft.start.radial is None:
        return
    if not draft.has("drag") or getattr(draft.initial, "dust_velocity", None) == "balance":
        wrong = f"beta = {max(beta):g} is at least 1, so grains have no circular orbit"
        words = 'lower beta, or add [drag] with initial.dust_velocity = "drift"'
        yield ("radiation_pressure", "beta"), f"{wrong}; {words}"


class Effect(base.Effect):
    """Radiation pressure of the star on the dust."""

    keys = Keys
    rules = (_scene_problems, _beta_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.softening = scene.star.softening
        self.beta = 1.0 - gravity_factor(scene)  # of each population
        self.in_drift, self.step = star_acts_in_drift(scene), _relative_step(scene)

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return GRAIN_COST * counts.dust

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        strongest = float((1.0 - gravity_factor(scene)).max()) * scene.star.mass
        return expected_orbit_limit(scene, outlook, strongest, _relative_step(scene))

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        beta = 1.0 - float(gravity_factor(scene).min())
        text = (
            f"radiation_pressure.beta = {beta:g}: grains with beta >= 1 are unbound, and only gas drag holds "
            "them back; lower beta below 1 for bound grains"
        )
        return base.Report(warnings=[text] if beta >= 1.0 and scene.drag is not None else [])

    def operators(self, state: State) -> list[base.Operator]:
        reads, of = base.arrays("dust", "pos species") | {"bodies"}, base.Slot
        force, acc = of.DRIFT_FORCE if self.in_drift else of.FORCE, base.arrays("dust", "acc_unshared")
        return [
            base.Operator("radiation_pressure.push", force, self.accelerate, reads, acc),
            base.Operator("radiation_pressure.limit", of.LIMIT, self.limit, reads),
        ]

    def accelerate(self, view: base.View) -> None:
        """Add the acceleration by radiation pressure to `acc_unshared` of the dust."""
        dust, strength = view.dust, view.star_mass * self.beta
        away = view.from_star(dust.pos)
        given = away, dust.species, strength, self.softening, dust.acc_unshared
        parallel_for(kernels.add_radiation_pressure, dust.count, *given)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        strongest, dust = view.star_mass * self.beta.max(), view.dust
        if dust.count == 0 or strongest == 0.0 or self.step == np.inf:
            return {}
        distance2 = min(parallel_for(stars.nearest_squared, dust.count, dust.pos, *view.star_place))
        softened2 = distance2 + self.softening**2
        return {"dust": orbit_limit(dust.pos, view.star_place, softened2, strongest, self.step, base.GROWS / IN_KICKS)}

    def potential_energy(self, state: State) -> float:
        dust, star = state.dust, np.array(state.star_place)
        return -state.star_mass * base.point_mass_energy(dust, star, self.beta[dust.species], self.softening)


def _relative_step(scene: Scene) -> float:
    """Return the step limit divided by sqrt((r^2 + s^2)^(3/2) / (beta G M)); inf if the force acts in the drift."""
    if star_acts_in_drift(scene):
        return float("inf")
    return IN_KICKS if scene.model.given is None else 1.0
