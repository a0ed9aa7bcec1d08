"""Cooling of adiabatic gas: du/dt = heating - (u - u_eq) / t_cool, or radiation from the two surfaces of a grey disc.

    kind = "beta"         t_cool = beta / Omega_K, with Omega_K about the central mass
    kind = "constant"     t_cool the same everywhere
    kind = "radiative"    du/dt = heating - 2 sigma (T^4 - T_irr^4) / (tau_eff Sigma),
                          tau_eff = 3 tau / 8 + sqrt(3) / 4 + 1 / (4 tau), tau = kappa Sigma / 2 (Hubeny 1990)

kappa is the opacity. u_eq and T_irr are the specific energy and temperature of a disc heated only by the star,
u_eq = (H/r)^2 (G M / r) / (gamma - 1). Cooling is part of the kick of u, which solves cooling and all heating together
(`kernels/sph/cooling.py`). The solution is right at any step, so cooling sets no time-step limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.numerics.state import Gas, State
from discsim.numerics.threads import parallel_for
from discsim.parts import Lazy
from discsim.physics import cooling as physics
from discsim.scene.keys import OPACITY_TABLE
from discsim.scene.keys import Cooling as Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.sph.cooling")

KEY_OF = {"beta": "beta", "constant": "t_cool", "radiative": "opacity"}  # the key that each kind needs
# CPU nanoseconds in a step, per particle, of one kick and one prediction of the energy.
NANOSECONDS = {"beta": 100.0, "constant": 60.0, "radiative": 1000.0}


def _energy_equation_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene whose gas has no energy equation, or whose drag scheme has no cooling."""
    if not draft.has("gas"):
        yield ("cooling",), "cooling needs gas; add a table [gas], or remove [cooling]"
    elif draft.gas and not draft.eos.holds_heat:
        wrong = f'gas with eos.kind = "{draft.eos_kind}" has no energy equation'
        yield ("cooling",), f'{wrong}; set gas.eos.kind = "adiabatic"'
    else:
        yield from base.grid_scheme_problems(draft, "cooling", "cooling")


def _key_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the keys that belong to each kind of cooling."""
    own = draft.cooling
    for kind, key in KEY_OF.items():
        given = getattr(own, key) is not None
        if kind == own.kind and not given:
            yield ("cooling", key), f'missing, but required by cooling.kind = "{kind}"; add this key'
        elif kind != own.kind and given:
            wrong = f'used only with cooling.kind = "{kind}", but cooling.kind is "{own.kind}"'
            yield ("cooling", key), f'{wrong}; set cooling.kind = "{kind}", or remove this key'
    if isinstance(own.opacity, float) and own.opacity <= 0.0:
        yield ("cooling", "opacity"), f"opacity {own.opacity:g} is not positive; expected more than 0"
    if own.kind == "radiative" and draft.in_code_units:
        wrong = "radiative cooling needs temperatures, which do not exist in code units"
        yield ("cooling", "kind"), f'{wrong}; set units.system = "physical", or cooling.kind = "beta" or "constant"'


def _star_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of keys that need a star, in a scene without one."""
    own = draft.cooling
    if draft.has("star"):
        return
    if own.kind != "constant":
        what = "beta / Omega" if own.kind == "beta" else "the height of a disc"
        yield ("cooling", "kind"), f"{what} needs the orbital frequency about a star; add a table [star]"
    elif own.aspect_ratio is not None:
        yield ("cooling", "aspect_ratio"), "H/r is defined only about a star; add a table [star]"


def _temperature_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the temperature to which the gas cools, which [cooling] or gas.eos must define."""
    own, gas = draft.cooling, draft.gas
    if not gas or not draft.eos.holds_heat or own.aspect_ratio is not None or gas.eos.aspect_ratio is not None:
        return
    if gas.eos.sound_speed is None:
        wrong = "the temperature to which gas cools is given neither in [cooling] nor in [gas.eos]"
        yield ("cooling", "aspect_ratio"), f"{wrong}; add cooling.aspect_ratio"
        return
    for key in ("temperature_index", "reference_radius"):
        if draft.gives("cooling", key):
            yield (
                ("cooling", key),
                "used only with cooling.aspect_ratio or gas.eos.aspect_ratio; add cooling.aspect_ratio",
            )


class Effect(base.Effect):
    """Cooling of the gas. The kick of its energy calls the method `cooled_energy`, as `state.cooled_energy`."""

    keys = Keys
    rules = (_energy_equation_problems, _key_problems, _star_problems, _temperature_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.own = scene.cooling
        self.target = physics.target_energy_law(scene)
        self.radiation = physics.radiative_constants(scene) if self.own.kind == "radiative" else np.empty(0)
        self.state = state
        state.cooled_energy = self.cooled_energy

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return NANOSECONDS[scene.cooling.kind] * counts.gas

    def cooled_energy(self, gas: Gas, dt: float) -> np.ndarray:
        """Return the specific energies (n,) of the gas after dt of cooling and of heating at the rate `gas.kick_rate`.

        The gas itself does not change. Immobile gas keeps its energy.
        """
        if dt == 0.0:
            return gas.u.copy()
        own, rate, out = self.own, gas.kick_rate, np.empty_like(gas.u)
        pos = self.state.from_centre(gas.pos)
        if own.kind == "radiative":
            kappa = 0.0 if own.opacity == OPACITY_TABLE else own.opacity
            grey = kappa, self.target, *self.state.central, self.radiation
            parallel_for(kernels.cool_radiatively, gas.count, pos, gas.u, gas.density, rate, dt, *grey, out)
        else:
            time = own.beta if own.kind == "beta" else own.t_cool
            law = own.kind == "beta", time, self.target, *self.state.central
            parallel_for(kernels.relax_to_energy, gas.count, pos, gas.u, rate, dt, *law, out)
        if gas.immobile is not None:
            out[gas.immobile] = gas.u[gas.immobile]
        return out
