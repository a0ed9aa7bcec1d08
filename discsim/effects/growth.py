"""Dust growth with two populations: da_r/dt = rho_d v_rel / rho_s, n(a) ~ a^-3.5 from a_min to a_r.

The model is that of FEoSaD (Stoyanovskaya et al. 2017; Vorobyov et al. 2018, arXiv:1801.06898); `formulas/growth.py`
has the equations. Small dust, with sizes below a_*, moves with the gas: the array `small` is the mass of small dust
that each gas particle carries. The particles of [dust] represent grown dust. Each has its own largest size a_r, which
grows up to the size at which grains fragment. While a_r rises, small dust becomes grown dust such that n(a) is
continuous at a_*; while it falls, grown dust becomes small dust (`kernels/dust/growth.py` has the exchange).

Growth is applied at the end of a step, if the fastest grains may have grown by the fraction GROWTH_STEP since its
last application. Otherwise sizes and masses do not change. An application advances sizes in substeps with a relative
error of 1e-10 each, so that growth sets no time-step limit. Exchanged mass keeps its velocity, and the total thermal
energy of the gas does not change. Mass and momentum are conserved to rounding, and so is angular momentum if the
grains have gas on all sides. With one-way drag, growth has no effect on the gas: `mass` then excludes small dust.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from discsim.effects import base
from discsim.effects.dust import laws_of_grains, schemes_with_sizes
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics import world
from discsim.numerics.state import State, SubcycleClock
from discsim.numerics.threads import parallel_for
from discsim.parts import LAWS, SCHEMES, Lazy
from discsim.physics import growth
from discsim.physics.laws import SceneLaw
from discsim.scene.fields import Default, Length, Number, Table, Velocity, units_of
from discsim.scene.keys import Sizes
from discsim.scene.rules import Draft, Problem, missing_tables

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.growth")
sums = Lazy("discsim.kernels.dust.growth_sums")
exchange = Lazy("discsim.kernels.dust.growth_exchange")
neighbours = Lazy("discsim.numerics.neighbours")
meeting = Lazy("discsim.numerics.meeting")
smoothing = Lazy("discsim.numerics.sph")

GROWTH_STEP = 0.03  # relative change of the fastest-growing size between two applications
STEPS_BETWEEN_CALLS = 6  # typical number of steps between two applications
# CPU nanoseconds in an application: per grain, and per gas neighbour of a grain and pass; number of passes.
GRAIN_COST, PAIR_COST, PASSES = 1000.0, 6.0, 4


def _default_length(length: str) -> BeforeValidator:
    """Return a validator that gives a key the default `length` in scenes with physical units."""

    def fill(value: Any, info: ValidationInfo) -> Any:
        return length if value is None and units_of(info).system == "physical" else value

    return BeforeValidator(fill)


class Keys(Table):
    """Growth and fragmentation of dust."""

    fragmentation_speed: Velocity = Field(
        ge=0, description="impact velocity above which grains fragment; 0: all dust becomes small"
    )
    alpha: Annotated[Number | None, Default("same as alpha_viscosity")] = Field(
        None, ge=0, description="alpha of the turbulence that sets collision velocities and settling"
    )
    small_size: Annotated[Length | None, _default_length("1 um"), Default('"1 um"; required in code units')] = Field(
        None, gt=0, validate_default=True, description="a_*: size below which dust is small dust, carried by the gas"
    )
    smallest: Annotated[
        Length | None, _default_length("5e-3 um"), Default('"5e-3 um"; in code units small_size / 200')
    ] = Field(None, gt=0, validate_default=True, description="a_min in the size distribution n(a) ~ a^-3.5")
    small_ratio: Annotated[Number | None, Default("dust.ratio: all dust")] = Field(
        None, ge=0, description="initial mass ratio of small dust to gas, included in dust.ratio"
    )


# Reasons why growth needs other tables, for messages.
NEEDS = {
    "gas": "growth needs gas to carry small dust",
    "dust": "growth needs dust particles",
    "drag": "collision velocities need drag",
    "star": "collision velocities need an orbital frequency",
}


def _scene_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene without the tables that growth needs, or with particles that include small dust."""
    where = ("growth",)
    needs = dict(NEEDS)
    if draft.has("background"):
        del needs["gas"]
        yield (
            where,
            "growth needs gas particles to carry small dust, but [background] has none; replace [background] by [gas]",
        )
    yield from missing_tables(draft, where, needs)
    if draft.growth.alpha is None and not draft.has("alpha_viscosity"):
        yield where, "no strength of the turbulence is given; add growth.alpha, or a table [alpha_viscosity]"
    if draft.growth.small_ratio is not None and (draft.start is None or draft.start.restore):
        wrong = "not used with particles from a snapshot or from the caller, which include their small dust"
        yield (*where, "small_ratio"), f"{wrong}; remove this key"


