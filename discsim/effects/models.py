"""Models of the gas: SPH particles, a prescribed disc, or cells of a fixed 1D grid or a polar grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from discsim.parts import SCHEMES
from discsim.physics.given_disc import PrescribedDisc

if TYPE_CHECKING:
    from discsim.scene import Scene


@dataclass(frozen=True)
class GasModel:
    """Model of the gas. A scene without gas has the model SPH.

    applies_to: function (scene) that returns whether a scene has this model. effects: "module:object" of effects that
    replace the usual ones, by the name of their table. table: name of the table with the equation of state of the gas.
    given: function (scene) that returns prescribed gas, which has no particles; None for other gas. cells: whether gas
    and dust are fluids on a fixed 1D grid; each entry of a particle array is then a grid cell. polar: whether the gas
    is in cells of a polar grid, and dust consists of particles. sampler: "module:object" of the class that samples the
    gas at the positions of grains (`effects/sampling.py`).
    """

    applies_to: Callable[[Scene], bool]
    effects: Mapping[str, str] = field(default_factory=dict)
    table: str = "gas"
    given: Callable[[Scene], PrescribedDisc] | None = None
    cells: bool = False
    polar: bool = False
    sampler: str = "discsim.effects.sampling:SphSampler"

    @property
    def star_in_kick(self) -> bool:
        """Whether the kick contains the gravity of the star, and the acceleration of the frame of the star."""
        return self.given is not None or self.polar


GIVEN_DISC = GasModel(
    applies_to=lambda scene: scene.background is not None,
    effects={"dust": "discsim.effects.given_disc:Dust", "drag": "discsim.effects.given_disc:Drag"},
    table="background",
    given=PrescribedDisc,
    sampler="discsim.effects.sampling:DiscSampler",
)

FIXED_CELLS = GasModel(
    applies_to=lambda scene: scene.drag is not None and SCHEMES[scene.drag.scheme].on_grid,
    effects={name: f"discsim.effects.cells:{name.capitalize()}" for name in ("gas", "dust", "drag")},
    cells=True,
)

POLAR_CELLS = GasModel(
    applies_to=lambda scene: scene.gas is not None and scene.gas.method == "grid",
    effects={
        "gas": "discsim.effects.polar:Gas",
        "dust": "discsim.effects.polar:Dust",
        "alpha_viscosity": "discsim.effects.polar:Viscosity",
        "companion": "discsim.effects.polar_accretion:Companion",
        "growth": "discsim.effects.polar_growth:Growth",
    },
    polar=True,
    sampler="discsim.effects.sampling:PolarSampler",
)

SPH = GasModel(applies_to=lambda scene: True)
