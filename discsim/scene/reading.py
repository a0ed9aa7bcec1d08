"""Reading of a scene file or dict into nested dicts whose values have only the types of TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from discsim.scene.messages import KeyPath, SceneError, name_of
from discsim.scene.tables import REQUIRED
from discsim.userfiles import read_plain

MAX_SCENE_BYTES = 2**20  # bytes
MAX_DEPTH = 8  # nesting of tables and lists; a scene needs four levels


def read(path: Path) -> str:
    """Return the text of a scene file. Raises SceneError if it cannot be read."""
    try:
        content = read_plain(path, MAX_SCENE_BYTES)
    except FileNotFoundError:
        raise SceneError([f"{path}: file not found; expected a scene file (TOML)"]) from None
    except IsADirectoryError:
        raise SceneError([f"{path}: is a directory; expected a scene file (TOML)"]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError([f"{path}: cannot be read: {reason}; expected a scene file (TOML)"]) from None
    try:
        return content.decode("utf-8").removeprefix("\ufeff").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        wrong = f"byte 0x{byte:02x} at offset {error.start} is not UTF-8; expected a TOML file in UTF-8"
        raise SceneError([f"{path}:{line}: {wrong}"]) from None


def parsed(path: Path, text: str) -> dict[str, Any]:
    """Return the tables of the TOML text of a scene file. Raises SceneError if the text is invalid or empty."""
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
        raise SceneError([f"{path}:1: the scene is empty; expected the tables {wanted} and [gas] or [dust]"])
    return data


def refuse_deep(data: dict[str, Any], where: str) -> None:
    """Raise SceneError if tables and lists are nested more than MAX_DEPTH levels deep."""
    left: list[tuple[Any, KeyPath]] = [(data, ())]
    while left:
        value, path = left.pop()
        if len(path) > MAX_DEPTH:
            raise SceneError([f"{where}: {name_of(path)}: nested too deeply; expected tables like [gas.eos]"])
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        left += [(entry, (*path, key)) for key, entry in entries]


def plain(value: Any) -> Any:
    """Convert a value of a dict scene to TOML types: Quantities to texts, arrays and tuples to lists.

    Entries of a dict that are None are left out.
    """
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items() if entry is not None}
    if hasattr(value, "unit") and hasattr(value, "value"):
        if getattr(value, "isscalar", True):
            return f"{float(value.value)!r} {value.unit}"
        return [plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
