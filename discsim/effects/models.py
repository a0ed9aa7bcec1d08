"""Models of the gas: SPH particles, a prescribed disc, or cells of a fixed grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from discsim.parts import SCHEMES
from discsim.physics.given_disc import GivenDisc

if TYPE_CHECKING:
    from discsim.scene import Scene


@dataclass(frozen=True)
class GasModel:
    """Model of the gas. A scene without gas has the model SPH.

    is_of: return whether a scene has this model. stand_ins: for each table whose usual effect does not suit the model,
    the "module:object" of the effect that replaces it. table: name of the table with the equation of state of the gas.
    given: return the gas of a scene as functions of radius; only for prescribed gas, which has no particles. cells:
    whether gas and dust are fluids on a fixed grid. Each entry of a particle array is then a grid cell.
    """

    is_of: Callable[[Scene], bool]
    stand_ins: Mapping[str, str] = field(default_factory=dict)
    table: str = "gas"
    given: Callable[[Scene], GivenDisc] | None = None
    cells: bool = False


GIVEN_DISC = GasModel(
    is_of=lambda scene: scene.background is not None,
    stand_ins={"dust": "discsim.effects.given_disc:Dust", "drag": "discsim.effects.given_disc:Drag"},
    table="background",
    given=GivenDisc,
)

FIXED_CELLS = GasModel(
    is_of=lambda scene: scene.drag is not None and SCHEMES[scene.drag.scheme].on_grid,
    stand_ins={name: f"discsim.effects.cells:{name.capitalize()}" for name in ("gas", "dust", "drag")},
    cells=True,
)

SPH = GasModel(is_of=lambda scene: True)
