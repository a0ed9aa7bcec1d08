"""A title is text of a user: a run, its figures and its report show it without any other effect on them."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout

import matplotlib
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from runs import WAVE, scene_of

import discsim
from discsim.output.drawing import figure_text
from discsim.preview.check import report
from discsim.report.page import write_report
from discsim.run.runner import run_scene

HOSTILE = "\x1b[31mred\u202egnp\x07 $$ $\\nosuch$\nwarning: forged"
SHOWN = "\\x1b[31mred\\u202egnp\\x07 $$ $\\nosuch$\\nwarning: forged"


@pytest.mark.parametrize(
    "title",
    [
        "$$",
        "$\\nosuch$",
        "$a",
        "a$b$c$",
        "$\\frac{1}$",
        "\\$$",
        "$}$",
        "$" * 7,
        "$\\hspace{1e9}$",
        "$" + "{" * 300 + "$",
    ],
)
def test_dollars_that_are_no_mathematics_are_drawn_as_they_stand(title):
    figure = Figure()
    text = figure.suptitle(f"{figure_text(title)} and {figure_text(title)}\nt = 3")
    FigureCanvasAgg(figure).draw()
    assert not matplotlib.cbook.is_math_text(text.get_text().split("\n")[0])
    assert text.get_text().replace("\\$", "$").startswith(title.replace("\\$", "$"))


def test_mathematics_of_a_title_is_typeset():
    assert figure_text("$\\alpha = 10^{-3}$ costs \\$5") == "$\\alpha = 10^{-3}$ costs \\$5"
    assert matplotlib.cbook.is_math_text(figure_text("$\\Sigma$ and $\\Omega_K$"))


def test_a_hostile_title_in_a_run_its_figures_and_its_report(tmp_path):
    out = tmp_path / "a\x1b\nwarning: forged too"
    text = f"title = {json.dumps(HOSTILE)}\n{WAVE}"
    scene = scene_of(tmp_path, text)
    assert report(scene).split("\n")[0] == scene.title == SHOWN
    with redirect_stdout(io.StringIO()) as said, redirect_stderr(io.StringIO()) as errors:
        assert run_scene(scene, out) == 0
    assert errors.getvalue() == "" and (out / "last_state.png").stat().st_size > 1000
    for lines in (said.getvalue(), (out / "run.log").read_text()):
        assert lines.replace("\n", "").isprintable()
        assert SHOWN in lines and "\nwarning: forged" not in lines
    snap = discsim.read_snapshot(out / "snapshots/0002.h5")
    assert snap.title == SHOWN and snap.tables["title"] == HOSTILE
    assert "\x1b" not in snap._repr_html_() and "\u202e" not in scene._repr_html_()
    write_report(out, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.replace("\n", "").isprintable() and "\\x1b[31mred" in page and "forged</p>" not in page
