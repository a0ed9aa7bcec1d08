"""Times of a scene as numbers of orbits, against Kepler's third law in SI units, and texts that are no such times."""

import copy
import math
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import problems

from discsim.physics import centre, companions
from discsim.physics.orbits import Orbits
from discsim.run.progress import Progress
from discsim.scene import SceneError, load_scene
from discsim.scene.differences import differences
from discsim.scene.orbits import OrbitalPeriods, show_time, shown_orbit
from discsim.scene.overrides import Option
from discsim.scene.units import UnitError, Units

ROUNDING = 1e-12  # of some products and roots
DISC = {
    "units": {"length": "3.1 au", "mass": "0.4 Msun"},
    "run": {"until": "70 yr"},
    "space": {"size": "90 au"},
    "initial": {"kind": "disc", "mass": "1e-3 Msun", "inner": "2 au", "outer": "30 au"},
    "dust": {"particles": 70, "ratio": 0.02},
    "star": {"mass": "0.7 Msun"},
}
PLANET = {"mass": "0.03 Msun", "semi_major_axis": "7.3 au", "softening": "0.4 au", "eccentricity": 0.43}
FLYBY = PLANET | {"eccentricity": 1.7}


def scene_of(*changes, **tables):
    """The disc, with tables added or, as None, removed, and settings as of --set."""
    data = {name: table for name, table in (copy.deepcopy(DISC) | tables).items() if table is not None}
    return load_scene(data, changes)


def kepler(semi_major_axis, mass, orbits=1.0):
    """The time of some orbits in SI units, of a semi-major axis in au about a mass in Msun."""
    a = semi_major_axis * u.au
    return (orbits * 2 * math.pi * np.sqrt(a**3 / (constants.G * mass * u.Msun))).to("s")


def assert_equals(scene, time, expected):
    assert scene.units.quantity(time, "time").to_value("s") == pytest.approx(expected.value, rel=ROUNDING)


@pytest.mark.parametrize("number, radius", [(40.0, 5.2), (0.37, 123.4)])
def test_orbits_at_a_radius_are_circular_about_the_star(number, radius):
    """A companion inside of the radius counts only in a disc about the barycentre."""
    for tables in ({}, {"companion": PLANET}, {"companion": [PLANET, FLYBY]}):
        scene = scene_of(f"run.until={number} orbits at {radius} au", **tables)
        assert_equals(scene, scene.run.until, kepler(radius, 0.7, number))
        omega = float(centre.kepler_omega(scene, radius * u.au.to(scene.units.length)))
        assert scene.run.until * omega / (2 * math.pi) == pytest.approx(number, rel=ROUNDING)


def test_orbits_about_a_binary_have_the_mass_of_both_stars():
    """The fly-by is no part of the central mass."""
    stars = [PLANET | {"mass": "0.52 Msun"}, FLYBY]
    star = {"mass": "0.7 Msun", "centre": "barycentre", "frame": "inertial"}
    scene = scene_of("run.until=11 orbits at 26 au", "run.every=3 orbits", star=star, companion=stars)
    assert_equals(scene, scene.run.until, kepler(26.0, 1.22, 11.0))
    assert_equals(scene, scene.run.every, kepler(7.3, 1.22, 3.0))
    omega = float(centre.kepler_omega(scene, 26.0 / 3.1))
    assert scene.run.until * omega / (2 * math.pi) == pytest.approx(11.0, rel=ROUNDING)


def test_a_softened_star_has_slower_circular_orbits():
    scene = scene_of("run.until=2.5 orbits at 4 au", star={"mass": "0.7 Msun", "softening": "3 au"})
    # Omega^2 = G M / (r^2 + s^2)^(3/2) is that of a semi-major axis of 5 au.
    assert_equals(scene, scene.run.until, kepler(5.0, 0.7, 2.5))


@pytest.mark.parametrize("words", ["orbits", "orbit", "orbits of the companion", " orbits\tof the companion "])
def test_orbits_of_the_companion_have_the_total_mass(words):
    scene = scene_of(f"run.until=2.7{words}", f"companion.ramp=1.3 {words}", companion=PLANET)
    assert_equals(scene, scene.run.until, kepler(7.3, 0.73, 2.7))
    assert_equals(scene, scene.companion[0].ramp, kepler(7.3, 0.73, 1.3))
    assert scene.run.until == pytest.approx(2.7 * companions.period(scene, scene.companion[0]), rel=ROUNDING)


