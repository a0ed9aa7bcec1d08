"""Drag between gas and dust: dv/dt = a_g + eps (u - v) / t_stop, du/dt = a_d + (v - u) / t_stop.

v and u are the velocities of gas and dust, and eps is the dust-to-gas ratio. In a scene with drag, this effect makes
the whole kick: accelerations and drag are solved together, so that the slip u - v is right at any step. Schemes are in
`discsim/drag`, laws of the stopping time in `formulas/laws.py`. Two-way drag of an explicit scheme limits the step to
about t_stop / max(1, eps). All other drag sets no limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.drag.base import KickResult
from discsim.drag.classes import estimated_class_count
from discsim.drag.engine import Engine
from discsim.effects import base
from discsim.effects.drag_base import DragEffect
from discsim.effects.gas import kick_energy, kick_gas
from discsim.numerics.state import State
from discsim.numerics.threads import copied, parallel_for
from discsim.numerics.totals import mean
from discsim.parts import LAWS, SCHEMES, Lazy
from discsim.physics.grains import has_sizes
from discsim.physics.laws import stopping_times
from discsim.scene.keys import Drag as Keys
from discsim.scene.rules import Draft, Problem, quoted

if TYPE_CHECKING:
    from discsim.scene import Scene

moves = Lazy("discsim.kernels.common.move")
heat_of_drag = Lazy("discsim.drag.heat")
# Keys that apply only to SPH gas.
OF_CELLS = ("scheme", "kernel", "cell", "class_width", "heating", "integration")
COST_OF_CLASS = 0.12  # additional cost of each further class of grains, as a fraction of the cost of a kick


def _table_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of drag without gas or without dust."""
    for table in ("gas", "dust"):
        if not draft.has(table) and not (table == "gas" and draft.has("background")):
            also = " or [background]" if table == "gas" else ""
            yield ("drag",), f"drag needs {table}; add a table [{table}]{also}, or remove [drag]"


def _class_width_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of drag.class_width if all grains of each population have the same size."""
    grows = draft.has("growth")
    if draft.gives("drag", "class_width") and not grows and not any(map(has_sizes, draft.dust or ())):
        words = "set dust.grain_size to a size distribution, add [growth], or remove this key"
        yield ("drag", "class_width"), f"class_width needs grains of different sizes; {words}"


def _law_key_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of keys that the drag law needs or does not use."""
    law = draft.drag.law
    for key in dict.fromkeys(part.key for part in LAWS.values() if part.key):
        laws = [name for name in LAWS if LAWS[name].key == key]
        given = getattr(draft.drag, key) is not None
        of_dust = any(getattr(dust, key, None) is not None for dust in draft.dust or ())
        if of_dust and law not in laws:
            wrong = f'used only with drag.law = {quoted(laws)}, but drag.law is "{law}"'
            yield ("dust", key), f"{wrong}; choose another law, or remove this key"
        elif law in laws and not given and not of_dust:
            yield ("drag", key), f'missing, but required by drag.law = "{law}"; add this key'
        elif law not in laws and given:
            wrong = f'used only with drag.law = {quoted(laws)}, but drag.law is "{law}"'
            yield ("drag", key), f"{wrong}; choose another law, or remove this key"
    if draft.drag.supersonic and not LAWS[law].of_grains:
        words = quoted(name for name in LAWS if LAWS[name].of_grains)
        yield (
            ("drag", "supersonic"),
            f'drag.law "{law}" has no supersonic correction; set drag.supersonic = false, or choose drag.law {words}',
        )
    if draft.drag.mean_free_column is not None and not LAWS[law].needs_mean_free_path:
        words = quoted(name for name in LAWS if LAWS[name].needs_mean_free_path)
        yield (
            ("drag", "mean_free_column"),
            f'not used with drag.law = "{law}"; choose drag.law {words}, or remove this key',
        )


def _scheme_key_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of keys that the drag scheme, or drag by a [background], does not use."""
    scheme = draft.drag.scheme
    if draft.has("background"):
        unused = {"not used with [background], which has no drag cells": OF_CELLS}
    else:
        unused = {f'scheme "{scheme}" has {why}': keys for why, keys in SCHEMES[scheme].unused.items()}
    for wrong, keys in unused.items():
        for key in keys:
            if draft.gives("drag", key):
                yield ("drag", key), f"{wrong}; remove this key"
    if draft.drag.cell is not None and draft.drag.cell_length is not None:
        yield ("drag", "cell_length"), "drag.cell is also given; keep drag.cell or drag.cell_length"


def _heating_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of drag.heating in gas without an energy equation, and with one-way drag."""
    if not draft.drag.heating:
        return
    if draft.gas and not draft.eos.holds_heat:
        yield (
            ("drag", "heating"),
            f'gas with gas.eos.kind = "{draft.eos_kind}" has no energy equation; set drag.heating = false',
        )
    if draft.drag.direction == "one-way":
        yield ("drag", "heating"), "one-way drag does not act on the gas; set drag.heating = false"


CELLS = "drag.cells"  # name of the operator that builds the drag cells


