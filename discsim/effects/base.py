"""Interface of an effect: its part in a step, and its description for scenes, previews and outputs.

The methods of `Effect` do nothing, and an effect overrides the ones that it needs:

- `accelerate` adds to `acc` and moves nothing.
- `kick` turns `acc` into velocities. Each species has its own kick, or one effect with `is_kick` kicks gas and dust
  together, which solves their relaxation with the accelerations inside.
- `drift` moves a species along, `move` changes positions in other ways, and `sort` reorders arrays in some steps.
- `operate` changes velocities or energies over dt, before and after the move.
- `event` acts once the particles have moved.
- `limit` bounds the step; the step loop records which effect sets the step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.state import Particles, State
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy
from discsim.physics.local import Expected
from discsim.scene.fields import Table
from discsim.scene.rules import Rule

if TYPE_CHECKING:
    from discsim.physics.local import Local, Outlook
    from discsim.scene import Scene

kepler, moves = Lazy("discsim.kernels.gravity.kepler"), Lazy("discsim.kernels.common.move")

NO_SPECIES = np.empty(0, np.int64)  # for gas, which has no populations

# Steps between reorderings of a species' arrays. The first step reorders, as the order of a start makes poor use of the
# cache. The order in memory decides the order of sums, so reordering must depend on the number of the step alone.
SORT_EVERY = 16


def to_sort(step: int) -> bool:
    """Return whether arrays are reordered at the end of this step."""
    return step % SORT_EVERY == 1


class Counts(NamedTuple):
    """Numbers of gas particles, dust particles and grid cells of a scene."""

    gas: int
    dust: int
    cells: int


class Column(NamedTuple):
    """Array (n,) or (n, d) for snapshots, in code units, with its name in the file, its dimension and its meaning.

    dimension: one of `discsim.scene.units`, or "" for a plain number.
    """

    values: np.ndarray
    dataset: str
    dimension: str
    about: str


class Effect:
    """Base class of effects; by itself an effect does nothing and limits nothing.

    The registry (`discsim/parts.py`) maps the name of a table to its effect; `scene.table(name)` returns that table.
    All numbers are in code units, and arrays have one row per particle.

    Parameters
    ----------
    scene : Scene
        Validated scene.
    state : State
        State at the start of the run.

    Raises
    ------
    ValueError
        The effect cannot run with this scene and state.
    """

    # The table of the effect.
    keys: type[Table]
    several = False  # whether the scene may have an array of these tables
    rules: tuple[Rule, ...] = ()  # generators of the problems of a scene with this table
    runs = True  # False: the table configures other effects, and this effect is not created

    lists_schemes = False  # whether the reference lists the drag schemes below the keys
    marks_centre = False  # whether the origin is a centre that figures mark

    # The part of the effect in a step.
    acts_on: tuple[str, ...] = ("gas", "dust")  # species that it accelerates
    # Whether gas and dust at one place get the same acceleration, so that their slip does not change. All other
    # accelerations reach the relaxation of drag as `state.own_acc`.
    shared = False
    # Whether `accelerate` overwrites the `acc` of species in `State.blank`, which is uninitialised.
    writes_first = False
    is_kick = False  # whether `kick` kicks gas and dust, in place of each species' own kick; at most one in a scene
    needs_grid = False  # whether the effect needs `state.grid`
    # Attributes made from the particles of the start, in `__init__` or `begin`. On several processes one process makes
    # them and sends them to the others, in place of `begin` there. All other attributes must need the scene alone.
    from_start: tuple[str, ...] = ()
    # Factor on the limit, above which errors grow without end. A leapfrog of frequency 1 / limit is unstable above 2;
    # 2.5 leaves a margin, as limits are estimates.
    grows_at = 2.5
    softer = ""  # remedy in messages: a change of the scene that makes `limit_of` longer

    @property
    def uncoupled(self) -> float:
        """Share of the dust mass that the last kick should have coupled to gas and could not."""
        return 0.0

    def __init__(self, scene: Scene, state: State) -> None:
        """Create the effect for a run of `scene` from the start `state`."""

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        """Return the keys of its table that have no meaning in this scene."""
        return ()

    @classmethod
    def warnings(cls, scene: Scene, at: Local) -> Iterable[str]:
        """Yield warnings of a scene that runs, but perhaps not as meant.

        Parameters
        ----------
        scene : Scene
            Validated scene.
        at : Local
            Gas of the start at a few places.

        Returns
        -------
        iterable of str
            Warnings, each with its number and a remedy.
        """
        return ()

    @classmethod
    def rows(cls, scene: Scene, at: Local) -> Iterable[tuple[str, str]]:
        """Return names and texts of derived numbers, for `check` and the log of a run."""
        return ()

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: Counts) -> float:
        """Return the CPU time of a step in nanoseconds, as `preview/forecast.py` defines it."""
        return 0.0

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: Outlook) -> Expected:
        """Estimate the step limit of the effect at a time of the run, for the forecast.

        Parameters
        ----------
        scene : Scene
            Validated scene.
        outlook : Outlook
            Expected state of the run at that time.

        Returns
        -------
        Expected
            The limit in code units, inf for none, and the place that sets the limit.
        """
        return Expected()

    @classmethod
    def grid_bytes(cls, scene: Scene, shape: tuple[int, ...]) -> int:
        """Return the memory in bytes that the effect holds on a grid of this shape."""
        return 0

    def begin(self, state: State, effects: Mapping[str, Effect]) -> None:
        """Prepare the effect for the starting state, which has its velocities. The call is also made before a run is
        resumed.

        Parameters
        ----------
        state : State
            State at the start.
        effects : mapping of str to Effect
            All effects of the run, by the names of their tables.
        """

    def forget(self) -> None:
        """Drop results of an earlier state: a checkpoint has replaced the state."""

    def prepare(self, state: State) -> None:
        """Compute what `accelerate` needs and no effect's `accelerate` changes, like a field or the density of the
        gas.

        Several threads call `prepare` of different effects at the same time, so it must not change what another
        effect reads. Without such a call, as on one thread, `accelerate` has to call it first.
        """

    def prepare_kick(self, state: State) -> None:
        """Compute what the next `kick` needs and no effect's `accelerate` changes.

        Inputs are positions, velocities, masses and smoothing lengths. Another thread accelerates at the same time,
        so the method must not change the state.
        """

    def discard(self) -> None:
        """Drop what `prepare` and `prepare_kick` have computed, as the state may have changed since."""

    def accelerate(self, state: State) -> None:
        """Add the accelerations of the effect to `acc` (n, dimensions) of the species that it acts on.

        Gas that holds heat has rates (n,) in `heating_rate`, to which the method may add too.
        """

    def acceleration(self, state: State) -> None:
        """Add to `acc` (n, dimensions) all accelerations of the effect, including those that the drift contains."""
        self.accelerate(state)

    def limit(self, state: State) -> float:
        """Return the longest step that the effect allows, before the Courant factor. The call follows `accelerate`."""
        return float("inf")

    def limit_of(self, state: State, name: str) -> float:
        """Return the longest step in which particles of the species `name` keep their orbits in the field of the
        effect.
        """
        return float("inf")

    def tightest(self, particles: Particles, acc: np.ndarray) -> int:
        """Return the index of the particle that sets `limit_of`.

        Parameters
        ----------
        particles : Particles
            Particles of one species.
        acc : array (n, dimensions)
            Their accelerations by this effect, in code units.
        """
        return int((acc**2).sum(axis=1).argmax())

    def kick(self, state: State, dt: float) -> None:
        """Turn accelerations into velocities over dt: those of its species, or of all species if `is_kick`."""

    def operate(self, state: State, dt: float) -> None:
        """Change velocities or energies over dt, for changes that are stiff or no acceleration, exactly if possible.

        A step calls the method over half of its length before the move, and over half after it
        (`run/integrators.py`). A change that composes, like exp(-dt/t), is then of second order. Velocities are ahead
        of positions in the first call (`state.lag` below 0) and behind in the second. On a circle of frequency Omega
        they are rotated against positions by asin(Omega lag), unless the drift rotates them. Effects that do not
        override the method are not called.
        """

    def drift(self, state: State, dt: float) -> None:
        """Move particles of the effect's own species at their velocities over dt.

        Several threads call `drift` of different effects at the same time, so neither `drift` nor `sort` may read
        other species.
        """

    def move(self, state: State, dt: float) -> None:
        """Move particles over dt in other ways, after the drift."""

    def sort(self, state: State) -> None:
        """Sort the arrays of the effect's own species by position; called in some steps."""

    def event(self, state: State) -> None:
        """Act on particles after they have moved and perhaps were sorted.

        `state.step` and `state.time` are those at the end of the step.
        """

    def potential_energy(self, state: State) -> float:
        """Return the potential energy of particles in the field of the effect."""
        return 0.0

    def columns(self, state: State) -> Mapping[str, Mapping[str, np.ndarray | Column]]:
        """Return additional arrays for a snapshot, at a state with its closing kick made.

        Returns
        -------
        mapping of str to mapping
            By species and name: arrays (n,) of names in the snapshot layout (`output/layout.py`), or a `Column` for any
            other name.
        """
        return {}


