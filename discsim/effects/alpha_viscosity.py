"""Shear viscosity nu of SPH gas, alpha c_s H or a constant, as forces between pairs of particles.

    dv_i/dt = (d + 2) sum_j m_j 4 / [(1 / mu_i + 1 / mu_j) rho_i rho_j] (v_ij . e_ij / r_ij) e_ij F_ij             (1)
    F_ij    = d / (2 (d + 2) <q^2>) [q_i^2 dW(h_i)/dr + q_j^2 dW(h_j)/dr],   q = r_ij / h                          (2)

with e_ij = r_ij / |r_ij| and mu = rho nu of each particle (Espanol & Revenga 2003; for a viscosity that varies,
Lodato & Price 2010). The force acts along the line between two particles, so momentum and angular momentum are exact.
In uniform gas eq. (1) is nu (lap v + 2 grad div v): a bulk viscosity of 2 nu accompanies the shear viscosity nu.

Eq. (2) weights the kernel gradient with q^2. In a sum of plain gradients the nearest neighbours dominate, and nu is
off by 12% on a lattice and by 4 to 7% in a disc. With the weights of (2), nu is right to 2%, and a step may be twice
as long. The harmonic mean of mu keeps the stress continuous where nu has a step (Cleary & Monaghan 1999, for heat).
Gas that holds heat gains the energy that the pairs lose, in equal shares.

The effect of [gas] adds these forces together with the pressure (`kernels/sph/forces.py`). `physics/viscosity.py`
computes nu, from the present sound speed of each particle. In a [background], viscosity only causes a radial flow.

The step limit is 1 / (18 W(0, h) nu), which is 0.122 h^2 / nu for the cubic kernel. With steps above
1 / (14 W(0, h) nu), velocities of disordered particles grow, so `run.courant` is at most 0.72.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.physics import viscosity
from discsim.scene.keys import AlphaViscosity as Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

PARTICLE, NEIGHBOUR = 60.0, 2.5  # CPU nanoseconds in a step, per particle and per neighbour of a particle
TABLE = ("alpha_viscosity",)
STEP_KEYS = ("inner_alpha", "outer_alpha", "radius", "width")
DEAD_ZONE_KEYS = ("dead_alpha", "dead_inner", "dead_outer", "dead_width")
UNSTABLE = 1.25  # unstable step over step limit: in longer steps, velocities of disordered particles grow


def _law_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a table that defines no viscosity or several."""
    keys = draft.alpha_viscosity
    given = [key for key in ("alpha", "nu") if getattr(keys, key) is not None]
    given += [key for key in STEP_KEYS if getattr(keys, key) is not None][:1]
    if len(given) != 1:
        wrong = f"{' and '.join(given)} are both given" if given else "no viscosity is given"
        words = "give either alpha, or nu, or the four keys inner_alpha, outer_alpha, radius and width"
        yield (*TABLE, *given[-1:]), f"{wrong}; {words}"
    if keys.index != 0.0 and keys.alpha is None:
        yield (*TABLE, "index"), "index is used only with alpha; add the key alpha, or remove index"


def _key_group_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of the keys of a step of alpha and of a dead zone."""
    keys = draft.alpha_viscosity
    if keys.step == "logarithmic":
        if None in (keys.inner_alpha, keys.outer_alpha):
            yield (
                (*TABLE, "step"),
                "step is used only with inner_alpha and outer_alpha; add the two keys, or remove step",
            )
        for key in ("inner_alpha", "outer_alpha"):
            if getattr(keys, key) == 0.0:
                yield (*TABLE, key), '0 has no logarithm; choose a value above 0, or step = "linear"'
    for group in (STEP_KEYS, DEAD_ZONE_KEYS):
        there = [key for key in group if getattr(keys, key) is not None]
        for key in group if there else ():
            if key not in there:
                yield (*TABLE, key), f"missing, but needed with {' and '.join(there)}; add this key"
    if keys.nu is not None and keys.dead_alpha is not None:
        wrong = "nu is uniform, so there is no dead zone"
        yield (*TABLE, "dead_alpha"), f"{wrong}; replace nu by alpha, or remove the dead_* keys"
    if None not in (keys.dead_inner, keys.dead_outer) and keys.dead_outer <= keys.dead_inner:
        yield (*TABLE, "dead_outer"), "dead_outer is not larger than dead_inner; expected dead_outer > dead_inner"


def _reference_radius_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if alpha is a power of r and the start has no reference radius."""
    keys, start = draft.alpha_viscosity, draft.initial
    if keys.index != 0.0 and start is not None and not hasattr(start, "reference_radius"):
        yield (*TABLE, "index"), f'initial.kind = "{draft.kind}" has no reference_radius; remove index'


