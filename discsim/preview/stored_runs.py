"""Lists of measurements from runs, stored for later calls of `discsim check`: JSON files in the user's cache directory.

If a file is absent or cannot be read, its list is empty. If a file cannot be written, nothing is stored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from discsim.output.files import replace_atomically
from discsim.userfiles import read_text

MAX_FILE_BYTES = 2**20  # largest size of a file in bytes


def read_list(name: str, is_valid: Callable[[Any], bool]) -> list[dict[str, Any]]:
    """Return the valid entries of the stored list `name`. is_valid: function that checks an entry."""
    try:
        runs = json.loads(read_text(_list_file(name), most=MAX_FILE_BYTES))["runs"]
        return [run for run in runs if isinstance(run, dict) and is_valid(run)]
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):
        return []


def write_list(name: str, runs: Sequence[dict[str, Any]]) -> None:
    """Store `runs` as the list `name`, in place of an earlier one. The file is replaced atomically."""
    try:
        path = _list_file(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_atomically(path) as temporary:
            temporary.write_text(json.dumps({"runs": list(runs)}, indent=1) + "\n")
    except (OSError, RuntimeError):
        return


def _list_file(name: str) -> Path:
    """Return the path of the file with the list `name`.

    Raises OSError or RuntimeError if the user has no home directory.
    """
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home().resolve(strict=True) / ".cache"
    return Path(cache) / "discsim" / f"{name}.json"
