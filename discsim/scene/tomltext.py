"""Line numbers of the keys in a TOML text, and edits that preserve its comments.

`tomllib` reads values but no line numbers. `positions` scans a text that tomllib has accepted, and so needs no
checks of syntax.
"""

from __future__ import annotations

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


def positions(text: str) -> dict[Path, int]:
    """Return the line (from 1) of every table, key and list entry of a valid TOML text, by path.

    List entries, also those of `[[dust]]`, have their index in the path: ("dust", 0, "ratio").
    """
    return _Scanner(text).scan()


def without_table(data: dict[str, Any], path: Sequence[str]) -> None:
    """Remove the table `path` from nested tables in place, if present."""
    for name in path[:-1]:
        data = data.get(name, {})
        if not hasattr(data, "get"):
            return
    data.pop(path[-1], None)


def with_value(data: Any, path: Sequence[str], value: Any) -> None:
    """Set the key `path` in nested tables in place; missing tables are created.

    Raises KeyError with a message if the path crosses a value that is no table.
    """
    for depth, name in enumerate(path[:-1]):
        is_list = isinstance(data, list)
        data = data[_index(data, name, path[:depth])] if is_list else data.setdefault(name, {})
        if not isinstance(data, dict | list):
            raise KeyError(f"{'.'.join(path[: depth + 1])} is not a table")
    if isinstance(data, list):
        data[_index(data, path[-1], path[:-1])] = value
    else:
        data[path[-1]] = value


def _index(data: list[Any], name: str, path: Sequence[str]) -> int:
    """Return the list index that `name` is. Raises KeyError with a message for any other name."""
    if not name.isdecimal() or int(name) >= len(data):
        where = ".".join(path)
        raise KeyError(f'"{where}" is a list; expected an index from 0 to {len(data) - 1} after it, as in {where}.0')
    return int(name)


def edited(
    text: str,
    data: dict[str, Any],
    values: Sequence[tuple[Sequence[str], Any]],
    removed: Sequence[Sequence[str]],
) -> str:
    """Return `text` with `values` set and the tables `removed` taken out, with its comments. It parses to `data`.

    Comments are lost if tomlkit cannot make the edit.
    """
    if not values and not removed:
        return text
    import tomlkit

    try:
        document = tomlkit.parse(text)
        for path, value in values:
            with_value(document, path, value)
        for path in removed:
            without_table(document, path)
        result = tomlkit.dumps(document)
        if tomllib.loads(result) == data:
            return result
    except (tomlkit.exceptions.TOMLKitError, ValueError, KeyError, TypeError):
        pass  # an order of tables that tomlkit cannot edit: values matter more than comments
    return dumped(data)


def dumped(data: dict[str, Any]) -> str:
    """Return nested tables as TOML text."""
    import tomlkit

    return tomlkit.dumps(data)


class _Scanner:
    """Scanner of a valid TOML text that records the line of every key."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.breaks = [i for i, character in enumerate(text) if character == "\n"]
        self.lines: dict[Path, int] = {}
        self.lengths: dict[Path, int] = {}  # numbers of entries of the arrays of tables so far

    def scan(self) -> dict[Path, int]:
        table: Path = ()
        while self._blank() < len(self.text):
            if self.text.startswith("[", self.at):
                table = self._header()
            else:
                self._pair(table)
        return self.lines

    def _blank(self) -> int:
        self.at = self._match(_BLANK).end()
        return self.at

    def _match(self, pattern: re.Pattern[str]) -> re.Match[str]:
        found = pattern.match(self.text, self.at)
        if not found:
            raise ValueError(f"not TOML from character {self.at} on: {self.text[self.at : self.at + 20]!r}")
        return found

    def _take(self, pattern: re.Pattern[str]) -> str:
        found = self._match(pattern)
        self.at = found.end()
        return found[0]

    def _line(self) -> int:
        return bisect_right(self.breaks, self.at - 1) + 1

    def _note(self, path: Path, line: int) -> None:
        """Record the line of a path, and of enclosing tables without a header."""
        self.lines[path] = line
        for end in range(1, len(path)):  # tables without a header of their own
            self.lines.setdefault(path[:end], line)

    def _header(self) -> Path:
        line = self._line()
        many = self.text.startswith("[[", self.at)
        self.at += 2 if many else 1
        keys = self._keys()
        self.at += 2 if many else 1
        path = (*self._inside(keys[:-1]), keys[-1])
        if many:
            self.lengths[path] = self.lengths.get(path, 0) + 1
            self.lines.setdefault(path, line)
        if path in self.lengths:
            path += (self.lengths[path] - 1,)
        self._note(path, line)
        return path

    def _inside(self, keys: list[str]) -> Path:
        """Return the path of the table named by `keys`, with the index of the last entry of each array of tables."""
        path: Path = ()
        for key in keys:
            path += (key,)
            if path in self.lengths:
                path += (self.lengths[path] - 1,)
        return path

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._blank()
            if self.text[self.at] in "\"'":
                keys.append(tomllib.loads("k=" + self._take(_STRING))["k"])
            else:
                keys.append(self._take(_BARE_KEY))
            self._blank()
            if not self.text.startswith(".", self.at):
                return keys
            self.at += 1

    def _pair(self, table: Path) -> None:
        line = self._line()
        path = table + tuple(self._keys())
        self._note(path, line)
        self.at += 1  # the equals sign
        self._blank()
        self._value(path)

    def _value(self, path: Path) -> None:
        start = self.text[self.at]
        if start == "[":
            self._sequence("]", path)
        elif start == "{":
            self._sequence("}", path)
        else:
            self._take(_STRING if start in "\"'" else _SCALAR)

    def _sequence(self, end: str, path: Path) -> None:
        """Scan an array, or the pairs of an inline table, up to the bracket `end`."""
        self.at += 1
        count = 0
        while True:
            self._blank()
            if self.text[self.at] == end:
                self.at += 1
                return
            if self.text[self.at] == ",":
                self.at += 1
            elif end == "}":
                self._pair(path)
            else:
                self._note((*path, count), self._line())
                self._value((*path, count))
                count += 1
