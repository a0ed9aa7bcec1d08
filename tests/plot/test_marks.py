"""Marks on figures are where the physics puts them: orbits, Hill circles, gap edges, damping zones, the start."""

import math
import shutil

import matplotlib.patches
import numpy as np
import planets
import pytest
from matplotlib.figure import Figure
from planets import AXIS, RATIO
from typer.testing import CliRunner

import discsim
import discsim.plot
from discsim.cli import app
from discsim.output.fields.display import display_options
from discsim.output.snapshot import SnapshotError
from discsim.plot import marks
from discsim.plot.request import Request

HILL = AXIS * (RATIO / 3.0) ** (1.0 / 3.0)
EDGE = 0.2 * math.sqrt(2.0 * math.log(0.8 / 0.5))  # distance of a gap's edge from the orbit, of `write_gap_run`
RING = 0.009 * AXIS  # width of the rings in which gaps are measured
AU_SCENE = (
    planets.SCENE.replace('units.system = "code"', 'units = {length = "10 au", mass = "1 Msun"}')
    .replace("run.until = 9.0", 'run.until = "90 yr"')
    .replace("space.size = 9.0", 'space.size = "90 au"')
    .replace("surface_density = 1e-4", 'surface_density = "10 g/cm2"')
    .replace("inner = 0.55", 'inner = "5.5 au"')
    .replace("outer = 3.4", 'outer = "34 au"')
    .replace("mass = 1.6", 'mass = "1.6 Msun"')
)
AU_PLANET = '[[companion]]\nmass = "3 Mjup"\nsemi_major_axis = "13 au"\nsoftening = 0.6\n'


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return planets.write_gap_run(tmp_path_factory.mktemp("runs") / "gap", count=20_000)


