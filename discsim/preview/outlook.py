"""Estimated state of a disc during a run, from its start; input of the forecast of steps.

The inner edge of gas moves towards the star at EDGE_SPEED c_s, by pressure and noise, until the star accretes it. With
[damping] the edge moves no faster than pressure moves gas within the damping time. A second star makes the edge faster.
With [background], the inner edge of the dust moves with the drift speed of the dust. Densities are those of the start,
except for clumps if a disc fragments.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from discsim.initial import start_of, start_time
from discsim.initial.base import Places
from discsim.parts import Lazy
from discsim.physics import companions
from discsim.physics.eos import eos_of
from discsim.physics.local import ForecastState, GasSamples
from discsim.preview.derived import dust_masses, gas_mass, local, local_at, particle_count, stopping_times
from discsim.scene import Scene

self_gravity = Lazy("discsim.effects.self_gravity")
Array = np.ndarray
SAMPLE_POINTS = 129  # sample points of the gas
# The constants below are a joint fit to the numbers of steps of the shipped setups and of nine published discs, each
# within a factor of 1.5 (`analysis/forecast_steps.py`, table in docs/cost.md). None of them is measured by itself.
EDGE_SPEED = 0.2  # speed of an edge in c_s
VISCOUS_FACTOR = 2.5  # factor of EDGE_SPEED per h/H if artificial viscosity acts fully in shear
DRIVEN_EDGE_SPEED = 0.5  # speed in c_s of an edge that a second star drives
MIN_EDGE_RADIUS = 0.1  # smallest radius of the edge without accretion, over its initial radius
MIN_PERTURBATION = 0.03  # smallest relative perturbation of Sigma at the start
COLLAPSED_PERTURBATION = 1.5  # relative perturbation above which gas has collapsed to clumps
MAX_COOLING_TIME, MAX_TOOMRE_Q = 5.0, 2.0  # cooling time in 1/Omega, and Toomre Q, below which cooling discs fragment
MAX_HOT_CONTRAST = 4.0  # largest density contrast of clumps in gas with an energy equation
CLUMP_GAMMA = 5.0 / 3.0  # ratio of specific heats in these clumps: T ~ Sigma^(CLUMP_GAMMA - 1)


class Outlooks:
    """Estimates of the state of a disc at any time of a run."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.start, self.begins = scene, start_of(scene), start_time(scene)
        self.places = self._sample_gas()
        self.gas = local_at(scene, self.places)
        self.stars = [c for c in scene.table("companion") or () if companions.is_second_star(scene, c)]
        self.inner, self.outer, self.speed, self.tenth = math.inf, 0.0, 0.0, 0.0
        self.radius, self.spacing = np.zeros(1), np.zeros(1)
        if scene.star is not None and self.start.edges is not None:
            self.radius, self.spacing = self._spacings()
            self.inner, self.tenth = self._first_radii()
            self.outer = float(self.radius[-1])
            self.speed = self._edge_speed()

    def at(self, time: float) -> ForecastState:
        """Return the estimated state at `time`."""
        star, passed = self.scene.star, time - self.begins
        inner = self.inner - self.speed * passed
        if star is not None:
            inner = min(self.inner, max(inner, star.accretion_radius, MIN_EDGE_RADIUS * self.inner))
        found = ForecastState(time, passed, self._gas_at(time), inner, self.outer, inner, self._spacing_at)
        if star is not None and any(companions.particles_reach(self.scene, other, found) for other in self.stars):
            stream = star.accretion_radius + companions.SPACINGS_STREAM * self._spacing_at(star.accretion_radius)
            return replace(found, nearest=min(inner, stream))
        return found

    def _spacing_at(self, r: float) -> float:
        """Return the particle spacing at the radius `r`; inside the innermost 10% of particles, that at their edge."""
        return float(np.interp(max(r, self.tenth), self.radius, self.spacing))

    def _gas_at(self, time: float) -> GasSamples:
        if self.start.later is not None:
            return local_at(self.scene, self.start.later(self.scene, time))
        contrast = self._clump_contrast(time - self.begins)
        gas = self.gas
        if contrast is None or gas.h is None or gas.resolution is None or gas.sound_speed is None:
            return gas
        hotter = contrast ** (0.5 * (CLUMP_GAMMA - 1.0)) if eos_of(self.scene).holds_heat else 1.0
        h, fine, sound = gas.h * contrast**-0.5, gas.resolution * contrast**-0.5, gas.sound_speed * hotter
        return replace(gas, density=contrast * gas.density, h=h, resolution=fine, sound_speed=sound)

    def _clump_contrast(self, passed: float) -> Array | None:
        """Return the surface density over that of the start (n,), above 1 in clumps of a disc that fragments.

        Return None if the disc cannot fragment. passed: time since the start.
        Isothermal gas with Q < 1 fragments at the rate (1 / Q^2 - 1)^(1/2) Omega. The gas within half the fastest
        growing wavelength, 2 c_s^2 / G Sigma, collapses to the softening length. Gas that cools within
        MAX_COOLING_TIME / Omega (Gammie 2001) fragments for Q < MAX_TOOMRE_Q at the rate of cooling, and its clumps
        retain heat.
        """
        scene, gas = self.scene, self.gas
        if scene.self_gravity is None or scene.gas is None or gas.toomre_q is None:
            return None
        assert gas.omega is not None and gas.thermal_speed is not None
        half = gas.thermal_speed**2 / gas.density
        most = np.maximum(half / max(self_gravity.kernel_length(scene), gas.cell or 0.0), 1.0) ** 2
        if eos_of(scene).holds_heat:
            beta = getattr(scene.table("cooling"), "beta", None)
            if beta is None or beta > MAX_COOLING_TIME:
                return None
            rate, most = 0.5 * gas.omega / beta * (gas.toomre_q < MAX_TOOMRE_Q), np.minimum(most, MAX_HOT_CONTRAST)
        else:
            rate = gas.omega * np.sqrt(np.maximum(gas.toomre_q**-2.0 - 1.0, 0.0))
        seed = max(getattr(scene.initial, "perturbation", 0.0), MIN_PERTURBATION)
        grown = seed * np.exp(np.minimum(rate * passed, 50.0))
        return np.where((rate > 0.0) & (grown > COLLAPSED_PERTURBATION), most, 1.0)

    def _sample_gas(self) -> Places:
        places, _ = self.start.all_over(self.scene)
        few = np.unique(np.linspace(0, len(places.density) - 1, SAMPLE_POINTS).astype(int))
        some = {
            name: values[few]
            for name in ("density", "radius", "pressure", "relative_mass")
            if (values := getattr(places, name)) is not None
        }
        names = places.names
        if places.radius is not None:
            names = [self.scene.units.show(float(r), "length") for r in some["radius"]]
        return replace(places, names=names, **some)

    def _spacings(self) -> tuple[Array, Array]:
        """Return radii (n,) from edge to edge of the gas, or without gas of the dust, and particle spacings (n,)."""
        scene, (places, _) = self.scene, self.start.all_over(self.scene)
        assert places.radius is not None
        if scene.gas is not None:
            mass = gas_mass(scene) / particle_count(scene, scene.gas)
            relative = 1.0 if places.relative_mass is None else places.relative_mass
        else:
            found = zip(scene.dust or (), dust_masses(scene), strict=True)
            mass, relative = min(total / dust.ratio / dust.particles for dust, total in found), 1.0
        return places.radius, np.sqrt(mass * relative / places.density)

    def _first_radii(self) -> tuple[float, float]:
        """Return the median radius of the innermost ring of particles, and the radius that encloses 10% of them all."""
        r, spacing = self.radius, self.spacing
        number = np.concatenate([[0.0], np.cumsum(np.diff(r) * (2.0 * np.pi * r / spacing**2)[1:])])
        first = np.argmax(number >= np.pi * r / spacing)
        return float(r[first]), float(r[np.argmax(number >= 0.1 * number[-1])])

    def _edge_speed(self) -> float:
        """Return the inward speed of the disc's inner edge."""
        gas = self.gas
        if gas.thermal_speed is None or gas.omega is None:
            return 0.0
        if self.scene.gas is None:
            return self._dust_edge_speed()
        found = (DRIVEN_EDGE_SPEED if self.stars else self._gas_edge_speed()) * float(gas.thermal_speed[0])
        damping = self.scene.table("damping")
        if damping is not None and damping.inner is not None and damping.inner[0] <= self.inner <= damping.inner[1]:
            return found * min(1.0, 2.0 * math.pi * damping.time / EDGE_SPEED)
        return found

    def _gas_edge_speed(self) -> float:
        """Return the speed in c_s of an edge of gas: EDGE_SPEED, or more for a large h/H with artificial viscosity."""
        at = local(self.scene)  # at the end of the taper
        given = self.scene.gas.viscosity
        if at.resolution is None or at.scale_height is None or given is None:
            return EDGE_SPEED
        wide = float(at.resolution[0] / at.scale_height[0])
        unswitched = given.acts_in_shear and given.switch != "balsara"
        return EDGE_SPEED * min(max(1.0, wide * (VISCOUS_FACTOR if unswitched else 1.0)), 1.0 / EDGE_SPEED)

    def _dust_edge_speed(self) -> float:
        """Return the largest inward drift speed of dust at the inner edge of a prescribed disc.

        The drift is that of Nakagawa et al. (1986) without back-reaction.
        """
        gas = self.gas
        assert gas.radius is not None and gas.thermal_speed is not None and gas.omega is not None
        if len(gas.radius) < 2:
            return 0.0
        log = np.log(gas.density * gas.thermal_speed**2)
        headwind = -np.gradient(log, gas.radius)[0] * gas.thermal_speed[0] ** 2 / gas.omega[0]
        stokes = [float(time[0] * gas.omega[0]) for time in stopping_times(self.scene, gas)]
        return max([0.0, *(headwind / (one + 1.0 / one) for one in stokes)])
