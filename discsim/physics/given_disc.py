"""Prescribed gas of `[background]` as functions of radius. Numpy only.

Sigma is a power law or a column of a file (`scene/columns.py`), times 1 + height G(r) for a bump and 1 - depth G(r)
for a gap, with G(r) = exp(-(r - radius)^2 / (2 width^2)). With [alpha_viscosity], viscosity drives a radial flow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.parts import EOS, Lazy

if TYPE_CHECKING:
    from discsim.scene import Scene

viscosity = Lazy("discsim.physics.viscosity")
Array = np.ndarray
# Table in ln r: number of nodes, and ratio of its largest radius (beyond the corners of space) to its smallest.
NODES, INWARDS = 16_384, 1e5


class PrescribedDisc:
    """Prescribed gas disc. Methods take radii (n,) and return arrays (n,) in code units.

    c_T = sqrt(P / Sigma) is the thermal speed. laws: (Sigma, p, c_T^2, q, f) of the power laws Sigma ~ r^-p and
    c_T^2 ~ r^-q, with Sigma and c_T^2 at radius 1 and -(1/Sigma) dP/dr = f c_T^2 / r. is_power_law: whether the disc
    follows these power laws exactly, without file, bump or gap.
    """

    def __init__(self, scene: Scene):
        given = scene.background
        self.scene, self.given, self.eos = scene, given, EOS[given.eos.kind]
        self.viscous = scene.table("alpha_viscosity") is not None
        p = given.surface_density_index
        sigma = 1.0 if given.file is not None else given.surface_density * given.reference_radius**p
        speed2, q, f = self.eos.power_law(scene, given.eos, sigma, p)
        self.laws = np.array([sigma, p, speed2, q, f])
        self.is_power_law = given.file is None and given.bump is None and given.gap is None

    def surface_density(self, r: Array) -> Array:
        """Return Sigma (n,)."""
        if self.is_power_law:
            return self.laws[0] * r ** -self.laws[1]
        return self._density_and_slope(r)[0]

    def sound_speed(self, r: Array) -> Array:
        """Return the speed of sound waves (n,)."""
        return self.thermal_speed(r) * np.sqrt(self.eos.adiabatic_index(self.given.eos, self.surface_density(r)))

    def thermal_speed(self, r: Array) -> Array:
        """Return c_T = sqrt(P / Sigma) (n,)."""
        if self.is_power_law:
            return np.sqrt(self.laws[2] * r ** -self.laws[3])
        return np.sqrt(self._speed2_and_pull(r)[0])

    def pressure_slope(self, r: Array) -> Array:
        """Return -d ln P / d ln r (n,)."""
        speed2, pull = self._speed2_and_pull(r)
        return pull / speed2

    def table(self) -> tuple[Array, float, float]:
        """Return (table, first, nodes) of the disc as functions of ln r.

        table (n, 5): ln Sigma, ln c_T^2, g = f c_T^2, dg / d ln r and the radial velocity v_r at equidistant ln r;
        no rows for power laws without viscosity. first: ln r of the first node. nodes: number of nodes per unit of
        ln r.
        """
        if self.is_power_law and not self.viscous:
            return np.empty((0, 5)), 0.0, 1.0
        last = np.log(1.5 * max(self.scene.space.size))
        log = np.linspace(last - np.log(INWARDS), last, NODES)
        r = np.exp(log)
        speed2, pull = self._speed2_and_pull(r)
        flow = np.zeros_like(r)
        if self.viscous:
            flow = viscosity.radial_flow(self.scene, r, self.surface_density, self.thermal_speed)
        columns = np.log(self._density_and_slope(r)[0]), np.log(speed2), pull, np.gradient(pull, log), flow
        return np.stack(columns, axis=1), float(log[0]), (NODES - 1) / float(log[-1] - log[0])

    def _density_and_slope(self, r: Array) -> tuple[Array, Array]:
        """Return Sigma (n,) and -d ln Sigma / d ln r (n,)."""
        file = self.given.file
        density = self.laws[0] * r ** -self.laws[1] if file is None else file.value("Sigma", r)
        slope = np.full_like(r, self.laws[1]) if file is None else -file.slope("Sigma", r)
        for part, high in ((self.given.bump, "height"), (self.given.gap, "depth")):
            if part is not None:
                away = (r - part.radius) / part.width
                rise = getattr(part, high) * np.exp(-0.5 * away**2) * (1.0 if high == "height" else -1.0)
                density, slope = density * (1.0 + rise), slope + r * away / part.width * rise / (1.0 + rise)
        return density, slope

    def _speed2_and_pull(self, r: Array) -> tuple[Array, Array]:
        """Return c_T^2 (n,) and g (n,), with -(1/Sigma) dP/dr = g / r."""
        scene, file = self.scene, self.given.file
        density, slope = self._density_and_slope(r)
        if file is not None and file.has("T"):
            speed2 = file.speed2(r, self.given.eos.mean_molecular_weight, scene.units.cgs("velocity"))
            return speed2, (slope - file.slope("T", r)) * speed2
        at_one, q, _ = self.eos.power_law(scene, self.given.eos, density, 0.0)
        speed2 = at_one * r**-q
        return speed2, self.eos.power_law(scene, self.given.eos, density, slope)[2] * speed2
