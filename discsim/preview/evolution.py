"""Estimated state of a run at any time, from its start; the forecast of steps uses it.

Pressure and noise move the inner edge of the gas towards the star at the speed EDGE_SPEED c_s, until the star accretes
gas there. With [damping] the edge moves no faster than pressure moves gas within the damping time. A second star makes
the edge faster. With [background], the inner edge of the dust moves with the drift speed of the dust. Densities are
those of the start, except in the clumps of a disc that fragments.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from discsim.initial import start_of, start_time
from discsim.initial.base import SamplePoints
from discsim.parts import Lazy
from discsim.physics import companions
from discsim.physics.eos import eos_of
from discsim.physics.local import ForecastState, GasSamples
from discsim.preview.derived import dust_masses, gas_at_points, gas_at_start, gas_mass, particle_count, stopping_times
from discsim.scene import Scene

self_gravity = Lazy("discsim.effects.self_gravity")
Array = np.ndarray
SAMPLE_POINTS = 129  # number of sample points of the gas
# The constants below are a joint fit to the numbers of steps of the shipped setups and of nine published discs, each
# within a factor of 1.5 (`analysis/forecast_steps.py`, table in docs/cost.md). None of them is measured by itself.
EDGE_SPEED = 0.2  # speed of an edge in c_s
VISCOUS_FACTOR = 2.5  # speed of an edge over EDGE_SPEED c_s h/H, if artificial viscosity acts fully in shear
DRIVEN_EDGE_SPEED = 0.5  # speed in c_s of an edge that a second star drives
MIN_EDGE_RADIUS = 0.1  # smallest radius of the edge without accretion, over its initial radius
MIN_PERTURBATION = 0.03  # smallest relative perturbation of Sigma at the start
COLLAPSED_PERTURBATION = 1.5  # relative perturbation above which gas has collapsed to clumps
MAX_COOLING_TIME, MAX_TOOMRE_Q = 5.0, 2.0  # cooling time in 1/Omega, and Toomre Q, below which cooling discs fragment
MAX_HOT_CONTRAST = 4.0  # largest density contrast of clumps in gas with an energy equation
CLUMP_GAMMA = 5.0 / 3.0  # exponent of the temperature in these clumps: T ~ Sigma^(CLUMP_GAMMA - 1)


class EstimatedEvolution:
    """Estimated evolution of a run: `state_at(time)` returns its state at a time.

    gas: properties of the gas at the start. stars: companions that are stars. inner, outer: radii of the edges at the
    start. edge_speed: inward speed of the inner edge. radius, spacing (n,): particle spacing as a function of radius.
    innermost: radius that encloses 10% of the particles.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.start, self.start_time = scene, start_of(scene), start_time(scene)
        self.gas = gas_at_points(scene, self._sample_gas())
        self.stars = [c for c in scene.table("companion") or () if companions.is_second_star(scene, c)]
        self.inner, self.outer, self.edge_speed, self.innermost = math.inf, 0.0, 0.0, 0.0
        self.radius, self.spacing = np.zeros(1), np.zeros(1)
        if scene.star is not None and self.start.edges is not None:
            self.radius, self.spacing = self._spacings()
            self.inner, self.innermost = self._first_radii()
            self.outer = float(self.radius[-1])
            self.edge_speed = self._edge_speed()
        if scene.model.disc_cells is not None:
            cells = scene.model.disc_cells(scene)
            self.inner, self.outer, self.edge_speed, self.stars = cells.inner, cells.outer, 0.0, []

    def state_at(self, time: float) -> ForecastState:
        """Return the estimated state of the run at `time`."""
        star, passed = self.scene.star, time - self.start_time
        inner = self.inner - self.edge_speed * passed
        if star is not None:
            inner = min(self.inner, max(inner, star.accretion_radius, MIN_EDGE_RADIUS * self.inner))
        found = ForecastState(time, passed, self._gas_at(time), inner, self.outer, inner, self._spacing_at)
        if star is not None and any(companions.particles_reach(self.scene, other, found) for other in self.stars):
            stream = star.accretion_radius + companions.SPACINGS_STREAM * self._spacing_at(star.accretion_radius)
            return replace(found, nearest=min(inner, stream))
        return found

    def _spacing_at(self, r: float) -> float:
        """Return the particle spacing at the radius `r`. Inside the radius `innermost`, the spacing is constant."""
        return float(np.interp(max(r, self.innermost), self.radius, self.spacing))

    def _gas_at(self, time: float) -> GasSamples:
        """Return the properties of the gas at `time`: those of the start, changed by shocks or clumps."""
        if self.start.limiting_gas is not None:
            return gas_at_points(self.scene, self.start.limiting_gas(self.scene, time))
        contrast = self._clump_contrast(time - self.start_time)
        gas = self.gas
        if contrast is None or gas.h is None or gas.resolution is None or gas.sound_speed is None:
            return gas
        hotter = contrast ** (0.5 * (CLUMP_GAMMA - 1.0)) if eos_of(self.scene).holds_heat else 1.0
        h, usual_h, sound = gas.h * contrast**-0.5, gas.resolution * contrast**-0.5, gas.sound_speed * hotter
        return replace(gas, density=contrast * gas.density, h=h, resolution=usual_h, sound_speed=sound)

    def _clump_contrast(self, passed: float) -> Array | None:
        """Return the surface density (n,), divided by that of the start; above 1 in clumps of a disc that fragments.

        Return None if the disc cannot fragment. passed: time since the start.
        Isothermal gas with Q < 1 fragments at the rate (1 / Q^2 - 1)^(1/2) Omega. The gas within half the
        fastest-growing wavelength 2 c_s^2 / (G Sigma) collapses to the softening length. Gas that cools within
        MAX_COOLING_TIME / Omega (Gammie 2001) fragments for Q < MAX_TOOMRE_Q at the rate of cooling, and its clumps
        retain heat.
        """
        scene, gas = self.scene, self.gas
        if scene.self_gravity is None or scene.gas is None or gas.toomre_q is None:
            return None
        assert gas.omega is not None and gas.thermal_speed is not None
        half_wave = gas.thermal_speed**2 / gas.density
        collapsed = np.maximum(half_wave / max(self_gravity.kernel_length(scene), gas.cell or 0.0), 1.0) ** 2
        if eos_of(scene).holds_heat:
            beta = getattr(scene.table("cooling"), "beta", None)
            if beta is None or beta > MAX_COOLING_TIME:
                return None
            rate = 0.5 * gas.omega / beta * (gas.toomre_q < MAX_TOOMRE_Q)
            collapsed = np.minimum(collapsed, MAX_HOT_CONTRAST)
        else:
            rate = gas.omega * np.sqrt(np.maximum(gas.toomre_q**-2.0 - 1.0, 0.0))
        seed = max(getattr(scene.initial, "perturbation", 0.0), MIN_PERTURBATION)
        grown = seed * np.exp(np.minimum(rate * passed, 50.0))
        return np.where((rate > 0.0) & (grown > COLLAPSED_PERTURBATION), collapsed, 1.0)

    def _sample_gas(self) -> SamplePoints:
        """Return at most SAMPLE_POINTS sample points throughout the gas."""
        points, _ = self.start.sample_all_gas(self.scene)
        chosen = np.unique(np.linspace(0, len(points.density) - 1, SAMPLE_POINTS).astype(int))
        arrays = {name: getattr(points, name) for name in ("density", "radius", "pressure", "relative_mass")}
        arrays = {name: None if values is None else values[chosen] for name, values in arrays.items()}
        names = points.names
        if points.radius is not None:
            names = [self.scene.units.show(float(r), "length") for r in arrays["radius"]]
        return replace(points, names=names, **arrays)

    def _spacings(self) -> tuple[Array, Array]:
        """Return radii (n,) from edge to edge of the disc, and the particle spacing (n,) at each radius.

        The particles are those of the gas, or in a scene without gas those of the dust population with the smallest
        spacing.
        """
        scene, (points, _) = self.scene, self.start.sample_all_gas(self.scene)
        assert points.radius is not None
        if scene.model.disc_cells is not None:
            return points.radius, scene.model.disc_cells(scene).side(points.radius)
        if scene.gas is not None:
            mass = gas_mass(scene) / particle_count(scene, scene.gas)
            relative = 1.0 if points.relative_mass is None else points.relative_mass
        else:
            totals = zip(scene.dust or (), dust_masses(scene), strict=True)
            mass, relative = min(total / dust.ratio / dust.particles for dust, total in totals), 1.0
        return points.radius, np.sqrt(mass * relative / points.density)

    def _first_radii(self) -> tuple[float, float]:
        """Return the median radius of the innermost particle ring, and the radius that encloses 10% of particles."""
        r, spacing = self.radius, self.spacing
        number = np.concatenate([[0.0], np.cumsum(np.diff(r) * (2.0 * np.pi * r / spacing**2)[1:])])
        first = np.argmax(number >= np.pi * r / spacing)
        return float(r[first]), float(r[np.argmax(number >= 0.1 * number[-1])])

    def _edge_speed(self) -> float:
        """Return the inward speed of the inner edge of the disc."""
        gas = self.gas
        if gas.thermal_speed is None or gas.omega is None:
            return 0.0
        if self.scene.gas is None:
            return self._dust_edge_speed()
        speed = (DRIVEN_EDGE_SPEED if self.stars else self._gas_edge_speed()) * float(gas.thermal_speed[0])
        damping = self.scene.table("damping")
        if damping is not None and damping.inner is not None and damping.inner[0] <= self.inner <= damping.inner[1]:
            return speed * min(1.0, 2.0 * math.pi * damping.time / EDGE_SPEED)
        return speed

    def _gas_edge_speed(self) -> float:
        """Return the speed in c_s of an edge of gas: EDGE_SPEED, or more for a large h/H with artificial viscosity."""
        at = gas_at_start(self.scene)  # at the end of the taper
        viscosity = self.scene.gas.viscosity
        if at.resolution is None or at.scale_height is None or viscosity is None:
            return EDGE_SPEED
        ratio = float(at.resolution[0] / at.scale_height[0])  # h/H
        unswitched = viscosity.acts_in_shear and viscosity.switch != "balsara"
        return EDGE_SPEED * min(max(1.0, ratio * (VISCOUS_FACTOR if unswitched else 1.0)), 1.0 / EDGE_SPEED)

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
