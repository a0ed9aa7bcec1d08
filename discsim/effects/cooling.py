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
from discsim.parts import SCHEMES, Lazy
from discsim.physics import cooling as physics
from discsim.scene.keys.cooling import TABLE, Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.sph.cooling")

KEY_OF = {"beta": "beta", "constant": "t_cool", "radiative": "opacity"}  # the key that each kind needs
# CPU nanoseconds in a step, per particle, of one kick and one prediction of the energy.
NANOSECONDS = {"beta": 100.0, "constant": 60.0, "radiative": 1000.0}


def _needs_energy_equation(draft: Draft) -> Iterator[Problem]:
    if not draft.has("gas"):
        yield ("cooling",), "cooling needs gas; expected a table [gas] too, or no [cooling]"
    elif draft.gas and not draft.eos.holds_heat:
        yield (
            ("cooling",),
            f'gas with eos.kind = "{draft.eos_kind}" has no energy equation; expected eos.kind = "adiabatic"',
        )
    elif draft.drag and SCHEMES[draft.drag.scheme].on_grid:
        yield ("cooling",), f'drag.scheme "{draft.drag.scheme}" has no cooling; expected another drag.scheme'


def _keys_of_kind(draft: Draft) -> Iterator[Problem]:
    own = draft.cooling
    for kind, key in KEY_OF.items():
        given = getattr(own, key) is not None
        if kind == own.kind and not given:
            yield ("cooling", key), f'missing, but kind = "{kind}" needs it; expected this key too'
        elif kind != own.kind and given:
            yield (
                ("cooling", key),
                f'used only by kind "{kind}", but cooling.kind is "{own.kind}"; expected kind = "{kind}", or this '
                "key left out",
            )
    if isinstance(own.opacity, float) and own.opacity <= 0.0:
        yield ("cooling", "opacity"), f"opacity {own.opacity:g} is not positive; expected more than 0"


def _star(draft: Draft) -> Iterator[Problem]:
    own = draft.cooling
    if draft.has("star"):
        return
    if own.kind != "constant":
        what = "beta / Omega" if own.kind == "beta" else "the height of a disc"
        yield ("cooling", "kind"), f"{what} needs a star to orbit; expected a table [star] too"
    elif own.aspect_ratio is not None:
        yield (
            ("cooling", "aspect_ratio"),
            "H/r is defined only about a star; expected a table [star] too",
        )


def _passive_temperature(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the temperature of the passive disc, which [cooling] or gas.eos must define."""
    own, gas = draft.cooling, draft.gas
    if not gas or not draft.eos.holds_heat or own.aspect_ratio is not None or gas.eos.aspect_ratio is not None:
        return
    if gas.eos.sound_speed is None:
        yield (
            ("cooling", "aspect_ratio"),
            "no temperature to cool to, neither here nor in gas.eos; expected cooling.aspect_ratio",
        )
        return
    for key in ("temperature_index", "reference_radius"):
        if draft.gives("cooling", key):
            yield ("cooling", key), "used only with an aspect_ratio, here or in gas.eos; expected aspect_ratio too"


def _needs_physical_units(draft: Draft) -> Iterator[Problem]:
    if draft.cooling.kind == "radiative" and draft.in_code_units:
        wrong = "radiative cooling needs temperatures, which do not exist in code units"
        yield ("cooling", "kind"), f'{wrong}; expected units.system = "physical", or kind = "beta" or "constant"'


class Effect(base.Effect):
    keys = Keys
    rules = (_needs_energy_equation, _keys_of_kind, _star, _passive_temperature, _needs_physical_units)

    def __init__(self, scene: Scene, state: State) -> None:
        own = scene.cooling
        assert own is not None
        self.own = own
        self.passive = physics.passive_law(scene)
        self.light = physics.radiative_constants(scene) if own.kind == "radiative" else np.empty(0)
        self.state = state
        state.cooled = self.cooled

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        return NANOSECONDS[scene.cooling.kind] * counts.gas

    def cooled(self, gas: Gas, dt: float) -> np.ndarray:
        """Return the specific energies (n,) of the gas after dt of cooling, and of heating at the rate `kick_rate`.

        Positions do not change. The energy of immobile gas does not change either.
        """
        if dt == 0.0:
            return gas.u.copy()
        own, rate, out = self.own, gas.kick_rate, np.empty_like(gas.u)
        pos = self.state.from_centre(gas.pos)
        if own.kind == "radiative":
            kappa = 0.0 if own.opacity == TABLE else own.opacity
            grey = kappa, self.passive, *self.state.central, self.light
            parallel_for(kernels.radiative, gas.count, pos, gas.u, gas.density, rate, dt, *grey, out)
        else:
            time = own.beta if own.kind == "beta" else own.t_cool
            law = own.kind == "beta", time, self.passive, *self.state.central
            parallel_for(kernels.towards, gas.count, pos, gas.u, rate, dt, *law, out)
        if gas.immobile is not None:
            out[gas.immobile] = gas.u[gas.immobile]
        return out
