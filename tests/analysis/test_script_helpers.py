"""Options of the analysis scripts that list several things, and names of lines in their figures."""

from argparse import ArgumentParser

import numpy as np
import pytest
import script_helpers as scripts
from matplotlib.figure import Figure


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


@pytest.mark.parametrize("values", [(3e-3, 3.1e-3, 0.4, 2e-5, 2.1e-5, 2.2e-5), (1e-5, 1.1e-5, 1.2e-5), (0.9, 0.95)])
def test_names_of_lines_are_in_the_order_of_their_ends_and_do_not_overlap(values):
    """Names of lines with close ends move apart as little as needed, and stay next to the panel, also at its edges."""
    axes = Figure(figsize=(4, 4)).subplots()
    axes.set(xscale="log", yscale="log", xlim=(0.1, 20), ylim=(1e-5, 1))
    scripts.name_ends(axes, [(f"{value:g}", 7.0, value, "black") for value in values], gap=0.07)
    places = {float(text.get_text()): text.get_position()[1] for text in axes.texts}
    heights = [places[value] for value in sorted(values)]
    assert min(np.diff(heights)) >= 0.07 - 1e-12
    assert heights[0] >= -1e-12 and heights[-1] <= 1.0 + 1e-12
    ends = 1.0 + np.log10(sorted(values)) / 5
    assert np.abs(heights - ends).max() < 0.07 * len(values)
    if len(values) > 3:  # the highest is alone, and stays
        assert heights[-1] == pytest.approx(ends[-1], abs=1e-12)
