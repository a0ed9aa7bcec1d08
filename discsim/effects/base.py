"""The contract of an effect: what it may do in a step, and what it says of itself; each overrides what it needs.

A force adds to `acc` and moves nothing. The kick turns `acc` into velocities: each species by itself, or one effect
for all (`is_kick`), which solves the relaxation of gas and dust with the accelerations inside. A species drifts, other
moves change places too, and arrays are sorted now and then; an operator changes velocities or energies over dt by
itself, around the move; an event runs once the particles have moved. Each effect may limit the step, and the loop knows
which did.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.state import Particles, State
from discsim.numerics.threads import share
from discsim.parts import Lazy
from discsim.physics.local import Expected
from discsim.scene.fields import Table
from discsim.scene.rules import Rule

if TYPE_CHECKING:
    from discsim.physics.local import Local, Outlook
    from discsim.scene import Scene

kepler, moves = Lazy("discsim.kernels.gravity.kepler"), Lazy("discsim.kernels.common.move")

NO_SPECIES = np.empty(0, np.int64)  # of gas, which has no populations

# Steps between reorderings of a species' arrays, of which the first comes with the first step: a start is in no order
# of use to a cache. A particle's place in memory decides the order of sums, so that reordering must depend on the
# number of the step alone.
SORT_EVERY = 16


def to_sort(step: int) -> bool:
    """Whether arrays are put in a new order at the end of this step."""
    return step % SORT_EVERY == 1


class Counts(NamedTuple):
    """How many particles of gas and dust a scene has, and cells of its grid."""

    gas: int
    dust: int
    cells: int


class Column(NamedTuple):
    """An array (n,) or (n, d) for snapshots, in code units: its name in the file, its dimension, and what it is.

    dimension: one of `discsim.scene.units`, or "" for a plain number.
    """

    values: np.ndarray
    dataset: str
    dimension: str
    about: str


class Effect:
    """Base of the effects: does nothing and limits nothing. Numbers are in code units, arrays have a row a particle.

    A registry (`discsim/parts.py`) gives the name of its table in a scene; `scene.table(name)` is the table.
    """

    # What it says of its table.
    keys: type[Table]
    several = False  # whether the table may be a list of them
    rules: tuple[Rule, ...] = ()  # what the table demands of the others
    runs = True  # False: other effects act for it, and the table only says how

    lists_schemes = False  # whether the reference has the drag schemes below its keys
    marks_centre = False  # whether it makes the origin a centre, which figures mark

    # What it says of its part in a step.
    acts_on: tuple[str, ...] = ("gas", "dust")  # whom it accelerates
    # Whether gas and dust at one place get the same acceleration from it: then it leaves their slip alone. What is not
    # shared reaches the relaxation as `state.own_acc`.
    shared = False
    # Whether its `accelerate` does not look at an `acc` that nobody has written, in `State.blank`, but writes to it.
    writes_first = False
    is_kick = False  # whether it kicks gas and dust together, in place of each species' own; one in a scene at most
    needs_grid = False  # whether `state.grid` has to be there
    # Attributes that it has made of the particles of the start, in `__init__` or `begin`: other processes, which have
    # none of these, take them from the one that has made them, in place of `begin`. All others need the scene alone.
    from_start: tuple[str, ...] = ()
    # Times its limit: in longer steps what it limits grows without end. A leapfrog of a frequency of 1 over the limit
    # does above 2, and limits are estimates.
    grows_at = 2.5
    softer = ""  # what to change so that `limit_of` is longer

    @property
    def uncoupled(self) -> float:
        """Share of the dust mass that it should have coupled to gas at the last kick, and could not."""
        return 0.0

    def __init__(self, scene: Scene, state: State) -> None:
        """The effect of a run of `scene` from the start `state`. Raises ValueError where the two make none."""

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        """Keys of its table that mean nothing in this scene."""
        return ()

    @classmethod
    def warnings(cls, scene: Scene, at: Local) -> Iterable[str]:
        """What will run, but perhaps not as meant: each with its number and what to change."""
        return ()

    @classmethod
    def rows(cls, scene: Scene, at: Local) -> Iterable[tuple[str, str]]:
        """Names and texts of numbers of its own, for `check` and the log of a run."""
        return ()

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: Counts) -> float:
        """CPU time of a step, in the measure of `preview/forecast.py`."""
        return 0.0

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: Outlook) -> Expected:
        """About the longest step that it will allow at a time of the run, and where, for the forecast."""
        return Expected()

    @classmethod
    def grid_bytes(cls, scene: Scene, shape: tuple[int, ...]) -> int:
        """What it keeps on a grid of this shape."""
        return 0

    def begin(self, state: State, effects: Mapping[str, Effect]) -> None:
        """What it has to know of the start, once that has its velocities; of a run that goes on it is called too."""

    def forget(self) -> None:
        """The state is that of a checkpoint from now on: what it has found in another one means nothing any more."""

    def prepare(self, state: State) -> None:
        """Make what `accelerate` needs and no effect's `accelerate` changes: a field, the density of the gas.

        Several threads call those of different effects at the same time: it changes nothing that another one reads.
        Where nobody has called it, as on one thread, `accelerate` does so itself.
        """

    def prepare_kick(self, state: State) -> None:
        """Make what the next `kick` needs and no effect's `accelerate` changes: of places, velocities, masses and
        smoothing lengths. Several threads call it while effects accelerate: it changes nothing of the state.
        """

    def discard(self) -> None:
        """Let go of what has been prepared: the state may be another one since."""

    def accelerate(self, state: State) -> None:
        """Add its accelerations to `acc` (n, dimensions) of those it acts on (and rates (n,) to `heating_rate`)."""

    def acceleration(self, state: State) -> None:
        """Add to `acc` all that it does to its species, also what the step has in their drift."""
        self.accelerate(state)

    def limit(self, state: State) -> float:
        """The longest step that it allows, before the Courant factor; asked after `accelerate`."""
        return float("inf")

    def limit_of(self, state: State, name: str) -> float:
        """The longest step in which the species `name` keeps its orbits in this effect's field."""
        return float("inf")

    def tightest(self, particles: Particles, acc: np.ndarray) -> int:
        """Which of the particles sets `limit_of`, from what this effect gives them, `acc` (n, dimensions)."""
        return int((acc**2).sum(axis=1).argmax())

    def kick(self, state: State, dt: float) -> None:
        """Turn accelerations into velocities over dt: of its species, or of all where it `is_kick`."""

    def operate(self, state: State, dt: float) -> None:
        """Change velocities or energies over dt, exactly if it can: as a force cannot, being stiff or no acceleration.

        The step calls it for half of it before the move, and for half after (`run/integrators.py`): what composes, as
        exp(-dt/t) does, is of second order. Velocities are then ahead of the places (`state.lag` below 0), and behind:
        on a circle of frequency Omega they have turned by asin(Omega lag) against it, unless the drift turns them.
        Effects that leave it as it is are not called.
        """

    def drift(self, state: State, dt: float) -> None:
        """Move particles of its own at their velocities over dt. Several threads call those of different effects at the
        same time: neither it nor `sort` looks at others' particles.
        """

    def move(self, state: State, dt: float) -> None:
        """Move particles over dt in other ways, once they have drifted."""

    def sort(self, state: State) -> None:
        """Put the arrays of its own particles in the order of their places, now and then."""

    def event(self, state: State) -> None:
        """Act on the particles after they have moved, and may have been sorted; `state.step` and `state.time` are those
        they have reached.
        """

    def potential_energy(self, state: State) -> float:
        """The potential energy that it holds."""
        return 0.0

    def columns(self, state: State) -> Mapping[str, Mapping[str, np.ndarray | Column]]:
        """What snapshots hold beside the arrays of the state, by species and name; velocities are closed.

        Arrays (n,) of names that the layout knows (`output/layout.py`), and a `Column` of any other.
        """
        return {}


