"""SPH gas: dv/dt = -grad P / rho, with optional artificial viscosity and conductivity, and the motion of the particles.

`kernels/sph/forces.py` has the equations: density sum, adaptive smoothing length h with grad-h terms, conservative
force. The step limit is the smaller of h / (c_s (1 + 1.2 alpha) + h (1 + 1.2 beta) max(0, -div v)) (after Monaghan
1992) and sqrt(h / |a|). For the kernel quintic-h, h in these limits is a third of the smoothing length.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.effects import base
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics import alloc
from discsim.numerics.state import FOLLOWED, State
from discsim.numerics.threads import block_slices, copied, fill, parallel_for
from discsim.parts import EOS, Lazy
from discsim.physics import centre, companions, viscosity
from discsim.physics.eos import eos_of, pressure_and_sound_speed, radius, thermal_speed
from discsim.physics.local import longest_step, resolution
from discsim.physics.orbits import drift_masses
from discsim.scene.keys import Gas as Keys
from discsim.scene.rules import Draft, Problem, quoted

if TYPE_CHECKING:
    from discsim.scene import Scene

    Profile = Callable[[np.ndarray], np.ndarray]  # of radii (n,)

eos_kernels = Lazy("discsim.kernels.sph.eos")
moves = Lazy("discsim.kernels.common.move")
quiet = Lazy("discsim.effects.quiet")
growth = Lazy("discsim.physics.growth")
polar = Lazy("discsim.effects.polar")
sums = Lazy("discsim.numerics.sph")


# CPU nanoseconds in a step: per particle, and per neighbour of a particle by the precision of the sums.
PARTICLE, NEIGHBOUR = 300.0, {"double": 27.0, "single": 15.0}
RECONSTRUCTED, QUIET_COST = 1.2, 150.0  # factor on NEIGHBOUR for reconstructed velocities; per particle of quiet gas
QUIET_EOS = ("isothermal", "locally-isothermal")  # kinds of eos that allow quiet gas
DENSITY = "gas.density"  # name of the operator that computes it


def _smoothing_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a fixed smoothing length, or of one that gives a particle too few neighbours."""
    gas = draft.gas
    if gas.smoothing_length is not None:
        if draft.gives("gas", "eta"):
            yield ("gas", "smoothing_length"), "gas.eta is also given; keep gas.eta or gas.smoothing_length"
        elif draft.space and gas.smoothing_length > 2 * max(draft.space.size):
            times = gas.smoothing_length / max(draft.space.size)
            yield ("gas", "smoothing_length"), f"the length is {times:.3g} times space.size; expected at most 2 times"
        return
    kernel, axis = SMOOTHING[gas.kernel], draft.dimensions - 1
    if gas.eta < kernel.least_eta[axis]:
        wrong = f'{gas.eta:g} leaves a particle of kernel "{gas.kernel}" without neighbours'
        yield ("gas", "eta"), f"{wrong}; expected more than {kernel.least_eta[axis]:g}, like {kernel.eta[axis]:g}"


def _conductivity_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of conductivity in gas without an energy equation."""
    if draft.gas.conductivity and not draft.eos.holds_heat:
        wrong = f'conductivity needs an energy equation, but gas.eos.kind is "{draft.eos_kind}"'
        words = quoted(kind for kind, eos in EOS.items() if eos.holds_heat)
        yield ("gas", "conductivity"), f"{wrong}; expected {words}"


def _quiet_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of quiet gas.

    Quiet gas needs a disc or a periodic plane, isothermal gas and reconstructed velocities.
    """
    gas, where = draft.gas, ("gas", "quiet")
    if gas.quiet is None:
        return
    if not draft.has("star") and not (draft.space and draft.space.boundary == "periodic" and draft.dimensions == 2):
        yield where, "quiet gas needs a disc about a star, or a periodic 2D space; remove gas.quiet"
    if draft.eos_kind not in QUIET_EOS:
        wrong = f'quiet gas has no energy equation, but gas.eos.kind is "{draft.eos_kind}"'
        yield where, f'{wrong}; set gas.eos.kind = "isothermal" or "locally-isothermal", or remove quiet'
    if gas.viscosity is None or gas.viscosity.acts_in_shear:
        wrong = "quiet gas needs the velocity gradients of the reconstruction"
        yield where, f'{wrong}; set gas.viscosity.pairs = "reconstructed"'


