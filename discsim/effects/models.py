"""What the gas of a scene is made of, and what follows for the effects that run and for all that looks at the gas."""

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
    """A model of the gas; a scene without gas is of the last one, SPH, too.

    is_of: whether it is that of a scene. stand_ins: table -> "module:object" of the effect that runs there in place of
    the one for particles. table: which one has the gas's equation of state. given: the gas as functions of the radius,
    where nothing moves it and no particle is of it. cells: whether gas and dust are fluids on a fixed grid, and their
    particles its cells.
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
