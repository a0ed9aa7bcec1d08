"""Accretion of gas from the cells of a polar grid by companions.

In a step dt a companion of mass m takes the fraction c (1 - exp(-f dt)) of the gas in each cell. c is the part of the
cell within the accretion radius R: (R - d) / side + 1/2 between 0 and 1, with the distance d of the centroid and the
side of the cell. The rate is f = `accretion_rate` / P, the mean of the accretion of particles, or else the orbital
frequency sqrt(G m / R^3) at the radius, about as fast as gas can follow (compare Kley 1999, MNRAS 303, 696). Gas below
the fraction FLOOR of the largest surface density is not taken.

The velocity of the gas that stays does not change. Mass and momentum of gas and live companion are exact. The ledger
has the angular momentum that accreted gas has about the companion, which has no spin.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import companion
from discsim.effects.accretion import Accreted, add_to_body
from discsim.formulas.polar import FLOOR
from discsim.numerics import world
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import total
from discsim.parts import Lazy
from discsim.physics.polar import cell_sides

if TYPE_CHECKING:
    from discsim.numerics.bodies import Bodies
    from discsim.numerics.state import State

kernels = Lazy("discsim.kernels.gravity.point_masses")
growth = Lazy("discsim.physics.growth")


def _spin(mass: np.ndarray, pos: np.ndarray, vel: np.ndarray) -> np.ndarray:
    """Return angular momenta (k,) about the origin."""
    return mass * (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])


class Companion(companion.Effect):
    """Companions that take gas from polar cells, and dust as particles."""

    def _accrete(self, state: State, k: int, name: str, position: list[float]) -> None:
        if name != "gas":
            super()._accrete(state, k, name, position)
            return
        p, scene = state.gas, self.scene
        radius, sides = self.companions[k].accretion_radius, cell_sides(scene, p.h)
        reach = radius + 0.5 * float(sides.max(initial=0.0))
        found = parallel_for(kernels.split_by_radius, p.count, p.pos, reach**2, *position)
        rows = np.concatenate([inside for _, inside in found])
        pos, vel, mass, side = p.pos[rows], p.vel[rows], p.mass[rows], sides[rows]
        covered = np.clip((radius - np.sqrt(((pos - position) ** 2).sum(axis=1))) / side + 0.5, 0.0, 1.0)
        densest = world.processes.max(float(p.density.max(initial=0.0)))
        left = np.minimum(FLOOR * densest * side**2, mass)
        gone = covered * -math.expm1(-self._accretion_rate(state.bodies, k) * self._dt) * (mass - left)
        small = np.zeros(len(rows)) if p.small is None else p.small[rows] * (gone / mass)
        included = small if p.small is not None and growth.gas_mass_includes_small_dust(scene) else 0.0
        masses, live = Accreted(total(gone), total(gone - included), total(small)), bool(self.orbits.live[k])
        before = self._spin_of_companion(state.bodies, k)
        add_to_body(state, k + 1, name, (gone, pos, vel), masses, grows=True, moves=live)
        if live:
            gained = self._spin_of_companion(state.bodies, k) - before
            state.ledger.accreted_angular_momentum += total(_spin(gone, pos, vel)) - gained
        p.mass[rows] = mass - gone
        if p.small is not None:
            p.small[rows] -= small
        if p.radiated is not None:
            p.radiated[rows] *= mass / p.mass[rows]

    def _spin_of_companion(self, bodies: Bodies, k: int) -> float:
        """Return the angular momentum of companion `k` about the origin."""
        one = slice(k + 1, k + 2)
        return float(_spin(bodies.mass[one], bodies.pos[one], bodies.vel[one])[0])

    def _accretion_rate(self, bodies: Bodies, k: int) -> float:
        """Return the rate at which companion `k` takes gas within its accretion radius."""
        keys = self.companions[k]
        if keys.accretion_rate is not None:
            return keys.accretion_rate / self.period(bodies, k)
        return math.sqrt(float(bodies.mass[k + 1]) / keys.accretion_radius**3)
