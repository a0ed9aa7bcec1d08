"""Radiation pressure on dust: a = beta G M r / (r^2 + s^2)^(3/2), beta = F_rad / F_grav of a population.

M and s are mass and softening of the star, the only source of radiation. Gas does not feel this force, so the drag
solution includes it as an acceleration of dust alone. If dust drifts on Kepler orbits, which needs a scene without
drag, the central mass of these orbits is (1 - beta) M, and there is no step limit. Otherwise the step limit is half of
sqrt((r^2 + s^2)^(3/2) / (beta G M)) of the innermost grain; in a given disc it is twice as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.effects.star import SOFTER, nearest_row
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import total
from discsim.parts import SCHEMES, Lazy
from discsim.physics.local import Expected
from discsim.physics.orbits import IN_KICKS, in_drift
from discsim.physics.radiation import pull_share
from discsim.scene.keys.radiation_pressure import Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.physics.local import Local, Outlook
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.radiation")
stars = Lazy("discsim.kernels.gravity.point_masses")
GRAIN_COST = 6.0  # CPU nanoseconds in a step, per grain


def _needs_dust_and_star(draft: Draft) -> Iterator[Problem]:
    for table, what in (("dust", "acts on dust"), ("star", "needs a star")):
        if not draft.has(table):
            yield ("radiation_pressure",), f"radiation pressure {what}; expected a table [{table}] too"


def _one_beta_per_population(draft: Draft) -> Iterator[Problem]:
    given, there = len(draft.radiation_pressure.beta), len(draft.dust or ())
    if draft.dust and given not in (1, there):
        yield (
            ("radiation_pressure", "beta"),
            f"{given} numbers for {there} populations of dust; expected {there}, or one",
        )


def _needs_dust_particles(draft: Draft) -> Iterator[Problem]:
    if draft.drag and SCHEMES[draft.drag.scheme].on_grid:
        yield (
            ("radiation_pressure",),
            f'drag.scheme "{draft.drag.scheme}" has no radiation pressure; expected another drag.scheme',
        )


def _unbound_grains(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of beta >= 1 for grains that start on circular orbits."""
    most = max(draft.radiation_pressure.beta)
    if most < 1.0 or not draft.start or draft.start.radial is None:
        return
    if not draft.has("drag") or getattr(draft.initial, "dust_velocity", None) == "balance":
        yield (
            ("radiation_pressure", "beta"),
            f"beta = {most:g} is at least 1, so grains have no circular orbit; expected less than 1, or "
            '[drag] with initial.dust_velocity = "drift"',
        )


class Effect(base.Effect):
    keys = Keys
    rules = (_needs_dust_and_star, _one_beta_per_population, _needs_dust_particles, _unbound_grains)

    def __init__(self, scene: Scene, state: State) -> None:
        assert scene.star is not None
        self.softening = scene.star.softening
        self.share = 1.0 - pull_share(scene)  # beta of each population
        self.in_drift, self.step = in_drift(scene), _relative_step(scene)

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return GRAIN_COST * counts.dust

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: Outlook) -> Expected:
        strongest, step = float((1.0 - pull_share(scene)).max()) * scene.star.mass, _relative_step(scene)
        if outlook.nearest == np.inf or strongest == 0.0 or step == np.inf:
            return Expected()
        away = float(np.hypot(outlook.nearest, scene.star.softening))
        return Expected(step * (away**3 / strongest) ** 0.5, f"at {scene.units.show(outlook.nearest, 'length')}")

    @classmethod
    def report(cls, scene: Scene, at: Local) -> base.Report:
        return base.Report(warnings=cls._warnings(scene))

    @classmethod
    def _warnings(cls, scene: Scene) -> Iterator[str]:
        most = 1.0 - float(pull_share(scene).min())
        if most >= 1.0 and scene.drag is not None:
            yield (
                f"radiation_pressure.beta = {most:g}: grains with beta >= 1 are unbound, and only gas drag holds "
                "them back; expected less than 1 for bound grains"
            )

    def operators(self, state: State) -> list[base.Operator]:
        reads, of = base.arrays("dust", "pos species") | {"bodies"}, base.Slot
        force, acc = of.DRIFT_FORCE if self.in_drift else of.FORCE, base.arrays("dust", "acc_unshared")
        return [
            base.Operator("radiation_pressure.push", force, self.accelerate, reads, acc),
            base.Operator("radiation_pressure.limit", of.LIMIT, self.limit, reads),
        ]

    def accelerate(self, view: base.View) -> None:
        dust, strength = view.dust, view.star_mass * self.share
        away = view.from_star(dust.pos)
        parallel_for(kernels.push, dust.count, away, dust.species, strength, self.softening, dust.acc_unshared)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        strongest, pos = view.star_mass * self.share.max(), view.dust.pos
        if len(pos) == 0 or strongest == 0.0 or self.step == np.inf:
            return {}
        distance2 = min(parallel_for(stars.nearest, len(pos), pos, *view.star_place))
        step = self.step * float(((distance2 + self.softening**2) ** 1.5 / strongest) ** 0.5)
        return {
            "dust": base.Limit(step, base.GROWS / IN_KICKS * step, partial(nearest_row, pos, view.star_place), SOFTER)
        }

    def potential_energy(self, state: State) -> float:
        dust = state.dust
        distance = np.sqrt((state.from_star(dust.pos) ** 2).sum(axis=1) + self.softening**2)
        return state.star_mass * total(dust.mass * self.share[dust.species] / distance)


def _relative_step(scene: Scene) -> float:
    """Return the step limit divided by sqrt((r^2 + s^2)^(3/2) / (beta G M)); inf if the force acts in the drift."""
    if in_drift(scene):
        return float("inf")
    return IN_KICKS if scene.model.given is None else 1.0
