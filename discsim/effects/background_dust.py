"""Dust in a given gas disc: it moves with its radial velocity and angular momentum, so that circles stay circles.

The drift of `kernels/background.py`, eq. (1), whose kick is the drag's.
"""

from discsim.effects import dust
from discsim.kernels.background import drift_dust
from discsim.numerics.state import State
from discsim.numerics.threads import share


class Effect(dust.Effect):
    def move(self, state: State, dt: float) -> None:
        share(drift_dust, state.dust.count, state.dust.pos, state.dust.vel, dt)
