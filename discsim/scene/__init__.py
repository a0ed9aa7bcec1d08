"""What a user writes: units, tables of keys, the rules between them, and the validated scene."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from discsim.scene.loading import Scene, SceneError, load_scene, near

__all__ = ["Scene", "SceneError", "load_scene", "near"]


def __getattr__(name: str) -> Any:
    # Lazy: the files of effects and starts take the types of their keys from here, and loading takes keys from them.
    if name in __all__:
        return getattr(import_module("discsim.scene.loading"), name)
    raise AttributeError(f"module 'discsim.scene' has no attribute {name!r}")