def overriding(effects: Mapping[str, Effect], what: str) -> list[str]:
    """Return the names of the effects that override the method `what` of `Effect`."""
    return [name for name, effect in effects.items() if getattr(type(effect), what) is not getattr(Effect, what)]


def drift(scene: Scene, particles: Particles, dt: float, masses: np.ndarray | None = None) -> None:
    """Move particles over dt: along straight lines, or on orbits about central `masses` (populations,).

    Immobile particles stay. Positions are wrapped into a periodic space.
    """
    species = getattr(particles, "species", NO_SPECIES)
    if particles.immobile is None:
        _drift(particles.pos, particles.vel, dt, masses, species)
    else:
        free = ~particles.immobile
        pos, vel = particles.pos[free], particles.vel[free]
        _drift(pos, vel, dt, masses, species[free] if len(species) else species)
        particles.pos[free], particles.vel[free] = pos, vel
    if scene.space.boundary == "periodic":
        parallel_for(moves.wrap, particles.count, particles.pos, np.array(scene.space.size), light=True)


def _drift(pos: np.ndarray, vel: np.ndarray, dt: float, masses: np.ndarray | None, species: np.ndarray) -> None:
    if masses is not None:
        parallel_for(kepler.drift, len(pos), pos, vel, masses, species, dt)
    else:
        parallel_for(moves.add_scaled, len(pos), pos, vel, dt, light=True)
