"""Options of figures: frames of streamlines, contours, logarithmic radii, colours, styles, and sizes of text."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text
from PIL import Image
from two_sizes import EDGES, SPEEDS, surface_density, write_two_sizes
from typer.testing import CliRunner

import discsim
import discsim.plot
from discsim.cli import app
from discsim.output import bins
from discsim.output.drawing import broken
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import display_options
from discsim.output.ink import line_colour
from discsim.output.snapshot import SnapshotParticles
from discsim.output.style import use_style
from discsim.plot import overlays, pictures
from discsim.plot.film import Film
from discsim.plot.request import Request

COMPANION = np.array([0.3, 3.0]), np.array([-0.41, 0.17])  # position and velocity
PHONE = 390.0  # width of a phone in pixels of a web page


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_two_sizes(tmp_path_factory.mktemp("runs") / "two")


@pytest.fixture(scope="module")
def snap(run):
    """The last snapshot, with a companion at COMPANION."""
    found = discsim.read_snapshot(run)
    pos, vel = (np.stack([np.zeros(2), each]) for each in COMPANION)
    mass, ids = np.array([1.0, 1e-3]), np.arange(2)
    bodies = SnapshotParticles(found.units, found.gas.dimensions_of, pos, vel, mass, ids)
    return replace(found, bodies=bodies, scene_text=f"{found.scene_text}\n[[companion]]\n")


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def options(**given):
    return display_options(**({"pixels": 100} | given))


def figure_of(run, *words, kind=None, populations=(), style=None, **given):
    with use_style(style):
        figure = Request([run], words, kind, populations=populations, display=options(**given)).figure()
        figure.canvas.draw()
    return figure


def texts(figure):
    """Texts of a figure, with those of ticks."""
    return [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]


def opened(path):
    with Image.open(path) as image:
        return image.convert("RGB"), getattr(image, "n_frames", 1)


@pytest.mark.parametrize("name", ["dust.pebbles.stokes", "dust.0.surface_density"])
def test_streamlines_follow_the_velocity_of_a_population_in_each_frame(snap, name):
    """v = s r e_r in the code units of the run, whose star has the mass 1; r is in au on the axis, 2 per unit.

    Bins of r / 40 average over 3%.
    """
    number = int("pebbles" in name)
    inner, outer = EDGES[number][0] / 1.55**number, EDGES[number][1] / 1.55**number
    (x, y), (vx, vy) = COMPANION
    turning = (x * vy - y * vx) / (x * x + y * y)
    for frame, omega in (("scene", lambda r: 0 * r), ("kepler", lambda r: r**-1.5), ("companion.1", lambda r: turning)):
        display = options(streamlines=frame)
        lines = pictures.polar_pictures(snap, [name], display)[name].overlays[-1]
        radius = overlays.middles(lines.picture)[1] / 2.0
        inside = (radius > 1.15 * inner) & (radius < 0.9 * outer)
        r = radius[inside, None]
        expected = np.broadcast_to(-np.degrees(omega(r)), lines.u[inside].shape)
        np.testing.assert_allclose(lines.u[inside], expected, rtol=0.05, atol=1e-9)
        np.testing.assert_allclose(lines.v[inside], np.broadcast_to(2 * SPEEDS[number] * r, expected.shape), rtol=0.05)
        assert lines.text.startswith("streamlines: dust")


def test_streamlines_of_gas_on_a_plane_and_on_a_logarithmic_axis(snap):
    """Gas moves outwards at 0.1 r: u / v = x / y on the plane; and lines are drawn in both kinds of maps."""
    name, display = "gas.surface_density", options(streamlines="scene")
    lines = pictures.map_pictures(snap, [name], display)[name].overlays[-1]
    x, y = overlays.middles(lines.picture)
    x, y = np.meshgrid(x / 2, y / 2)
    seen = (np.hypot(x, y) > 1.6) & (np.hypot(x, y) < 4.5)
    np.testing.assert_allclose(lines.u[seen], 0.1 * x[seen], atol=0.02)
    np.testing.assert_allclose(lines.v[seen], 0.1 * y[seen], atol=0.02)
    ax = discsim.plot.polar_map(snap, name, log_radius=True, streamlines="companion", pixels=100)
    assert ax.get_yscale() == "log" and len(ax.collections) > 1


def test_contours_lie_where_their_field_has_the_level(snap):
    """Contours of the field x are the lines x = level; contours of dust_to_gas have a label."""
    ax = discsim.plot.field_map(snap, "gas.surface_density", contours="gas.x=-3.1,2.6", pixels=150)
    (lines,) = [found for found in ax.collections if hasattr(found, "levels")]
    assert list(lines.levels) == [-3.1, 2.6]
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        x, y = path.vertices.T
        x = x[(np.abs(y) < 8.0) & (np.hypot(x, y) > 3.0)]  # within the disc from 2.4 to 10 au
        np.testing.assert_allclose(x, level, atol=0.3)  # particles are 0.3 au apart
    assert {text.get_text() for text in lines.labelTexts} == {"-3.1", "2.6"}
    assert any("contours: $x$ [au]" in text.get_text() for text in ax.texts)


def test_contours_without_levels_are_round_and_the_same_for_populations_and_runs(run):
    request = Request([run], ["dust.surface_density"], populations=["0", "1"], at=["0 yr", "30 yr"])
    figure = replace(request, display=options(contours="surface_density")).figure()
    found = [list(c.levels) for axes in figure.axes for c in axes.collections if hasattr(c, "levels")]
    assert len(found) == 4
    every = sorted({level for levels in found for level in levels})
    assert 2 <= len(every) <= overlays.MAX_DEFAULT_LEVELS
    assert all(float(f"{level:.0e}") == pytest.approx(level) for level in every)


def test_contours_of_a_map_in_time_and_of_levels_out_of_range(run):
    ax = discsim.plot.time_map(run, "dust.0.v_r", contours="dust.0.surface_density=1e5", log_radius=True)
    assert ax.get_xscale() == "log"
    assert [text.get_text() for text in ax.texts] == [
        "contours: $\\Sigma_\\mathrm{dust}$, 1 mm [g cm$^{-2}$] (no level in this range)"
    ]


def test_profile_over_logarithmic_radii_is_that_of_the_disc(run, snap):
    """Rings are equally spaced in log r, and the density between the edges is that of the particles: 3%."""
    ax = discsim.plot.profile(snap, "dust.0.surface_density", log_radius=True)
    radius, sigma = ax.lines[0].get_data()
    assert ax.get_xscale() == "log"
    np.testing.assert_allclose(np.diff(np.log(radius)), np.log(radius[1] / radius[0]), rtol=1e-3)
    inside = (radius > 2 * 1.15 * EDGES[0][0]) & (radius < 2 * 0.93 * EDGES[0][1])
    expected = snap.units.quantity(surface_density(0, 11.0), "density").to_value("g/cm2")
    np.testing.assert_allclose(sigma[inside], expected, rtol=0.03)
    in_time = discsim.open_run(run).profile("dust.0.surface_density", "3 au,9 au", log_radius=True)
    assert in_time.plot().get_xscale() == "log"
    middle = in_time.radius.to_value("AU")
    np.testing.assert_allclose(np.diff(middle) / middle[1:], 1 - middle[0] / middle[1], rtol=1e-3)


def test_logarithmic_bins_keep_the_mass_and_its_density():
    """A disc of density r^-1.3 from 0.2 to 7. A Gaussian in the rings has 700 particles: 4%, and 3 of that."""
    rng, count, power = np.random.default_rng(5), 60_000, 0.7
    inner, outer = 0.2**power, 7.0**power
    r, phi = (inner + (outer - inner) * rng.random(count)) ** (1 / power), rng.uniform(0, 2 * np.pi, count)
    polar = bins.polar_pixels(np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1), 0.1, 12.0, 160, log=True)
    smooth = bins.SmoothRings(r, (0.1, 12.0), 2, log=True)
    assert polar.sum(np.ones(count)).sum() == pytest.approx(count, rel=2e-3)  # Gaussians reach beyond the edges
    assert smooth.sum(np.ones(count)).sum() == pytest.approx(count, rel=1e-9)
    for found, rings in ((polar, 80), (smooth, bins.FINE_BINS)):
        edges = np.geomspace(0.1, 12.0, rings + 1)
        middle = np.sqrt(edges[1:] * edges[:-1])
        density = found.sum(np.ones(count)) / found.measure
        density = density.mean(axis=0) if density.ndim == 2 else density
        expected = power * count / (2 * np.pi * (outer - inner)) * middle ** (power - 2)
        seen = (middle > 0.4) & (middle < 5.0)
        np.testing.assert_allclose(density[seen], expected[seen], rtol=0.12)


def test_maps_of_populations_have_one_scale_that_contains_both_and_a_given_range_is_kept(run):
    def ranges(**given):
        words = ["dust.surface_density", "gas.surface_density"]
        figure = figure_of(run, *words, populations=["0", "1"], **given)
        return [(image.norm.vmin, image.norm.vmax) for axes in figure.axes for image in axes.images]

    first, second, gas = ranges()
    assert first == second != gas
    for name in ("dust.0.surface_density", "dust.1.surface_density"):
        alone = figure_of(run, name).axes[0].images[0].norm
        assert first[0] <= alone.vmin < alone.vmax <= first[1]
    assert ranges(limits="0.003,7") == [(0.003, 7.0)] * 3


@pytest.mark.parametrize("style", [None, "paper", "slide"])  # a dark figure has the sizes of None
@pytest.mark.parametrize(
    ("words", "kind", "populations"),
    [
        (["gas.surface_density"], None, ()),
        (["surface_density"], "profile", ()),
        (["stokes"], "polar", ("0", "1")),
        (["surface_density", "stokes"], None, ("0", "1")),
    ],
)
def test_no_text_leaves_the_figure_in_any_style(run, style, words, kind, populations):
    figure = figure_of(run, *words, kind=kind, populations=populations, style=style)
    drawn, (across, up) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(drawn.x0, drawn.y0) > -0.01 and drawn.x1 < across + 0.01 and drawn.y1 < up + 0.01
    assert drawn.height > 0.85 * up and drawn.width > 0.85 * across  # and little of it is empty


@pytest.mark.parametrize("style", [None, "paper"])
@pytest.mark.parametrize("words", [["dust.surface_density"], ["dust.stokes", "surface_density", "dust.0.v_r"]])
def test_labels_of_profiles_have_space_next_to_wide_numbers(run, style, words):
    """Numbers like 2e-11 are wider than the space left of a panel; all panels become narrower by the same length."""
    figure = figure_of(run, *words, kind="profile", style=style, limits="3.1e-12,1.7e-11")
    panels = figure.axes
    assert np.ptp([axes.bbox.width for axes in panels]) < 1e-6
    assert any("10^" in text.get_text() for axes in panels for text in axes.get_yticklabels())
    for axes in panels:
        label = axes.yaxis.label.get_window_extent()
        assert label.x0 > 0.05 * figure.dpi
        assert not any(label.overlaps(other.bbox) for other in panels)


@pytest.mark.parametrize(
    ("word", "kind"), [("gas.toomre_q", None), ("surface_density", "profile"), ("gas.v_r", "phase")]
)
def test_a_single_panel_is_legible_on_a_phone(run, word, kind):
    """Numbers and labels of a page are 12 pixels high at the least, here 11 with those within the map."""
    figure = figure_of(run, word, kind=kind)
    assert len(figure.axes) == 1
    per_point = PHONE / (72.0 * figure.get_size_inches()[0])
    sizes = [text.get_fontsize() * per_point for text in texts(figure)]
    assert len(sizes) > 8 and min(sizes) >= 11.0
    assert figure.axes[0].get_window_extent().width > 0.7 * figure.get_window_extent().width


def test_styles_set_the_width_of_a_page_and_end_with_their_block(run):
    before = dict(matplotlib.rcParams)
    one, several = (figure_of(run, *words, style="paper") for words in (["gas.v_r"], ["gas.v_r", "stokes", "gas.h"]))
    assert one.get_size_inches()[0] == pytest.approx(88 / 25.4, abs=0.02)  # a column of 88 mm
    assert several.get_size_inches()[0] == pytest.approx(180 / 25.4, abs=0.02)  # a page of 180 mm
    assert min(text.get_fontsize() for text in texts(several)) >= 7.0
    slide = figure_of(run, "stokes", populations=["0", "1"], style="slide")
    assert slide.get_size_inches()[1] <= 7.51 and min(text.get_fontsize() for text in texts(slide)) >= 14.0
    assert dict(matplotlib.rcParams) == before
    with pytest.raises(PlotError, match=r'^style: "light"; expected one of paper, slide, dark$'), use_style("light"):
        pass


def luminance(colour):
    """Relative luminance of WCAG 2."""
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in to_rgb(colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def ratio(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("style", [None, "dark"])
def test_text_and_curves_have_contrast_to_the_page_of_a_style(run, style):
    """4.5 for text, and 2.8 for curves, of which those of the light style have 2.9; WCAG 2 asks for 3."""
    figure = figure_of(run, "surface_density", kind="profile", populations=["0", "1"], style=style, mark="none")
    page = figure.get_facecolor()
    assert (luminance(page) < 0.05) == (style == "dark")
    assert all(ratio(text.get_color(), page) > 4.5 for text in texts(figure))
    curves = [line.get_color() for axes in figure.axes for line in axes.lines]
    least = 2.2 if style is None else 4.5  # sky blue of the second population on white
    assert len(curves) == 3 and all(ratio(colour, page) > least for colour in curves)
    with use_style(style):
        assert ratio(line_colour("#000000"), page) > 10.0
    maps = figure_of(run, "gas.toomre_q", style=style)
    assert ratio(maps.axes[0].get_facecolor(), page) < 2.0  # missing values are near the colour of the page
    assert all(ratio(text.get_color(), page) > 4.5 for text in texts(maps) if text not in maps.axes[0].texts)


def test_colour_maps_by_name_of_matplotlib_and_of_cmasher(run, snap, tmp_path, monkeypatch):
    ax = discsim.plot.field_map(snap, "gas.surface_density", cmap="Greys_r")
    assert ax.images[0].get_cmap().name == "Greys_r"
    with pytest.raises(PlotError, match=r'^cmap: "virdis" is not a colour map .* are viridis'):
        discsim.plot.field_map(snap, cmap="virdis")
    monkeypatch.setattr("discsim.output.ink.find_spec", lambda name: None)
    result = command("plot", run, "--cmap", "cmr.rainforest", "-o", tmp_path / "a.png")
    assert result.exit_code == 2 and "needs cmasher, which is not installed; run: pip install" in result.stderr
    monkeypatch.undo()
    (tmp_path / "cmasher.py").write_text(
        "import matplotlib\nmatplotlib.colormaps.register(matplotlib.colormaps['hot'].copy(), name='cmr.mine')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "cmasher", raising=False)
    try:
        figure = figure_of(run, "gas.v_r", kind="time", cmap="cmr.mine")
        assert figure.axes[0].collections[0].get_cmap() == matplotlib.colormaps["hot"]
    finally:
        matplotlib.colormaps.unregister("cmr.mine")


def test_dpi_sets_the_pixels_of_figures_and_frames(run, tmp_path):
    inches = figure_of(run, "gas.toomre_q").get_size_inches()
    path = tmp_path / "q.png"
    assert command("plot", run, "--field", "toomre_q", "--dpi", 70, "-o", path).exit_code == 0
    assert opened(path)[0].size == tuple(np.floor(70 * inches).astype(int))
    film = tmp_path / "q.gif"
    assert command("movie", run, "--field", "toomre_q", "--dpi", 60, "--style", "dark", "-o", film).exit_code == 0
    frame, count = opened(film)
    assert frame.size == tuple(np.floor(60 * inches).astype(int)) and count == 3
    assert max(frame.getpixel((1, 1))) < 40  # the page is dark
    with pytest.raises(PlotError, match=r"^dpi: 20; expected a whole number from 30 to 1200$"):
        discsim.plot.movie(run, tmp_path / "small.gif", dpi=20)
    with pytest.raises(PlotError, match=r"^900 dpi: the frame has .* at most 4096 pixels"):
        Film(run, ["toomre_q"], dpi=1200 * 3 // 4).save(tmp_path / "large.gif")
    assert {path.name for path in tmp_path.iterdir()} == {"q.png", "q.gif"}


REFUSED = {
    ("--log-radius",): "--log-radius: used only for profiles, polar maps, maps in radius and time, not for maps",
    ("--profile", "--cmap", "hot"): "--cmap: used only for maps",
    ("--profile", "--contours", "stokes"): "--contours: used only for maps",
    ("--time", "--streamlines", "scene"): "--streamlines: used only for maps, polar maps, not for maps in radius",
    ("--contours", "stokes=1,x"): '--contours: "stokes=1,x"; expected FIELD, or FIELD=LEVEL,LEVEL,...',
    ("--contours", "stokes=nan"): '--contours: "stokes=nan"; expected FIELD, or FIELD=LEVEL,LEVEL,...',
    ("--contours", "stoke"): '--contours: "stoke" is not a field',
    ("--contours", ""): '--contours: "no field" is not a field',
    ("--contours", "small_dust.surface_density"): "--contours: small_dust.surface_density: the snapshot has no",
    ("--streamlines", "planet"): '--streamlines: "planet"; expected one of scene, kepler, companion, companion.N',
    ("--streamlines", "kepler.2"): '--streamlines: "kepler.2"; expected one of scene',
    ("--streamlines", "companion.0"): '--streamlines: "companion.0"; expected one of scene',
    ("--streamlines", "companion"): "--streamlines: the run has no companion 1; expected scene or kepler",
    ("--style", "light"): '--style: "light"; expected one of paper, slide, dark',
    ("--dpi", "12"): "--dpi: 12; expected a whole number from 30 to 1200",
    ("--profile", "--log-radius", "--window", "0 au,9 au"): "--log-radius: the radii are 0 to",
}


@pytest.mark.parametrize("given", REFUSED, ids=" ".join)
def test_options_that_are_wrong_or_without_effect_end_in_one_message(run, tmp_path, given):
    result = command("plot", run, *given, "-o", tmp_path / "a.png")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith(REFUSED[given]) and result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_python_functions_refuse_options_without_effect(run, snap):
    with pytest.raises(PlotError, match=r"^log_radius: used only for profiles"):
        discsim.plot.field_map(snap, log_radius=True)
    with pytest.raises(PlotError, match=r"^cmap: used only for maps"):
        discsim.plot.profile(snap, cmap="hot")
    with pytest.raises(PlotError, match=r"^streamlines: used only for maps"):
        discsim.plot.phase(snap, streamlines="scene")
    with pytest.raises(PlotError, match=r'^contours: stokes: a film needs levels.* give "stokes=LEVEL,..."'):
        discsim.plot.movie(run, None, "stokes", contours="stokes")


def test_lines_of_a_title_are_broken_after_commas_and_never_within_mathematics():
    line = r"$\lambda$ = 1.3 mm, $\kappa$ = 2.31 cm$^2$ per g of dust, at 140 pc, F = 41.7 mJy"
    found = broken(line, 3.0, 12.0)
    assert len(found) > 1 and " ".join(found) == line and all(part.count("$") % 2 == 0 for part in found)
    assert all(part.endswith(",") for part in found[:-1])
    long = broken("word " * 400, 3.0, 12.0)
    assert len(long) == 4 and long[-1].endswith(" ...")


def test_image_on_the_sky_takes_colours_resolution_and_style(run, tmp_path):
    path = tmp_path / "sky.png"
    given = ("--distance", "93 pc", "--pixels", 64, "--temperature", "30 K")
    more = ("--cmap", "Greys", "--dpi", 80, "--style", "dark")
    result = command("image", run, *given, *more, "-o", path)
    assert result.exit_code == 0, result.stderr
    image = opened(path)[0]
    assert 330 < image.width < 370  # of 4.4 inches
    assert max(image.getpixel((1, 1))) < 40 and min(image.getpixel((100, 100))) > 220  # a dark page, white sky
    wrong = command("image", run, *given, "--cmap", "grey_", "-o", tmp_path / "b.png")
    assert wrong.exit_code == 2 and wrong.stderr.startswith('--cmap: "grey_" is not a colour map')
