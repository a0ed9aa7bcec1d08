"""Reading of a scene, from a file or a dict, into nested dicts whose values have the types of TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from discsim.scene.messages import KeyPath, SceneError, name_of
from discsim.scene.tables import REQUIRED
from discsim.userfiles import read_plain

MAX_SCENE_BYTES = 2**20  # bytes
MAX_DEPTH = 8  # nesting of tables and lists; a scene needs four levels


def read_scene_text(path: Path) -> str:
    """Return the text of a scene file. Raises SceneError if it cannot be read."""
    try:
        content = read_plain(path, MAX_SCENE_BYTES)
    except (OSError, ValueError) as error:
        known: dict[type, str] = {FileNotFoundError: "file not found", IsADirectoryError: "is a directory"}
        wrong = known.get(type(error), f"cannot be read: {getattr(error, 'strerror', None) or error}")
        raise SceneError([f"{path}: {wrong}; give a scene file (TOML)"]) from None
    try:
        return content.decode("utf-8").removeprefix("\ufeff").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        wrong = f"byte 0x{byte:02x} at offset {error.start} is not UTF-8; expected a TOML file in UTF-8"
        raise SceneError([f"{path}:{line}: {wrong}"]) from None


def parse_scene(path: Path, text: str) -> dict[str, Any]:
    """Return the tables in the text of a scene file. Raises SceneError if the text is no TOML, or has no tables."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).partition(" (at ")
        line = place.split(",")[0].removeprefix("line ")
        if not line.isdecimal():
            line = str(text.rstrip().count("\n") + 1)
        raise SceneError([f"{path}:{line}: not valid TOML: {reason}"]) from None
    except (RecursionError, ValueError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise SceneError([f"{path}:1: not valid TOML: {reason}"]) from None
    if not data:
        wanted = ", ".join(f"[{name}]" for name in REQUIRED)
        raise SceneError([f"{path}:1: the scene is empty; add the tables {wanted}, and [gas] or [dust]"])
    return data


def refuse_deep(data: dict[str, Any], where: str) -> None:
    """Raise SceneError if tables and lists are nested more than MAX_DEPTH levels deep; `where` begins the message."""
    left: list[tuple[Any, KeyPath]] = [(data, ())]
    while left:
        value, path = left.pop()
        if len(path) > MAX_DEPTH:
            raise SceneError([f"{where}: {name_of(path)}: nested too deeply; expected tables like [gas.eos]"])
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        left += [(entry, (*path, key)) for key, entry in entries]


def to_toml_types(value: Any) -> Any:
    """Convert a value of a scene dict to TOML types: Quantities and paths to texts, arrays and tuples to lists.

    Entries of a dict that are None are left out.
    """
    if isinstance(value, dict):
        return {str(key): to_toml_types(entry) for key, entry in value.items() if entry is not None}
    if hasattr(value, "unit") and hasattr(value, "value"):
        if getattr(value, "isscalar", True):
            return f"{float(value.value)!r} {value.unit}"
        return [to_toml_types(entry) for entry in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [to_toml_types(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
