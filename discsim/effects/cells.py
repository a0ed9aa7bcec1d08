"""Gas and dust on a fixed 1D grid with drag between them (`discsim/numerics/ppm.py`), for sios-ppm and emsi-ppm.

Dust is a fluid without pressure. The effects of [gas] and [dust] compute densities, pressure and the step limits
dx / (|v| + c_s) and dx / |u|, with the velocities v of gas and u of dust. The effect of [drag] solves fluxes and drag
in one operator in the slot MOVE; there is no kick. Drag sets no time-step limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discsim.drag.classes import law_of
from discsim.drag.published.fixed_grid import OF_SPH
from discsim.effects import base
from discsim.effects.drag_base import DragEffect
from discsim.numerics.state import State
from discsim.parts import SCHEMES, Lazy
from discsim.physics.eos import pressure_and_sound_speed, thermal_speed
from discsim.physics.laws import SceneLaw

if TYPE_CHECKING:
    from discsim.scene import Scene

ppm = Lazy("discsim.numerics.ppm")


class Gas(base.Effect):
    """Density, pressure and step limit of the gas."""

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene = scene
        self.dx = scene.space.size[0] / state.gas.count
        state.gas.h[:] = self.dx

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return OF_SPH

    @classmethod
    def expected_limit(cls, scene: Scene, outlook: base.ForecastState) -> base.Expected:
        sound, dx = outlook.at.sound_speed, scene.space.size[0] / scene.gas.particles
        return base.Expected() if sound is None else base.Expected(dx / float(sound.max()))

    def operators(self, state: State) -> list[base.Operator]:
        found = base.arrays("gas", "density pressure sound_speed")
        return [
            base.Operator("gas.density", base.Slot.FORCE, self.find_density, base.arrays("gas", "pos mass u"), found),
            base.Operator("gas.limit", base.Slot.LIMIT, self.limit, base.arrays("gas", "vel sound_speed")),
        ]

    def find_density(self, view: base.View) -> None:
        """Set density, pressure and sound speed of the gas."""
        gas = view.gas
        gas.density = gas.mass / self.dx
        gas.pressure, gas.sound_speed = pressure_and_sound_speed(self.scene, gas.pos, gas.density, gas.u)

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        fastest = float((np.abs(view.gas.vel[:, 0]) + view.gas.sound_speed).max(initial=0.0))
        return {base.ALL: base.Limit(self.dx / fastest)} if fastest != 0.0 else {}


class Dust(base.Effect):
    """Density and step limit of the dust."""

    def __init__(self, scene: Scene, state: State) -> None:
        self.dx = scene.space.size[0] / state.dust.count
        state.dust.density = np.zeros(state.dust.count)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return "offset", "placement"

    def operators(self, state: State) -> list[base.Operator]:
        mass, vel, density = (base.arrays("dust", name) for name in ("mass", "vel", "density"))
        return [
            base.Operator("dust.density", base.Slot.FORCE, self.find_density, mass, density),
            base.Operator("dust.limit", base.Slot.LIMIT, self.limit, vel),
        ]

    def find_density(self, view: base.View) -> None:
        """Set the density of the dust."""
        view.dust.density = view.dust.mass / self.dx

    def limit(self, view: base.View) -> dict[str, base.Limit]:
        fastest = float(np.abs(view.dust.vel).max(initial=0.0))
        return {base.ALL: base.Limit(self.dx / fastest)} if fastest > 0.0 else {}


class Drag(DragEffect):
    """Fluxes of gas and dust between cells, and drag in each cell."""

    def __init__(self, scene: Scene, state: State) -> None:
        self.advance = SCHEMES[scene.drag.scheme].advance
        self.law = law_of(scene, SceneLaw(scene))
        self.heating = scene.drag.heating
        self.tube = ppm.Tube(scene, state)

    @classmethod
    def unused(cls, scene: Scene) -> tuple[str, ...]:
        return sum(SCHEMES[scene.drag.scheme].unused.values(), ())

    def operators(self, state: State) -> list[base.Operator]:
        """Return the only operator, which applies fluxes and drag."""
        return [base.Operator("drag.move", base.Slot.MOVE, self.move)]

    def move(self, state: State, dt: float) -> None:
        """Advance gas and dust in all cells over dt."""
        self.tube.write(state, self.advance(self.law, self.tube, self.tube.read(state), dt, self.heating))

    def current_stopping_times(self, state: State) -> np.ndarray:
        """Return the stopping time of the dust in each cell (n,)."""
        gas, dust = state.gas, state.dust
        sound = thermal_speed(state.scene, gas)
        return self.law.stopping_time(0, gas.density, sound, np.zeros(len(sound)), dust.density / gas.density)
