"""Turbulent diffusion of dust: dx = (grad D + D grad ln Sigma_g) dt + sqrt(2 D dt) xi, D = alpha c_s H / (1 + St^2).

xi is a random vector. The grains make a random walk, and their surface density obeys
d Sigma_d/dt = div [D Sigma_g grad(Sigma_d / Sigma_g)] (Ciesla 2010; Zsom et al. 2011). Without drift the walk leads to
the same Sigma_d / Sigma_g everywhere. alpha is `dust_diffusion.alpha`, or the alpha of [alpha_viscosity] with its dead
zone. The Stokes number St of each grain is that of the last kick (Youdin & Lithwick 2007). The key D sets the
diffusivity of the grains at any St. In one dimension Sigma is the density, and Omega is `external.vertical_frequency`.

Each grain walks once a step, after its drift. xi depends on the seed, the id of the grain and the step number
(`kernels/common/philox.py`). The walk is split into substeps if sqrt(2 D dt) exceeds h/2, half a cell of a polar grid,
or H/6 in a prescribed disc. The walk sets no time-step limit.

The walk conserves velocities, and so momentum. About a star it conserves velocities relative to the circular orbit at
each position (`kernels/dust/diffusion.py`), which changes the angular momentum of a grain. With two-way drag, the gas
near the middle of the grain's path loses the angular momentum that the grain gains. The total angular momentum is then
conserved, and gas moves against the diffusing dust. With one-way drag, turbulence supplies the angular momentum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from discsim.effects import base
from discsim.effects.sampling import sampler_class
from discsim.numerics import world
from discsim.numerics.state import State
from discsim.numerics.threads import copied, parallel_for
from discsim.parts import Lazy
from discsim.physics import diffusion
from discsim.physics.orbits import drift_rotates_velocities
from discsim.scene.fields import Default, Diffusivity, Number, Table
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.dust.diffusion")
philox = Lazy("discsim.kernels.common.philox")
moves = Lazy("discsim.kernels.common.move")

GRAIN_COST = 250.0  # CPU nanoseconds in a step, per grain, without those of the sampler
LONGEST_WALK = 0.5  # largest sqrt(2 D dt) of a substep, in units of the length over which the gas changes
MOST_SUBSTEPS, MANY_SUBSTEPS = 2000, 10  # largest number of substeps in a step, and largest one without a warning
WALK = 0xD1FF  # part of the generator's key that no other random number of a run shares


class Keys(Table):
    """Turbulent diffusion of the dust."""

    alpha: Annotated[Number | None, Default("same as alpha_viscosity")] = Field(
        None, gt=0, description="alpha of the turbulence in D = alpha c_s H / (1 + St^2)"
    )
    D: Diffusivity | None = Field(
        None, gt=0, description="uniform diffusion coefficient of the grains, instead of alpha"
    )


def _strength_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene that defines no strength of the turbulence, or two."""
    own = draft.dust_diffusion
    if own.alpha is not None and own.D is not None:
        yield ("dust_diffusion", "D"), "dust_diffusion.alpha is also given; keep alpha or D"
    elif own.alpha is None and own.D is None and not draft.has("alpha_viscosity"):
        wrong = "no strength of the turbulence is given"
        yield ("dust_diffusion",), f"{wrong}; add the key alpha or D, or a table [alpha_viscosity]"


def _dust_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene without dust particles."""
    if not draft.has("dust"):
        yield ("dust_diffusion",), "dust diffusion needs dust; add a table [dust]"
    else:
        yield from base.grid_scheme_problems(draft, "dust_diffusion", "dust diffusion")


def _gas_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene that derives D from the gas and lacks gas, drag or orbits."""
    if draft.dust_diffusion.D is not None or not draft.has("dust"):
        return
    if not draft.has("gas") and not draft.has("background"):
        yield ("dust_diffusion",), "alpha c_s H needs gas; add a table [gas] or [background], or replace alpha by D"
    elif not draft.has("drag"):
        wrong = "turbulent gas does not act on dust without drag"
        yield ("dust_diffusion",), f"{wrong}; add a table [drag], or replace alpha by D"
    layer = draft.external is not None and draft.external.vertical_frequency > 0.0
    if draft.dust_diffusion.alpha is not None and not draft.has("star") and not layer:
        wrong = "H = c_s / Omega needs an orbital frequency"
        yield ("dust_diffusion", "alpha"), f"{wrong}; add [star] or external.vertical_frequency, or replace alpha by D"


