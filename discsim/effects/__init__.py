"""The effects a scene can name, each in its own module, imported only where its table is present."""

from __future__ import annotations

from typing import TYPE_CHECKING

from discsim.parts import EFFECTS, Lazy, found_at

if TYPE_CHECKING:
    from discsim.effects.base import Effect
    from discsim.numerics.state import State
    from discsim.scene import Scene

grids = Lazy("discsim.numerics.grid")


def effect_classes(scene: Scene) -> dict[str, type[Effect]]:
    """The effects that run, by the names of their tables, in the order of a step."""
    others = scene.model.stand_ins
    found = {name: found_at(others[name]) if name in others else EFFECTS[name] for name in scene.named}
    return {name: effect for name, effect in found.items() if effect.runs}


def load_effects(scene: Scene, state: State) -> dict[str, Effect]:
    """Make the effects of `scene`, and the state's grid where one needs it. Raises ValueError where they cannot be."""
    classes = effect_classes(scene)
    if any(effect.needs_grid for effect in classes.values()):
        # As fine as the gas, where there is any: one-way dust must not change it.
        first = next(iter(state.species.values()))
        state.grid = grids.Grid.from_scene(scene, first.count)
    return {name: effect(scene, state) for name, effect in classes.items()}
