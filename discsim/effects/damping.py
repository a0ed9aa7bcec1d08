"""Wave damping in zones at the edges of a disc: dv/dt = -(v - v*(r)) R(r), solved exactly at any step.

R = x^2 / tau (de Val-Borro et al. 2006, sec. 3.2). x rises from 0 at the end of a zone that faces the disc to 1 at its
far end, and tau is `time` orbits at the far end. v*(r) is the initial velocity at radius r: the rotation in balance of
the gas, and the drift of the dust. If the start defines neither (a snapshot, own particles), v*(r) is the initial
velocity of the particles, averaged over azimuth.

With `surface_density` the gas of a polar grid relaxes to the mean initial surface density of its rings too:
dSigma/dt = -(Sigma - Sigma*(r)) R(r). Added gas has the velocity v* and the initial energy per mass.

The ledger records the momentum, angular momentum and mass that damping removes. Damping sets no time-step limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from discsim.effects import base
from discsim.initial import balance, start_of
from discsim.numerics.state import State
from discsim.numerics.threads import parallel_for
from discsim.numerics.totals import rounded, total
from discsim.parts import Lazy
from discsim.physics import growth, profile
from discsim.physics.centre import kepler_omega
from discsim.physics.orbits import drift_masses
from discsim.physics.polar import cell_areas, polar_shape
from discsim.scene.keys import Damping as Keys
from discsim.scene.rules import Draft, Problem

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.common.damping")
OUTSIDE_COST, WITHIN_COST = 10.0, 170.0  # CPU nanoseconds in a step, per particle outside and within the zones
# Table of v*: number of nodes in ln r, and factor in r by which the table extends beyond the zones on both sides.
NODES, MARGIN = 4096, 8.0


def _zone_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a table without damping zones, or with zones that are no rings."""
    damping = draft.damping
    if damping.inner is None and damping.outer is None:
        yield ("damping",), "no damping zone is given; add inner = [from, to], outer = [from, to], or both keys"
    for key in ("inner", "outer"):
        zone = getattr(damping, key)
        if zone is not None and not 0.0 < zone[0] < zone[1]:
            yield ("damping", key), "the two radii are not increasing; expected [from, to] with 0 < from < to"


def _disc_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene that is no disc about a star."""
    if not draft.has("star"):
        wrong = "damping times are in orbits about a star, but there is no [star]"
        yield ("damping",), f"{wrong}; add a table [star]"
    elif draft.space and (draft.dimensions != 2 or draft.space.boundary != "open"):
        yield ("space",), 'damping zones are rings about a star; expected dimensions = 2 and boundary = "open"'


def _density_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of gas without cells, whose surface density cannot relax."""
    if draft.damping.surface_density and (draft.gas is None or draft.gas.method != "grid"):
        wrong = "only gas on a polar grid relaxes its surface density"
        yield ("damping", "surface_density"), f'{wrong}; remove this key, or set gas.method = "grid"'


