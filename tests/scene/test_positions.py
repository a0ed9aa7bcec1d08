"""Where the keys of a scene's text are, and texts that are edited."""

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from discsim.scene import tomltext

KEYS = st.sampled_from(["a", "b-c", "1", '"x.y"', "'q # '", '"\\""'])
PLAIN = ("1", "-1.5e3", "true", "nan", '"a # ] } , b"', "'\\'", '"\\\\"', "1979-05-27 07:32:00Z", '""', "''")
# Strings over several lines that look like something else, or end in quotes of their own.
LONG = ('"""x\n[a]\n\\"""" z"""', "'''\nq = 1\n'''", '"""a"""""', "'''a''''", '""""a" """', "''''a''''")
SCALARS = st.sampled_from((*PLAIN, *LONG))
BREAKS = st.sampled_from(["", " ", "\n", " # note ]\n", "\n\n\t"])


@st.composite
def values(draw, depth=2):
    """A value and nothing else, on one line or several."""
    kind = draw(st.sampled_from(["scalar", "scalar", "array", "inline"])) if depth else "scalar"
    if kind == "scalar":
        return draw(SCALARS)
    if kind == "array":
        entries = draw(st.lists(values(depth=depth - 1), max_size=3))
        return "[" + ",".join(draw(BREAKS) + entry + draw(BREAKS) for entry in entries) + draw(BREAKS) + "]"
    keys = draw(st.lists(KEYS, max_size=3, unique=True))
    return "{" + ", ".join(f"{key} = {draw(values(depth=depth - 1))}" for key in keys) + "}"


@st.composite
def documents(draw):
    lines = []
    for table in range(draw(st.integers(0, 4))):
        if table:
            name = draw(st.sampled_from(["t", "t.u", "t . 'v'", "w"])) + draw(st.sampled_from(["", f".n{table}"]))
            many = draw(st.booleans())
            lines.append(
                draw(BREAKS) + (f"[[{name}]]" if many else f"[{name}]") + draw(st.sampled_from(["", " # [x]"]))
            )
        for key in draw(st.lists(KEYS, max_size=3, unique=True)):
            dotted = draw(st.sampled_from([key, f"{key} . d", f"{key}.d.e"]))
            lines.append(f"{draw(BREAKS)}{dotted} = {draw(values())}{draw(st.sampled_from(['', ' # x = 1']))}")
    return "\n".join(lines) + draw(BREAKS)


def paths(value, path=()):
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from paths(entry, (*path, key))


@given(documents())
def test_positions_know_every_path_that_tomllib_reads(text):
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return  # tables defined twice: another test's matter
    found = tomltext.line_numbers(text)
    assert set(found) == set(paths(data))
    assert all(1 <= line <= text.count("\n") + 1 for line in found.values())


@given(st.lists(st.tuples(values(), BREAKS), min_size=1, max_size=6))
def test_positions_count_lines(entries):
    """Every key is on the line where its name stands: found by looking for it."""
    text = "".join(f"{space}\nkey-{i} = {value}\n" for i, (value, space) in enumerate(entries))
    found = tomltext.line_numbers(text)
    for i in range(len(entries)):
        assert text.split("\n")[found[(f"key-{i}",)] - 1].startswith(f"key-{i} =")


@given(documents(), st.sampled_from([["t", "u", "z"], ["w", "z"], ["z"]]))
def test_edited_text_reads_as_the_edited_data(text, path):
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    if "nan" in text:
        return  # it does not equal itself
    try:
        tomltext.set_value(data, path, "new")
    except KeyError:
        return
    assert tomllib.loads(tomltext.edit(text, data, [(path, "new")], [])) == data
