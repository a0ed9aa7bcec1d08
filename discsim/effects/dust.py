"""Collisionless dust: dx/dt = v, dv/dt = a.

Dust has one or several populations of particles. The grains of a population have one size, or a size distribution.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from discsim.effects import base
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.parts import LAWS, SCHEMES, Lazy
from discsim.physics.orbits import drift_masses
from discsim.scene.keys import Dust as Keys
from discsim.scene.keys import Sizes
from discsim.scene.rules import Draft, Problem, quoted, starts_where

if TYPE_CHECKING:
    from discsim.scene import Scene

moves = Lazy("discsim.kernels.common.move")

GRAIN_COST = 2.0  # CPU nanoseconds in a step, per particle


def _edge_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the keys `inner` and `outer`, the radii between which a population starts."""
    for i, dust in enumerate(draft.dust or ()):
        for key in ("inner", "outer"):
            if draft.start and not draft.start.edges and getattr(dust, key) is not None:
                wrong = f'initial.kind = "{draft.kind}" has no radius'
                words = " or ".join(starts_where(lambda start: start.edges))
                yield ("dust", i, key), f"{wrong}; set initial.kind to {words}, or remove this key"
        if dust.inner is not None and dust.outer is not None and dust.outer <= dust.inner:
            yield (
                ("dust", i, "outer"),
                "the outer edge is not larger than the inner one; expected dust.outer > dust.inner",
            )


def _name_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the names of populations: two of one name, or a name that is the number of another one."""
    taken: dict[str, int] = {}
    count = len(draft.dust or ())
    for i, dust in enumerate(draft.dust or ()):
        if dust.name is None:
            continue
        if dust.name in taken:
            yield ("dust", i, "name"), f'population {taken[dust.name]} is "{dust.name}" too; expected another name'
        elif dust.name in map(str, range(count)) and dust.name != str(i):
            wrong = f'"{dust.name}" is the number of another population'
            yield ("dust", i, "name"), f"{wrong}; expected another name, or this key left out"
        taken.setdefault(dust.name, i)


def _size_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of size distributions, which need a drag law and a drag scheme that depend on the size."""
    for i, dust in enumerate(draft.dust or ()):
        sizes, where = dust.grain_size, ("dust", i, "grain_size")
        if not isinstance(sizes, Sizes):
            continue
        if not sizes.largest > sizes.smallest:
            yield (*where, "largest"), "the largest size is not larger than the smallest; expected largest > smallest"
        if draft.drag is None:
            yield where, "grain sizes have no effect without drag; add a table [drag]"
        elif not LAWS[draft.drag.law].of_grains:
            wrong = f'drag.law "{draft.drag.law}" does not depend on grain size'
            yield where, f"{wrong}; choose drag.law {laws_of_grains()}"
        elif not draft.has("background") and not SCHEMES[draft.drag.scheme].sizes:
            wrong = f'drag.scheme "{draft.drag.scheme}" allows only one size per population'
            yield where, f"{wrong}; choose drag.scheme {schemes_with_sizes()}"


def laws_of_grains() -> str:
    """Return the names of the drag laws that depend on grain size, for messages."""
    return quoted(name for name, law in LAWS.items() if law.of_grains)


def schemes_with_sizes() -> str:
    """Return the names of the drag schemes that allow several grain sizes in a population, for messages."""
    return quoted(name for name, scheme in SCHEMES.items() if scheme.sizes)


class Effect(base.Effect):
    """Motion of the dust particles."""

    keys = Keys
    rules = (_name_problems, _edge_problems, _size_problems)
    role = base.Role(several=True)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.central_masses = drift_masses(scene, "dust")

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return GRAIN_COST * counts.dust

    def operators(self, state: State) -> list[base.Operator]:
        of = base.Slot
        return [
            base.Operator("dust.kick", of.KICK, self.kick),
            base.Operator("dust.drift", of.DRIFT, self.drift),
            base.Operator("dust.sort", of.SORT, self.sort),
        ]

    def kick(self, state: State, dt: float) -> None:
        """Add dt times the acceleration to the velocities of the dust."""
        parallel_for(moves.add_scaled, state.dust.count, state.dust.vel, state.dust.acc, dt, light=True)

    def drift(self, state: State, dt: float) -> None:
        base.drift(self.scene, state.dust, dt, self.central_masses)

    def sort(self, state: State) -> None:
        """Sort the arrays of the dust by grid cell, if the state has a grid."""
        if state.grid is not None:
            state.dust.sort(*state.grid.sort_keys(state.dust.pos))
