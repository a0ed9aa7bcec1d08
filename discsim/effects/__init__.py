"""Effects: the physical processes of a run, one module for each table of a scene.

A module is imported only if the scene has its table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from discsim.parts import EFFECTS, Lazy, import_object

if TYPE_CHECKING:
    from discsim.effects.base import Effect
    from discsim.numerics.state import State
    from discsim.scene import Scene

grids = Lazy("discsim.numerics.grid")


def effect_classes(scene: Scene) -> dict[str, type[Effect]]:
    """Return the effect classes of a scene by table name, in the order in which a step calls them."""
    replacing = scene.model.effects
    found = {name: import_object(replacing[name]) if name in replacing else EFFECTS[name] for name in scene.named}
    return {name: effect for name, effect in found.items() if not effect.role.table_only}


def load_effects(scene: Scene, state: State) -> dict[str, Effect]:
    """Create the effects of `scene`, by table name, and the grid of `state` if an effect needs one.

    Raises ValueError if an effect cannot run with this scene and state.
    """
    classes = effect_classes(scene)
    if any(effect.role.grid for effect in classes.values()):
        # The number of grid cells follows from the gas, or from the dust in a scene without gas: one-way dust must not
        # change the grid.
        first = next(iter(state.species.values()))
        state.grid = grids.Grid.from_scene(scene, first.count)
    return {name: effect(scene, state) for name, effect in classes.items()}
