r"""Safe display of foreign text in terminals, logs, tables, pages and figures.

Titles, keys, values and file names come from users and from files of unknown origin. Terminal escape sequences,
right-to-left marks and line breaks in them could hide or forge messages of discsim. These characters are replaced by
Python's escapes, like `\x1b`, `\u202e` and `\n`.
"""

from __future__ import annotations


class UserError(Exception):
    """Base class of errors that the user can correct; the message becomes one printable line."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def printable(text: object) -> str:
    """Escape control characters, line breaks and invisible characters of a text.

    Parameters
    ----------
    text
        A text, or an object, which is converted by `str`.

    Returns
    -------
    str
        One line of printable characters.

    Examples
    --------
    >>> printable("red \\x1b[31m, then a new line\\n")
    'red \\\\x1b[31m, then a new line\\\\n'
    """
    line = str(text)
    if line.isprintable():
        return line
    return "".join(letter if letter.isprintable() else _escaped(letter) for letter in line)


def printable_lines(text: object) -> str:
    """Escape a text as `printable`, except its line breaks; for texts whose line breaks are from discsim."""
    return "\n".join(map(printable, str(text).split("\n")))


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")
