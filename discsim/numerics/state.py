"""The state of a run: particles of each species, star and companions, time and grid. The physics is in the effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from discsim.formulas.centre import central_flags, omega
from discsim.numerics import alloc, world
from discsim.numerics.bodies import Bodies
from discsim.numerics.dataframe import dataframe_of
from discsim.scene.summary import Rows, Summarised

if TYPE_CHECKING:
    from discsim.numerics.grid import Grid
    from discsim.scene import Scene

Array = np.ndarray


def read_only(array: Array) -> Array:
    """Return a read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(kw_only=True, repr=False)
class Particles(Summarised):
    """Particles of one species in code units; every array has one row per particle.

    Attributes
    ----------
    pos, vel, acc : ndarray, shape (n, dimensions)
        Positions, velocities and accelerations.
    mass : ndarray, shape (n,)
        Masses.
    ids : ndarray, shape (n,)
        Identification numbers, which particles keep when arrays are sorted.
    immobile : ndarray or None, shape (n,)
        True for boundary particles, which do not move; None if there are none.
    global_index : ndarray or None, shape (n,)
        Key of each particle; the keys give the order of the particles of all processes. None on one process.
    across, across_acc : ndarray or None, shape (n,)
        Velocity out of the plane, along the azimuth of a shearing box, relative to the shear flow; and the acceleration
        along this direction that a kick applies (`effects/shearing_box.py`). None without [shearing_box].
    """

    pos: Array
    vel: Array
    acc: Array
    mass: Array
    ids: Array
    immobile: Array | None = None
    global_index: Array | None = None
    across: Array | None = None
    across_acc: Array | None = None

    spare = 0  # spare capacity of newly allocated arrays (`numerics/alloc.py`)
    # Rows whose particles have changed since the last sort, without which `global_index` ascends; may have repeats.
    unsorted_rows = np.empty(0, np.int64)

    @property
    def count(self) -> int:
        return len(self.mass)

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name, without those that are None."""
        named = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: array for name, array in named.items() if array is not None}

    def summary(self) -> tuple[str, Rows]:
        rows = [(name, array.shape) for name, array in self.arrays().items()]
        return f"{type(self).__name__}: {self.count:,} particles", rows

    def to_pandas(self) -> Any:
        """Return the arrays as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            Copies in code units, with `ids` as index; vectors have a column per component: x, y, vx, vy, ax, ay.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return dataframe_of(self.arrays())

    def take(self, index: Array) -> None:
        """Reorder or select particles: row k of every array becomes the former row `index[k]`."""
        from discsim.kernels.common.move import take_rows
        from discsim.numerics.threads import parallel_for

        for name, array in self.arrays().items():
            taken = alloc.allocate(len(index), array, self.spare)
            # Arrays are viewed as integers of the same width, so that one kernel serves all types.
            wide = math.prod(array.shape[1:])
            rows, out = (a.reshape(len(a), wide).view(f"i{array.itemsize}") for a in (array, taken))
            parallel_for(take_rows, len(index), rows, index, out)
            setattr(self, name, taken)

    @property
    def global_count(self) -> int:
        """Number of particles on all processes."""
        return int(world.processes.sum(self.count))

    def sort(self, key: Array, count: int) -> None:
        """Sort every array by `key` (n,), integers in [0, count), and particles with equal keys by their ids.

        The result does not depend on the former order of the particles.
        """
        from discsim.numerics.sorting import counting_sort

        if self.global_index is not None:  # local keys are a small part of [0, count)
            self.global_index[:] = key.astype(np.uint64) << np.uint64(32) | self.ids.astype(np.uint64)
            world.processes.drop_caches()
            self.take(np.argsort(self.global_index, kind="stable"))  # twice as fast, as keys mostly ascend
            self.unsorted_rows = self.unsorted_rows[:0]
            return
        self.take(counting_sort(key, count, self.ids)[0])

    def remove(self, gone: Array) -> None:
        """Remove the particles `gone`, a mask (n,) or ascending rows, and move the last particles into the gaps.

        Collective: with several processes all processes must call this method, each for its local particles.
        """
        gone = np.flatnonzero(gone) if gone.dtype == bool else gone
        if self.global_index is not None:
            self.unsorted_rows = np.append(
                self.unsorted_rows, world.processes.reuse_removed_keys(self.global_index, gone, self.unsorted_rows)
            )
        self.replace(gone)

    def replace(self, leaving: Array, arriving: dict[str, Array] | None = None) -> None:
        """Remove the rows `leaving` (k,), and insert the new particles `arriving`, a dict of arrays (m, ...) by name.

        New particles fill the removed rows first; any others are appended. If there are fewer new particles than
        removed rows, the last rows move into the remaining gaps.
        """
        more = 0 if arriving is None else min(len(arriving["ids"]), len(leaving))
        filled, gone = leaving[:more], leaving[more:]
        left = self.count - len(gone)
        stays = np.ones(len(gone), bool)
        stays[gone[gone >= left] - left] = False
        holes, tail = gone[gone < left], left + np.flatnonzero(stays)
        for name, array in self.arrays().items():
            if arriving is not None:
                array[filled] = arriving[name][:more]
            array[holes] = array[tail]
            setattr(
                self, name, array[:left] if arriving is None else self._appended(array[:left], arriving[name][more:])
            )
        if self.global_index is not None:
            self.unsorted_rows = np.concatenate([self.unsorted_rows, filled, holes, np.arange(left, self.count)])

    def _appended(self, array: Array, others: Array) -> Array:
        """Return an array (n, ...) with the entries `others` (m, ...) appended, in its spare capacity if possible."""
        if len(others) == 0:
            return array
        count = len(array) + len(others)
        both = alloc.grow(array, count)
        if both is None:
            both = alloc.allocate(count, array, self.spare)
            both[: len(array)] = array
        both[len(array) :] = others
        return both

    def read_only(self) -> Self:
        """Return read-only views of the particles."""
        return type(self)(**{name: read_only(array) for name, array in self.arrays().items()})

    def copy(self) -> Self:
        same = type(self)(**{name: array.copy() for name, array in self.arrays().items()})
        same.unsorted_rows = self.unsorted_rows
        return same


