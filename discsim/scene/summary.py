"""Short summaries of objects for display: text for `print`, HTML for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from discsim.printable import printable

LEFT_ALIGNED = 'style="text-align: left"'
Rows = Sequence[tuple[str, object]]


class Summarised:
    """Base class of objects that `print` and notebooks show as a title and rows of names and values."""

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
        cells = "".join(
            f"<tr><th {LEFT_ALIGNED}>{_html(name)}</th><td {LEFT_ALIGNED}>{_html(value)}</td></tr>"
            for name, value in rows
        )
        return f"<p><strong>{_html(title)}</strong></p><table>{cells}</table>"


def _html(text: object) -> str:
    return escape(printable(text))
