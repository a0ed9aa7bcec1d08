"""Populations of dust apart: fields, labels and messages, for grains of 1 mm and 5 cm."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from two_sizes import COUNT, EDGES, MASSES, SPEEDS, STOKES, TABLES, surface_density, write_two_sizes
from typer.testing import CliRunner

import discsim
import discsim.plot
from discsim.cli import app
from discsim.output.fields.base import FieldError
from discsim.output.fields.display import display_options
from discsim.output.fields.names import field_label, species_text
from discsim.output.figure import last_state_figure
from discsim.plot.film import Film
from discsim.plot.request import Request
from discsim.report.page import _fact_rows
from discsim.scene import SceneError, load_scene
from discsim.scene.populations import populations_of
from discsim.study.outcomes import _snapshot_values, outcomes_of

TIME = 11.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_two_sizes(tmp_path_factory.mktemp("runs") / "two")


@pytest.fixture(scope="module")
def snap(run):
    return discsim.read_snapshot(run)


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def legends(figure):
    return [[text.get_text() for text in axes.get_legend().texts] for axes in figure.axes if axes.get_legend()]


def labels(figure):
    return {axes.get_ylabel() for axes in figure.findobj(lambda a: hasattr(a, "get_ylabel"))}


@pytest.mark.parametrize(("name", "number"), [("0", 0), ("1", 1), ("pebbles", 1)])
def test_fields_of_one_population_are_those_of_its_grains(snap, name, number):
    """Of an even spiral, hence 2%, the width of the rings; St and v_r / r are the same for all grains."""
    inner, outer = EDGES[number]
    edges = np.array([inner, outer]) / (1 + TIME / 20) ** number
    sigma = snap.field(f"dust.{name}.surface_density", edges=np.linspace(*edges, 4))
    expected = snap.units.quantity(surface_density(number, TIME), "density")
    np.testing.assert_allclose((sigma / expected).to_value(""), 1.0, rtol=0.02)
    stokes = snap.field(f"dust.{name}.stokes")
    assert stokes.shape == (COUNT,)
    np.testing.assert_allclose(stokes.value, STOKES[number], rtol=1e-12)
    v_r = snap.field(f"dust.{name}.v_r", edges=[2.05, 2.15])
    speed = snap.units.quantity(SPEEDS[number] * 2.1, "velocity")
    np.testing.assert_allclose((v_r / speed).to_value(""), 1.0, rtol=0.02)


def test_fields_of_populations_add_up_on_maps_rings_and_in_ratios_to_gas(snap):
    """Smoothing widths of a map depend on the neighbours, so there only totals agree, to the mass beyond the edges."""
    edges = np.linspace(1.0, 5.0, 9)
    for name in ("surface_density", "dust_to_gas", "emission"):
        parts = [snap.field(f"dust.{k}.{name}", edges=edges).value for k in ("0", "pebbles")]
        whole = snap.field("dust.surface_density" if name == "surface_density" else name, edges=edges).value
        np.testing.assert_allclose(np.nansum(parts, axis=0), np.nan_to_num(whole), rtol=1e-12)
        assert min(np.nanmax(part) for part in parts) > 0.0
    maps = [snap.field(f"dust.{k}.surface_density", window="30 au", pixels=90).value.sum() for k in ("0", "1")]
    assert maps[0] / maps[1] == pytest.approx(MASSES[0] / MASSES[1], rel=1e-3)


def test_mean_over_populations_is_weighted_by_mass_and_says_so(snap):
    stokes = snap.field("dust.stokes", edges=[2.0, 2.1]).value
    sigma = [surface_density(k, TIME) for k in (0, 1)]
    assert stokes == pytest.approx(np.dot(sigma, STOKES) / sum(sigma), rel=0.02)
    assert field_label("dust.stokes", snap) == "Stokes number, mean over 2 sizes"
    assert field_label("dust.0.stokes", snap) == "Stokes number, 1 mm"
    assert field_label("dust.1.surface_density", snap) == r"$\Sigma_\mathrm{dust}$, pebbles, 5 cm [g cm$^{-2}$]"
    assert field_label("dust.surface_density", snap) == r"$\Sigma_\mathrm{dust}$, all dust [g cm$^{-2}$]"
    assert field_label("emission", snap).startswith(r"$I_\nu$, all dust")
    assert field_label("gas.v_r", snap) == r"$v_{r,\mathrm{gas}}$ [m s$^{-1}$]"
    assert species_text("dust.v_r", snap) == "dust, mean over 2 sizes"
    one = replace(snap, scene_text=load_scene(TABLES | {"dust": TABLES["dust"][0]}).text)
    assert field_label("dust.stokes", one) == "Stokes number"


def test_profiles_of_populations_share_a_panel_and_have_their_sizes_in_the_legend(run):
    figure = Request([run], ["surface_density"], "profile", populations=["0", "pebbles"]).figure()
    assert legends(figure) == [["gas", "dust 1 mm", "pebbles, 5 cm", "initial"]]
    words = ["dust.0.surface_density", "dust.pebbles.surface_density", "dust.surface_density", "stokes"]
    figure = Request([run], words, "profile", display=display_options(mark="none")).figure()
    assert legends(figure) == [["dust 1 mm", "pebbles, 5 cm", "all dust"]]
    assert labels(figure) == {r"$\Sigma$ [g cm$^{-2}$]", "Stokes number, mean over 2 sizes"}
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert len({line.get_color() for line in lines.values()}) == 3
    peaks = [np.nanmax(lines[name].get_ydata()) for name in ("dust 1 mm", "pebbles, 5 cm", "all dust")]
    assert peaks[2] == pytest.approx(peaks[0] + peaks[1], rel=0.1)
    assert peaks[1] / peaks[0] == pytest.approx(surface_density(1, TIME) / surface_density(0, TIME), rel=0.1)


def test_curves_on_the_same_axes_have_one_label_and_are_all_inside(run):
    ax = discsim.plot.profile(run, "dust.0.surface_density")
    assert ax.get_ylabel() == r"$\Sigma_\mathrm{dust}$, 1 mm [g cm$^{-2}$]"
    discsim.plot.profile(run, "dust.1.surface_density", ax)
    assert ax.get_ylabel() == r"$\Sigma$ [g cm$^{-2}$]"
    assert [text.get_text() for text in ax.get_legend().texts] == ["dust 1 mm", "initial", "pebbles, 5 cm"]
    assert len([line for line in ax.lines if (line.get_gid() or "").startswith("initial")]) == 2  # of each
    assert ax.get_ylim()[1] > max(np.nanmax(line.get_ydata()) for line in ax.lines)


def test_maps_polar_maps_and_maps_in_time_name_the_size(run):
    for kind in ("map", "polar", "time"):
        figure = Request([run], ["dust.stokes"], kind, populations=["1", "0"]).figure()
        found = labels(figure)
        assert {"Stokes number, 1 mm", "Stokes number, pebbles, 5 cm"} <= found
        values = [
            np.ma.masked_invalid(a.get_array()).mean()
            for axes in figure.axes[:2]
            for a in axes.images + axes.collections
        ]
        np.testing.assert_allclose(values, STOKES[::-1], rtol=1e-9)
    figure = Request([run], ["v_r"], "phase", against="radius", populations=["pebbles"]).figure()
    assert {"mass fraction of gas", "mass fraction of pebbles, 5 cm"} <= labels(figure)


def test_figure_of_the_last_state_has_a_curve_for_each_population(run, monkeypatch):
    drawn = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *given, **more: drawn.append(figure))
    last_state_figure(run / "snapshots/0002.h5", "unused.png")
    assert legends(drawn[0]) == [["gas", "all dust", "dust 1 mm", "pebbles, 5 cm"]]
    assert [axes.get_title() for axes in drawn[0].axes[:2]] == ["gas", "all dust"]


def test_commands_take_populations_and_name_files_after_them(run, tmp_path):
    done = command("plot", run, "--population", "pebbles", "--population", "0", "--profile")
    assert done.exit_code == 0, done.output
    assert (run / "plots/surface_density-pebbles-0-profile.png").exists()
    film = Film(run, ["dust.surface_density"], populations=["pebbles"])
    assert film.save(tmp_path / "film.gif") == 3
    done = command("movie", run, "--population", "1", "--field", "stokes", "-o", tmp_path / "one.gif")
    assert done.exit_code == 0 and (tmp_path / "one.gif").exists(), done.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--population", "boulders"],
            '"boulders" is not a population of dust; expected one of 0 (1 mm), pebbles (5 cm)',
        ),
        (["--field", "dust.2.stokes"], '"2" is not a population of dust; expected one of 0 (1 mm), pebbles (5 cm)'),
        (["--field", "toomre_q", "--population", "0"], "--population: none of gas.toomre_q is a field of all dust"),
        (["--field", "dust.0.toomre_q"], '"dust.0.toomre_q" is not a field; expected one of '),
        (["--field", "dust..stokes"], '"dust..stokes" is not a field; expected one of '),
        (["--field", "dust.0.v_r", "--against", "dust.1.radius"], "dust.1.radius: not a particle field of dust"),
    ],
)
def test_unknown_populations_are_one_message(run, arguments, message):
    done = command("plot", run, *arguments)
    assert done.exit_code == 2 and done.output.startswith(message) and done.output.count("\n") == 1


def test_a_snapshot_read_without_populations_says_which_column_is_missing(run):
    snap = discsim.read_snapshot(run, columns=["dust.stokes"])
    with pytest.raises(FieldError, match=r'without "dust.species"'):
        snap.field("dust.0.stokes")


def test_results_of_sweeps_are_those_of_each_population(run):
    """Half of an even ring lies within the root of the mean square of its edges."""
    scene = load_scene(run / "scene.toml")
    known, found = outcomes_of(scene), _snapshot_values(run / "snapshots")
    for number, name in enumerate(("dust.0", "dust.pebbles")):
        assert known[f"{name}-r50"].unit == "au" and known[f"{name}-peak"].unit == "g/cm2"
        half = np.sqrt(np.mean(np.square(EDGES[number]))) / (1 + TIME / 20) ** number
        assert found[f"{name}-r50"] == pytest.approx(half, rel=1e-3)
    assert found["dust.pebbles-r50"] < found["dust-r50"] < found["dust.0-r50"]


def test_report_lists_populations_by_size(run):
    rows = [{"time": "0.0", "step": "0"}]
    facts = dict(_fact_rows(load_scene(run / "scene.toml"), rows))
    assert facts["dust 1 mm"] == facts["pebbles, 5 cm"] == "3,000 particles"


def test_texts_of_populations():
    def texts(drag="epstein", **changes):
        tables = deepcopy(TABLES)
        tables["drag"] = {"law": drag, "stokes": 0.3}
        for key, values in changes.items():
            for table, value in zip(tables["dust"], values, strict=True):
                table.pop(key, None)
                table |= {} if value is None else {key: value}
        return [each.legend for each in populations_of(tables)]

    assert texts() == ["dust 1 mm", "pebbles, 5 cm"]
    assert texts(grain_size=["2 mm", "2 mm"], name=[None, None]) == ["dust 0, 2 mm", "dust 1, 2 mm"]
    assert texts(grain_size=[None, None], name=[None, "far"]) == ["dust 0", "far"]
    assert texts("stokes-number", grain_size=[None, None], name=[None, None]) == [
        "dust 0, St = 0.3",
        "dust 1, St = 0.3",
    ]
    sizes = {"smallest": "1 um", "largest": "1 mm"}
    assert texts(grain_size=[sizes, 0.25], name=["1 um to 1 mm", None]) == ["1 um to 1 mm", "dust s = 0.25"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("a", "a"), 'dust.1.name: population 0 is "a" too; expected another name'),
        (
            ("1", "b"),
            'dust.0.name: "1" is the number of another population; expected another name, or this key left out',
        ),
        (("a,b", "c"), 'dust.0.name: "a,b" is not a name; expected 1 to 40 printable characters'),
        (("", "c"), "dust.0.name: "),
        ((" a", "c"), "dust.0.name: "),
        (("x" * 41, "c"), "dust.0.name: "),
        (("a\nb", "c"), "dust.0.name: "),
        ((5, "c"), "dust.0.name: 5 is not a text; expected a name in quotes"),
    ],
)
def test_names_of_populations_are_unique_short_texts(names, message):
    tables = deepcopy(TABLES)
    for table, name in zip(tables["dust"], names, strict=True):
        table["name"] = name
    with pytest.raises(SceneError) as error:
        load_scene(tables)
    assert len(error.value.problems) == 1 and message in error.value.problems[0]


def test_a_name_with_a_dot_a_space_or_a_dollar_can_be_drawn(tmp_path):
    tables = deepcopy(TABLES)
    tables["dust"][0]["name"], tables["dust"][1]["name"] = "0.1 mm", r"$\frac{"
    run = write_two_sizes(tmp_path / "run", times=(2.0,), tables=tables)
    snap = discsim.read_snapshot(run)
    assert snap.field("dust.0.1 mm.stokes").value == pytest.approx(STOKES[0])
    figure = Request([run], ["surface_density"], "profile", populations=["0.1 mm", r"$\frac{"]).figure()
    figure.canvas.draw()
    assert legends(figure) == [["gas", "0.1 mm, 1 mm", r"\$\frac{, 5 cm"]]
    assert discsim.load_scene(tables).dust[0].name == "0.1 mm" and load_scene(tables | {"dust": TABLES["dust"]})


def test_population_without_grains_gives_an_empty_map(run):
    snap = discsim.read_snapshot(run)
    snap = replace(snap, dust=replace(snap.dust, species=np.zeros(2 * COUNT, int)))
    assert snap.field("dust.pebbles.surface_density", window="9 au", pixels=30).value.max() == 0.0
    assert np.isnan(snap.field("dust.pebbles.v_r", edges=[1.0, 2.0, 3.0]).value).all()
    discsim.plot.profile(snap, "dust.pebbles.surface_density")
