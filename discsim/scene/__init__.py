"""What a user writes: units, tables of keys, the rules between them, and the validated scene."""

from discsim.scene.loading import Scene, SceneError, load_scene, near

__all__ = ["Scene", "SceneError", "load_scene", "near"]