def test_a_star_that_feels_no_companion_binds_it_with_its_own_mass():
    star = {"mass": "0.7 Msun", "indirect": ["dust"]}
    scene = scene_of("run.until=2.7 orbits", star=star, companion=PLANET)
    assert_equals(scene, scene.run.until, kepler(7.3, 0.7, 2.7))
    assert scene.run.until == pytest.approx(2.7 * companions.period(scene, scene.companion[0]), rel=ROUNDING)


@pytest.mark.parametrize("phase", [0.0, 77.0])
@pytest.mark.parametrize("orbit", ["fixed", "live"])
def test_an_eccentric_companion_is_back_after_one_orbit_and_not_before(orbit, phase):
    scene = scene_of("run.until=1 orbit", companion=PLANET | {"orbit": orbit, "phase": phase})
    orbits = Orbits(scene)
    bodies = orbits.initial_bodies()
    first = bodies.pos.copy()
    orbits.drift(bodies, 0.0, 0.5 * scene.run.until)
    assert np.abs(bodies.pos - first).max() > 0.1
    orbits.drift(bodies, 0.5 * scene.run.until, 0.5 * scene.run.until)
    np.testing.assert_allclose(bodies.pos, first, atol=1e-9)  # of solutions of Kepler's equation


def test_in_code_units_the_radius_is_a_number():
    scene = scene_of(
        "run.until=40 orbits at 2.0", "companion.ramp=0.5 orbits", "companion.every=3",
        units={"system": "code"}, space={"size": 30.0}, star={"mass": 0.7},
        initial=DISC["initial"] | {"mass": 1e-3, "inner": 1.0, "outer": 6.0},
        companion=PLANET | {"mass": 0.03, "semi_major_axis": 7.3, "softening": "0.4"},
    )  # fmt: skip
    assert scene.run.until == pytest.approx(40 * 2 * math.pi * math.sqrt(8.0 / 0.7), rel=ROUNDING)
    assert scene.companion[0].ramp == pytest.approx(math.pi * math.sqrt(7.3**3 / 0.73), rel=ROUNDING)
    assert scene.companion[0].every == 3.0
    assert scene.show_time(0.25 * scene.run.until) == "212.4 (10 orbits at 2)"


def test_every_key_that_is_a_time_counts_orbits():
    gas = {
        "particles": 70,
        "eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.05, "reference_radius": "5 au"},
    }
    changes = ["run.until=9 orbits at 5 au", "run.timestep=1e-3 orbits", "companion.every=0.2 orbits at 5 au"]
    scene = scene_of(
        *changes, gas=gas, companion=PLANET, cooling={"kind": "constant", "t_cool": "4 orbits at 5 au"},
        drag={"law": "stopping-time", "t_stop": "0.03 orbits at 5 au"},
    )  # fmt: skip
    at_5 = kepler(5.0, 0.7)
    for time, number in (
        (scene.run.until, 9), (scene.companion[0].every, 0.2), (scene.cooling.t_cool, 4), (scene.drag.t_stop, 0.03),
    ):  # fmt: skip
        assert_equals(scene, time, number * at_5)
    assert_equals(scene, scene.run.timestep, kepler(7.3, 0.73, 1e-3))


def test_the_scene_keeps_the_text_and_reads_to_the_same_bits():
    """As a run does that is resumed, and a sweep that changes the star."""
    scene = scene_of("run.every=0.1 orbits", Option("--until", "run.until", "7 orbits at 5.2 au"), companion=PLANET)
    assert tomllib.loads(scene.text)["run"] == {"until": "7 orbits at 5.2 au", "every": "0.1 orbits"}
    again = load_scene(tomllib.loads(scene.text))
    assert (again.run.until, again.run.every) == (scene.run.until, scene.run.every)
    assert list(differences(scene, again)) == []
    heavier = load_scene(tomllib.loads(scene.text), ["star.mass=2.1 Msun"])
    assert heavier.run.until == pytest.approx(scene.run.until / math.sqrt(3.0), rel=ROUNDING)
    assert heavier.run.every == pytest.approx(scene.run.every * math.sqrt(0.73 / 2.13), rel=ROUNDING)