class Effect(base.Effect):
    """Damping of velocities in zones. zones: parameters of the zones and the table of v*, for the kernel."""

    keys = Keys
    rules = (_zone_problems, _disc_problems, _density_problems)
    from_start = ("zones",)

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene

    @classmethod
    def nanoseconds(cls, scene: Scene, counts: base.Counts) -> float:
        each = OUTSIDE_COST + (WITHIN_COST - OUTSIDE_COST) * _damped_fraction(scene)
        return each * (counts.gas + counts.dust)

    @classmethod
    def report(cls, scene: Scene, at: base.GasSamples) -> base.Report:
        inner, outer = scene.table("damping").inner, scene.table("damping").outer
        text = "damping.inner overlaps damping.outer, so all gas is damped: leave a gap between the two zones"
        overlap = [text] if inner and outer and inner[1] > outer[0] else []
        return base.Report(warnings=[*overlap, *_cell_warnings(scene)] if scene.model.polar else overlap)

    def begin(self, state: State, effects: Mapping[str, base.Effect]) -> None:
        """Compute v* from the starting state."""
        keys = self.scene.table("damping")
        # Radii of each zone from the end that faces the disc to its far end.
        ends = [zone[::-1] for zone in (keys.inner,) if zone] + [zone for zone in (keys.outer,) if zone]
        rates = [float(kepler_omega(self.scene, far)) / (2.0 * math.pi * keys.time) for _, far in ends]
        first = math.log(min(min(zone) for zone in ends)) - math.log(MARGIN)
        last = math.log(max(max(zone) for zone in ends)) + math.log(MARGIN)
        radius = np.exp(np.linspace(first, last, NODES))
        circular = radius * kepler_omega(self.scene, radius)
        self.zones = kernels.Zones(
            np.array([[*zone, rate] for zone, rate in zip(ends, rates, strict=True)]),
            first,
            (NODES - 1) / (last - first),
            balance.velocity_profiles(state, dict(effects), radius) / circular[:, None],
            *state.central,
            self._pull_in_drift(state),
            self.scene.model.polar,
            self._reservoir(state, radius),
        )

    def _reservoir(self, state: State, radius: np.ndarray) -> np.ndarray:
        """Return mean initial surface density and energy (n, 2) of the gas at `radius` (n,); empty if masses stay."""
        if not self.scene.table("damping").surface_density:
            return np.empty((0, 2))
        shape, gas = polar_shape(self.scene), state.gas
        of_cells = np.sqrt((gas.pos**2).sum(axis=1)), gas.mass / cell_areas(self.scene, gas), gas.u
        r, *means = (
            np.zeros(shape.rings) if values is None else values.reshape(shape.rings, shape.angles).mean(axis=1)
            for values in of_cells
        )
        # A table that ended at the outermost rings would be flat on the far side of their centroids.
        r, *means = (np.concatenate([[2.0 * v[0] - v[1]], v, [2.0 * v[-1] - v[-2]]]) for v in (r, *means))
        return np.stack([np.interp(radius, r, mean) for mean in means], axis=1)

    def _pull_in_drift(self, state: State) -> np.ndarray:
        """Return the fractions of the star's pull that act in the drift: for the gas, then for each dust population."""
        found = []
        for name in state.species:
            masses = drift_masses(self.scene, name)
            rows = 1 if name == "gas" else len(self.scene.dust)
            found.append(np.zeros(rows) if masses is None else masses / self.scene.star.mass)
        return np.concatenate(found)

    def operators(self, state: State) -> list[base.Operator]:
        return [base.Operator("damping.zones", base.Slot.AROUND_DRIFT, self.operate)]

    def operate(self, state: State, dt: float) -> None:
        """Damp velocities of gas and dust over dt, and record what they lose in the ledger."""
        ahead = 0.0 if self.scene.model.given is not None else -state.velocity_lag
        zones = self.zones._replace(star=state.central_mass)  # a growing star speeds up circular orbits
        for name, p in state.species.items():
            row = 0 if name == "gas" else int(state.gas is not None)  # of v*; the first row of the species
            species = getattr(p, "species", base.NO_SPECIES)
            is_damped = name == "gas" and len(zones.reservoir) > 0
            u = state.gas.u if is_damped and state.gas.u is not None else np.empty(0)
            area = cell_areas(self.scene, state.gas) if is_damped else np.empty(0)
            mass = p.mass.copy() if is_damped else None
            arguments = p.pos, p.vel, p.mass, u, species, area, row, base.centre_of_disc(state), zones, ahead, dt
            lost = rounded(sum(parallel_for(kernels.relax, p.count, *arguments)))
            state.ledger.damped_momentum += lost[:2]
            state.ledger.damped_angular_momentum += float(lost[2])
            state.ledger.damped_gas += float(lost[3])
            if mass is not None:
                self._keep_contents(state, mass)

    def _keep_contents(self, state: State, mass: np.ndarray) -> None:
        """Adapt what the gas carries to its masses, `mass` (n,) before, and record the small dust that zones take."""
        gas = state.gas
        is_separate = gas.small is not None and not growth.gas_mass_includes_small_dust(self.scene)
        before = gas.small.copy() if is_separate else None
        gas.keep_contents(mass)
        if before is not None:
            state.ledger.damped_gas += total(before - gas.small)


def _damped_fraction(scene: Scene) -> float:
    """Return the fraction of particles or cells within the zones at the start; 1 if the start has no radial profile."""
    keys = scene.table("damping")
    inner, outer = keys.inner[1] if keys.inner else 0.0, keys.outer[0] if keys.outer else math.inf
    if scene.model.polar:
        middle = polar_shape(scene).centroids()[0]
        return float(((middle < inner) | (middle > outer)).mean())
    if scene.initial is None or start_of(scene).radial is None:
        return 1.0
    disc = profile.radial(scene)
    between = np.clip([disc.inner, inner, max(inner, outer), disc.outer], disc.inner, disc.outer)
    low, first, last, whole = disc.mass_within(between)
    return 1.0 - float((last - first) / (whole - low))


def _cell_warnings(scene: Scene) -> Iterator[str]:
    """Yield warnings of zones that damp no ring of a polar grid, or all rings."""
    shape, keys = polar_shape(scene), scene.table("damping")
    middle = shape.centroids()[0]
    for name, zone, damped in (
        ("inner", keys.inner, keys.inner and middle < keys.inner[1]),
        ("outer", keys.outer, keys.outer and middle > keys.outer[0]),
    ):
        if zone is not None and not damped.any():
            yield f"damping.{name} contains no cell of the polar grid, so it damps nothing: choose a wider zone"
        elif zone is not None and damped.all():
            yield f"damping.{name} contains all cells of the polar grid, so all gas is damped: choose a narrower zone"
