"""The state of a run: particles of each kind, the time, the grid. Data only; the physics is in the effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from discsim.formulas.centre import central, omega
from discsim.numerics import room, world
from discsim.numerics.bodies import Bodies
from discsim.numerics.dataframe import dataframe_of
from discsim.scene.summary import Rows, Summarised

if TYPE_CHECKING:
    from discsim.numerics.grid import Grid
    from discsim.scene import Scene

Array = np.ndarray


def read_only(array: Array) -> Array:
    """A view of an array that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(kw_only=True, repr=False)
class Particles(Summarised):
    """Particles of one kind, in code units; every array has one entry a particle.

    pos, vel, acc have shape (n, dimensions); mass and ids have shape (n,).
    """

    pos: Array
    vel: Array
    acc: Array
    mass: Array
    ids: Array
    immobile: Array | None = None  # boundary particles of a shock tube (mask); None where there are none
    place: Array | None = None  # in the order of all particles of a run, where other processes have some of them

    spare = 0  # entries for which arrays that are made anew have room behind them
    loose = np.empty(0, np.int64)  # rows, some twice or gone, besides which places rise since arrays were sorted

    @property
    def count(self) -> int:
        return len(self.mass)

    def arrays(self) -> dict[str, Array]:
        """The arrays by name, without those that this run does not hold."""
        named = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: array for name, array in named.items() if array is not None}

    def summary(self) -> tuple[str, Rows]:
        rows = [(name, array.shape) for name, array in self.arrays().items()]
        return f"{type(self).__name__}: {self.count:,} particles", rows

    def to_pandas(self) -> Any:
        """The arrays as a pandas DataFrame in code units, with ids as its index. Raises ImportError without pandas."""
        return dataframe_of(self.arrays())

    def take(self, index: Array) -> None:
        """Keep the particles `index` (whole numbers), in that order, in every array."""
        from discsim.kernels.common.move import take_rows
        from discsim.numerics.threads import share

        for name, array in self.arrays().items():
            taken = room.empty(len(index), array, self.spare)
            # Bits are moved, whatever they mean: one kernel for all.
            wide = math.prod(array.shape[1:])
            rows, out = (a.reshape(len(a), wide).view(f"i{array.itemsize}") for a in (array, taken))
            share(take_rows, len(index), rows, index, out)
            setattr(self, name, taken)

    @property
    def everywhere(self) -> int:
        """How many particles all processes of the run have."""
        return int(world.together.sum(self.count))

    def sort(self, key: Array, count: int) -> None:
        """Sort every array by `key` (n,) in [0, count), and by ids where keys are equal."""
        from discsim.numerics.sorting import by_ids

        if self.place is not None:  # keys of all space, of which own ones are few
            self.place[:] = key.astype(np.uint64) << np.uint64(32) | self.ids.astype(np.uint64)
            world.together.forget()
            self.take(np.argsort(self.place, kind="stable"))  # places still rise in part: half the time
            self.loose = self.loose[:0]
            return
        self.take(by_ids(key, count, self.ids))

    def remove(self, gone: Array) -> None:
        """Drop the particles `gone`, a mask (n,) or their numbers in rising order; the last ones take their places, so
        that little is moved.

        Where other processes have some of the particles all call it, with what goes of theirs.
        """
        gone = np.flatnonzero(gone) if gone.dtype == bool else gone
        if self.place is not None:
            self.loose = np.append(self.loose, world.together.close_up(self.place, gone, self.loose))
        self.replace(gone)

    def replace(self, leaving: Array, come: dict[str, Array] | None = None) -> None:
        """Put particles that `come`, arrays (m, ...) by name, in the places `leaving` (k,), and then the last ones."""
        more = 0 if come is None else min(len(come["ids"]), len(leaving))
        filled, gone = leaving[:more], leaving[more:]
        left = self.count - len(gone)
        stays = np.ones(len(gone), bool)
        stays[gone[gone >= left] - left] = False
        holes, tail = gone[gone < left], left + np.flatnonzero(stays)
        for name, array in self.arrays().items():
            if come is not None:
                array[filled] = come[name][:more]
            array[holes] = array[tail]
            setattr(self, name, array[:left] if come is None else self._with(array[:left], come[name][more:]))
        if self.place is not None:
            self.loose = np.concatenate([self.loose, filled, holes, np.arange(left, self.count)])

    def _with(self, array: Array, others: Array) -> Array:
        """An array (n, ...) and others' entries behind it."""
        if len(others) == 0:
            return array
        count = len(array) + len(others)
        both = room.longer(array, count)
        if both is None:
            both = room.empty(count, array, self.spare)
            both[: len(array)] = array
        both[len(array) :] = others
        return both

    def read_only(self) -> Self:
        """Views that cannot be written to."""
        return type(self)(**{name: read_only(array) for name, array in self.arrays().items()})

    def copy(self) -> Self:
        same = type(self)(**{name: array.copy() for name, array in self.arrays().items()})
        same.loose = self.loose
        return same


