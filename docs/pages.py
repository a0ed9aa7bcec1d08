"""What the pages take from the code when they are built: keys, docstrings, the gallery."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gallery
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx
from sphinx.util import logging

import discsim.exact
from discsim.parts import EFFECTS, SCHEMES
from discsim.preview import reference
from discsim.preview.reference import paragraphs, split_code

GENERATED = Path(__file__).parent / "_generated"


class Docstring(Directive):
    """The docstring of a module, by the name of an effect or drag scheme, or by its whole name, as it stands there."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        module = name if "." in name else (EFFECTS if name in EFFECTS else SCHEMES).module(name)
        return [shown for part in paragraphs(reference.docstring(module)) for shown in self._nodes(part)]

    def _nodes(self, part: str) -> Iterator[nodes.Node]:
        if part.startswith(" "):
            yield nodes.literal_block(part, textwrap.dedent(part), language="text")
            return
        marked = (
            nodes.literal(piece, piece.strip("`")) if piece[:1] == "`" else nodes.Text(piece)
            for piece in split_code(part)
        )
        yield nodes.paragraph(part, "", *marked)


def write_pages(app: Sphinx) -> None:
    """The parts that pages include, where they are not what they should be already."""
    GENERATED.mkdir(exist_ok=True)
    for name, text in {
        "keys.md": reference.scene_markdown(),
        "exact.md": "\n".join(exact_solutions()),
        "gallery.md": gallery.markdown(app.tags.has("quick"), logging.getLogger(__name__).info),
    }.items():
        path = GENERATED / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def exact_solutions() -> Iterator[str]:
    """A section for each module of exact solutions."""
    for path in sorted(Path(discsim.exact.__path__[0]).glob("[!_]*.py")):
        yield f"## {path.stem}\n\n```{{eval-rst}}\n.. automodule:: discsim.exact.{path.stem}\n   :members:\n```\n"


def as_rst(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text, with equations and code as in `paragraphs` and `split_code`, and no other markup."""
    out: list[str] = []
    for part in paragraphs("\n".join(lines)):
        if part.startswith(" "):
            out += ["::", "", *(f"    {line}" for line in part.split("\n")), ""]
        else:
            out += [*plain(part).split("\n"), ""]
    lines[:] = out


def plain(part: str) -> str:
    """A paragraph of plain text as reStructuredText."""
    # Backslash and space end a literal where a letter follows it, and are not seen.
    marked = (
        rf"\ `{piece}`\ " if piece[:1] == "`" else re.sub(r"([*_|\\])", r"\\\1", piece) for piece in split_code(part)
    )
    return re.sub(r"^(?=\(?\w+[.)] )", r"\\", "".join(marked), flags=re.M)  # no numbered list


def skip(app: Sphinx, what: str, name: str, thing: Any, skipped: bool, options: Any) -> bool | None:
    """Entries of a NamedTuple stand in its signature."""
    return True if (getattr(thing, "__doc__", None) or "").startswith("Alias for field number") else None


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("docstring", Docstring)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}
