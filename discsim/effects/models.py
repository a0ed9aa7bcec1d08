"""Models of the gas: SPH particles, a prescribed disc, or cells of a fixed 1D grid or a polar grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discsim.parts import SCHEMES, Lazy
from discsim.physics.given_disc import PrescribedDisc

if TYPE_CHECKING:
    from discsim.formulas.polar import PolarShape
    from discsim.numerics.state import Particles
    from discsim.scene import Scene

polar = Lazy("discsim.physics.polar")


@dataclass(frozen=True)
class GasModel:
    """Model of the gas. A scene without gas has the model SPH.

    applies_to: function (scene) that returns whether a scene has this model. effects: "module:object" of effects that
    replace the usual ones, by the name of their table. table: name of the table with the equation of state of the gas.
    given: function (scene) that returns prescribed gas, which has no particles; None for other gas. cells: whether gas
    and dust are fluids on a fixed 1D grid; each entry of a particle array is then a grid cell. disc_cells: function
    (scene) that returns the cells of a disc whose gas is in cells that stay in place; None for other gas. Dust in it
    consists of particles. elements: word for the entries of an array of the gas. arrays: the arrays of the gas that not
    all models have. least_energy: smallest energy per mass after a kick, over that before. start_gas: "module:object"
    of the function (scene) that returns the gas of a start with radial profiles; None if the start makes it. sampler:
    "module:object" of the class that samples the gas at the positions of grains (`effects/sampling.py`). division:
    "module:object" of the class that divides space and gas among MPI ranks. gas_bytes: estimated memory of a run in
    bytes per entry of an array of the gas, with temporary arrays of steps and snapshots, of gas without and with an
    energy equation.
    """

    applies_to: Callable[[Scene], bool]
    effects: Mapping[str, str] = field(default_factory=dict)
    table: str = "gas"
    given: Callable[[Scene], PrescribedDisc] | None = None
    cells: bool = False
    disc_cells: Callable[[Scene], PolarShape] | None = None
    elements: str = "particles"
    arrays: frozenset[str] = frozenset({"gradh", "h_before"})
    least_energy: float = 0.0
    start_gas: str | None = None
    sampler: str = "discsim.effects.sampling:SphSampler"
    division: str = "discsim.ranks.division:Division"
    gas_bytes: tuple[float, float] = (500.0, 700.0)  # measured for SPH in a disc with a planet (2026-11)

    @property
    def is_sph(self) -> bool:
        """Whether the gas consists of SPH particles, with smoothing lengths."""
        return self.given is None and not self.cells and not self.polar

    @property
    def polar(self) -> bool:
        """Whether the gas is in cells of a polar grid."""
        return self.disc_cells is not None

    @property
    def star_in_kick(self) -> bool:
        """Whether the kick contains the gravity of the star, and the acceleration of the frame of the star."""
        return self.given is not None or self.polar

    def element_of(self, species: str) -> str:
        """Return the word for an entry of an array of "gas" or "dust", "cell" or "particle"."""
        return self.elements.removesuffix("s") if species == "gas" or self.cells else "particle"

    def mass_in_rings(self, scene: Scene, gas: Particles, edges: np.ndarray) -> np.ndarray:
        """Return the mass (rings,) of the gas of a scene in rings between the radii `edges` (rings + 1,)."""
        if self.disc_cells is not None:
            return self.disc_cells(scene).mass_in_rings(gas.mass, edges)
        return np.histogram(np.sqrt((gas.pos**2).sum(axis=1)), edges, weights=gas.mass)[0]


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
    elements="cells",
    arrays=frozenset(),
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
    disc_cells=lambda scene: polar.polar_shape(scene),  # imports the module at the first call
    elements="cells",
    arrays=frozenset({"kick_acc", "last_heating_rate", "last_pressure_acc"}),
    least_energy=0.2,  # gas that expands into almost empty cells would lose all its energy
    start_gas="discsim.initial.polar:gas_in_cells",
    sampler="discsim.effects.sampling:PolarSampler",
    division="discsim.ranks.polar:RingDivision",
    gas_bytes=(490.0, 720.0),  # measured for a disc with a planet (2026-11)
)

SPH = GasModel(applies_to=lambda scene: True)