def _switch_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a viscosity switch and a reconstruction that both remove viscosity from shear."""
    viscosity = draft.gas.viscosity
    if viscosity and not viscosity.acts_in_shear and viscosity.switch != "none":
        twice = f'"{viscosity.switch}" removes viscosity from shear, and so does pairs = "{viscosity.pairs}"'
        yield ("gas", "viscosity", "switch"), f"{twice}; keep switch or pairs"


def _grid_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of gas on a polar grid, and of its keys in other gas."""
    if draft.gas.method == "grid" or draft.gas.grid is not None:
        yield from polar.grid_problems(draft)


# Limits of h/H for a warning. Sound waves, and viscosity in shear, need h/H below FINE. h/H is largest at the edges of
# a disc, where gas spreads and falls in at any resolution. A mass fraction AT_EDGES of the gas may therefore have h/H
# above FINE, but no gas may have h/H above COARSE.
FINE, COARSE, AT_EDGES = 0.5, 1.0, 0.1


def _resolution_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield a warning of gas with a smoothing length too large for its scale height."""
    if at.resolution is None or at.scale_height is None:
        return
    ratio = at.resolution / at.scale_height
    worst = int(np.argmax(ratio))
    where = f"h/H = {ratio[worst]:.2g} {at.where(worst)}"
    values, fraction = at.by_mass()
    coarse = 1.0 - float(np.interp(FINE, values, fraction))
    inside = float(np.interp(1.0 - AT_EDGES, fraction, values))  # largest h/H without the coarsest gas
    needed = scene.gas.particles * max(ratio[worst] / COARSE, inside / FINE) ** 2
    if ratio[worst] > COARSE:
        yield f"{where}, above {COARSE:g}: raise gas.particles to about {needed:.2g}"
    elif coarse > AT_EDGES:
        yield (
            f"{where}, and above {FINE} for {coarse:.0%} of the gas, more than {AT_EDGES:.0%}: "
            f"raise gas.particles to about {needed:.2g}"
        )


def timestep_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield a warning of a run.timestep beyond the step limit of the gas."""
    dt = scene.run.timestep
    if dt is None or at.step is None:
        return
    worst = int(np.argmin(at.step))
    limit = at.step[worst]
    if dt > limit:
        given, best = (scene.units.show(time, "time") for time in (dt, limit))
        yield (
            f"run.timestep = {given} is {dt / limit:.2g} times the sound limit {at.where(worst)}: "
            f"lower run.timestep to {best}, or remove the key"
        )


# Estimates of the largest -div v. NOISE: by particle noise, in orbital frequencies of the innermost gas. GATHERING: of
# gas that collects about a companion, in the frequency of `companions.fastest_in_softening`. IN_SHOCKS: in a shock, in
# units of (velocity jump) / h. Fitted to the steps of the setups (`analysis/forecast_steps.py`, table in docs/cost.md).
NOISE, GATHERING, IN_SHOCKS = 0.15, 0.6, 0.2


