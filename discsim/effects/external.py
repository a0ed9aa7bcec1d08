"""Prescribed accelerations: constant ones of gas and of dust, and -Omega_z^2 z towards the midplane for both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.numerics.state import State
from discsim.numerics.totals import total
from discsim.scene.keys import External as Keys

if TYPE_CHECKING:
    from discsim.scene import Scene


class Effect(base.Effect):
    """Prescribed accelerations of gas and dust. constant: constant accelerations by species."""

    keys = Keys

    def __init__(self, scene: Scene, state: State) -> None:
        self.constant = {"gas": np.array(scene.external.gas), "dust": np.array(scene.external.dust)}
        self.frequency = scene.external.vertical_frequency

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        text = (
            "external.vertical_frequency attracts to z = 0, but z is periodic, so the force jumps at the boundary: "
            'set space.boundary = "open", or remove vertical_frequency'
        )
        is_wrong = scene.external.vertical_frequency > 0.0 and scene.space.boundary == "periodic"
        return base.Report(warnings=[text] if is_wrong else [])

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        frequency = scene.external.vertical_frequency
        return (
            base.Expected(1.0 / frequency, "from external.vertical_frequency") if frequency > 0.0 else base.Expected()
        )

    def operators(self, state: State) -> list[base.Operator]:
        pos, acc = (base.arrays(state.species, name) for name in ("pos", "acc_unshared"))
        return [
            base.Operator("external.push", base.Slot.FORCE, self.accelerate, pos, acc),
            base.Operator("external.limit", base.Slot.LIMIT, self.limit),
        ]

    def accelerate(self, view: base.View) -> None:
        """Add the accelerations to `acc_unshared` of gas and dust."""
        for name, particles in view.species.items():
            acc = particles.acc_unshared
            acc += self.constant[name]
            if self.frequency > 0.0:
                # The last axis is z, in one dimension the only axis.
                acc[:, -1] -= self.frequency**2 * particles.pos[:, -1]

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        return {base.ALL: base.Limit(1.0 / self.frequency)} if self.frequency > 0.0 else {}

    def potential_energy(self, state: State) -> float:
        energy = 0.0
        for name, p in state.species.items():
            work = sum(p.pos[:, axis] * component for axis, component in enumerate(self.constant[name]))
            energy -= total(p.mass * work)
            energy += 0.5 * self.frequency**2 * total(p.mass * p.pos[:, -1] ** 2)
        return energy
