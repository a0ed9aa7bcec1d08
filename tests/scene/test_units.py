"""Units of a scene, and texts with units."""

import math
import re

import pytest
from astropy import constants
from astropy import units as u
from hypothesis import given
from hypothesis import strategies as st

from discsim.physics.grains import epstein_stopping_time
from discsim.scene.units import _UNITS_FOR_HINTS, DIMENSIONS, UnitError, Units, parse_quantity


def test_code_time_makes_gravity_one():
    units = Units(length_text="5.2 au", mass_text="0.3 Msun")
    in_code = constants.G.to_value(units.length**3 / units.mass / units.time**2)
    assert in_code == pytest.approx(1, rel=1e-12)  # rounding
    assert units.cgs("velocity") == pytest.approx(units.cgs("length") / units.cgs("time"), rel=1e-12)
    assert units.cgs("energy") == pytest.approx(units.cgs("mass") * units.cgs("velocity") ** 2, rel=1e-12)


def test_density_is_of_the_surface_in_2d_and_of_the_volume_in_1d():
    assert Units(dimensions=2).density.physical_type == "surface mass density"
    assert Units(dimensions=1).density.physical_type == "mass density"


def test_code_system_has_no_units():
    units = Units("code")
    assert units.length is None and units.time is None and units.cgs("energy") == 1.0
    assert units.show(0.5, "time") == "0.5"
    assert Units().show(2 * math.pi, "time") == "1 yr"


@pytest.mark.parametrize("text", ["5 nm", "1 um", "500 um", "7.974 mm", "4 cm", "3 m", "20 km", "0.05 au"])
def test_lengths_are_shown_as_people_write_them(text):
    """From pieces of grains to planetesimals and orbits."""
    units = Units()
    assert units.show(float(units.to_code(parse_quantity(text))), "length") == text


TEXTS = (
    ("length", "pc"),
    ("mass", "kg"),
    ("time", "Myr"),
    ("velocity", "km/s"),
    ("volume_density", "g / cm3"),
    ("surface_density", "kg m-2"),
    ("acceleration", "cm/s^2"),
    ("frequency", "1/yr"),
    ("energy", "erg"),
)


@given(st.floats(1e-30, 1e30), st.sampled_from(TEXTS))
def test_parsed_texts_match_astropy(value, dimension):
    name, unit = dimension
    units = Units(length_text="3 pc", mass_text="7 Mearth")
    there = units.parse(f"{value!r} {unit}", name)
    back = units.quantity(there, name).to_value(unit)
    assert back == pytest.approx(value, rel=1e-12)  # rounding
    assert units.to_code(u.Quantity(value, unit)) == pytest.approx(there, rel=1e-12)


SYSTEMS = tuple(
    Units(dimensions=n, length_text=a, mass_text=b)
    for n in (1, 2)
    for a, b in (("3 pc", "7 Mearth"), ("1 au", "1 Msun"))
)
NAMES = ["polytropic_constant"], [*DIMENSIONS, "density", "pressure", "drag_coefficient"]
GAMMAS = st.sampled_from((1.0 + 1e-3, 1.4, 5.0 / 3.0, 2.0)) | st.floats(0.3, 3.0)


@pytest.mark.parametrize("names", NAMES)
@given(st.data(), st.floats(1e-30, 1e30), st.sampled_from((-1.0, 1.0)), st.sampled_from(SYSTEMS), GAMMAS)
def test_a_quantity_that_is_shown_is_taken_as_it_is_shown(names, data, value, sign, units, gamma):
    name = data.draw(st.sampled_from(names))
    text = units.show(sign * value, name, gamma)
    # Four digits are shown.
    assert units.parse(text, name, gamma) == pytest.approx(sign * value, rel=6e-4)
    assert units.show(units.parse(text, name, gamma), name, gamma) == text


@pytest.mark.parametrize("names", NAMES)
@given(st.data(), st.sampled_from(SYSTEMS), GAMMAS)
def test_an_example_in_a_message_is_taken(names, data, units, gamma):
    name = data.draw(st.sampled_from(names))
    example = re.search('like "(.*)"$', units.expected(name, gamma))[1]
    assert units.parse(example, name, gamma) > 0.0


def test_a_power_that_is_no_whole_number_is_in_brackets():
    with pytest.raises(
        UnitError, match=re.escape('"0.05" has no unit; expected a polytropic constant, like "1 ')
    ) as fault:
        Units().parse("0.05", "polytropic_constant", 1.4)
    assert str(fault.value).endswith('"1 g(-0.4) cm(2.8) s-2"')
    assert Units().expected("polytropic_constant", 2.0).endswith('"1 g-1 cm4 s-2"')
    assert Units().expected("pressure").endswith('"1 g s-2"')


def test_a_power_beyond_the_range_of_numbers_is_one_message():
    with pytest.raises(UnitError, match='"1 cm50" is in cm50; expected a length, like "10 au"'):
        Units().parse("1 cm50", "length")
    example = "1 g(-19) cm(40) s-2"
    assert Units().expected("polytropic_constant", 20.0).endswith(f'"{example.replace("(", "").replace(")", "")}"')
    for take in (
        lambda: Units().parse(example, "polytropic_constant", 20.0),
        lambda: Units().to_code(u.Unit(example) * 1),
    ):
        with pytest.raises(UnitError, match="overflows in code units; use smaller powers, or other"):
            take()


@pytest.mark.parametrize("unit", _UNITS_FOR_HINTS)
def test_a_unit_that_is_suggested_is_known(unit):
    assert parse_quantity(f"1 {unit}").value == 1.0


@pytest.mark.parametrize("text", ["nan", "-inf", "1e999", "a", "", "3 au"])
def test_a_number_in_code_units_is_finite(text):
    with pytest.raises(UnitError, match=f'"{text}" is not a finite number; expected a length in code units'):
        Units("code").of_text(text, "length")
    assert Units("code").of_text(" -2.5e-3 ", "length") == -2.5e-3
    assert Units(length_text="2 au").of_text("5 au", "length") == 2.5


@given(st.text(max_size=20))
def test_any_text_is_a_quantity_or_a_unit_error(text):
    try:
        quantity = parse_quantity(text)
    except UnitError as error:
        assert str(error)
    else:
        assert math.isfinite(quantity.value)


def test_stopping_time_in_both_conventions():
    grain = (1 * u.cm, 3 * u.g / u.cm**3)
    gas = (1 * u.km / u.s, 1e-10 * u.g / u.cm**3)
    papers = epstein_stopping_time(*grain, *gas, "papers")
    assert papers.to_value(u.s) == pytest.approx(3e5, rel=1e-12)  # 3 / (1e5 1e-10) s
    kinetic = epstein_stopping_time(*grain, *gas, "kinetic")
    assert (kinetic / papers).to_value("") == pytest.approx(math.sqrt(math.pi / 8), rel=1e-12)