class Effect(base.Effect):
    """SPH forces on the gas, and the motion of gas particles."""

    keys = Keys
    rules = (_grid_problems, _smoothing_problems, _conductivity_problems, _switch_problems, _quiet_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.sph = sums.Sph(scene)
        self.central_masses = drift_masses(scene, "gas")
        self.quiet = None
        if scene.gas.quiet is not None:
            self.quiet = quiet.QuietPlane(scene) if scene.star is None else quiet.QuietDisc(scene)

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(warnings=chain(_resolution_warnings(scene, at), timestep_warnings(scene, at)))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        each, gas = NEIGHBOUR[scene.gas.precision], scene.gas
        if gas.viscosity is not None and not gas.viscosity.acts_in_shear:
            each *= RECONSTRUCTED
        own = PARTICLE + (QUIET_COST if gas.quiet is not None else 0.0)
        return counts.gas * (own + each * SMOOTHING[gas.kernel].neighbours(gas.eta))

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        at = outlook.at
        if at.h is None or at.sound_speed is None:
            return base.Expected()
        closing: Any = 0.0
        where = ""
        if scene.star is not None and outlook.nearest < np.inf:
            noise = NOISE * float(centre.kepler_omega(scene, outlook.nearest))
            frequency, number = companions.fastest_in_softening(scene, outlook)
            closing = max(noise, GATHERING * frequency)
            where = f"near companion {number}" if closing > noise else ""
        if at.jump is not None:
            closing = closing + IN_SHOCKS * at.jump / resolution(scene, at.h)
        return at.smallest(longest_step(scene, at.h, at.sound_speed, closing), where)

    def pressure_push(self, state: State, gravity: Profile) -> Profile | None:
        """Return the initial outward acceleration of gas by pressure, as a function of radii (n,).

        gravity: inward acceleration by gravity, as a function of radii. None: that of the initial profile.
        """
        return None

    def operators(self, state: State) -> list[base.Operator]:
        slots, found = base.Slot, base.arrays("gas", "h density gradh h_before")
        reads, moved = base.arrays("gas", "pos mass"), base.arrays("gas", "vel kick_acc u kick_rate") | {"bodies"}
        forced = reads | found | {DENSITY, "gas.small", "bodies"}
        written = "acc_unshared pressure sound_speed density nu heating_rate pressure_acc pressure_vel "
        made = base.arrays("gas", written + " ".join(FOLLOWED))
        return [
            base.Operator(DENSITY, slots.FIELD, self.find_density, reads | moved, found),
            base.Operator("gas.forces", slots.FORCE, self.accelerate, forced, made),
            base.Operator("gas.limit", slots.LIMIT, self.limit, frozenset({"gas.forces"})),
            base.Operator("gas.kick", slots.KICK, kick_gas),
            base.Operator("gas.drift", slots.DRIFT, self.drift),
            base.Operator("gas.sort", slots.SORT, self.sort),
        ]

    def find_density(self, view: base.View) -> tuple[np.ndarray, np.ndarray | None] | None:
        """Compute densities, and return velocities and energies from `predicted`; None if the run has no gas left."""
        gas = view.gas
        if gas.global_count == 0:  # all gas is accreted
            return None
        vel, u = self.predicted(view)
        if gas.h_before is not None:
            gas.h_before[:] = gas.h
        self.sph.density(gas, vel)
        return vel, u

    def accelerate(self, view: base.View) -> float:
        """Add the accelerations by pressure and viscosity to `acc_unshared`, and return the step limit."""
        gas, predicted = view.gas, view.pop(DENSITY)
        if predicted is None:
            return np.inf
        (vel, u), acc = predicted, gas.acc_unshared
        self.set_pressure(view, u)
        if gas.nu is not None:
            self.find_viscosity(view)
        if gas.heating_rate is not None:
            gas.heating_rate[:] = 0.0
        before = None if gas.pressure_acc is None else copied(acc)
        if self.quiet is None:
            limit = self.sph.forces(gas, acc, vel, u, gas.pressure)
        else:
            with self.quiet.split_pressure(view, self.sph) as pressure:
                limit = self.sph.forces(gas, acc, vel, u, pressure)
        if gas.pressure_acc is not None:
            gas.pressure_acc[:] = acc - before
            gas.pressure_vel[:] = vel
        if gas.immobile is not None and gas.heating_rate is not None:
            gas.heating_rate[gas.immobile] = 0.0
        return limit

    def find_viscosity(self, view: State | base.View) -> None:
        """Set the shear viscosity of the gas, from its pressure."""
        gas = view.gas
        pos, speed = view.from_centre(gas.pos), thermal_speed(self.scene, gas)
        mass = view.central_mass if self.scene.star is not None else None
        fill(gas.nu, lambda piece: viscosity.diffusivity(self.scene, radius(pos[piece]), speed[piece], mass))

    def set_pressure(self, view: State | base.View, u: np.ndarray | None) -> None:
        """Set pressure and sound speed of the gas; u (n,): specific energies, or None."""
        gas, pos = view.gas, view.from_centre(view.gas.pos)
        out = gas.pressure, gas.sound_speed
        roots = eos_of(self.scene).roots(self.scene)
        if roots is not None and gas.small is None:  # the usual disc, which this kernel makes twice as fast
            parallel_for(eos_kernels.write_pressure_and_sound, gas.count, pos, gas.density, *roots, *out, light=True)
            return

        def part(first: int, last: int) -> None:
            for within in block_slices(first, last):
                energy, density = None if u is None else u[within], gas.density[within]
                if gas.small is not None and energy is None:  # small dust has no pressure; u is per total mass
                    density = density * growth.gas_fraction(self.scene, gas, within)
                out[0][within], out[1][within] = pressure_and_sound_speed(self.scene, pos[within], density, energy)

        parallel_for(part, gas.count)

    def predicted(self, state: State | base.View) -> tuple[np.ndarray, np.ndarray | None]:
        """Return velocity (n, d) and specific energy (n,) at the time of the positions, for viscosity and pressure.

        `vel` and `u` of the gas lack the closing kick of the step. These arrays are extrapolated with the mean rates
        of the last kick, including drag and its heat, which makes the step second order. Cooling is computed as in
        the kick. The energy is None for gas without an energy equation.
        """
        gas, vel = state.gas, state.gas.vel
        if gas.kick_acc is not None:
            vel = alloc.allocate_like(gas.vel)
            parallel_for(moves.sum_scaled, gas.count, gas.vel, gas.kick_acc, state.velocity_lag, vel, light=True)
        return vel, None if gas.u is None else energy_after(state, state.velocity_lag)

    def viscous_acceleration(self, state: State) -> np.ndarray:
        """Return the acceleration (n, d) by artificial viscosity and, with [alpha_viscosity], by shear viscosity."""
        gas = state.gas.copy()
        gas.acc[:] = 0.0
        vel, u = self.predicted(state)
        self.sph.density(gas, vel)
        self.sph.forces(gas, gas.acc, vel, u, np.zeros(gas.count))
        return gas.acc

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        return {"gas": base.Limit(view["gas.forces"])}

    def drift(self, state: State, dt: float) -> None:
        base.drift(self.scene, state.gas, dt, self.central_masses)

    def sort(self, state: State) -> None:
        """Sort the arrays of the gas by the cells of the neighbour search."""
        if state.gas.global_count > 0:
            state.gas.sort(*self.sph.keys(state.gas))


def kick_gas(state: State, dt: float) -> None:
    """Advance velocities and energies of the gas over dt: velocities at the rate `acc`, energies by `kick_energy`."""
    gas = state.gas
    parallel_for(moves.add_scaled, gas.count, gas.vel, gas.acc, dt, light=True)
    if gas.kick_acc is not None:
        parallel_for(moves.copy, gas.count, gas.kick_acc, gas.acc, light=True)
    if gas.u is not None:
        gas.kick_rate[:] = gas.heating_rate
        kick_energy(state, dt)


def kick_energy(state: State, dt: float) -> None:
    """Advance energies of the gas over dt at the rate `kick_rate`, and record the energy radiated by cooling."""
    gas = state.gas
    after = energy_after(state, dt)
    if gas.radiated is not None:
        gas.radiated += gas.u + dt * gas.kick_rate - after
    gas.u[:] = after


def energy_after(state: State | base.View, dt: float) -> np.ndarray:
    """Return the specific energies (n,) of the gas after dt of heating at the rate `kick_rate` and of cooling."""
    gas, least = state.gas, state.scene.model.least_energy
    after = gas.u + dt * gas.kick_rate if state.cooled_energy is None else state.cooled_energy(gas, dt)
    return np.maximum(after, least * gas.u) if least > 0.0 else after