def doing(effects: Mapping[str, Effect], what: str) -> list[str]:
    """Names of the effects that have a method of their own in place of that of `Effect`."""
    return [name for name, effect in effects.items() if getattr(type(effect), what) is not getattr(Effect, what)]


def drift(scene: Scene, particles: Particles, dt: float, masses: np.ndarray | None = None) -> None:
    """Move at constant velocity over dt, or on orbits about central `masses`, one a population; immobile ones stay."""
    species = getattr(particles, "species", NO_SPECIES)
    if particles.immobile is None:
        _drift(particles.pos, particles.vel, dt, masses, species)
    else:
        free = ~particles.immobile
        pos, vel = particles.pos[free], particles.vel[free]
        _drift(pos, vel, dt, masses, species[free] if len(species) else species)
        particles.pos[free], particles.vel[free] = pos, vel
    if scene.space.boundary == "periodic":
        share(moves.wrap, particles.count, particles.pos, np.array(scene.space.size), light=True)


def _drift(pos: np.ndarray, vel: np.ndarray, dt: float, masses: np.ndarray | None, species: np.ndarray) -> None:
    if masses is not None:
        share(kepler.drift, len(pos), pos, vel, masses, species, dt)
    else:
        share(moves.add_scaled, len(pos), pos, vel, dt, light=True)
