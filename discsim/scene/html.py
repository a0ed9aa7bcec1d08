"""What notebooks show of an object: a small table, all of it escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from discsim.printable import printable

LEFT = 'style="text-align: left"'


def table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """A title over rows of names and what they are."""
    cells = "".join(f"<tr><th {LEFT}>{_safe(name)}</th><td {LEFT}>{_safe(text)}</td></tr>" for name, text in rows)
    return f"<p><strong>{_safe(title)}</strong></p><table>{cells}</table>"


def _safe(text: object) -> str:
    return escape(printable(text))
