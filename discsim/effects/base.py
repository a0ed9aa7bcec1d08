"""What an effect may do in a step; each overrides what it needs.

A force adds to `acc` and moves nothing. The drag *is* the kick: it turns accelerations into velocities together
with the relaxation. An event runs once the particles have moved. Each may limit the step.
"""

from discsim.state import State


class Effect:
    """Base of the effects: does nothing and limits nothing."""

    name: str

    def accelerate(self, state: State) -> None:
        """Add this effect's accelerations to `acc` (and rates to `heating_rate`)."""

    def limit(self, state: State) -> float:
        """The longest step this effect allows, before the Courant factor, in code units."""
        return float("inf")

    def event(self, state: State) -> None:
        """Act on the particles after they have moved."""

    def potential_energy(self, state: State) -> float:
        """The potential energy that this effect holds, in code units."""
        return 0.0