@pytest.fixture(scope="module")
def migrating(tmp_path_factory):
    """A planet that moves inwards by 0.3 au a snapshot, and one at 22 au with e = 0.15, about a star of 1.6 Msun."""
    run = tmp_path_factory.mktemp("runs") / "migrating"
    for k in range(4):
        orbits = [(3.2e-3, 1.3 - 0.03 * k, 0.0, 2.1 * k, 0.0), (1e-3, 2.2, 0.15, 1.7 * k + 1.0, 0.5)]
        bodies, gas = planets.bodies_of(1.6, orbits), planets.gas_of(planets.even(500), 1e-6)
        planets.write(run / "snapshots" / f"{k:04}.h5", AU_SCENE + 2 * AU_PLANET, 2.0 * k, gas, None, bodies)
    return run


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A disc about a star alone, which grows by 10%."""
    run = tmp_path_factory.mktemp("runs") / "alone"
    for k in range(2):
        gas = planets.gas_of(planets.even(2000) * (1.0 + 0.1 * k), 1e-6)
        planets.write(run / "snapshots" / f"{k:04}.h5", planets.SCENE, 3.0 * k, gas)
    return run


def profile_of(source, mark=None, **more):
    (axes,) = (
        Request([source], ["gas.surface_density"], "profile", display=display_options(mark=mark), **more).figure().axes
    )
    return axes


def picture_of(source, kind="map", **options):
    request = Request([source], ["gas.surface_density"], kind, display=display_options(**options))
    return request.figure().axes[0]


def verticals(axes, gid):
    return sorted(line.get_xdata()[0] for line in axes.lines if line.get_gid() == gid)


def circles(axes):
    """Middles and radii of the circles on a map."""
    return [(*each.center, each.radius) for each in axes.patches if isinstance(each, matplotlib.patches.Circle)]


def legend_of(axes):
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.texts]


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_profile_shows_planet_damping_and_start(run):
    axes = profile_of(run)
    assert legend_of(axes) == ["gas", "initial", "damping"]
    assert verticals(axes, "companions") == pytest.approx([AXIS], rel=1e-9)
    assert [text.get_text() for text in axes.texts] == ["companion"]
    spans = sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)
    assert spans == [pytest.approx((0.0, 0.8)), pytest.approx((2.7, axes.get_xlim()[1]))]
    gas, start = (line for line in axes.lines if len(line.get_xdata()) > 2)
    depth = np.interp(AXIS + 0.1, gas.get_xdata(), gas.get_ydata()) / np.interp(
        AXIS + 0.1, start.get_xdata(), start.get_ydata()
    )
    # Profiles are smoothed over 0.6 of the particle spacing of 0.03.
    heavy = 29.0 * HILL**2 * np.pi / (2.0 * np.pi * AXIS * 2.0 * HILL)  # of the planet's disc, near its edge less
    assert 1.0 - 0.8 * math.exp(-0.125) - 0.02 < depth < heavy
    # A mark does not set the scale: it is that of the curves.
    assert axes.get_yscale() == "log" and axes.get_ylim()[1] < 3.0 * np.nanmax(start.get_ydata())


def test_gap_edges_are_drawn_where_half_of_the_start_is_left(run):
    axes = profile_of(run, "gap")
    expected = [AXIS - EDGE, AXIS + EDGE]
    assert verticals(axes, "gap") == pytest.approx(expected, abs=RING)
    assert not verticals(axes, "companions") and legend_of(axes) == ["gas", marks.GAP_LABEL]
    assert sorted(r for *_, r in circles(picture_of(run, mark="gap"))) == pytest.approx(expected, abs=RING)
    lines = picture_of(run, "polar", mark="gap").lines
    assert sorted(line.get_ydata()[0] for line in lines) == pytest.approx(expected, abs=RING)
    lines = picture_of(run, "time", mark="gap").lines
    assert [list(np.isnan(line.get_xdata())) for line in lines] == 2 * [[True, False]]
    assert sorted(line.get_xdata()[1] for line in lines) == pytest.approx(expected, abs=RING)


def test_the_figure_says_where_a_gap_ends(run, tmp_path):
    title = Request([run], display=display_options(mark="gap")).figure().get_suptitle()
    found = [float(text) for text in title.rpartition(": ")[2].split(" to ")]
    assert found == pytest.approx([AXIS - EDGE, AXIS + EDGE], abs=RING)
    shallow = planets.write_gap_run(tmp_path / "shallow", depth=0.7, count=4000)
    assert Request([shallow], display=display_options(mark="gap")).figure().get_suptitle().endswith(": none")


def test_a_map_shows_the_hill_circle_and_the_damped_radii(run):
    place = AXIS * math.cos(2.1), AXIS * math.sin(2.1)
    assert [r for *_, r in circles(picture_of(run, mark="damping"))] == pytest.approx([0.8, 2.7])
    ((x, y, radius),) = circles(picture_of(run, mark="hill"))
    assert (x, y, radius) == pytest.approx((*place, HILL), rel=1e-9)
    axes = picture_of(run, window=1.7)
    assert len(circles(axes)) == 3 and len(axes.lines) == 3  # star, planet and the scale bar
    assert axes.get_xlim() == pytest.approx((-1.7, 1.7)) and axes.get_ylim() == pytest.approx((-1.7, 1.7))
    # On a map of 20 its radius is 0.6% of the side, which the dot of the planet covers.
    assert len(circles(picture_of(run, window=9.0))) == 2
    assert len(circles(picture_of(run, window=9.0, mark="hill"))) == 1
    assert len(picture_of(run, mark="none").lines) == 1  # the scale bar


def test_on_a_polar_map_the_hill_circle_is_as_far_from_the_planet_everywhere(run):
    axes = picture_of(run, "polar", mark="hill")
    (line,) = axes.lines
    angle, r = np.radians(line.get_xdata()), line.get_ydata()
    away = np.hypot(r * np.cos(angle) - AXIS * math.cos(2.1), r * np.sin(angle) - AXIS * math.sin(2.1))
    np.testing.assert_allclose(away, HILL, rtol=1e-9)
    assert axes.get_xlim() == (-180.0, 180.0)


def test_in_arcsec_marks_keep_their_places(migrating):
    first, second = circles(picture_of(migrating, mark="hill", distance="50 pc"))
    # 12.1 au and its Hill radius at 50 pc; the last snapshot is at a true anomaly of 6.3.
    expected = 12.1 / 50.0 * np.array([math.cos(6.3), math.sin(6.3), (RATIO / 3.0) ** (1.0 / 3.0)])
    assert first == pytest.approx(expected, rel=1e-6)
    r = 22.0 * (1.0 - 0.15**2) / (1.0 + 0.15 * math.cos(6.1))
    assert second[2] == pytest.approx(r / 50.0 * (1e-3 / 1.6 / 3.0) ** (1.0 / 3.0), rel=1e-6)


def test_orbits_in_time_are_semi_major_axes_with_the_apsides_of_eccentric_ones(migrating):
    axes = picture_of(migrating, "time")
    found = {tuple(np.round(line.get_xdata(), 6)) for line in axes.lines}
    assert found == {(13.0, 12.7, 12.4, 12.1), 4 * (22.0,), 4 * (18.7,), 4 * (25.3,)}
    years = discsim.read_snapshot(migrating).quantity("time").to_value("yr")
    assert [line.get_ydata()[-1] for line in axes.lines] == pytest.approx(len(axes.lines) * [years])
    assert sorted(text.get_text() for text in axes.texts) == ["companion 1", "companion 2"]
    assert axes.get_ylim() == pytest.approx((0.0, years))
    places = verticals(profile_of(migrating), "companions")
    assert places == pytest.approx([12.1, 18.7, 22.0, 25.3], rel=1e-6)


def test_orbits_that_nearly_coincide_share_a_label():
    assert marks.companion_label([2], several=False) == "companion"
    assert marks.companion_label([1, 3], several=True) == "companions 1, 3"
    assert marks.companion_label([1, 2, 3, 5], several=True) == "4 companions"


def test_a_second_star_has_no_hill_circle(tmp_path):
    text = planets.SCENE + planets.PLANET.replace("3.2e-3", "0.4")
    bodies = planets.bodies_of(1.6, [(0.4, AXIS, 0.0, 1.0, 0.0)])
    path = planets.write(tmp_path / "a.h5", text, 0.0, planets.gas_of(planets.even(500), 1e-6), None, bodies)
    assert not circles(picture_of(path)) and verticals(profile_of(path), "companions") == pytest.approx([AXIS])
    done = command("plot", path, "--mark", "hill", "-o", tmp_path / "a.png")
    assert done.exit_code == 2 and "--mark: hill: the run has no planet" in done.stderr


def test_a_run_without_companion_has_its_start_alone(alone):
    axes = profile_of(alone)
    assert legend_of(axes) == ["gas", "initial"] and not axes.texts and not axes.patches
    late, early = (np.interp(3.6, line.get_xdata(), line.get_ydata()) for line in axes.lines)
    assert early < 0.1 * late  # the disc grew beyond its first edge at 3.4
    assert legend_of(profile_of(alone / "snapshots" / "0000.h5")) == []
    assert legend_of(profile_of(alone, at=("0", "3"))) == ["t = 0", "t = 3"]
    assert not circles(picture_of(alone))


def test_python_draws_marks_once_on_the_same_axes(run):
    axes = Figure().subplots()
    discsim.plot.profile(run, "gas.surface_density", ax=axes)
    discsim.plot.profile(run, "dust.surface_density", ax=axes)
    assert len(verticals(axes, "companions")) == 1 and len(axes.patches) == 2 and len(axes.texts) == 1
    assert legend_of(axes).count("initial") == 1
    assert len([line for line in axes.lines if str(line.get_gid()).startswith("initial")]) == 2  # gas and dust
    snap = discsim.read_snapshot(run)
    assert "initial" not in legend_of(discsim.plot.profile(snap, ax=Figure().subplots()))
    assert discsim.plot.field_map(snap, ax=Figure().subplots(), mark=["damping"]).patches
    with pytest.raises(discsim.plot.PlotError, match="mark: gap: needs the first snapshot of the run; give the dir"):
        discsim.plot.field_map(snap, ax=Figure().subplots(), mark="gap")


def test_a_film_has_the_marks_of_maps(run, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(marks, "_draw_on_map", lambda axes, rings, hills: seen.append((list(rings), list(hills))))
    discsim.plot.movie(run, tmp_path / "a.gif", "gas.surface_density", mark="damping,gap,hill")
    (first, _), (last, ((place, radius),)) = seen
    assert [r for r, _ in first] == pytest.approx([0.8, 2.7])
    assert [r for r, _ in last] == pytest.approx([0.8, 2.7, AXIS - EDGE, AXIS + EDGE], abs=RING)
    assert place == pytest.approx((AXIS * math.cos(2.1), AXIS * math.sin(2.1))) and radius == pytest.approx(HILL)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["RUN", "--mark", "orbit"], '--mark: "orbit" is unknown; expected names of bodies, companions, damping, gap,'),
        (["RUN", "--mark", ""], '--mark: "" is unknown'),
        (["RUN", "--mark", "gap,none"], '--mark: "none" is unknown'),
        (["RUN", "--mark", "initial"], "--mark: initial: not a mark of a map; expected some of bodies, damping, gap"),
        (["RUN", "--profile", "--mark", "hill"], "--mark: hill: not a mark of a profile"),
        (["RUN", "--against", "radius", "--field", "v_r", "--mark", "gap"], "remove --mark or --against"),
        (["ALONE", "--mark", "gap"], "--mark: gap: the run has no planet"),
        (["ALONE", "--mark", "damping"], "--mark: damping: the scene has no [damping]; remove damping"),
        (["ALONE", "--time", "--mark", "companions"], "--mark: companions: the run has no companion"),
        (["RUN/snapshots/0000.h5", "--profile", "--mark", "initial"], "the snapshot is the first one of its run"),
        (["COPY", "--profile", "--mark", "initial"], "--mark: initial: needs the first snapshot of the run"),
        (["RUN", "RUN", "--profile", "--mark", "initial,gap"], "--mark: gap, initial: expected a single snapshot"),
    ],
)
def test_a_mark_that_there_is_not_is_one_message(run, alone, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    copy = str(shutil.copy(run / "snapshots" / "0001.h5", tmp_path / "copy.h5"))
    given = [text.replace("RUN", str(run)).replace("ALONE", str(alone)).replace("COPY", copy) for text in arguments]
    done = command("plot", *given)
    assert done.exit_code == 2 and words in done.stderr
    assert done.stderr.count("\n") == 1 and {path.name for path in tmp_path.iterdir()} == {"copy.h5"}


@pytest.mark.parametrize("zone", ['["0.8", "nan"]', '"wide"', "[0.8]", "[0.8, 0.3]", "3.0", '["1 s", "2 s"]'])
def test_damping_zones_that_are_none_are_one_message(run, tmp_path, zone):
    snap = discsim.read_snapshot(run)
    text = snap.scene_text.replace("[0.55, 0.8]", zone)
    assert text != snap.scene_text
    with pytest.raises(SnapshotError, match=r"damping.inner in the scene of the snapshot is .*; expected two rising"):
        marks.damped_radii(type(snap)(**{**vars(snap), "scene_text": text}))


def test_a_damaged_start_does_not_keep_a_profile_from_being_drawn(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    (copy / "snapshots" / "0000.h5").write_bytes(b"no file of HDF5")
    assert legend_of(profile_of(copy)) == ["gas", "damping"]
    with pytest.raises(SnapshotError, match=r"0000\.h5"):
        profile_of(copy, "initial")
