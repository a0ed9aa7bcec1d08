"""Options of the analysis scripts that list several things."""

from argparse import ArgumentParser

import pytest
import script_helpers as scripts


def test_names_are_some_of_those_known():
    assert scripts.some_of(("gas", "mix"), "case")("mix,gas") == ["mix", "gas"]
    assert scripts.some_of(("a, b", "c"), "choice", ";")("a, b;c") == ["a, b", "c"]


def test_numbers_are_whole():
    assert scripts.whole_numbers(32)("64,1e5") == [64, 100_000]


@pytest.mark.parametrize("name", ["mixx", "", "gas,,mix"])
def test_an_unknown_name_is_one_clear_line(name, capsys):
    parser = ArgumentParser()
    parser.add_argument("--cases", type=scripts.some_of(("gas", "mix"), "case"), default="gas")
    with pytest.raises(SystemExit):
        parser.parse_args(["--cases", name])
    wrong = "" if name != "mixx" else name
    assert f"--cases: unknown case {wrong!r}; expected some of gas, mix\n" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "abc", "64,", "1.5", "31", "nan", "inf"])
def test_what_is_no_whole_number_is_one_clear_line(text, capsys):
    parser = ArgumentParser()
    parser.add_argument("--cells", type=scripts.whole_numbers(32))
    with pytest.raises(SystemExit):
        parser.parse_args(["--cells", text])
    assert f"--cells: {text!r}; expected whole numbers from 32, separated by commas\n" in capsys.readouterr().err
