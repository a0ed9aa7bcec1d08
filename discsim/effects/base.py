"""Interface of an effect: its operators in a step, and its description for scenes, previews and outputs.

The methods of `Effect` do nothing, and an effect overrides the ones that it needs. `operators` lists what the effect
does in a step (`discsim/numerics/operators.py`): fields, forces, limits, kicks, drifts and others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.numerics.operators import ALL, GROWS, Limit, Operator, Slot, View, arrays
from discsim.numerics.state import Particles, State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import total
from discsim.parts import SCHEMES, Lazy
from discsim.physics.local import Expected, ForecastState, GasSamples
from discsim.scene.fields import Table
from discsim.scene.rules import Draft, Problem, Rule

if TYPE_CHECKING:
    from discsim.scene import Scene

kepler, moves = Lazy("discsim.kernels.gravity.kepler"), Lazy("discsim.kernels.common.move")

__all__ = [
    "ALL", "GROWS", "Column", "Counts", "Effect", "Expected", "ForecastState", "GasSamples", "KickEffect", "Limit",
    "Operator", "Report", "Role", "Slot", "View", "arrays", "centre_of_disc", "drift", "grid_scheme_problems",
    "is_sort_step", "kick_effect_name", "point_mass_energy", "source_problems",
]  # fmt: skip

NO_SPECIES = np.empty(0, np.int64)  # for gas, which has no populations

# Steps between reorderings of a species' arrays. The first step reorders too, as the order of particles at the start
# makes poor use of the cache. The order in memory decides the order of sums, so reordering must depend on the step
# number alone.
SORT_EVERY = 16


def is_sort_step(step: int) -> bool:
    """Return whether particle arrays are reordered at the end of the step with the number `step`."""
    return step % SORT_EVERY == 1


class Counts(NamedTuple):
    """Numbers of gas particles, dust particles and grid cells of a scene."""

    gas: int
    dust: int
    cells: int


class Column(NamedTuple):
    """Array for snapshots that the snapshot layout does not define.

    values: array (n,) or (n, d) in code units. dataset: name of the array in the file. dimension: a name of
    `discsim.scene.units` like "length", or "" for a plain number. about: description in the file.
    """

    values: np.ndarray
    dataset: str
    dimension: str
    about: str


class Role(NamedTuple):
    """Properties of an effect that are the same in all scenes.

    Attributes
    ----------
    kicks : bool
        Whether the effect kicks gas and dust together. It is then a `KickEffect` and replaces the separate kicks of
        the species.
    grid : bool
        Whether the effect needs `state.grid`.
    centre : bool
        Whether figures mark the origin as the centre.
    table_only : bool
        Whether the table only configures other effects. No object of this effect is then created.
    several : bool
        Whether a scene may have several of these tables, as an array [[name]].
    lists_schemes : bool
        Whether the reference page lists the drag schemes below the keys of the table.
    """

    kicks: bool = False
    grid: bool = False
    centre: bool = False
    table_only: bool = False
    several: bool = False
    lists_schemes: bool = False


class Report(NamedTuple):
    """Derived numbers and warnings of a scene, for `discsim check` and the log of a run.

    rows: (name, text) of each derived number. warnings: one text for each setting that allows a run but is probably
    wrong, with the number that shows it and a remedy.
    """

    rows: Iterable[tuple[str, str]] = ()
    warnings: Iterable[str] = ()


class Effect:
    """Base class of effects: an effect without operators, time-step limit or output.

    The registry (`discsim/parts.py`) maps the name of a table to its effect class; `scene.table(name)` returns the
    table. All numbers are in code units. Arrays have one row per particle.

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

    keys: type[Table]  # the keys of the effect's table
    role = Role()
    rules: tuple[Rule, ...] = ()  # generators that yield the problems of a scene with this table
    # Names of attributes that `__init__` or `begin` computes from the initial particles. On several processes, one
    # process computes them and sends them to the others, which do not call `begin`. All other attributes must depend
    # on the scene alone.
    from_start: tuple[str, ...] = ()

    def __init__(self, scene: Scene, state: State) -> None:
        """Create the effect for a run of `scene` that starts from `state`."""

    def __init_subclass__(cls) -> None:
        """Raise TypeError for a class with `accelerate` but no `operators`, as no step would call `accelerate`."""
        if "accelerate" in vars(cls) and cls.operators is Effect.operators:
            wrong = f"{cls.__name__} defines accelerate, but no step calls it"
            raise TypeError(f"{wrong}; add the method operators (docs/recipes/effect.md)")

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        """Return the keys of the effect's table that have no meaning in this scene."""
        return ()

    @classmethod
    def report(cls, scene: Scene, at: GasSamples) -> Report:
        """Return derived numbers and warnings of a scene.

        Parameters
        ----------
        scene : Scene
            Validated scene.
        at : GasSamples
            Estimates of the initial gas at a few points.
        """
        return Report()

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: Counts) -> float:
        """Estimate the CPU time of the effect in one step, in nanoseconds (see `preview/forecast.py`)."""
        return 0.0

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: ForecastState) -> Expected:
        """Estimate the time-step limit of the effect at a time of the run, for the forecast of the run's cost.

        Parameters
        ----------
        scene : Scene
            Validated scene.
        outlook : ForecastState
            Estimated state of the run at this time.

        Returns
        -------
        Expected
            The limit in code units, inf without a limit, and the place that sets it.
        """
        return Expected()

    @classmethod
    def grid_bytes(cls, scene: Scene, shape: tuple[int, ...]) -> int:
        """Estimate the memory in bytes of the effect's arrays on a grid with `shape` cells along each axis."""
        return 0

    def begin(self, state: State, effects: Mapping[str, Effect]) -> None:
        """Prepare the effect for a run, once the initial velocities are set. A resumed run calls this method too, with
        the same initial state.

        Parameters
        ----------
        state : State
            State at the start.
        effects : mapping of str to Effect
            All effects of the run, by the names of their tables.
        """

    def operators(self, state: State) -> list[Operator]:
        """Return the operators of the effect, in the order in which they run within a slot.

        The list must depend only on the scene and on the species that are present.
        """
        return []

    def potential_energy(self, state: State) -> float:
        """Return the total potential energy of all particles in the field of the effect."""
        return 0.0

    def columns(self, state: State) -> Mapping[str, Mapping[str, np.ndarray | Column]]:
        """Return additional arrays for a snapshot, from a state after the closing kick of its step.

        Returns
        -------
        mapping of str to mapping
            Arrays by species and name. A name of the snapshot layout (`output/layout.py`) has an array (n,), any other
            name has a `Column`.
        """
        return {}


