"""Measurements stored by runs for the next `discsim check` of the same user, as JSON lists in the cache directory.

The cache is optional: if it is absent or cannot be read or written, lists are empty and nothing is stored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from discsim.output.files import replace_atomically
from discsim.userfiles import read_text

LARGEST = 2**20  # largest file of a list in bytes


def kept(name: str, is_entry: Callable[[Any], bool]) -> list[dict[str, Any]]:
    """Return the valid entries of the list `name`."""
    try:
        runs = json.loads(read_text(_path(name), most=LARGEST))["runs"]
        return [run for run in runs if isinstance(run, dict) and is_entry(run)]
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):
        return []


def keep(name: str, runs: Sequence[dict[str, Any]]) -> None:
    """Write the entries as the list `name`, atomically."""
    try:
        path = _path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_atomically(path) as temporary:
            temporary.write_text(json.dumps({"runs": list(runs)}, indent=1) + "\n")
    except (OSError, RuntimeError):
        return


def _path(name: str) -> Path:
    """Return the file of a list. Raises OSError or RuntimeError if the user has no home directory."""
    place = os.environ.get("XDG_CACHE_HOME") or Path.home().resolve(strict=True) / ".cache"
    return Path(place) / "discsim" / f"{name}.json"
