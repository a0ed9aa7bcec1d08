"""Collisionless dust: dx/dt = v, dv/dt = a; particles of one or several populations, moved, never diffused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from discsim.effects import base
from discsim.numerics.state import State
from discsim.numerics.threads import share
from discsim.parts import Lazy
from discsim.scene.fields import Length, Measure, Number, Particles, Table
from discsim.scene.rules import Draft, Problem, kinds

if TYPE_CHECKING:
    from discsim.scene import Scene

moves = Lazy("discsim.kernels.move")

MOVED = 2.0  # CPU nanoseconds of a particle in a step


class Keys(Table):
    """One population of dust."""

    particles: Particles = Field(description="number of particles")
    ratio: Number = Field(gt=0, description="dust-to-gas mass ratio")
    grain_size: Length | None = Field(None, gt=0, description="for the Epstein law")
    grain_density: Annotated[float | None, Measure("volume_density")] = Field(
        None, gt=0, description="of the grain's material"
    )
    offset: Number = Field(0.0, description="placement against the gas, in gas spacings")
    inner: Length | None = Field(None, gt=0, description="dust only outside this radius")
    outer: Length | None = Field(None, gt=0, description="dust only inside this radius")
    placement: Literal["even", "random"] = Field("even", description="of the particles at the start")


def _within_radii(draft: Draft) -> Iterator[Problem]:
    for i, dust in enumerate(draft.dust or ()):
        for key in ("inner", "outer"):
            if draft.start and not draft.start.edges and getattr(dust, key) is not None:
                words = " or ".join(kinds(lambda start: start.edges))
                yield ("dust", i, key), f"a {draft.kind} has no radius; expected a {words}"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            yield ("dust", i, "outer"), "not outside dust.inner; expected outer > inner"


class Effect(base.Effect):
    keys = Keys
    rules = (_within_radii,)
    several = True
    acts_on = ()

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return MOVED * counts.dust

    def kick(self, state: State, dt: float) -> None:
        share(moves.add_scaled, state.dust.count, state.dust.vel, state.dust.acc, dt)

    def move(self, state: State, dt: float) -> None:
        base.drift(self.scene, state.dust, dt)

    def event(self, state: State) -> None:
        if state.grid is not None and state.step % base.SORT_EVERY == 0:
            state.dust.take(state.grid.order(state.dust.pos))