class Effect(base.Effect):
    """Random walk of the dust particles."""

    keys = Keys
    rules = (_strength_problems, _dust_problems, _gas_problems)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene, self.dim = scene, scene.space.dimensions
        given = diffusion.uniform_diffusivity(scene)
        self.constant = 0.0 if given is None else given
        self.table = diffusion.alpha_table(scene)
        self.uses_stokes = scene.table("dust_diffusion").D is None
        self.key = philox.key_words(scene.run.seed, WALK)
        self.drag: Any = None
        self.sampler = sampler_class(scene)(scene)

    def begin(self, state: State, effects: Mapping[str, base.Effect]) -> None:
        self.drag = self.sampler.drag = effects.get("drag")

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        return base.Report(_diffusion_rows(scene, at), _diffusion_warnings(scene, at))

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        passes = 3 if scene.gas and scene.star and scene.drag and scene.drag.direction == "two-way" else 1
        return counts.dust * (GRAIN_COST + passes * sampler_class(scene).nanoseconds(scene))

    def operators(self, state: State) -> list[base.Operator]:
        return [base.Operator("dust_diffusion.walk", base.Slot.MOVE, self.move)]

    def move(self, state: State, dt: float) -> None:
        """Move the dust by the random walk over dt, in substeps."""
        dust = state.dust
        if dust.global_count == 0 or (state.gas is not None and state.gas.global_count == 0):
            return
        norm, strength = np.empty((2, dust.count))
        drift, centre = np.empty_like(dust.pos), base.centre_of_disc(state)
        times = self.drag.stopping_times if self.uses_stokes else norm
        row, turbulence = self._turbulence(state)
        done, steps, count = 0, 1, state.step + state.earlier
        self.sampler.begin(state)
        while done < steps:
            gas = self.sampler.at(dust.pos)
            steepest = max(
                parallel_for(
                    kernels.write_diffusivities, dust.count, dust.pos, centre, row, gas, times, norm, done == 0,
                    turbulence, strength, drift,
                )
            )  # fmt: skip
            if done == 0:
                steps = _substep_count(2.0 * float(world.processes.max(steepest)) * dt / LONGEST_WALK**2)
            if dust.immobile is not None:
                strength[dust.immobile] = 0.0
            lag = 0.0 if drift_rotates_velocities(self.scene) else state.velocity_lag + dt
            self._walk(state, gas, strength, drift, dt / steps, lag, count * MOST_SUBSTEPS + done)
            done += 1

    def _walk(
        self,
        state: State,
        gas: np.ndarray,
        strength: np.ndarray,
        drift: np.ndarray,
        dt: float,
        lag: float,
        number: int,
    ) -> None:
        """Make one substep of the walk over dt, and subtract the gained angular momentum from the gas.

        gas: properties of the gas at the grains, from `GasSampler.at`. strength (n,), drift (n, d): diffusivity and
        drift velocity of the walk, from `kernels.write_diffusivities`. lag: time by which velocities are rotated
        behind positions on circular orbits. number: index of the substep in the run, which determines the random
        vectors.
        """
        dust, centre, star = state.dust, base.centre_of_disc(state), state.central
        circles = kernels.CircularOrbits(*star, lag, centre, self.scene.model.polar)
        two_way = star[0] > 0.0 and state.gas is not None and self.drag is not None and not state.dust_is_passive
        gained = np.empty(dust.count if two_way else 0)
        before = copied(dust.pos) if two_way else dust.pos
        parallel_for(
            kernels.random_walk, dust.count, dust.pos, dust.vel, dust.ids, strength, drift, gas, self.key, number, dt,
            circles, gained,
        )  # fmt: skip
        if self.scene.space.boundary == "periodic":
            parallel_for(moves.wrap, dust.count, dust.pos, np.array(self.scene.space.size))
        if two_way:
            self.sampler.subtract_angular_momentum(
                gained * dust.mass, before, dust.pos, gas[:, kernels.DENSITY], centre
            )

    def _turbulence(self, state: State) -> tuple[np.ndarray, Any]:
        """Return (row, turbulence) for the kernels.

        row (n,): row of each grain in the parameters of the drag law. turbulence: parameters of the turbulence and of
        the drag law.
        """
        law, dust = self.drag.law if self.uses_stokes else None, state.dust
        row, grains = dust.species, law.grains if law else np.empty((0, 5))
        if law and dust.size is not None:
            row, grains = np.arange(dust.count), law.rows(dust.species, dust.size)
        return row, kernels.Turbulence(
            *self.table, self.constant, self.uses_stokes, *state.central, diffusion.frequency(self.scene),
            law.code if law else 0, grains,
        )  # fmt: skip


def _diffusion_rows(scene: Scene, at: base.GasSamples) -> Iterator[tuple[str, str]]:
    """Yield (name, text) of the diffusion coefficient and time of each dust population."""
    found = diffusion.diffusivities(scene, at)
    for (strength, _), dust in zip(found, scene.dust_phrases, strict=False):
        texts = [scene.units.show(float(value), "diffusivity") for value in strength]
        yield f"diffusion coefficient of {dust}", ", ".join(texts)
        if at.scale_height is not None:
            times = [scene.units.show(float(time), "time") for time in at.scale_height**2 / strength]
            yield "diffusion time over H" + (f" of {dust}" if len(found) > 1 else ""), ", ".join(times)


def _diffusion_warnings(scene: Scene, at: base.GasSamples) -> Iterator[str]:
    """Yield a warning of many substeps in a time step."""
    if at.step is None or at.resolution is None:
        return
    dt = scene.run.timestep or scene.run.courant * at.step
    for strength, _ in diffusion.diffusivities(scene, at):
        steps = 2.0 * strength * dt / (LONGEST_WALK * at.resolution) ** 2
        worst = int(np.argmax(steps))
        if steps[worst] > MANY_SUBSTEPS:
            key = "D" if scene.table("dust_diffusion").D is not None else "alpha"
            yield (
                f"dust diffusion needs about {steps[worst]:.3g} substeps per time step {at.where(worst)}, each of "
                f"at most {sampler_class(scene).longest}: lower dust_diffusion.{key} or run.courant"
            )
            return


def _substep_count(wanted: float) -> int:
    """Return `wanted`, at least 1, rounded up to a whole number. Raises FloatingPointError above MOST_SUBSTEPS."""
    if not wanted <= MOST_SUBSTEPS:
        raise FloatingPointError(
            f"dust_diffusion would need {wanted:.2g} substeps per time step, each over half the length scale of "
            f"the gas; lower the diffusivity, or choose a run.timestep with at most {MOST_SUBSTEPS} substeps"
        )
    return max(1, math.ceil(wanted))