@dataclass(kw_only=True, repr=False)
class Gas(Particles):
    """SPH particles. `h` is the smoothing length, `gradh` the factor Omega of the grad-h terms."""

    h: Array
    density: Array
    gradh: Array
    pressure: Array
    sound_speed: Array
    # Only what a scene calls for:
    u: Array | None = None  # specific internal energy (adiabatic gas)
    heating_rate: Array | None = None  # du/dt of pressure work, viscosity and conductivity
    # Mean rates over the last kick, drag and its heat included (viscous or adiabatic gas; adiabatic gas).
    kick_acc: Array | None = None
    kick_rate: Array | None = None
    # What pressure and viscosity gave, and the velocity at which their work was reckoned (gas that drag heats).
    pressure_acc: Array | None = None
    pressure_vel: Array | None = None
    radiated: Array | None = None  # what each has lost by cooling since the start, per mass (gas that cools)
    nu: Array | None = None  # kinematic viscosity (gas with a shear viscosity)
    small: Array | None = None  # mass of small dust that each carries (where dust grows)
    # Of quiet gas: density that follows the flow, div v, 1 in shocks, and the time of these (`effects/quiet.py`).
    followed: Array | None = None
    divergence: Array | None = None
    shocked: Array | None = None
    followed_at: Array | None = None
    h_before: Array | None = None  # from which the search for h began (where h is not fixed)


FOLLOWED = ("followed", "divergence", "shocked", "followed_at")  # arrays of quiet gas


@dataclass(kw_only=True, repr=False)
class Dust(Particles):
    """Dust particles of one or several populations."""

    species: Array
    size: Array | None = None  # radius of the grains, where they have sizes of their own
    density: Array | None = None  # on a fixed grid


@dataclass
class Ledger:
    """What left the run through events, so that totals can be closed."""

    accreted_gas: float = 0.0
    accreted_dust: float = 0.0
    accreted_small: float = 0.0
    accreted_momentum: Array = field(default_factory=lambda: np.zeros(2))
    accreted_angular_momentum: float = 0.0
    damped_momentum: Array = field(default_factory=lambda: np.zeros(2))
    damped_angular_momentum: float = 0.0


class Pace(NamedTuple):
    """Of an effect that comes once in some steps: the time since it last did, and the fastest rate of change then."""

    since: float = 0.0
    rate: float = math.inf


