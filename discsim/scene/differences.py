"""Comparison of two scenes, to decide whether a run may be resumed with another scene."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from discsim.scene import Scene, SceneError, load_scene
from discsim.scene.units import Units

# Keys that may differ when a run is resumed.
FREE_TO_CHANGE = (
    "title", "run.until", "run.snapshots", "run.every", "run.threads", "run.checkpoint_every", "run.walltime",
)  # fmt: skip


def refuse_changed_scene(path: str | Path, text: bytes, now: Scene) -> None:
    """Raise SceneError if a run cannot be resumed with the scene `now`, because its own scene differs.

    path: file with the run's own scene. text: content of this file.
    """
    try:
        before = load_scene(tomllib.loads(text.decode()), own_particles=now.initial is None, folder=Path(path).parent)
    except (SceneError, ValueError, RecursionError) as fault:
        raise SceneError(
            [f"{path}: this version of discsim cannot read the scene of the run: {str(fault).splitlines()[0]}"]
        ) from None
    changed = [key for key in differences(before, now) if key not in FREE_TO_CHANGE]
    if changed:
        wrong = f"the scene differs from the scene of the run in {', '.join(changed)}"
        raise SceneError([f"{path}: {wrong}; change only {', '.join(FREE_TO_CHANGE)}"])


def differences(before: Any, now: Any, name: str = "") -> Iterator[str]:
    """Yield the dotted names of the keys in which two scenes, or two parts of scenes, differ.

    A table that only one of the scenes has counts as one key. name: dotted name of the parts `before` and `now`.
    """
    parts, others = _entries_by_name(before), _entries_by_name(now)
    if parts is None or others is None or type(before) is not type(now):
        if before != now:
            yield name
        return
    for key in parts | others:
        yield from differences(parts.get(key), others.get(key), f"{name}.{key}" if name else key)


def _entries_by_name(value: Any) -> dict[str, Any] | None:
    """Return the entries by name of a scene, a table, units or a tuple of tables; None for a plain value."""
    if isinstance(value, Scene):
        return {name: entry for name, entry in value if name not in ("text", "path", "others")} | value.others
    if isinstance(value, BaseModel):
        return dict(value)
    if isinstance(value, Units):
        return {"system": value.system, "length": value.length_text, "mass": value.mass_text}
    if isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
        return {str(number): entry for number, entry in enumerate(value)}
    return None
