"""Text of users is shown as printable characters, in one line: none of it moves a cursor, hides or forges a message."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from discsim.output.checkpoint import CheckpointError
from discsim.printable import UserError, printable, printable_lines
from discsim.scene import SceneError, load_scene
from discsim.scene.summary import Summarised


@given(st.text(st.characters(), max_size=40))
def test_every_text_becomes_one_printable_line(text):
    line = printable(text)
    assert line.isprintable() and len(line.splitlines()) <= 1
    assert printable(line) == line
    if text.isprintable():
        assert line == text


def test_escape_sequences_bidi_marks_and_line_breaks_are_written_out():
    hostile = "a\x1b[2J\x07 \u202egnp\u2066 \u2028b\r\n\x00\x9b31m\udcff"
    assert printable(hostile) == (
        "a\\x1b[2J\\x07 \\u202egnp\\u2066 \\u2028b\\r\\n\\x00\\x9b31m\\udcff"
    )  # fmt: skip
    assert printable("Wirbelstraße, Ω = 2π, 円盤") == "Wirbelstraße, Ω = 2π, 円盤"
    assert printable_lines("one\ntwo\x1b") == "one\ntwo\\x1b"


def test_errors_for_users_are_one_line_and_survive_another_process():
    """As in studies with several workers, which pickle them."""
    for error in (CheckpointError("a\nb\x1b: damaged"), SceneError(["scene: a\nb", "scene: c\u202e"])):
        assert isinstance(error, UserError)
        again = pickle.loads(pickle.dumps(error))
        assert str(again) == str(error) and vars(again) == vars(error)
    assert str(CheckpointError("a\nb\x1b")) == "a\\nb\\x1b"
    assert SceneError(["scene: a\nb", "scene: c\u202e"]).problems == ["scene: a\\nb", "scene: c\\u202e"]


def test_keys_and_values_of_a_scene_are_one_message_each(tmp_path):
    path = tmp_path / "two\nlines\x1b.toml"
    path.write_text(
        'run = {until = "1 yr", snapshots = "3\\n4"}\nspace = {size = "1\\u202e au"}\n"ev\\u001bil\\nkey" = {a = 1}\n'
        "initial = 3\n"
    )
    with pytest.raises(SceneError) as fault:
        load_scene(path, ["gas.particles=1\n2\x1b"])
    text = str(fault.value)
    assert len(text.splitlines()) == len(fault.value.problems) == 6
    assert all((problem.isprintable() and "two\\nlines\\x1b.toml" in problem) or "--set" in problem
               for problem in fault.value.problems)  # fmt: skip


def test_text_in_another_encoding_is_one_message(tmp_path):
    """As a shell gives it, with a byte that is not UTF-8; no such scene could be written down."""
    (tmp_path / "a.toml").write_text(
        "units.system = 'code'\nrun.until = 1.3\nspace = {size = 2, boundary = 'periodic'}\n"
        "initial.kind = 'box'\ngas = {particles = 90, eos = {kind = 'isothermal', sound_speed = 0.7}}\n"
    )
    with pytest.raises(SceneError) as fault:
        load_scene(tmp_path / "a.toml", ["title=Stra\udcdfe"])
    (problem,) = fault.value.problems
    assert 'Stra\\udcdf" is not valid Unicode; expected UTF-8 text' in problem


def test_a_title_is_printable_in_a_notebook():
    class Named(Summarised):
        def summary(self):
            return "<b>\x1b[1m\u202e", [("a\x07", "b\nc")]

    html = Named()._repr_html_()
    assert repr(Named()) == str(Named()) == "<b>\\x1b[1m\\u202e\n  a\\x07  b\\nc"
    assert "\x1b" not in html and "\x07" not in html and "\u202e" not in html
    assert "&lt;b&gt;\\x1b[1m\\u202e" in html and "b\\nc" in html


def test_a_title_that_is_no_mistyped_initial():
    """A scene with a title, but without [initial], is refused."""
    scene = {
        "title": "x", "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 4.0},
        "gas": {"particles": 50, "eos": {"kind": "isothermal", "sound_speed": 0.3}},
    }  # fmt: skip
    with pytest.raises(SceneError) as fault:
        load_scene(scene)
    assert fault.value.problems == ["scene: missing table [initial]; add it"]
    with pytest.raises(SceneError) as fault:
        load_scene({**scene, "intial": {"kind": "box"}})
    (problem,) = fault.value.problems
    assert 'did you mean "initial"' in problem
