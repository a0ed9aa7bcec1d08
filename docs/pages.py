"""What the pages take from the code when they are built: keys, docstrings, the gallery."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gallery
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

import discsim.exact
from discsim import reference

GENERATED = Path(__file__).parent / "_generated"


class Docstring(Directive):
    """The docstring of the module of an effect, or of a drag scheme, as it stands there."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        modules = reference.MODULES | reference.SCHEMES | reference.GRID_SCHEMES
        text = reference.docstring(modules[self.arguments[0]])
        return [nodes.literal_block(text, text, language="text")]


def write_pages(app: Sphinx) -> None:
    """The parts that pages include, where they are not what they should be already."""
    GENERATED.mkdir(exist_ok=True)
    for name, text in {
        "keys.md": reference.scene_markdown(),
        "exact.md": "\n".join(exact_solutions()),
        "gallery.md": gallery.markdown(app.tags.has("quick")),
    }.items():
        path = GENERATED / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def exact_solutions() -> Iterator[str]:
    """A section for each module of exact solutions."""
    for path in sorted(Path(discsim.exact.__path__[0]).glob("[!_]*.py")):
        yield f"## {path.stem}\n\n```{{eval-rst}}\n.. automodule:: discsim.exact.{path.stem}\n   :members:\n```\n"


def as_rst(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: indented lines are equations, `words` are code, and nothing else is markup."""
    out: list[str] = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(lines).strip("\n")):
        if paragraph.startswith(" "):
            out += ["::", "", *(f"    {line}" for line in paragraph.split("\n")), ""]
        else:
            out += [*plain(paragraph).split("\n"), ""]
    lines[:] = out


def plain(text: str) -> str:
    """A paragraph of plain text as reStructuredText."""
    pieces = re.split(r"(`[^`]+`)", text)
    # Backslash and space end a literal where a letter follows it, and are not seen.
    pieces = [rf"\ `{piece}`\ " if piece.startswith("`") else re.sub(r"([*_|\\])", r"\\\1", piece) for piece in pieces]
    return re.sub(r"^(?=\(?\w+[.)] )", r"\\", "".join(pieces), flags=re.M)  # no numbered list


def skip(app: Sphinx, what: str, name: str, thing: Any, skipped: bool, options: Any) -> bool | None:
    """Entries of a NamedTuple stand in its signature."""
    return True if (getattr(thing, "__doc__", None) or "").startswith("Alias for field number") else None


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("docstring", Docstring)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}