def _flow_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene in 1D, without gas, or without a star that alpha refers to."""
    if draft.dimensions == 1:
        wrong = "alpha viscosity needs shear, and 1D flow has none"
        yield TABLE, f"{wrong}; set space.dimensions = 2, or replace this table by [gas.viscosity]"
    elif not draft.has("gas") and not draft.has("background"):
        wrong = "viscosity needs gas, but there is no [gas] or [background]"
        yield TABLE, f"{wrong}; add a table [gas] or [background]"
    if not draft.has("star") and draft.alpha_viscosity.nu is None:
        yield TABLE, "H = c_s / Omega needs a star; add a table [star], or replace alpha by nu"


class Effect(base.Effect):
    """Time-step limit of a shear viscosity. The effect of [gas] adds the viscous acceleration."""

    keys = Keys
    rules = (_law_problems, _key_group_problems, _reference_radius_problems, _flow_problems)

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(_viscosity_rows(scene, at), _viscosity_warnings(scene, at))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        if not scene.gas:
            return 0.0
        return counts.gas * (PARTICLE + NEIGHBOUR * SMOOTHING[scene.gas.kernel].neighbours(scene.gas.eta))

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        at = outlook.at
        nu = None if at.h is None else viscosity.diffusivity_at(scene, at.radius, at.thermal_speed, at.h)
        return base.Expected() if nu is None else at.smallest(viscosity.longest_step(scene, nu, at.h))

    def operators(self, state: State) -> list[base.Operator]:
        """Return the operator of the step limit."""
        return [base.Operator("alpha_viscosity.limit", base.Slot.LIMIT, self.limit, base.arrays("gas", "nu h"))]

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        gas = view.gas
        if gas is None or gas.count == 0:
            return {}

        def part(first: int, last: int) -> float:
            return float(viscosity.longest_step(view.scene, gas.nu[first:last], gas.h[first:last]).min())

        step = min(parallel_for(part, gas.count))
        return {"gas": base.Limit(step, UNSTABLE * step)}


def requested_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of the viscosity that the scene requests, for gas without numerical viscosity."""
    found = _viscosities(scene, at)
    if found is not None:
        name, (asked, _, _) = found
        yield f"{name} of the scene", scene.units.show(asked[0], "diffusivity") if name == "nu" else _joined(asked)


def _viscosity_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of the requested and the numerical viscosities."""
    found = _viscosities(scene, at)
    if found is None:
        return
    name, (asked, artificial, noise) = found
    if name == "nu":
        yield "nu of the scene", scene.units.show(asked[0], "diffusivity")
        yield "nu of artificial viscosity", scene.units.show(artificial[0], "diffusivity")
        return
    yield "alpha of the scene", _joined(asked)
    if scene.gas:
        yield "alpha of artificial viscosity", _joined(artificial)
        yield "estimated alpha of particle noise", _joined(noise)


def _viscosity_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield a warning of a numerical viscosity above the requested one."""
    found = _viscosities(scene, at)
    if found is None or not scene.gas:
        return
    name, (asked, artificial, noise) = found
    numerical = np.where(_in_damping_zones(scene, at), 0.0, artificial + noise)
    worst = int(np.argmax(numerical - asked))
    if numerical[worst] > asked[worst]:
        from discsim.effects.gas import QUIET_EOS

        gas, remedy = scene.gas, ""
        if artificial[worst] > noise[worst]:
            remedy = "lower gas.viscosity.alpha, or "
        elif gas.quiet is None and gas.eos.kind in QUIET_EOS:
            remedy = "set gas.quiet = true, or "
        yield (
            f"artificial viscosity and noise have {name} = {numerical[worst]:.2g} {at.where(worst)}, more than "
            f"the {asked[worst]:.2g} of [alpha_viscosity]: {remedy}raise gas.eta or gas.particles"
        )


def _viscosities(scene: Scene, at: base.GasSamples) -> tuple[str, tuple[np.ndarray, np.ndarray, np.ndarray]] | None:
    """Return (name, (requested, artificial, noise)): three viscosities (n,) at the points of `at`.

    requested: viscosity of [alpha_viscosity]. artificial: of SPH. noise: of particle noise. name: "alpha" if they are
    in units of c_s H, or "nu" in gas that does not rotate. Returns None if the scene does not define the viscosity.
    """
    asked = viscosity.diffusivity_at(scene, at.radius, at.thermal_speed, at.density)
    if asked is None:
        return None
    artificial = noise = np.zeros_like(asked)
    if scene.gas:
        artificial, noise = viscosity.artificial_nu(scene, at), viscosity.noise_nu(scene, at)
    if at.omega is None or at.thermal_speed is None:
        return "nu", (asked, artificial, np.zeros_like(asked))
    unit = at.thermal_speed**2 / at.omega
    return "alpha", (asked / unit, artificial / unit, noise / unit)


def _in_damping_zones(scene: Scene, at: base.GasSamples) -> np.ndarray | bool:
    """Return a mask (n,) of the points in zones of [damping], where the velocity does not depend on the viscosity."""
    damping = scene.table("damping")
    if damping is None or at.radius is None:
        return False
    within = [(at.radius >= zone[0]) & (at.radius <= zone[1]) for zone in (damping.inner, damping.outer) if zone]
    return np.logical_or.reduce(within)


def _joined(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2g}" for value in values)
