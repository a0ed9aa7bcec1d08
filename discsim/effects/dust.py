"""Collisionless dust: dx/dt = v, dv/dt = a; particles of one or several populations, moved, never diffused."""

from discsim.effects import base
from discsim.kernels.move import add_scaled
from discsim.numerics.state import State
from discsim.numerics.threads import share


class Effect(base.Effect):
    name = "dust"
    acts_on = ()

    def __init__(self, scene, state):
        self.scene = scene

    def kick(self, state: State, dt: float) -> None:
        share(add_scaled, state.dust.count, state.dust.vel, state.dust.acc, dt)

    def move(self, state: State, dt: float) -> None:
        base.drift(self.scene, state.dust, dt)

    def event(self, state: State) -> None:
        if state.grid is not None and state.step % base.SORT_EVERY == 0:
            state.dust.take(state.grid.order(state.dust.pos))
