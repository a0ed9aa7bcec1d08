"""Scenes: units, tables of keys, rules between tables, and the validated `Scene`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from discsim.scene.loading import Scene, SceneError, load_scene, nearest_hint

__all__ = ["Scene", "SceneError", "load_scene", "nearest_hint"]


def __getattr__(name: str) -> Any:
    # Imported lazily to avoid a cycle: effects and starts import key types from here, and `loading` imports their keys.
    if name in __all__:
        return getattr(import_module("discsim.scene.loading"), name)
    raise AttributeError(f"module 'discsim.scene' has no attribute {name!r}")