def _size_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the sizes of small dust."""
    own = draft.growth
    if own.small_size is None:
        wrong = "missing; the default 1 um is not available in code units"
        yield ("growth", "small_size"), f"{wrong}; add a size in code units"
    elif own.smallest is not None and own.small_size <= own.smallest:
        yield ("growth", "smallest"), "the size is not smaller than growth.small_size; expected smallest < small_size"


def _dust_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the dust, which must be one population with one initial size."""
    if draft.dust is None:
        return
    if len(draft.dust) > 1:
        yield ("growth",), f"{len(draft.dust)} populations of dust, but growth allows one; keep one [[dust]] table"
        return
    ((dust,), own), where = (draft.dust, draft.growth), ("dust", 0, "grain_size")
    if isinstance(dust.grain_size, Sizes):
        yield where, "a size distribution is not allowed with growth; expected a length, the initial size of all grains"
    elif None not in (dust.grain_size, own.small_size) and dust.grain_size < own.small_size:
        yield where, f"the initial size is smaller than growth.small_size; expected at least {own.small_size:g}"
    if own.small_ratio is not None and own.small_ratio > dust.ratio:
        wrong = f"the ratio is larger than dust.ratio = {dust.ratio:g}, which includes small dust"
        yield ("growth", "small_ratio"), f"{wrong}; lower small_ratio to at most dust.ratio"


