"""Estimated state of a disc during a run, from its start; input of the forecast of steps.

The inner edge of gas moves towards the star at SPREAD c_s, by pressure and noise, until the star accretes it. With
[damping] it moves no faster than pressure moves gas within the damping time; a second star makes it faster. In a given
disc the edge of the dust drifts. Densities are those of the start, except for clumps if a disc fragments.
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
from discsim.physics.local import Local, Outlook
from discsim.preview.derived import dust_masses, gas_mass, local, local_at, particle_count, stopping_times
from discsim.scene import Scene

self_gravity = Lazy("discsim.effects.self_gravity")
Array = np.ndarray
PLACES = 129  # sample points of the gas
# A joint fit to the number of steps of the shipped setups and of nine published discs, each within a factor of 1.5
# (`analysis/forecast_steps.py`, table in docs/cost.md). None of these numbers is a measurement by itself.
SPREAD = 0.2  # speed of an edge in c_s
UNSWITCHED = 2.5  # factor of that speed per h/H if artificial viscosity acts fully in shear
DRIVEN = 0.5  # speed in c_s of an edge that a second star drives
LEAST = 0.1  # smallest radius of the edge without accretion, over its initial radius
UNEVEN, COLLAPSES = 0.03, 1.5  # relative perturbation of Sigma if the start has none, and that of collapse
RAPID, MARGINAL = 5.0, 2.0  # cooling time in 1/Omega, and Toomre Q, below which cooling discs fragment
HOT, GAMMA = 4.0, 5.0 / 3.0  # largest contrast of clumps with u, and the exponent of their temperature


class Outlooks:
    """Estimated state of a scene's run at any time."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.start, self.begins = scene, start_of(scene), start_time(scene)
        self.places = self._all_over()
        self.gas = local_at(scene, self.places)
        self.stars = [c for c in scene.table("companion") or () if companions.is_star(scene, c)]
        self.inner, self.outer, self.speed, self.tenth = math.inf, 0.0, 0.0, 0.0
        self.radius, self.spacing = np.zeros(1), np.zeros(1)
        if scene.star is not None and self.start.edges is not None:
            self.radius, self.spacing = self._spacings()
            self.inner, self.tenth = self._first()
            self.outer = float(self.radius[-1])
            self.speed = self._speed()

    def at(self, time: float) -> Outlook:
        """Return the estimated state at a time."""
        star, passed = self.scene.star, time - self.begins
        inner = self.inner - self.speed * passed
        if star is not None:
            inner = min(self.inner, max(inner, star.accretion_radius, LEAST * self.inner))
        found = Outlook(time, passed, self._gas(time), inner, self.outer, inner, self._spacing_at)
        if star is not None and any(companions.particles_reach(self.scene, other, found) for other in self.stars):
            stream = star.accretion_radius + companions.STREAM * self._spacing_at(star.accretion_radius)
            return replace(found, nearest=min(inner, stream))
        return found

    def _spacing_at(self, r: float) -> float:
        """Return the particle spacing at a radius; below the radius of the first 10% of particles, the value there."""
        return float(np.interp(max(r, self.tenth), self.radius, self.spacing))

    def _gas(self, time: float) -> Local:
        if self.start.later is not None:
            return local_at(self.scene, self.start.later(self.scene, time))
        contrast = self._contrast(time - self.begins)
        gas = self.gas
        if contrast is None or gas.h is None or gas.resolution is None or gas.sound_speed is None:
            return gas
        hotter = contrast ** (0.5 * (GAMMA - 1.0)) if eos_of(self.scene).holds_heat else 1.0
        h, fine, sound = gas.h * contrast**-0.5, gas.resolution * contrast**-0.5, gas.sound_speed * hotter
        return replace(gas, density=contrast * gas.density, h=h, resolution=fine, sound_speed=sound)

    def _contrast(self, passed: float) -> Array | None:
        """Return the surface density of clumps over that of the start (n,) in a disc that fragments; None if it cannot.

        Isothermal gas with Q < 1 fragments at the rate (1 / Q^2 - 1)^(1/2) Omega. The gas within half the fastest
        growing wavelength, 2 c_s^2 / G Sigma, collapses to the softening length. Gas that cools within RAPID / Omega
        (Gammie 2001) fragments for Q < MARGINAL at the rate of cooling, and its clumps retain heat.
        """
        scene, gas = self.scene, self.gas
        if scene.self_gravity is None or scene.gas is None or gas.toomre_q is None:
            return None
        assert gas.omega is not None and gas.thermal_speed is not None
        half = gas.thermal_speed**2 / gas.density
        most = np.maximum(half / max(self_gravity.kernel_length(scene), gas.cell or 0.0), 1.0) ** 2
        if eos_of(scene).holds_heat:
            beta = getattr(scene.table("cooling"), "beta", None)
            if beta is None or beta > RAPID:
                return None
            rate, most = 0.5 * gas.omega / beta * (gas.toomre_q < MARGINAL), np.minimum(most, HOT)
        else:
            rate = gas.omega * np.sqrt(np.maximum(gas.toomre_q**-2.0 - 1.0, 0.0))
        seed = max(getattr(scene.initial, "perturbation", 0.0), UNEVEN)
        grown = seed * np.exp(np.minimum(rate * passed, 50.0))
        return np.where((rate > 0.0) & (grown > COLLAPSES), most, 1.0)

    def _all_over(self) -> Places:
        places, _ = self.start.all_over(self.scene)
        few = np.unique(np.linspace(0, len(places.density) - 1, PLACES).astype(int))
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
        """Return radii (n,) throughout the gas, or without gas the dust, and the particle spacing there (n,)."""
        scene, (places, _) = self.scene, self.start.all_over(self.scene)
        assert places.radius is not None
        if scene.gas is not None:
            mass = gas_mass(scene) / particle_count(scene, scene.gas)
            relative = 1.0 if places.relative_mass is None else places.relative_mass
        else:
            found = zip(scene.dust or (), dust_masses(scene), strict=True)
            mass, relative = min(total / dust.ratio / dust.particles for dust, total in found), 1.0
        return places.radius, np.sqrt(mass * relative / places.density)

    def _first(self) -> tuple[float, float]:
        """Return the median radius of the innermost ring of particles, and the radius within which 10% of all are."""
        r, spacing = self.radius, self.spacing
        number = np.concatenate([[0.0], np.cumsum(np.diff(r) * (2.0 * np.pi * r / spacing**2)[1:])])
        first = np.argmax(number >= np.pi * r / spacing)
        return float(r[first]), float(r[np.argmax(number >= 0.1 * number[-1])])

    def _speed(self) -> float:
        """Return the inward speed of the inner edge."""
        gas = self.gas
        if gas.thermal_speed is None or gas.omega is None:
            return 0.0
        if self.scene.gas is None:
            return self._drift()
        found = (DRIVEN if self.stars else self._spread()) * float(gas.thermal_speed[0])
        damping = self.scene.table("damping")
        if damping is not None and damping.inner is not None and damping.inner[0] <= self.inner <= damping.inner[1]:
            return found * min(1.0, 2.0 * math.pi * damping.time / SPREAD)
        return found

    def _spread(self) -> float:
        """Return the speed of an edge over c_s, which grows with h/H by the artificial viscosity."""
        at = local(self.scene)  # at the end of the taper
        given = self.scene.gas.viscosity
        if at.resolution is None or at.scale_height is None or given is None:
            return SPREAD
        wide = float(at.resolution[0] / at.scale_height[0])
        unswitched = given.acts_in_shear and given.switch != "balsara"
        return SPREAD * min(max(1.0, wide * (UNSWITCHED if unswitched else 1.0)), 1.0 / SPREAD)

    def _drift(self) -> float:
        """Return the drift of grains at the inner edge of a given disc (Nakagawa et al. 1986, no back-reaction)."""
        gas = self.gas
        assert gas.radius is not None and gas.thermal_speed is not None and gas.omega is not None
        if len(gas.radius) < 2:
            return 0.0
        log = np.log(gas.density * gas.thermal_speed**2)
        headwind = -np.gradient(log, gas.radius)[0] * gas.thermal_speed[0] ** 2 / gas.omega[0]
        stokes = [float(time[0] * gas.omega[0]) for time in stopping_times(self.scene, gas)]
        return max([0.0, *(headwind / (one + 1.0 / one) for one in stokes)])