@pytest.mark.parametrize(
    "text, wrong",
    [
        ("1e400 orbits", '"1e400 orbits" is not a finite number'),
        ("nan orbits", '"nan orbits" is not a finite number'),
        ("orbits at", '"orbits at" is not a quantity; expected a time, like "40 orbits at 5.2 au"'),
        ("40 orbits at", "is not a number of orbits"),
        ("40 orbits / 2", "is not a number of orbits"),
        ("40 orbits of the star", "is not a number of orbits"),
        ("1__0 orbits", "is not a quantity"),
        ("40 orbits at -1 au", 'the radius "-1 au" is not positive'),
        ("40 orbits at nan au", "is not a finite number"),
        ("40 orbits at 5.2 s", '"5.2 s" is a time; expected a length'),
        ("40 orbits at 5.2", '"5.2" has no unit; expected a length'),
        ("40 orbits at 5.2 au 3", "is a volume; expected a length"),
        ("40 orbits at 1e300 au", "the orbital period is too large or too small"),
        ("1e70 orbits", "is out of range"),
        ("1e300 orbits at 1e90 au", "is too large"),
        ("0 orbits", "is not positive"),
        ("-3 orbits", "is not positive"),
        ("40 orbits at 5.2 \u0430u", "unknown unit"),
        ("40 orbits at \x1b[2J", r"\x1b[2J"),
        ("40 orbits at " + 9000 * "9" + " au", "is not a finite number"),
        ("40 orbits" + 90_000 * " " + "x", "is not a number of orbits"),
    ],
)
def test_a_wrong_number_of_orbits_is_one_message(text, wrong):
    (found,) = problems(copy.deepcopy(DISC) | {"run": {"until": text}, "companion": PLANET})
    assert found.startswith("scene: run.until: ") and wrong in found
    assert len(found) < 400 and "\x1b" not in found


@pytest.mark.parametrize(
    "tables, wrong",
    [
        ({}, "there are 0 companions on bound orbits, not one"),
        ({"companion": FLYBY}, "there are 0 companions on bound orbits, not one"),
        ({"companion": [PLANET, FLYBY, PLANET]}, "there are 2 companions on bound orbits, not one"),
    ],
)
def test_orbits_need_a_radius_unless_one_companion_is_bound(tables, wrong):
    (found,) = problems(copy.deepcopy(DISC) | {"run": {"until": "2 orbits"}} | tables)
    assert found == f'scene: run.until: "2 orbits": {wrong}; give a radius too, like "40 orbits at 5.2 au"'
    one = scene_of("run.until=2 orbits", companion=[FLYBY, PLANET])
    assert_equals(one, one.run.until, kepler(7.3, 0.73, 2.0))


@pytest.mark.parametrize("text", ["2 orbits", "2 orbits at 5.2 au"])
def test_without_a_star_there_is_no_central_mass(text):
    box = {
        "run": {"until": text}, "space": {"size": "3 au", "boundary": "periodic"},
        "initial": {"kind": "box", "surface_density": "3 g/cm2"}, "dust": {"particles": 70, "ratio": 0.02},
    }  # fmt: skip
    found = problems(box)
    wrong = 'the scene has no central mass; add a table [star], or give the time without "orbits"'
    assert f'scene: run.until: "{text}": {wrong}' in found
    assert sum("run.until" in each for each in found) == 1


@pytest.mark.parametrize(
    "tables, wrong",
    [
        ({"star": {"mass": "3 au"}}, "star.mass"),
        ({"star": {"mas": "0.7 Msun"}}, "star.mas: unknown key"),
        ({"star": "sun"}, "star"),
        ({"star": None, "stra": {"mass": "0.7 Msun"}}, "stra: unknown table"),
        ({"companion": PLANET | {"mass": "-1 g"}}, "companion.mass"),
        ({"companion": PLANET | {"semi_major_axis": 3.0}}, "companion.semi_major_axis"),
        ({"companion": PLANET | {"eccentricity": "x"}}, "companion.eccentricity"),
        ({"companion": [PLANET, PLANET | {"eccentricity": -1.0}]}, "companion.1.eccentricity"),
        ({"companion": "planet"}, "companion"),
    ],
)
def test_a_faulty_star_or_companion_is_the_only_message(tables, wrong):
    """The times that depend on it have no message of their own."""
    data = copy.deepcopy(DISC) | {"run": {"until": "9 orbits", "every": "2 orbits"}, "companion": PLANET} | tables
    found = problems({name: table for name, table in data.items() if table is not None})
    assert len(found) == 1 and found[0].startswith(f"scene: {wrong}")


MASSES = st.floats(1e-3, 1e3)
AXES = st.floats(1e-3, 1e4)


@given(st.floats(1e-6, 1e9), AXES, MASSES, MASSES, st.floats(0.0, 0.999), st.booleans())
def test_any_number_of_orbits_is_that_of_kepler(number, axis, star, companion, eccentricity, both):
    centre_of_disc = "barycentre" if both else "star"
    tables = {
        "star": {"mass": f"{star!r} Msun", "centre": centre_of_disc},
        "companion": [{"mass": f"{companion!r} Msun", "semi_major_axis": f"{axis!r} au", "eccentricity": eccentricity}],
    }
    units = Units(length_text="3 pc", mass_text="7 Mearth")
    periods = OrbitalPeriods(tables, units)
    central = star + companion if both else star
    for text, mass in ((f"{number!r} orbits", star + companion), (f"{number!r} orbits at {axis!r} au", central)):
        found = units.quantity(periods.parse(text), "time").to_value("s")
        assert found == pytest.approx(kepler(axis, mass, number).value, rel=1e-11)


