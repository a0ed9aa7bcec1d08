"""Interface of an effect: its operators in a step, and its description for scenes, previews and outputs.

The methods of `Effect` do nothing, and an effect overrides the ones that it needs. `operators` lists what the effect
does in a step (`discsim/numerics/operators.py`): fields, forces, limits, kicks, drifts and others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.operators import ALL, GROWS, Limit, Operator, Slot, View, arrays
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

__all__ = [
    "ALL", "GROWS", "Column", "Counts", "Effect", "KickEffect", "Limit", "Operator", "Report", "Role", "Slot", "View",
    "arrays", "drift", "kick_effect", "to_sort",
]  # fmt: skip

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


class Role(NamedTuple):
    """Facts of an effect that do not depend on the scene.

    Attributes
    ----------
    kicks : bool
        Whether the effect kicks gas and dust together, in place of the kick of each species; a `KickEffect`.
    grid : bool
        Whether the effect needs the grid of the state.
    centre : bool
        Whether the origin is a centre that figures mark.
    table_only : bool
        Whether the table configures other effects, and the effect is not created.
    several : bool
        Whether the scene may have an array of these tables.
    lists_schemes : bool
        Whether the reference lists the drag schemes below the keys.
    """

    kicks: bool = False
    grid: bool = False
    centre: bool = False
    table_only: bool = False
    several: bool = False
    lists_schemes: bool = False


class Report(NamedTuple):
    """Texts about a scene for `check` and the log of a run.

    rows: names and texts of derived numbers. warnings: warnings of a scene that runs, but perhaps not as meant, each
    with its number and a remedy.
    """

    rows: Iterable[tuple[str, str]] = ()
    warnings: Iterable[str] = ()


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

    keys: type[Table]  # the table of the effect
    role = Role()
    rules: tuple[Rule, ...] = ()  # generators of the problems of a scene with this table
    # Attributes made from the particles of the start, in `__init__` or `begin`. On several processes one process makes
    # them and sends them to the others, in place of `begin` there. All other attributes must need the scene alone.
    from_start: tuple[str, ...] = ()

    def __init__(self, scene: Scene, state: State) -> None:
        """Create the effect for a run of `scene` from the start `state`."""

    def __init_subclass__(cls) -> None:
        """Refuse methods of the former interface, which no step calls."""
        if "accelerate" in vars(cls) and cls.operators is Effect.operators:
            raise TypeError("accelerate alone is no part of an effect; expected operators (docs/recipes/effect.md)")

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        """Return the keys of its table that have no meaning in this scene."""
        return ()

    @classmethod
    def report(cls, scene: Scene, at: Local) -> Report:
        """Return derived numbers and warnings of a scene.

        Parameters
        ----------
        scene : Scene
            Validated scene.
        at : Local
            Gas of the start at a few places.
        """
        return Report()

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

    def operators(self, state: State) -> list[Operator]:
        """Return the operators of the effect, in the order in which they run within a slot.

        The list depends on the scene and the species alone.
        """
        return []

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


class KickEffect(Effect):
    """Effect that kicks gas and dust together, in place of the kick of each species; at most one in a scene.

    Its operator of the slot KICK solves the relaxation of the slip with the accelerations inside.
    """

    role = Role(kicks=True)

    @property
    def uncoupled(self) -> float:
        """Share of the dust mass that the last kick should have coupled to gas and could not."""
        return 0.0


def kick_effect(effects: Mapping[str, Effect]) -> str | None:
    """Return the name of the effect that kicks gas and dust together; None if each species has its own kick."""
    return next((name for name, effect in effects.items() if effect.role.kicks), None)


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