@dataclass(kw_only=True, repr=False)
class Gas(Particles):
    """SPH particles in code units: the arrays of `Particles`, and further arrays, with shape (n,) unless noted.

    h: smoothing length. gradh: factor Omega of the grad-h terms (`kernels/sph/forces.py`).
    """

    h: Array
    density: Array
    gradh: Array | None = None  # None unless the gas consists of SPH particles
    pressure: Array
    sound_speed: Array
    # None unless the scene needs them:
    u: Array | None = None  # specific internal energy (adiabatic gas)
    heating_rate: Array | None = None  # du/dt of pressure work, viscosity and conductivity
    # Means over the last kick, including drag and its heat: acceleration (n, dimensions) of viscous or adiabatic gas,
    # and du/dt of adiabatic gas.
    kick_acc: Array | None = None
    kick_rate: Array | None = None
    # For gas that drag heats and adiabatic gas in polar cells, (n, dimensions): acceleration by pressure and viscosity;
    # and for gas that drag heats, the velocity used for their work.
    pressure_acc: Array | None = None
    pressure_vel: Array | None = None
    radiated: Array | None = None  # energy per mass lost by cooling since the start (gas that cools)
    nu: Array | None = None  # kinematic viscosity (gas with a shear viscosity)
    small: Array | None = None  # mass of small dust carried by each particle (if dust grows)
    # For quiet gas: density integrated along the flow, div v, shock indicator from 0 to 1, and the time of these three
    # (`effects/quiet.py`).
    followed: Array | None = None
    divergence: Array | None = None
    shocked: Array | None = None
    followed_at: Array | None = None
    # For adiabatic gas in polar cells: heating_rate and pressure_acc before the present ones, those of the last kick.
    last_heating_rate: Array | None = None
    last_pressure_acc: Array | None = None
    h_before: Array | None = None  # start value of the iteration for h (if h is not fixed)

    def keep_contents(self, mass: Array) -> None:
        """Adapt what cells hold after their masses changed from `mass` (n,): small dust and radiated energy."""
        if self.small is not None:
            self.small *= self.mass / mass
        if self.radiated is not None:
            self.radiated *= mass / self.mass


