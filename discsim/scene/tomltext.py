"""Line numbers of the keys in a TOML text, and edits of the text that preserve its comments.

`tomllib` reads values, but no line numbers. `line_numbers` scans a text that tomllib has accepted, and therefore checks
no syntax.
"""

from __future__ import annotations

import json
import re
import tomllib
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

Path = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(r'"""(?:\\.|[^\\])*?"{3,5}|' + r"'''.*?'{3,5}|" + r'"(?:\\.|[^"\\])*"|' + r"'[^']*'", re.S)
_SCALAR = re.compile(r"[^,\]}#\n]+")


def line_numbers(text: str) -> dict[Path, int]:
    """Return the line (from 1) of every table, key and list entry of a valid TOML text, by path.

    Entries of a list have their index in the path, also tables like `[[dust]]`: ("dust", 0, "ratio").
    """
    return _Scanner(text).scan()


def remove_table(data: dict[str, Any], path: Sequence[str]) -> None:
    """Remove the table at `path` from the nested tables `data` in place, if it exists."""
    for name in path[:-1]:
        data = data.get(name, {})
        if not hasattr(data, "get"):
            return
    data.pop(path[-1], None)


def set_value(data: Any, path: Sequence[str], value: Any) -> None:
    """Set the key at `path` in the nested tables `data` in place, and create missing tables.

    Raises KeyError with a message if the path crosses a value that is not a table.
    """
    for depth, name in enumerate(path[:-1]):
        is_list = isinstance(data, list)
        data = data[_list_index(data, name, path[:depth])] if is_list else data.setdefault(name, {})
        if not isinstance(data, dict | list):
            raise KeyError(f"{'.'.join(path[: depth + 1])} is not a table")
    if isinstance(data, list):
        data[_list_index(data, path[-1], path[:-1])] = value
    else:
        data[path[-1]] = value


def _list_index(data: list[Any], name: str, path: Sequence[str]) -> int:
    """Return `name` as an index of the list `data`. Raises KeyError with a message unless it is a valid index.

    path: path of the list, for the message.
    """
    if not name.isdecimal() or int(name) >= len(data):
        where = ".".join(path)
        raise KeyError(f'"{where}" is a list; expected an index from 0 to {len(data) - 1} after it, as in {where}.0')
    return int(name)


def edit(
    text: str,
    data: dict[str, Any],
    values: Sequence[tuple[Sequence[str], Any]],
    removed: Sequence[Sequence[str]],
) -> str:
    """Return the TOML text `text` after edits, with its comments; the result parses to `data`.

    values: (path, value) of each key to set. removed: paths of the tables to remove. The comments are lost if tomlkit
    cannot make the edits.
    """
    if not values and not removed:
        return text
    import tomlkit

    try:
        document = tomlkit.parse(text)
        for path, value in values:
            set_value(document, path, value)
        for path in removed:
            remove_table(document, path)
        result = tomlkit.dumps(document)
        if tomllib.loads(result) == data:
            return result
    except (tomlkit.exceptions.TOMLKitError, ValueError, KeyError, TypeError):
        pass  # an order of tables that tomlkit cannot edit: values matter more than comments
    return dump(data)


def dump(data: dict[str, Any]) -> str:
    """Return nested tables as TOML text."""
    import tomlkit

    return tomlkit.dumps(data)


def inline(value: Any) -> str:
    """Return a TOML value as text in one line, tables in braces."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(inline, value)) + "]"
    return json.dumps(value)


class _Scanner:
    """Scanner of a valid TOML text, which records the line of every key in `lines`; `at` is the current character."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.breaks = [i for i, character in enumerate(text) if character == "\n"]
        self.lines: dict[Path, int] = {}
        self.lengths: dict[Path, int] = {}  # numbers of entries of the arrays of tables so far

    def scan(self) -> dict[Path, int]:
        """Scan the text, and return the lines by path."""
        table: Path = ()
        while self._skip_blank() < len(self.text):
            if self.text.startswith("[", self.at):
                table = self._read_header()
            else:
                self._read_pair(table)
        return self.lines

    def _skip_blank(self) -> int:
        """Move behind blanks, line breaks and comments, and return the new position."""
        self._read(_BLANK)
        return self.at

    def _read(self, pattern: re.Pattern[str]) -> str:
        """Move behind the text that matches `pattern`, and return this text."""
        found = pattern.match(self.text, self.at)
        if not found:
            raise ValueError(f"not TOML from character {self.at} on: {self.text[self.at : self.at + 20]!r}")
        self.at = found.end()
        return found[0]

    def _line_number(self) -> int:
        return bisect_right(self.breaks, self.at - 1) + 1

    def _record(self, path: Path, line: int) -> None:
        """Record the line of a path, and of enclosing tables that have no line so far."""
        self.lines[path] = line
        for end in range(1, len(path)):  # tables without a header of their own
            self.lines.setdefault(path[:end], line)

    def _read_header(self) -> Path:
        """Scan the header of a table, and return the path of the table."""
        line = self._line_number()
        brackets = 2 if self.text.startswith("[[", self.at) else 1
        self.at += brackets
        keys = self._read_dotted_key()
        self.at += brackets
        if brackets == 2:
            path = (*self._indexed_path(keys[:-1]), keys[-1])
            self.lengths[path] = self.lengths.get(path, 0) + 1
            self.lines.setdefault(path, line)
        path = self._indexed_path(keys)
        self._record(path, line)
        return path

    def _indexed_path(self, keys: list[str]) -> Path:
        """Return `keys` as a path, where the name of an array of tables is followed by the index of its last entry."""
        path: Path = ()
        for key in keys:
            path += (key,)
            if path in self.lengths:
                path += (self.lengths[path] - 1,)
        return path

    def _read_dotted_key(self) -> list[str]:
        """Scan a key like a."b c".d, and return its parts."""
        keys = []
        while True:
            self._skip_blank()
            if self.text[self.at] in "\"'":
                keys.append(tomllib.loads("k=" + self._read(_STRING))["k"])
            else:
                keys.append(self._read(_BARE_KEY))
            self._skip_blank()
            if not self.text.startswith(".", self.at):
                return keys
            self.at += 1

    def _read_pair(self, table: Path) -> None:
        """Scan a key with its value; `table` is the path of the table that contains it."""
        line = self._line_number()
        path = table + tuple(self._read_dotted_key())
        self._record(path, line)
        self.at += 1  # the equals sign
        self._skip_blank()
        self._skip_value(path)

    def _skip_value(self, path: Path) -> None:
        """Move behind the value of the key at `path`; entries and keys inside the value are recorded."""
        start = self.text[self.at]
        if start in "[{":
            self._read_bracketed("]" if start == "[" else "}", path)
        else:
            self._read(_STRING if start in "\"'" else _SCALAR)

    def _read_bracketed(self, end: str, path: Path) -> None:
        """Scan an array, or the pairs of an inline table, up to the bracket `end`; `path` is the path of its key."""
        self.at += 1
        count = 0
        while True:
            self._skip_blank()
            if self.text[self.at] == end:
                self.at += 1
                return
            if self.text[self.at] == ",":
                self.at += 1
            elif end == "}":
                self._read_pair(path)
            else:
                self._record((*path, count), self._line_number())
                self._skip_value((*path, count))
                count += 1
