"""Small dust at the start of a run with `[growth]`: a fraction of the dust mass moves from dust to gas particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.parts import STARTS, Lazy

if TYPE_CHECKING:
    from discsim.initial import Given
    from discsim.scene import Scene

growth = Lazy("discsim.physics.growth")


def move_small_dust(scene: Scene, given: Given) -> Given:
    """Return the arrays `given` of a start, with the mass `small` (n,) of small dust in each gas particle added.

    The fraction growth.small_ratio / dust.ratio of the dust mass moves to gas particles between the radii of the dust,
    in proportion to the dust-to-gas ratio of the start at each radius. At least the fraction SEED of the dust mass
    stays, because dust particles need a mass. The total mass of dust is conserved.
    Arrays from a snapshot are returned unchanged: they already contain `small`.
    """
    initial: Any = scene.initial
    gas, dust = given["gas"], given["dust"]
    if STARTS[initial.kind].take_up is not None:
        return given
    (population,) = scene.dust or ()
    r = np.sqrt((gas["pos"] ** 2).sum(axis=1))
    there = (r >= (population.inner or 0.0)) & (r <= (population.outer or np.inf))
    weight = np.where(there, gas["mass"], 0.0)
    radial = STARTS[initial.kind].radial
    if radial is not None and (share := radial(scene).dust_share) is not None:
        weight *= share(r)
    if not weight.sum() > 0.0:
        return given
    left = max(1.0 - growth.small_ratio(scene) / population.ratio, growth.SEED)
    small = weight * ((1.0 - left) * dust["mass"].sum() / weight.sum())
    gas = gas | {"small": small}
    return given | {
        "gas": loaded(gas) if growth.small_dust_in_mass(scene) else gas,
        "dust": dust | {"mass": left * dust["mass"]},
    }


def loaded(gas: dict[str, Any], sign: float = 1.0) -> dict[str, Any]:
    """Return the arrays of gas with the mass `small` of small dust added to `mass`; with sign = -1, subtracted.

    density and u change accordingly.
    """
    more = 1.0 + sign * gas["small"] / gas["mass"]
    per_mass = {"u": gas["u"] / more} if gas.get("u") is not None else {}
    return gas | {"mass": gas["mass"] * more, "density": gas["density"] * more} | per_mass
