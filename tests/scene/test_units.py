"""Units of a scene, and texts with units."""

import math

import pytest
from astropy import constants
from astropy import units as u
from hypothesis import given
from hypothesis import strategies as st

from discsim.physics.grains import epstein_stopping_time
from discsim.scene.units import UnitError, Units, parse_quantity


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
    assert units.show_time(0.5) == "0.5"
    assert Units().show_time(2 * math.pi) == "1 yr"


@pytest.mark.parametrize("text", ["5 nm", "1 um", "500 um", "7.974 mm", "4 cm", "3 m", "20 km", "0.05 au"])
def test_lengths_are_shown_as_people_write_them(text):
    """From pieces of grains to planetesimals and orbits."""
    units = Units()
    assert units.show(float(units.to_code(parse_quantity(text))), "length") == text


DIMENSIONS = (
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


@given(st.floats(1e-30, 1e30), st.sampled_from(DIMENSIONS))
def test_parsed_texts_match_astropy(value, dimension):
    name, unit = dimension
    units = Units(length_text="3 pc", mass_text="7 Mearth")
    there = units.parse(f"{value!r} {unit}", name)
    back = units.quantity(there, name).to_value(unit)
    assert back == pytest.approx(value, rel=1e-12)  # rounding
    assert units.to_code(u.Quantity(value, unit)) == pytest.approx(there, rel=1e-12)


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