PIECES = (
    "40",
    "1e400",
    "nan",
    "-",
    " ",
    "orbit",
    "orbits",
    " at ",
    "5.2",
    "au",
    "s",
    "*",
    "of the companion",
    "\x00",
    "9_9",
)


@settings(max_examples=40)
@given(st.lists(st.sampled_from(PIECES) | st.text(max_size=4), max_size=7).map("".join))
def test_any_text_is_a_time_or_one_line_about_it(text):
    tables = {"star": {"mass": "0.7 Msun"}, "companion": PLANET}
    try:
        assert math.isfinite(OrbitalPeriods(tables, Units()).parse(text))
    except UnitError as error:
        assert len(str(error)) < 500 and str(error).isprintable()


HOSTILE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from(("1 Msun", "3 au")),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from((*PLANET, "centre", "indirect")), inner)
    ),
    max_leaves=8,
)


@given(HOSTILE, HOSTILE, st.sampled_from(("2 orbits", "2 orbits at 5 au")), st.sampled_from(("physical", "code")))
def test_any_tables_give_a_time_or_one_line(star, companion, text, system):
    """As those of a snapshot from others, of which only some entries are checked."""
    tables = {"star": star, "companion": companion, "run": {"until": text}}
    try:
        assert OrbitalPeriods(tables, Units(system)).parse(text) > 0.0
    except UnitError as error:
        assert str(error).isprintable()


def test_times_are_shown_in_the_orbits_of_the_scene():
    for until, every, tables, shown in (
        ("40 orbits at 5.2 au", "1 orbit", {"companion": PLANET}, "(1 orbit at 5.2 au)"),
        ("40 yr", "1 orbit at 2 au", {}, "(4.192 orbits at 2 au)"),
        ("40 yr", "3 yr", {"companion": PLANET}, "(0.614 orbits of the companion)"),
        ("40 yr", "3 yr", {"companion": [PLANET, PLANET]}, ""),
        ("40 yr", "3 yr", {}, ""),
    ):
        scene = scene_of(f"run.until={until}", f"run.every={every}", **tables)
        time = float(scene.units.to_code(kepler(5.2, 0.7)))
        assert scene.show_time(time) == f"14.17 yr {shown}".strip()
    assert scene.show_time(0.0) == "0"


@pytest.mark.parametrize(
    ("until", "texts"),
    [
        ("40 yr", ["0.002738 yr", "36 yr"]),  # 365.25 days
        ("1 orbit at 2 au", ["0.002738 yr (0.0008099 orbits at 2 au)", "36 yr (10.65 orbits at 2 au)"]),
        ("30 day", ["1 day", "1.315e+04 day"]),
    ],
)
def test_all_times_of_a_run_have_the_unit_of_its_end(until, texts):
    scene = scene_of(f"run.until={until}", "run.every=1 day")
    times = [float(scene.units.parse(text, "time")) for text in ("1 day", "36 yr")]
    assert [scene.show_time(time) for time in times] == texts
    facts = Progress(scene, quiet=True)._facts(SimpleNamespace(step=3, time=times[1]), times[0], "gas")
    assert facts["dt"].startswith(f"dt = {texts[0].partition(' (')[0]}, ")
    assert facts["time"].startswith(f"t = {texts[1].partition(' (')[0]} of ")


def test_a_scene_that_cannot_be_read_has_no_orbits():
    units = Units()
    for text in (
        "",
        "= 3",
        'run = {until = "2 orbits"}',
        "run = 3",
        "companion = 3",
        "[" * 5000,
        "star = 3\ncompanion = {}",
    ):
        assert shown_orbit(text, units) is None and show_time(2 * math.pi, units, text) == "1 yr"


def test_a_plain_time_in_years_is_as_before():
    for text in ("70 yr", "70.0 yr", "25567.5 day"):
        assert_equals(scene_of(f"run.until={text}", companion=PLANET), scene_of().run.until, 70 * u.yr.to("s") * u.s)
    with pytest.raises(SceneError, match=r'"70 orbitz": unknown unit "orbitz"'):
        scene_of("run.until=70 orbitz", companion=PLANET)
