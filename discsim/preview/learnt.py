"""Measurements that runs leave for the next `discsim check` of this user: lists of JSON in the user's cache directory.

A cache is no promise: where there is none, or it cannot be read or written, nothing is known and nothing is kept.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from discsim.output.files import written
from discsim.userfiles import read_text

LARGEST = 2**20  # bytes of a list


def kept(name: str, is_entry: Callable[[Any], bool]) -> list[dict[str, Any]]:
    """Entries of the list `name` that are as they should be."""
    try:
        runs = json.loads(read_text(_path(name), most=LARGEST))["runs"]
        return [run for run in runs if isinstance(run, dict) and is_entry(run)]
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):
        return []


def keep(name: str, runs: Sequence[dict[str, Any]]) -> None:
    """Have these entries as the list `name`, which appears whole."""
    try:
        path = _path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with written(path) as temporary:
            temporary.write_text(json.dumps({"runs": list(runs)}, indent=1) + "\n")
    except (OSError, RuntimeError):
        return


def _path(name: str) -> Path:
    """Its file. Raises OSError, or RuntimeError, where the user has no home directory."""
    place = os.environ.get("XDG_CACHE_HOME") or Path.home().resolve(strict=True) / ".cache"
    return Path(place) / "discsim" / f"{name}.json"
