"""The effects a scene can name, each in its own module, imported only where its table is present."""

from importlib import import_module

# Table in the scene -> module with a class `Effect`. Order = order in a step.
EFFECTS = {
    "gas": "discsim.effects.gas",
    "dust": "discsim.effects.dust",
    "star": "discsim.effects.star",
    "self_gravity": "discsim.effects.self_gravity",
    "external": "discsim.effects.external",
    "drag": "discsim.effects.drag",
}

# Where the gas is given.
IN_BACKGROUND = {"dust": "discsim.effects.background_dust", "drag": "discsim.effects.background"}
ON_CELLS = {name: f"discsim.effects.grid_{name}" for name in ("gas", "dust", "drag")}  # where both are fluids


def load_effects(scene, state) -> dict:
    """Import and make the effects whose tables `scene` has, in the order of a step."""
    named = [name for name in EFFECTS if getattr(scene, name) is not None]
    modules = EFFECTS | (IN_BACKGROUND if scene.background is not None else {}) | (ON_CELLS if scene.on_cells else {})
    return {name: import_module(modules[name]).Effect(scene, state) for name in named}