@dataclass
class State:
    """Everything that a step reads and writes. `gas` or `dust` is None where the scene has none."""

    scene: Scene
    gas: Gas | None
    dust: Dust | None
    grid: Grid | None
    # Star and companions; None where there is a star alone, at the origin and of one mass, or none.
    bodies: Bodies | None = None
    time: float = 0.0
    step: int = 0
    earlier: int = 0  # steps of the run that this one goes on from
    lag: float = 0.0  # how far `vel` and `u` are behind `pos`: the closing kick still due, between steps
    # Where an effect kicks both: what gas and dust at one place do not both feel; no entries where that is nothing.
    own_acc: dict[str, Array] = field(default_factory=dict)
    blank: set[str] = field(default_factory=set)  # species to whose `acc` nobody has written yet
    ledger: Ledger = field(default_factory=Ledger)
    pace: Pace | None = None  # of an effect that comes once in some steps
    # Where gas cools: its energies (n,) after a time at `kick_rate`. Kicks of u, and foreseen ones, take it.
    cooled: Callable[[Gas, float], Array] | None = None

    def arrive(self, dt: float, until: float = math.inf) -> None:
        """Count a step of dt, which ends at `until` itself where it does but for rounding."""
        left = until - self.time
        self.time = until if abs(dt - left) <= 1e-9 * dt else self.time + dt
        self.step += 1

    def read_only(self) -> State:
        """The state in views that cannot be written to; what is set on it leaves this one as it is."""
        return replace(
            self,
            gas=self.gas and self.gas.read_only(),
            dust=self.dust and self.dust.read_only(),
            bodies=self.bodies and Bodies(**{name: read_only(array) for name, array in self.bodies.arrays().items()}),
            own_acc={name: read_only(array) for name, array in self.own_acc.items()},
            blank=set(self.blank),
            ledger=deepcopy(self.ledger),
        )

    @property
    def species(self) -> dict[str, Particles]:
        """The kinds of particles present, by name."""
        both = {"gas": self.gas, "dust": self.dust}
        return {name: particles for name, particles in both.items() if particles is not None}

    @property
    def unnoticed(self) -> bool:
        """Whether the dust is one-way beside gas: the gas must not notice it, not even by the length of a step."""
        drag = self.scene.drag
        one_way = drag is not None and drag.direction == "one-way"
        return one_way and self.gas is not None and self.gas.everywhere > 0

    @property
    def limiting(self) -> list[Particles]:
        """Whose motion may limit the step. One-way dust never does while there is gas."""
        return [particles for name, particles in self.species.items() if name == "gas" or not self.unnoticed]

    @property
    def body_count(self) -> int:
        """Number of the star and its companions in the scene."""
        return len(self._central)

    @property
    def star_mass(self) -> float:
        """Mass of the star now, of a scene that has one."""
        return self.scene.star.mass if self.bodies is None else float(self.bodies.mass[0])

    @property
    def star_pull(self) -> float:
        """Mass that gas and dust feel at the star: its own, but about a barycentre during a ramp."""
        return self.star_mass if self.bodies is None else float(self.bodies.felt[0])

    @property
    def star_place(self) -> tuple[float, float]:
        """Place at which gas and dust feel the star."""
        if self.bodies is None:
            return 0.0, 0.0
        x, y = self.bodies.felt_pos[0].tolist()
        return x, y

    @property
    def central_mass(self) -> float:
        """Mass that the disc turns about (`formulas/centre.py`), of a scene that has a star."""
        return self.scene.star.mass if self.bodies is None else float(self.bodies.mass[self._central].sum())

    @cached_property
    def _central(self) -> Array:
        """Bodies that the disc turns about (n,)."""
        return central(self.scene.star.centre, [c.eccentricity for c in self.scene.table("companion") or ()])

    @property
    def central(self) -> tuple[float, float]:
        """Central mass and the softening of circles about it, as kernels take them; zeros without a star."""
        star = self.scene.star
        return (0.0, 0.0) if star is None else (self.central_mass, star.softening)

    def kepler_omega(self, radius: Array) -> Array:
        """Frequency of circles (n,) about the central mass."""
        mass, softening = self.central
        return omega(mass, radius, softening)

    @property
    def centre(self) -> tuple[Array, Array] | None:
        """Place and velocity (2,) of the centre of the disc; None where it stays at the origin."""
        if self.bodies is None or self.scene.star.frame == "star":
            return None
        if self.scene.star.centre == "barycentre":
            return self.bodies.barycentre(self._central)
        return self.bodies.pos[0], self.bodies.vel[0]

    def from_centre(self, pos: Array) -> Array:
        """Positions (n, 2) relative to the centre of the disc."""
        centre = self.centre
        return pos if centre is None else pos - centre[0]

    def from_star(self, pos: Array) -> Array:
        """Positions (n, 2) relative to the star as gas and dust feel it."""
        return pos if self.bodies is None else pos - self.bodies.felt_pos[0]

    @contextmanager
    def about_centre(self, gas_vel: Array) -> Iterator[None]:
        """Gas and dust, and velocities `gas_vel` (n, 2) of the gas, relative to the centre of the disc, for a while.

        What becomes of `gas_vel` and the dust's velocities stays; the gas's own, where they are others, stay theirs.
        """
        centre, gas, dust = self.centre, self.gas, self.dust
        if centre is None or gas is None or dust is None:
            yield
            return
        pos, vel = (part.copy() for part in centre)
        places = gas.pos, dust.pos
        own = gas.vel
        gas.pos, dust.pos = gas.pos - pos, dust.pos - pos
        if gas_vel is not own:
            gas.vel = own - vel
        gas_vel -= vel
        dust.vel -= vel
        try:
            yield
        finally:
            gas.pos, dust.pos = places
            gas.vel = own
            gas_vel += vel
            dust.vel += vel
