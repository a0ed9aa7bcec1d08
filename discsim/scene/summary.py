"""Short summaries of objects: text for `print`, HTML for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from discsim.printable import printable

LEFT = 'style="text-align: left"'
Rows = Sequence[tuple[str, object]]


class Summarised:
    """Base class of objects that are displayed as a title and rows of names and values."""

    def summary(self) -> tuple[str, Rows]:
        """Return the title and the rows (name, value)."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, rows = self.summary()
        names = [printable(name) for name, _ in rows]
        width = max(map(len, names), default=0)
        lines = (
            f"  {name:<{width}}  {printable(value)}".rstrip() for name, (_, value) in zip(names, rows, strict=True)
        )
        return "\n".join([printable(title), *lines])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        title, rows = self.summary()
        cells = "".join(f"<tr><th {LEFT}>{_safe(name)}</th><td {LEFT}>{_safe(value)}</td></tr>" for name, value in rows)
        return f"<p><strong>{_safe(title)}</strong></p><table>{cells}</table>"


def _safe(text: object) -> str:
    return escape(printable(text))
