"""What notebooks show of an object: a small table, all of it escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

LEFT = 'style="text-align: left"'


def table(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """A title over rows of names and what they are."""
    cells = "".join(
        f"<tr><th {LEFT}>{escape(name)}</th><td {LEFT}>{escape(str(text))}</td></tr>" for name, text in rows
    )
    return f"<p><strong>{escape(title)}</strong></p><table>{cells}</table>"
