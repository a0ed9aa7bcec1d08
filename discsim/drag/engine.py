"""Drag engine: passes the arrays of the state to the drag scheme of a scene, and keeps the result of the last kick."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from discsim.drag.base import EMPTY, CellRule, DragLaw, Dust, Gas, KickContext, KickResult, Scheme
from discsim.drag.classes import Classes
from discsim.drag.width import CellWidth
from discsim.numerics import world
from discsim.numerics.layout import MAX_CELL_GROWTH
from discsim.numerics.totals import mean, total
from discsim.parts import SCHEMES, Lazy
from discsim.physics.eos import thermal_speed
from discsim.physics.laws import SceneLaw
from discsim.physics.polar import polar_shape

if TYPE_CHECKING:
    from discsim.drag.cells import Layout
    from discsim.drag.frame import Samples
    from discsim.kernels.drag.frame import Frame
    from discsim.numerics.operators import View
    from discsim.numerics.state import Dust as DustOfState
    from discsim.numerics.state import State
    from discsim.scene import Scene

cells, dust_density, frames = Lazy("discsim.drag.cells"), Lazy("discsim.drag.dust_density"), Lazy("discsim.drag.frame")
growth, sph = Lazy("discsim.physics.growth"), Lazy("discsim.numerics.sph")
polar = Lazy("discsim.numerics.polar")
Array = np.ndarray
Seen: TypeAlias = "State | View"
Prepared: TypeAlias = "tuple[Frame, Any]"  # frame of a kick, and its cells or None


def moving_mass(dust: DustOfState) -> Array:
    """Return the masses (n,) of the dust particles, with 0 for immobile particles."""
    return dust.mass if dust.immobile is None else np.where(dust.immobile, 0.0, dust.mass)


def azimuthal(state: State, gas: Gas, dust: Dust) -> tuple[Gas, Dust]:
    """Return gas and dust with azimuthal velocities and accelerations in column 0 of `vel`, `acc` and `acc_unshared`.

    A kick of these arrays relaxes the azimuthal velocities of a shearing box; column 1 is 0. gas, dust: arguments of
    the scheme for the velocities in the plane.
    """

    def column(values: Array) -> Array:
        return np.stack([values, np.zeros_like(values)], axis=1)

    rates = [column(p.across_acc) for p in (state.gas, state.dust)]
    return (
        gas._replace(vel=column(state.gas.across), acc=rates[0], acc_unshared=rates[0]),
        dust._replace(vel=column(state.dust.across), acc=rates[1], acc_unshared=rates[1]),
    )


def set_azimuthal(state: State, gas_vel: Array, dust_vel: Array) -> None:
    """Set the azimuthal velocities of the state to column 0 of the kicked velocities (n, 2) of `azimuthal`.

    One-way drag does not act on the gas, whose azimuthal velocity then has no source either (`across_acc` is 0).
    """
    if state.scene.drag.direction == "two-way":
        state.gas.across[:] = gas_vel[:, 0]
    state.dust.across[:] = dust_vel[:, 0]


class Engine:
    """Drag engine of a serial run; `ranks/drag.py` has the subclass for several MPI ranks.

    star: central mass and its softening at the last kick. buffers: scratch arrays of the scheme by name. samples:
    the particles of each species whose velocities determine the frame. geometry: polar cells of the gas, for schemes
    with `polar`; else None.
    """

    def __init__(self, scene: Scene, star: tuple[float, float]) -> None:
        self.scene, self.star, self.dim = scene, star, scene.space.dimensions
        self.scheme: Scheme = SCHEMES[scene.drag.scheme]
        self.law, self.width = SceneLaw(scene), CellWidth(scene)
        self.classes = Classes(scene, self.law)
        self.period = np.full(2, np.inf)
        if scene.space.boundary == "periodic":
            self.period[:] = *scene.space.size, *np.ones(2 - self.dim)
        self.buffers: dict[str, Array] = {}
        self.samples: Samples = {}
        self.geometry = polar.geometry_of(*polar_shape(scene)) if self.scheme.polar else None
        self._times: Array | Callable[[], Array] = EMPTY
        self._uncoupled_mass = EMPTY  # masses of the dust that the last kick did not couple to gas

    @property
    def stopping_times(self) -> Array:
        """Stopping times (n,) of the dust in the last kick, inf without gas.

        The times are computed at the first access.
        """
        self._times = times = self._times() if callable(self._times) else self._times
        return times

    def uncoupled_share(self, dust: DustOfState) -> float:
        """Return the fraction of the mobile dust mass that had no gas, or an enlarged cell, in the last kick.

        The fraction is computed here instead of in the kick because its exact sums cost 1% of a step.
        """
        uncoupled = total(self._uncoupled_mass)
        whole = total(moving_mass(dust)) if uncoupled > 0.0 else 0.0
        return uncoupled / whole if whole > 0.0 else 0.0

    def record(self, dust: DustOfState, kicked: KickResult) -> None:
        """Store the result of a kick, for `stopping_times` and `uncoupled_share`."""
        self._times, self._uncoupled_mass = kicked.stopping_times, moving_mass(dust)[kicked.uncoupled]

    def release(self) -> None:
        """Free the memory of the last kick: its stopping times, and the scratch arrays of the scheme."""
        self._times = EMPTY
        self.buffers.clear()

    def prepare(self, state: Seen) -> Prepared:
        """Return the frame and the cells of the next kick, for the argument `prepared` of `kick`."""
        self._sort(state)
        return self._build(state, *self._positions(state, state.gas.vel))

    def kick(self, state: State, dt: float, gas_vel: Array, heat: Array, prepared: Prepared | None = None) -> None:
        """Apply accelerations and drag over dt, and record the result.

        The velocities of the dust in `state`, and the gas velocities `gas_vel` (n, d), change in place. Immobile dust
        keeps its velocity. In a shearing box the azimuthal velocities `across` of gas and dust change too. heat (n,):
        output, the heat per mass of each gas particle; not written if it is empty. prepared: result of `prepare` for
        the same positions, if known.
        """
        dust = state.dust
        resting = dust.vel[dust.immobile] if dust.immobile is not None else None
        self._sort(state)
        with state.about_centre(gas_vel):
            kicked = self._relax(state, dt, gas_vel, heat, prepared)
        self.record(dust, kicked)
        if resting is not None:
            dust.vel[dust.immobile] = resting

    def limit(self, state: Seen) -> float:
        """Return the longest stable step of an explicit scheme."""
        return self.scheme.limit(*self.arguments(state))

    def arguments(self, state: Seen) -> tuple[Gas, Dust, DragLaw, Frame, KickContext]:
        """Return the arguments of the scheme's `limit`: gas, dust, law, frame, context."""
        self.classes.sort(state.dust)
        gas, dust = self._complete(state, *self._positions(state, state.gas.vel))
        return gas, dust, self.classes.law, self._frame(state), self._context(EMPTY)

    def layout(self, state: Seen) -> Layout:
        """Return the layout of the drag cells that the scheme builds at a state. The scheme must have cells."""
        self._sort(state)
        arrays = self._positions(state, state.gas.vel)
        return self.scheme.layout(*arrays, self._rule(state), self._frame(state), cells.OneRank())

    def _sort(self, state: Seen) -> None:
        """Sort the dust into classes, and update `star`, the central mass and its softening."""
        self.classes.sort(state.dust)
        self.star = state.central

    def _relax(self, state: State, dt: float, gas_vel: Array, heat: Array, prepared: Prepared | None) -> KickResult:
        """Call the scheme for the arrays of the state; arguments as in `kick`."""
        gas, dust = self._positions(state, gas_vel)
        frame, built = self._build(state, gas, dust) if prepared is None else prepared
        gas, dust = self._complete(state, gas, dust)
        kicked = self._call(gas, dust, frame, dt, built, heat)
        if state.gas.across is not None:
            gas, dust = azimuthal(state, gas, dust)
            self._call(gas, dust, frame, dt, built, EMPTY)
            set_azimuthal(state, gas.vel, dust.vel)
        return kicked

    def _call(self, gas: Gas, dust: Dust, frame: Frame, dt: float, built: Any, heat: Array) -> KickResult:
        """Call the scheme.

        built: cells of the kick, the result of the scheme's `build`; None for a scheme without `build`.
        """
        return self.scheme.kick(gas, dust, self.classes.law, frame, dt, built, self._context(heat))

    def _build(self, state: Seen, gas: Gas, dust: Dust) -> Prepared:
        """Return the frame of a kick, and its cells if the scheme has any."""
        frame, scheme = self._frame(state), self.scheme
        if scheme.layout is None or scheme.build is None:
            return frame, None
        rule = self._rule(state)
        return frame, scheme.build(gas, dust, rule, scheme.layout(gas, dust, rule, frame, cells.OneRank()))

    def _frame(self, state: Seen) -> Frame:
        """Return the frame about the star, with its sense of rotation for schemes with cells."""
        if self.scheme.layout is None:
            return frames.Frame(*self.star, 0.0, 0.0, np.ones(1))
        return frames.frame_of(state.species, *self.star, self.samples)

    def _positions(self, state: Seen, gas_vel: Array) -> tuple[Gas, Dust]:
        """Return gas and dust with the arrays that determine the drag cells; all other arrays are empty.

        gas_vel (n, d): velocities of the gas.
        """
        gas, dust = state.gas, state.dust
        order_of_gas, order_of_dust = ((p.global_index, p.unsorted_rows, p.count) for p in (gas, dust))
        return (
            Gas(gas.pos, gas_vel, EMPTY, EMPTY, gas.mass, gas.h, EMPTY, EMPTY, *order_of_gas),
            Dust(dust.pos, dust.vel, EMPTY, EMPTY, dust.mass, self.classes.of, EMPTY, *order_of_dust),
        )

    def _complete(self, state: Seen, gas: Gas, dust: Dust) -> tuple[Gas, Dust]:
        """Return gas and dust with all arrays that a kick needs; gas, dust: results of `_positions`."""
        scene, density = state.scene, state.gas.density
        if state.gas.small is not None:  # small dust that gas carries exerts no drag on grains
            density = density * growth.gas_fraction(scene, state.gas)
        gas = gas._replace(
            acc=state.gas.acc, acc_unshared=state.acc_unshared["gas"], density=density,
            thermal_speed=thermal_speed(scene, state.gas),
        )  # fmt: skip
        dust = dust._replace(acc=state.dust.acc, acc_unshared=state.acc_unshared["dust"])
        if self.scheme.layout is None and not self.scheme.polar:
            return gas, dust
        if state.dust.size is not None:
            return gas, dust._replace(per_grain=self.classes.relative)
        return gas, dust._replace(
            per_grain=dust_density.densities_of_sparse_dust(gas, dust, self.classes.law, self._context(EMPTY), scene)
        )

    def _rule(self, state: Seen) -> CellRule:
        """Return the rule by which leaves are merged to drag cells at a state."""
        scene, gas, of_scheme = state.scene, state.gas, self.scheme.cells
        number, length, two_way = self.width.number, scene.drag.cell_length, scene.drag.direction == "two-way"
        lengths = self.width.limited_lengths(gas.pos, gas.h)
        leaf = length
        if leaf is None:
            h_least = world.processes.min(float(lengths.min(initial=np.inf)))
            leaf = of_scheme.leaf(scene, number, lambda: float(np.exp(mean(np.log(lengths)))), h_least)
        lattice = cells.lattice_on(state.grid, self.dim, self.width.rounded * leaf, gas.global_count)
        fewest = of_scheme.minimum(scene) if of_scheme.minimum else (1, 0)
        # With drag.cell_length a leaf already has the side of a cell; otherwise leaves are merged to the smallest side.
        return CellRule(
            self.dim, self.classes.number, lattice, lengths, of_scheme.least_side * number,
            lattice.side if length else 0.0, fewest, MAX_CELL_GROWTH, 8.0 if self.dim == 1 else 4.0, two_way,
            state.step + state.earlier,
        )  # fmt: skip

    def _context(self, heat: Array) -> KickContext:
        """Return the context of a kick. heat (n,): output array for the heat, or an empty array."""
        ratios = [population.ratio for population in self.scene.dust]
        double_hump = self.scene.drag.kernel == "double-hump"
        return KickContext(self.dim, self.period, heat, self.buffers, self._new_sph, ratios, double_hump, self.geometry)

    def _new_sph(self) -> Any:
        """Return an object for SPH sums that need no velocities, with the options of the scene."""
        made = world.processes.make_sph(sph.Sph, self.scene)
        made.ignore_velocities()
        return made