class KickEffect(Effect):
    """Effect that kicks gas and dust together and replaces the separate kicks of the species; at most one in a scene.

    Its operator in the slot KICK applies accelerations and drag to the slip in one solution.
    """

    role = Role(kicks=True)

    @property
    def uncoupled(self) -> float:
        """Fraction of the dust mass to which the last kick could not apply drag as intended."""
        return 0.0


def kick_effect_name(effects: Mapping[str, Effect]) -> str | None:
    """Return the table name of the effect that kicks gas and dust together; None if each species has its own kick."""
    return next((name for name, effect in effects.items() if effect.role.kicks), None)


def drift(scene: Scene, particles: Particles, dt: float, masses: np.ndarray | None = None) -> None:
    """Move particles over dt: on straight lines, or on Kepler orbits if central masses are given.

    masses (populations,): central mass of the orbits of each population. Immobile particles do not move. Positions are
    wrapped into a periodic space.
    """
    species = getattr(particles, "species", NO_SPECIES)
    if particles.immobile is None:
        _drift_in_place(particles.pos, particles.vel, dt, masses, species)
    else:
        free = ~particles.immobile
        pos, vel = particles.pos[free], particles.vel[free]
        _drift_in_place(pos, vel, dt, masses, species[free] if len(species) else species)
        particles.pos[free], particles.vel[free] = pos, vel
    if scene.space.boundary == "periodic":
        parallel_for(moves.wrap, particles.count, particles.pos, np.array(scene.space.size), light=True)


def _drift_in_place(
    pos: np.ndarray, vel: np.ndarray, dt: float, masses: np.ndarray | None, species: np.ndarray
) -> None:
    """Move positions `pos` (n, d), and on Kepler orbits velocities `vel` (n, d), over dt in place; see `drift`."""
    if masses is not None:
        parallel_for(kepler.drift, len(pos), pos, vel, masses, species, dt)
    else:
        parallel_for(moves.add_scaled, len(pos), pos, vel, dt, light=True)


def centre_of_disc(state: State) -> np.ndarray:
    """Return the position and velocity (4,) of the centre of the disc, for kernels."""
    return np.zeros(4) if state.centre is None else np.concatenate(state.centre)


def point_mass_energy(particles: Particles, pos: np.ndarray, mass: float | np.ndarray, softening: float) -> float:
    """Return the potential energy of particles in the gravity of a softened point mass at the position `pos` (2,).

    mass: mass of the point, or masses (n,) that differ between the particles.
    """
    distance = np.sqrt(((particles.pos - pos) ** 2).sum(axis=1) + softening**2)
    return -total(particles.mass * mass / distance)


def source_problems(
    draft: Draft, where: tuple[str | int, ...], names: Iterable[str], path: str | None = None
) -> Iterator[Problem]:
    """Yield problems of the key `where`, a list of the sources of a force: "gas", "dust", "star" or "companions".

    path: how the force may act on the gas indirectly, as text for messages. If `path` is given, dust is no valid
    source in scenes with one-way drag.
    """
    names = list(names)
    if len(set(names)) < len(names):
        yield where, "a name occurs twice; list each name once"
    for name in dict.fromkeys(names):
        table = "companion" if name == "companions" else name
        if name != "star" and not draft.has(table):
            yield (
                where,
                f'"{name}" is listed, but there is no table [{table}]; add the table, or remove "{name}" from the list',
            )
    if path is not None and "dust" in names and draft.has_gas_and_one_way_drag:
        wrong = f"with one-way drag, dust must not act on the gas, not even through {path}"
        yield where, f'{wrong}; remove "dust" from the list, or set drag.direction = "two-way"'


def grid_scheme_problems(draft: Draft, table: str, what: str) -> Iterator[Problem]:
    """Yield a problem of `table` if the drag scheme is a fixed grid without particles. what: physics of the table."""
    if draft.drag and SCHEMES[draft.drag.scheme].on_grid:
        yield (table,), f'drag.scheme "{draft.drag.scheme}" does not allow {what}; choose another drag.scheme'