FOLLOWED = ("followed", "divergence", "shocked", "followed_at")  # arrays of quiet gas


@dataclass(kw_only=True, repr=False)
class Dust(Particles):
    """Dust particles of all populations in code units: the arrays of `Particles`, and further arrays (n,)."""

    species: Array  # index of the population
    size: Array | None = None  # radius of the grains, if particles have individual sizes
    density: Array | None = None  # on a fixed grid only


@dataclass
class Ledger:
    """Masses and momenta that accretion and wave damping have removed, for checks of conserved totals."""

    accreted_gas: float = 0.0
    accreted_dust: float = 0.0
    accreted_small: float = 0.0
    accreted_momentum: Array = field(default_factory=lambda: np.zeros(2))
    accreted_angular_momentum: float = 0.0
    damped_momentum: Array = field(default_factory=lambda: np.zeros(2))
    damped_angular_momentum: float = 0.0
    damped_gas: float = 0.0


class SubcycleClock(NamedTuple):
    """Clock of a sub-cycled effect: time since its last call, and the fastest rate of change at that call."""

    since: float = 0.0
    rate: float = math.inf


@dataclass
class State:
    """All variables that a step reads and writes, in code units. `gas` or `dust` is None if the scene has none."""

    scene: Scene
    gas: Gas | None
    dust: Dust | None
    grid: Grid | None
    # Star and companions; None without a star, or for a star of constant mass that stays at the origin.
    bodies: Bodies | None = None
    time: float = 0.0
    step: int = 0
    earlier: int = 0  # number of steps of the run that this run continues
    # Time by which `vel` and `u` are behind `pos`. Between steps it is the length of the closing kick, which is due.
    velocity_lag: float = 0.0
    # If an effect kicks gas and dust together: accelerations (n, dimensions) by species that act on this species only,
    # and not on the other species at the same position; arrays without entries if there are none.
    acc_unshared: dict[str, Array] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)  # results of operators at the present positions, by name
    ledger: Ledger = field(default_factory=Ledger)
    subcycle_clock: SubcycleClock | None = None  # clock of the sub-cycled effect; None if the scene has none
    # If gas cools: function (gas, time) that returns the energies (n,) of the gas after `time` at the rate `kick_rate`.
    cooled_energy: Callable[[Gas, float], Array] | None = None

    def advance_time(self, dt: float, until: float = math.inf) -> None:
        """Add dt to the time, and 1 to the number of steps; a time within rounding of `until` is set to `until`."""
        left = until - self.time
        self.time = until if abs(dt - left) <= 1e-9 * dt else self.time + dt
        self.step += 1

    def read_only(self) -> State:
        """Return a state with read-only views of the arrays; setting attributes of it does not change this state."""
        return replace(
            self,
            gas=self.gas and self.gas.read_only(),
            dust=self.dust and self.dust.read_only(),
            bodies=self.bodies and Bodies(**{name: read_only(array) for name, array in self.bodies.arrays().items()}),
            acc_unshared={name: read_only(array) for name, array in self.acc_unshared.items()},
            ledger=deepcopy(self.ledger),
        )

    def set_arrays(self, given: Mapping[str, Mapping[str, Array]]) -> None:
        """Replace arrays of the particles by those in `given`, by species and name."""
        for species, arrays in given.items():
            for name, array in arrays.items():
                setattr(self.species[species], name, array)

    @property
    def species(self) -> dict[str, Particles]:
        """Particles of each species present, by name."""
        both = {"gas": self.gas, "dust": self.dust}
        return {name: particles for name, particles in both.items() if particles is not None}

    @property
    def dust_is_passive(self) -> bool:
        """True if dust must not affect the gas or the time step: with one-way drag, while there is gas."""
        drag = self.scene.drag
        one_way = drag is not None and drag.direction == "one-way"
        return one_way and self.gas is not None and self.gas.global_count > 0

    @property
    def limiting_species(self) -> list[Particles]:
        """Species whose motion may limit the time step: all except passive dust."""
        return [particles for name, particles in self.species.items() if name == "gas" or not self.dust_is_passive]

    @property
    def body_count(self) -> int:
        """Number of bodies in the scene: the star and its companions. The scene must have a star."""
        return len(self._central)

    @property
    def star_mass(self) -> float:
        """Present mass of the star. The scene must have a star."""
        return self.scene.star.mass if self.bodies is None else float(self.bodies.mass[0])

    @property
    def star_pull(self) -> float:
        """Mass of the star in its gravity on gas and dust.

        This mass differs from `star_mass` while the mass of a companion is ramped up in a disc about the barycentre.
        """
        return self.star_mass if self.bodies is None else float(self.bodies.felt[0])

    @property
    def star_place(self) -> tuple[float, float]:
        """Position of the star in its gravity on gas and dust (`Bodies.felt_pos`)."""
        if self.bodies is None:
            return 0.0, 0.0
        x, y = self.bodies.felt_pos[0].tolist()
        return x, y

    @property
    def central_mass(self) -> float:
        """Central mass of the disc (`formulas/centre.py`). The scene must have a star."""
        return self.scene.star.mass if self.bodies is None else float(self.bodies.mass[self._central].sum())

    @cached_property
    def _central(self) -> Array:
        """Mask (n,) of the bodies that are part of the central mass."""
        return central_flags(self.scene.star.centre, [c.eccentricity for c in self.scene.table("companion") or ()])

    @property
    def central(self) -> tuple[float, float]:
        """Central mass and its softening, which are arguments of kernels; (0, 0) without a star."""
        star = self.scene.star
        return (0.0, 0.0) if star is None else (self.central_mass, star.softening)

    def kepler_omega(self, radius: Array) -> Array:
        """Return the orbital frequencies (n,) of circular orbits of `radius` (n,) about the central mass."""
        mass, softening = self.central
        return omega(mass, radius, softening)

    @property
    def centre(self) -> tuple[Array, Array] | None:
        """Position and velocity, (2,) each, of the centre of the disc; None if the centre stays at the origin."""
        if self.bodies is None or self.scene.star.frame == "star":
            return None
        if self.scene.star.centre == "barycentre":
            return self.bodies.barycentre(self._central)
        return self.bodies.pos[0], self.bodies.vel[0]

    def from_centre(self, pos: Array) -> Array:
        """Return positions (n, 2) relative to the centre of the disc."""
        centre = self.centre
        return pos if centre is None else pos - centre[0]

    def from_star(self, pos: Array) -> Array:
        """Return positions (n, 2) relative to the star, as placed in the gravity on gas and dust."""
        return pos if self.bodies is None else pos - self.bodies.felt_pos[0]

    @contextmanager
    def about_centre(self, gas_vel: Array) -> Iterator[None]:
        """Transform gas, dust and the gas velocities `gas_vel` (n, 2) to the frame of the disc's centre.

        At the end of the context all are transformed back. Changes of `gas_vel` and `dust.vel` within the context
        persist. `gas_vel` may be `gas.vel`. If it is another array, changes of `gas.vel` are lost.
        """
        centre, gas, dust = self.centre, self.gas, self.dust
        if centre is None or gas is None or dust is None:
            yield
            return
        pos, vel = (part.copy() for part in centre)
        before = gas.pos, dust.pos, gas.vel
        gas.pos, dust.pos = gas.pos - pos, dust.pos - pos
        if gas_vel is not gas.vel:
            gas.vel = gas.vel - vel
        gas_vel -= vel
        dust.vel -= vel
        try:
            yield
        finally:
            gas.pos, dust.pos, gas.vel = before
            gas_vel += vel
            dust.vel += vel
