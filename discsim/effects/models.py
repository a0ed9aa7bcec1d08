"""Models of the gas, and the effects that replace those of SPH particles in each model."""

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
    """Model of the gas. A scene without gas has the last model, SPH, too.

    is_of: whether a scene has this model. stand_ins: for a table, the "module:object" of the effect that replaces the
    one for particles. table: the table with the equation of state of the gas. given: the gas as functions of the
    radius, for gas that nothing moves and that has no particles. cells: whether gas and dust are fluids on a fixed
    grid, and their particles its cells.
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
    stand_ins={name: f"discsim.effects.cells_{name}:Effect" for name in ("gas", "dust", "drag")},
    cells=True,
)

SPH = GasModel(is_of=lambda scene: True)