class Effect(DragEffect):
    """Drag between SPH gas and dust particles, and the whole kick of the species."""

    keys = Keys
    role = base.Role(kicks=True, grid=True, lists_schemes=True)
    rules = (_table_problems, _law_key_problems, _scheme_key_problems, _class_width_problems, _heating_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.drag, self.state = scene.drag, state
        self.two_way = self.drag.direction == "two-way"
        self.engine = Engine(scene, state.central)
        self.law = self.engine.law
        self._kicked = (-1, 0.0)  # step and time of the last kick

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        more = 1.0 + COST_OF_CLASS * (estimated_class_count(scene) - 1)
        return SCHEMES[scene.drag.scheme].nanoseconds * more * (counts.gas + counts.dust)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return sum(SCHEMES[scene.drag.scheme].unused.values(), ())

    def operators(self, state: State) -> list[base.Operator]:
        reads = base.arrays("gas", "pos vel mass h") | base.arrays("dust", "pos vel mass species size") | {"bodies"}
        motion = base.arrays(("gas", "dust"), "acc") | base.arrays("gas", "density sound_speed u small")
        return [
            base.Operator(CELLS, base.Slot.KICK_INPUT, self.find_cells, reads),
            base.Operator("drag.limit", base.Slot.LIMIT, self.limit, reads | motion),
            base.Operator("drag.kick", base.Slot.KICK, self.kick),
        ]

    def stopping_time(
        self, population: int, density: np.ndarray, sound: np.ndarray, omega: np.ndarray, ratio: float
    ) -> np.ndarray:
        """Return the stopping times (n,) of the dust population with the index `population` at zero slip.

        density, sound, omega (n,): density, thermal speed and orbital frequency of the gas. ratio: dust-to-gas mass
        ratio of the population.
        """
        return self.law.stopping_time(population, density, sound, omega, ratio)

    @property
    def stopping_times(self) -> np.ndarray:
        """Stopping times of the dust at the last kick (n,), inf without gas."""
        return self.engine.stopping_times

    @property
    def uncoupled(self) -> float:
        """Fraction of the dust mass without gas, or in a cell enlarged for lack of particles, at the last kick."""
        return self.engine.uncoupled_share(self.state.dust)

    def find_cells(self, view: base.View) -> tuple[Any, np.ndarray] | None:
        """Return the drag cells of the next kick and the present gas velocities; None if the kick builds the cells."""
        # About a moving centre, building cells shifts positions, which other threads read at this time.
        if self.engine.scheme.build is None or view.centre is not None or not _both_present(view):
            return None
        return self.engine.prepare(view), copied(view.gas.vel)

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        """Estimate the limit of an explicit scheme: the shortest t_stop / max(1, eps)."""
        at, drag = outlook.at, scene.drag
        if not SCHEMES[drag.scheme].explicit or drag.direction == "one-way" or not scene.gas:
            return base.Expected()
        found = stopping_times(scene, at.density, at.thermal_speed, at.omega)
        loading = max(1.0, sum(dust.ratio for dust in scene.dust or ()))
        return at.smallest(np.min(found, axis=0) / loading) if found else base.Expected()

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        if not self.engine.scheme.explicit or not self.two_way or not _both_present(view):
            return {}
        return {base.ALL: base.Limit(self.engine.limit(view))}

    def kick(self, state: State, dt: float) -> None:
        """Advance the velocities of gas and dust, and the energies of the gas, over dt."""
        gas, dust, two_way = state.gas, state.dust, self.two_way
        self._kicked = state.step, state.time
        prepared, before = state.results.pop(CELLS, None) or (None, copied(gas.vel))
        heat = np.zeros(gas.count if self.drag.heating else 0)
        if _both_present(state):
            # One-way: `kick_gas` below kicks the gas, with the same bits as without dust.
            self.engine.kick(state, dt, gas.vel if two_way else before, heat, prepared)
        else:
            parallel_for(moves.add_scaled, gas.count, gas.vel if two_way else before, gas.acc, dt, light=True)
            parallel_for(moves.add_scaled, dust.count, dust.vel, dust.acc, dt, light=True)
            self.engine.record(dust, KickResult(np.arange(dust.count), np.full(dust.count, np.inf)))
        if not two_way:
            kick_gas(state, dt)
            return
        if gas.kick_acc is not None:
            parallel_for(moves.rate_of_change, gas.count, gas.vel, before, dt, gas.kick_acc, light=True)
        if gas.u is not None:
            gas.kick_rate[:] = gas.heating_rate
            if len(heat) > 0:
                # `heating_rate` has the work of pressure and viscosity at predicted velocities. The difference from
                # the work at actual velocities is heat, so that the total energy is conserved.
                heat += dt * np.einsum("ij,ij->i", gas.pressure_acc, gas.pressure_vel - 0.5 * (before + gas.vel))
                heat_of_drag.compensate_losses(gas, mean(gas.h), heat)
                gas.kick_rate += heat / dt
            kick_energy(state, dt)
        if gas.immobile is not None:
            gas.vel[gas.immobile] = before[gas.immobile]

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Return the stopping times (n,) of the dust at its present positions, inf without gas.

        The velocities of the state do not change. Stopping times of the last kick are reused if no particle has moved
        since and they do not depend on velocities.
        """
        gas, dust = state.gas, state.dust
        if self._kicked == (state.step, state.time) and not self.law.nonlinear:
            return self.stopping_times
        if not _both_present(state):
            return np.full(dust.count, np.inf)
        vel, dust.vel = dust.vel, dust.vel.copy()
        across = [(p, p.across) for p in (gas, dust) if p.across is not None]
        for p, kept in across:
            p.across = kept.copy()
        state.results.pop(CELLS, None)  # the caller may have changed positions
        self.engine.kick(state, 0.0, gas.vel.copy(), np.zeros(gas.count if self.drag.heating else 0))
        dust.vel = vel
        for p, kept in across:
            p.across = kept
        return self.stopping_times


def _both_present(state: State | base.View) -> bool:
    """Return whether gas and dust are left, counted over all processes."""
    return state.gas.global_count > 0 and state.dust.global_count > 0
