"""Wave damping in zones at the edges of a disc: dv/dt = -(v - v*(r)) R(r), solved exactly at any step.

R = x^2 / tau (de Val-Borro et al. 2006, sec. 3.2). x rises from 0 at the end of a zone that faces the disc to 1 at its
far end, and tau is `time` orbits at the far end. v*(r) is the initial velocity at radius r: the rotation in balance of
the gas, and the drift of the dust. If the start defines neither (a snapshot, own particles), v*(r) is the initial
velocity of the particles, averaged over azimuth.

The ledger records the momentum and angular momentum that damping removes. Damping sets no time-step limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.initial import balance
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import rounded
from discsim.parts import Lazy
from discsim.physics.centre import kepler_omega
from discsim.physics.orbits import masses_in_drift
from discsim.scene.keys.damping import Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.physics.local import Local
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.common.damping")
PARTICLE_COST = 12.0  # CPU nanoseconds in a step, per particle
NODES, BEYOND = 4096, 8.0  # number of nodes of the table of v* in ln r, and factor in r of its margin beyond the zones
NO_SPECIES = np.zeros(0, np.int64)


def _zones(draft: Draft) -> Iterator[Problem]:
    damping = draft.damping
    if damping.inner is None and damping.outer is None:
        yield ("damping",), "no damping zone is given; expected inner = [from, to], outer = [from, to], or both"
    for key in ("inner", "outer"):
        zone = getattr(damping, key)
        if zone is not None and not 0.0 < zone[0] < zone[1]:
            yield ("damping", key), "the two radii are not increasing; expected [from, to] with 0 < from < to"


def _needs_star(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star"):
        yield (
            ("damping",),
            "damping times are in orbits about a star, but there is no [star]; expected a table [star] too",
        )
    elif draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        yield ("space",), 'damping zones are rings about a star; expected dimensions = 2 and boundary = "open"'


class Effect(base.Effect):
    keys = Keys
    rules = (_zones, _needs_star)
    from_start = ("zones",)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return PARTICLE_COST * (counts.gas + counts.dust)

    @classmethod
    def report(cls, scene: Scene, at: Local) -> base.Report:
        return base.Report(warnings=cls._warnings(scene))

    @classmethod
    def _warnings(cls, scene: Scene) -> Iterator[str]:
        inner, outer = scene.table("damping").inner, scene.table("damping").outer
        if inner and outer and inner[1] > outer[0]:
            yield "damping.inner overlaps damping.outer, so all gas is damped: leave a gap between the two zones"

    def begin(self, state: State, effects: Mapping[str, base.Effect]) -> None:
        keys = self.scene.table("damping")
        ends = [(zone[::-1], zone[0]) for zone in (keys.inner,) if zone] + [
            (zone, zone[1]) for zone in (keys.outer,) if zone
        ]
        rates = [float(kepler_omega(self.scene, far)) / (2.0 * math.pi * keys.time) for _, far in ends]
        first, last = (math.log(pick(r for zone, _ in ends for r in zone)) for pick in (min, max))
        first, last = first - math.log(BEYOND), last + math.log(BEYOND)
        radius = np.exp(np.linspace(first, last, NODES))
        circles = radius * kepler_omega(self.scene, radius)
        self.zones = kernels.Zones(
            np.array([[*ends_of, rate] for (ends_of, _), rate in zip(ends, rates, strict=True)]),
            first,
            (NODES - 1) / (last - first),
            balance.tabulated(state, dict(effects), radius) / circles[:, None],
            *state.central,
            self._pull_in_drift(state),
        )

    def _pull_in_drift(self, state: State) -> np.ndarray:
        """Return the fractions of the star's pull that act in the drift: for the gas, then for each dust population."""
        found = []
        for name in state.species:
            masses = masses_in_drift(self.scene, name)
            kinds = 1 if name == "gas" else len(self.scene.dust)
            found.append(np.zeros(kinds) if masses is None else masses / self.scene.star.mass)
        return np.concatenate(found)

    def operators(self, state: State) -> list[base.Operator]:
        return [base.Operator("damping.zones", base.Slot.AROUND_DRIFT, self.operate)]

    def operate(self, state: State, dt: float) -> None:
        ahead = 0.0 if self.scene.model.given is not None else -state.lag
        zones = self.zones._replace(star=state.central_mass)  # a growing star speeds up circular orbits
        for name, p in state.species.items():
            kind = 0 if name == "gas" else int(state.gas is not None)
            species = NO_SPECIES if name == "gas" else p.species  # type: ignore[attr-defined]
            given = p.pos, p.vel, p.mass, species, kind, self.centre(state), zones, ahead, dt
            lost = rounded(sum(parallel_for(kernels.relax, p.count, *given)))
            state.ledger.damped_momentum += lost[:2]
            state.ledger.damped_angular_momentum += float(lost[2])

    def centre(self, state: State) -> np.ndarray:
        """Return the position and velocity (4,) of the centre of the disc, about which the zones lie."""
        centre = state.centre
        return np.zeros(4) if centre is None else np.concatenate(centre)
