"""The setups that come with discsim.

They are in `setups/` next to this module in an installed package, and in `setups/` of the repository in a clone.
"""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from discsim.printable import UserError, printable

HERE = Path(__file__).parent
PLACES = (HERE / "setups", HERE.parent / "setups")
_LABEL = re.compile(r"([A-Z][A-Za-z ]*): +(.+)")


class ShippedError(UserError):
    """A name of no setup, or a copy that would replace a file; the message has the details."""


@dataclass(frozen=True)
class Setup:
    """A shipped scene with the notes in the comment at its top."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8", errors="replace")

    @property
    def title(self) -> str:
        """The scene's title, printable; "" if the file has none or is no valid TOML."""
        try:
            return printable(tomllib.loads(self.text).get("title", ""))
        except tomllib.TOMLDecodeError:
            return ""

    @property
    def about(self) -> str:
        """The first line of the comment at the top."""
        return self._comment()[0]

    @property
    def notes(self) -> dict[str, str]:
        """The labelled notes of the comment ("What you will see:", "How long:", "Paper:") by label."""
        found: dict[str, str] = {}
        label = ""
        for line in self._comment()[1:]:
            start = _LABEL.fullmatch(line)
            if start:
                label, found[start[1]] = start[1], start[2]
            elif line and label:
                found[label] += f" {line}"
            else:  # before the first label, or after the blank line at the end of a note
                label = ""
        return found

    def _comment(self) -> list[str]:
        head = re.match(r"(?:#.*\n)+", self.text)
        return [line.removeprefix("#").strip() for line in head[0].splitlines()] if head else [""]


def setups() -> dict[str, Setup]:
    """Return the shipped setups by name."""
    folder = next(place for place in PLACES if place.is_dir())
    return {path.stem: Setup(path) for path in sorted(folder.glob("*.toml"))}


def setup(name: str) -> Setup:
    """Return the shipped setup `name`. Raises ShippedError with the nearest name."""
    known = setups()
    if name not in known:
        raise ShippedError(f"{name}: unknown setup{_hint(name, known)}")
    return known[name]


def scene_file(given: Path) -> Path:
    """Return the scene file for the command-line argument `given`.

    The candidates are, in this order, the file `given`, and for a bare NAME the file NAME.toml and the shipped setup
    NAME. Raises ShippedError.
    """
    if os.path.isfile(given):
        return given
    known, bare = setups(), given.name == str(given) and not given.suffix
    beside = Path(f"{given}.toml")
    if bare and os.path.isfile(beside):
        return beside
    if bare and given.name in known:
        return known[given.name].path
    if os.path.lexists(given):
        return given  # a directory or an unreadable file: loading the scene gives the message
    expected = "file not found; expected a scene file (TOML)"
    if given.stem in known:
        raise ShippedError(f"{given}: {expected}; to use the setup of this name, give: {given.stem}")
    if bare:
        raise ShippedError(f"{given}: {expected}, or the name of a setup{_hint(given.name, known)}")
    return given


def copy_setup(name: str, path: Path) -> None:
    """Copy the shipped setup `name` to a new file. Raises ShippedError, OSError."""
    content = setup(name).path.read_bytes()
    try:
        file = path.open("xb")
    except FileExistsError:
        raise ShippedError(f"{path}: already exists; expected the name of a new file") from None
    try:
        with file:
            file.write(content)
    except OSError:
        path.unlink(missing_ok=True)
        raise


def _hint(name: str, known: dict[str, Setup]) -> str:
    near = get_close_matches(name.lower(), known, n=1, cutoff=0.5)
    return f'; did you mean "{near[0]}"?' if near else "; `discsim setups` lists them"