def _drag_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a drag law or scheme that does not depend on the size of each grain."""
    if draft.drag is None:
        return
    law, scheme = draft.drag.law, draft.drag.scheme
    if not LAWS[law].of_grains:
        wrong = f'growth needs a drag law that depends on grain size, and "{law}" does not'
        yield ("growth",), f"{wrong}; choose drag.law {laws_of_grains()}"
    if not SCHEMES[scheme].sizes and not draft.has("background"):
        wrong = f'growth needs a scheme with a size per particle, and "{scheme}" has one per population'
        yield ("growth",), f"{wrong}; choose drag.scheme {schemes_with_sizes()}"


class Effect(base.Effect):
    """Growth of dust particles, and exchange of mass with small dust. grains: parameters for the kernels."""

    keys = Keys
    rules = (_scene_problems, _size_problems, _dust_problems, _drag_problems)
    from_start = ("grains",)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.mass_includes_small = growth.gas_mass_includes_small_dust(scene)
        law, (dust,), own = SceneLaw(scene), scene.dust or (), scene.table("growth")
        all_dust = float(state.dust.mass.sum() + state.gas.small.sum())
        self.grains = kernels.Grains(
            own.small_size, growth.smallest_size(scene), dust.grain_density, own.fragmentation_speed,
            float(law.typical[0]), law.code, law.grains[0],
            growth.SEED * all_dust / state.dust.count,
        )  # fmt: skip
        state.subcycle_clock = SubcycleClock()

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(_growth_rows(scene, at), _growth_warnings(scene, at))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        neighbours = SMOOTHING[scene.gas.kernel].neighbours(scene.gas.eta) if scene.gas else 0.0
        return counts.dust * (GRAIN_COST + PASSES * PAIR_COST * neighbours) / STEPS_BETWEEN_CALLS

    def operators(self, state: State) -> list[base.Operator]:
        return [
            base.Operator("growth.clock", base.Slot.MOVE, self.move),
            base.Operator("growth.exchange", base.Slot.EVENT, self.event),
        ]

    def move(self, state: State, dt: float) -> None:
        """Advance the clock of the applications by dt."""
        state.subcycle_clock = SubcycleClock(state.subcycle_clock.since + dt, state.subcycle_clock.rate)

    def event(self, state: State) -> None:
        """Apply growth if sizes may have changed enough since the last application."""
        since, rate = state.subcycle_clock
        if since * rate >= GROWTH_STEP and state.gas.global_count > 0 and state.dust.global_count > 0:
            state.subcycle_clock = SubcycleClock(rate=self._grow(state, since))

    def _grow(self, state: State, dt: float) -> float:
        """Apply growth over dt to sizes, masses and velocities; return the rate that sets the next application's time.

        The rate is the largest relative growth rate of a grain, at least GROWTH_STEP per orbit of the innermost grain.
        """
        dust = state.dust
        centre = np.zeros(2) if state.centre is None else state.centre[0]
        around = self.gas_around(state)
        field = around.find(centre)
        wanted = np.empty(dust.count)
        r = np.sqrt(((dust.pos - centre) ** 2).sum(axis=1))
        # The kernel skips grains at the centre of the star.
        omega = state.kepler_omega(r)
        alpha = growth.alpha(self.scene, r, field[:, kernels.SPEED2], omega)
        dust.size = dust.size.copy()  # a new array shows `Classes.sort` that sizes have changed
        rates = parallel_for(
            kernels.grow, dust.count, dt, *state.central, dust.pos, centre, field, alpha,
            self.grains, dust.mass, dust.size, wanted,
        )  # fmt: skip
        self._change_gas(state, *around.exchange(wanted))
        # The gas around a slowly growing grain may change within an orbit.
        fastest = max(*rates, float(omega.max(initial=0.0)) * GROWTH_STEP / (2.0 * math.pi))
        return float(world.processes.max(fastest))

    def gas_around(self, state: State) -> GasAroundGrains:
        """Return the gas around the dust of `state`."""
        return GasAroundGrains(state, self.mass_includes_small)

    def _change_gas(self, state: State, taken: np.ndarray, got: np.ndarray) -> None:
        """Change small dust and, with two-way drag, masses and velocities of the gas: result of `exchange`."""
        gas = state.gas
        lost = gas.small * taken
        gas.small += got[:, 0] - lost
        if not self.mass_includes_small:
            return
        after = gas.mass - lost + got[:, 0]
        gas.vel += (got[:, 1:] - (got[:, 0] - lost)[:, None] * gas.vel) / after[:, None]
        for per_mass in (gas.u, gas.kick_rate, gas.radiated):
            if per_mass is not None:
                per_mass *= gas.mass / after
        gas.mass[:] = after


class GasAroundGrains:
    """Gas particles around dust particles, and the exchange of mass between them.

    state: with gas and dust. mass_includes_small: whether the mass of the gas includes small dust.
    """

    def __init__(self, state: State, mass_includes_small: bool) -> None:
        gas, dust = state.gas, state.dust
        self.gas, self.dust = gas, dust
        self.carried = gas.mass - gas.small if mass_includes_small else gas.mass  # mass of the gas without small dust
        self.search(state)

    def search(self, state: State) -> None:
        """Find the gas around each dust particle."""
        self.sph = smoothing.Sph(state.scene)
        self.met = meeting.GasCells(self.sph, self.gas).neighbours_of(self.dust.pos, self.dust.global_index)

    def find(self, centre: np.ndarray) -> np.ndarray:
        """Return the properties of gas and dust around each dust particle.

        Parameters
        ----------
        centre : ndarray, shape (2,)
            Position of the centre of the disc.

        Returns
        -------
        ndarray, shape (n, COLUMNS)
            Surroundings in the columns of `kernels/dust/growth.py`.
        """
        gas, met = self.gas, self.met
        deposit, self.field = np.empty(len(met.pos)), np.empty((len(met.grain_pos), kernels.COLUMNS))
        parallel_for(
            sums.deposit_driver(self.sph.kernel), len(met.cells.filled), met.cells, met.grain_cells, met.pos, met.h,
            met.grains.with_ghosts(self.dust.mass), deposit, least=neighbours.LEAST, each=met.grains_about,
        )  # fmt: skip
        met.gas.update_ghosts(deposit)
        parallel_for(
            sums.gather_driver(self.sph.kernel), len(met.grain_cells.filled), met.grain_cells, met.cells,
            met.grain_pos, centre, self._carriers(), met.gas.with_ghosts(gas.mass / gas.density),
            met.gas.with_ghosts(gas.pressure), deposit, self.field, least=neighbours.LEAST, each=met.gas_about,
        )  # fmt: skip
        met.grains.update_ghosts(self.field)
        return self.field[met.grains.local_rows]

    def _carriers(self) -> Any:
        """Return arrays of the gas particles, which carry the small dust, including ghost particles."""
        gas, with_ghosts = self.gas, self.met.gas.with_ghosts
        return sums.CarrierGas(
            self.met.pos, *(with_ghosts(array) for array in (gas.vel, gas.h, self.carried, gas.small))
        )

    def exchange(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exchange mass between dust particles and the small dust of the gas around them.

        Masses and velocities of the dust change. `find` has to be called before.

        Parameters
        ----------
        wanted : ndarray, shape (n,)
            Mass that each dust particle should gain; a particle gains less if the gas around it has too little small
            dust.

        Returns
        -------
        taken : ndarray, shape (gas,)
            Fraction of the small dust of each gas particle that is taken.
        got : ndarray, shape (gas, 3)
            Mass that each gas particle receives, and the momentum that it receives minus the momentum that is taken.
        """
        dust, met, own = self.dust, self.met, self.met.gas.local_rows
        taken, spread = np.empty((2, len(met.pos)))
        got = np.empty((len(met.pos), 3))
        carriers = self._carriers()
        wanted, mass, vel = (met.grains.with_ghosts(array) for array in (wanted, dust.mass, dust.vel))
        parallel_for(
            exchange.exchange_gas_driver(self.sph.kernel),
            len(met.cells.filled), met.cells, met.grain_cells, carriers, vel, self.field, wanted, taken, spread, got,
            least=neighbours.LEAST, each=met.grains_about,
        )  # fmt: skip
        met.gas.update_ghosts(spread)
        parallel_for(
            exchange.exchange_dust_driver(self.sph.kernel),
            len(met.grain_cells.filled), met.grain_cells, met.cells, carriers, spread, self.field, wanted,
            met.grain_pos, mass, vel, least=neighbours.LEAST, each=met.gas_about,
        )  # fmt: skip
        dust.mass[:], dust.vel[:] = mass[met.grains.local_rows], vel[met.grains.local_rows]
        return taken[own], got[own]


def _growth_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of the growth limits and times."""
    found = growth.limits(scene, at)
    if found is None:
        return
    for name, sizes in (("fragmentation limit", found.fragmentation), ("drift limit", found.drift)):
        texts = [scene.units.show(float(size), "length") if size < math.inf else "none" for size in sizes]
        yield f"grain size at {name}", ", ".join(texts)
    yield "Stokes number at the smaller of the two limits", ", ".join(f"{stokes:.3g}" for stokes in found.stokes)
    times = [scene.units.show(float(time), "time") for time in found.time]
    yield "growth time of settled grains", ", ".join(times)


def _growth_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield a warning of initial sizes above the fragmentation limit."""
    found, (dust,) = growth.limits(scene, at), scene.dust or ()
    if found is not None and dust.grain_size > found.fragmentation.max() > 0.0:
        size = scene.units.show(float(found.fragmentation.max()), "length")
        yield (
            f"grains fragment above {size}, which is below dust.grain_size: lower dust.grain_size, or raise "
            "growth.fragmentation_speed"
        )
