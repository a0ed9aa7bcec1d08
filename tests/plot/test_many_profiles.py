"""Profiles of a whole run: one range of radii with maps in time, legends away from curves, and a colour bar of time."""

import shutil

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from two_sizes import write_two_sizes

import discsim
from discsim.output.style import use_style
from discsim.plot.request import Request

TIMES = (0.0, 3.0, 4.0, 7.0, 11.0, 12.0, 17.0, 19.0)  # in code units


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_two_sizes(tmp_path_factory.mktemp("runs") / "two", TIMES)


def curves_of(axes, style=None):
    """Lines with a curve in radius, of a line style."""
    return [line for line in axes.lines if len(line.get_xdata()) > 9 and style in (None, line.get_linestyle())]


def profiles(run, times, words=("dust.surface_density",), populations=()):
    unit = discsim.open_run(run).times[1] / TIMES[1]
    at = [f"{time * unit.value} yr" for time in times]
    return Request([run], words, "profile", at=at, populations=populations).figure()


@pytest.mark.parametrize("style", [None, "slide"])
@pytest.mark.parametrize("times", [(3.0, 11.0), TIMES])
def test_legends_of_many_curves_are_below_the_axes_and_inside_the_figure(run, times, style):
    with use_style(style):
        figure = profiles(run, times, ["surface_density"], ["0", "pebbles"])
    figure.draw_without_rendering()
    axes, legend = figure.axes[0], figure.axes[0].get_legend()
    box, outer = legend.get_window_extent(), figure.bbox
    lowest = min(each.get_tightbbox().y0 for each in (axes.xaxis, *axes.child_axes))
    assert outer.y0 <= box.y0 < box.y1 <= lowest and outer.x0 <= box.x0 < box.x1 <= outer.x1
    species = ["gas", "dust 1 mm", "pebbles, 5 cm"]
    entries = [text.get_text() for text in legend.texts]
    assert entries[-3:] == species and len(entries) == (5 if len(times) == 2 else 3)
    assert len({line.get_linestyle() for line in legend.get_lines()[-3:]}) == 3


def test_few_curves_have_their_legend_inside(run):
    axes = profiles(run, (3.0, 11.0)).axes[0]
    assert axes.get_window_extent().y0 < axes.get_legend().get_window_extent().y0


def test_many_times_have_the_colours_of_a_bar_of_time(run):
    axes = profiles(run, TIMES).axes[0]
    (bar,) = axes.child_axes
    ends = bar.get_xlim()
    shown = discsim.open_run(run).times.value
    np.testing.assert_allclose(ends, [shown[0], shown[-1]], rtol=1e-12)
    assert bar.get_xlabel() == "t [yr]" and axes.get_legend() is None
    colours = bar.collections[-1].cmap
    assert len(curves_of(axes)) == len(TIMES)
    for line, time in zip(curves_of(axes), shown, strict=True):
        expected = colours((time - ends[0]) / (ends[1] - ends[0]))[:3]
        assert np.abs(np.subtract(to_rgb(line.get_color()), expected)).max() < 0.02  # 256 colours
    six = profiles(run, TIMES[:6]).axes[0]
    assert len(six.get_legend().texts) == 6 and not six.child_axes


def test_profiles_and_maps_in_time_show_the_same_radii(tmp_path):
    """The gas spreads from 5 to 5 * 1.55, in units of 2 au: 99.5% of its particles are within 0.9975 of the edge."""
    run = write_two_sizes(tmp_path / "run", (0.0, 7.0, 11.0), spread=0.05)
    word = "dust.pebbles.surface_density"
    limits = [
        Request([run], [word], "time").figure().axes[0].get_xlim(),
        Request([run], [word], "profile").figure().axes[0].get_xlim(),
        Request([run], [word], "profile", at=["0 yr"]).figure().axes[0].get_xlim(),
        discsim.plot.profile(run, word, ax=Figure().subplots()).get_xlim(),
        discsim.plot.time_map(run, word, ax=Figure().subplots()).get_xlim(),
        discsim.open_run(run).plot(word, "profile", at=7.0, ax=Figure().subplots()).get_xlim(),
    ]
    np.testing.assert_allclose(limits, np.broadcast_to(limits[0], (6, 2)), rtol=1e-12)
    found = discsim.open_run(run).profile(word).radius
    ring = found[1] - found[0]
    np.testing.assert_allclose((found[-1] + 0.5 * ring).value, limits[0][1], rtol=1e-12)
    alone = shutil.copy(discsim.open_run(run).files[0], tmp_path / "first.h5")
    outer = discsim.plot.profile(alone, word, ax=Figure().subplots()).get_xlim()[1]
    np.testing.assert_allclose([outer, limits[0][1]], 0.9975 * np.array([10.0, 15.5]), rtol=1e-3)
