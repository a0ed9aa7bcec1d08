"""The effects a scene can name, each in its own module, imported only where its table is present."""

from importlib import import_module

from discsim.parts import EFFECTS

# In place of those of particles: where the gas is given, and where gas and dust are fluids on a fixed grid.
IN_BACKGROUND = {"dust": "discsim.effects.background_dust", "drag": "discsim.effects.background"}
ON_CELLS = {name: f"discsim.effects.grid_{name}" for name in ("gas", "dust", "drag")}


def load_effects(scene, state) -> dict:
    """Import and make the effects whose tables `scene` has, in the order of a step."""
    others = IN_BACKGROUND if scene.background is not None else ON_CELLS if scene.on_cells else {}
    effects = {}
    for name in scene.named:
        if name != "background":
            made = import_module(others[name]).Effect if name in others else EFFECTS[name]
            effects[name] = made(scene, state)
    return effects
