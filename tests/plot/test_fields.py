"""Fields by name: their values against formulas, and why a run has none of that name."""

from dataclasses import replace

import growing
import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from astropy.modeling.physical_models import BlackBody
from runs import put_out

import discsim
from discsim import Simulation
from discsim.numerics.state import Dust, Gas
from discsim.output.fields.base import FieldError
from discsim.output.fields.binned import Optics
from discsim.output.fields.names import available_fields, field_rows, matching_fields, missing_reason, needed_columns
from discsim.output.fields.values import default_window, fields_on_pixels, full_radius, outer_radius, polar_range
from discsim.output.snapshot import read_snapshot
from discsim.output.snapshot_writer import write_snapshot
from discsim.parts import FIELDS
from discsim.scene import load_scene

COUNT = 2000
SCENE = {
    "run": {"until": "10 yr"},
    "space": {"size": "20 au"},
    "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "1 au", "outer": "3 au"},
    "gas": {"particles": COUNT, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": {"particles": COUNT, "ratio": 0.01},
    "star": {"mass": "2 Msun"},
    "drag": {"law": "stokes-number", "stokes": 0.1},
}


def spiral():
    """Even over 1 to 3 in radius."""
    r = np.sqrt(1.0 + 8.0 * (np.arange(COUNT) + 0.5) / COUNT)
    phi = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Circles of 1.02 times Kepler's speed about 2 Msun, and a radial velocity of -.1 r."""
    pos, one = spiral(), np.ones(COUNT)
    r = np.hypot(*pos.T)
    vel = 1.02 * np.sqrt(2.0 / r**3)[:, None] * np.stack([-pos[:, 1], pos[:, 0]], axis=1) - 0.1 * pos
    zero, ids = np.zeros_like(pos), np.arange(COUNT)
    state = {"h": 0.1 * one, "density": 0.01 * r, "gradh": one, "pressure": 1e-4 / r, "sound_speed": 0.1 / r}
    gas = Gas(pos=pos, vel=vel, acc=zero, mass=1e-5 * one, ids=ids, **state)
    dust = Dust(pos=pos, vel=vel, acc=zero, mass=2e-7 * one, ids=ids, species=np.zeros(COUNT, int))
    path = tmp_path_factory.mktemp("fields") / "0001.h5"
    write_snapshot(path, load_scene(SCENE), 1.0, gas, dust, {"dust": {"stokes": 0.1 * one, "stopping_time": one}})
    return path


@pytest.fixture(scope="module")
def snap(path):
    return discsim.read_snapshot(path)


def test_fields_of_particles(snap):
    r = snap.gas.radius
    speed = np.sqrt(2.0 * constants.G * constants.M_sun / (r * u.au))
    np.testing.assert_allclose(snap.field("gas.v_phi").to_value("m/s"), 1.02 * speed.to_value("m/s"), rtol=1e-9)
    np.testing.assert_allclose(snap.field("dust.v_phi_excess").to_value("m/s"), 0.02 * speed.to_value("m/s"), rtol=1e-7)
    unit = (np.sqrt(constants.G * constants.M_sun / u.au)).to_value("m/s")
    np.testing.assert_allclose(snap.field("gas.v_r").to_value("m/s"), -0.1 * r * unit, rtol=1e-9)
    # c_s Omega / (pi G Sigma) in units with G = 1.
    np.testing.assert_allclose(
        snap.field("toomre_q").value, 0.1 / r * np.sqrt(2 / r**3) / (np.pi * 0.01 * r), rtol=1e-9
    )
    np.testing.assert_allclose(snap.field("aspect_ratio").value, 0.1 / r / np.sqrt(2 / r), rtol=1e-9)
    energy, spin = 0.5 * (2.0808 / r + 0.01 * r**2) - 2 / r, 1.02 * np.sqrt(2 * r)
    np.testing.assert_allclose(snap.field("gas.eccentricity").value, np.sqrt(1 + 0.5 * energy * spin**2), rtol=1e-6)
    assert snap.field("gas.temperature").unit == u.K


def test_fields_of_places(snap):
    """Gas has 50 times the mass of dust at the same places; rings hold what they hold."""
    edges = np.array([1.4, 1.8, 2.2, 2.6])
    expected = (COUNT * 1e-5 / (8 * np.pi) * u.M_sun / u.au**2).to_value("g/cm2")
    # The spiral is even: a ring's ends round by one of 300.
    np.testing.assert_allclose(snap.field("gas.surface_density", edges=edges).to_value("g/cm2"), expected, rtol=0.01)
    np.testing.assert_allclose(snap.field("dust_to_gas", edges=edges).value, 0.02, rtol=1e-12)
    ratio = snap.field("dust_to_gas", pixels=60).value
    assert ratio.shape == (60, 60)
    np.testing.assert_allclose(ratio[np.isfinite(ratio)], 0.02, rtol=1e-9)
    with pytest.raises(FieldError, match="exists for several species; expected one of gas"):
        snap.field("surface_density")


def test_emission_is_that_of_a_black_body_through_the_opacity(snap):
    optics = Optics(0.87 * u.mm, 3.0 * u.cm**2 / u.g)
    binned = fields_on_pixels(snap, (np.full(2, -2.5), np.full(2, 2.5)), 50, optics)
    body, sigma = binned["emission"], binned["dust.surface_density"] * snap.units.cgs("surface_density")
    warm = np.nan_to_num(binned["gas.temperature"]) > 0
    planck = BlackBody(binned["gas.temperature"][warm] * u.K)(0.87 * u.mm).to_value("mJy/arcsec2")
    np.testing.assert_allclose(body[warm], 3.0 * sigma[warm] * planck, rtol=1e-9)
    assert not body[~warm].any()
    assert Optics(1.0 * u.mm).opacity_cgs == pytest.approx(2.99792458)  # 10 cm2/g at 1 THz, ~ nu


def test_only_the_columns_that_a_field_needs_are_read(path):
    some = read_snapshot(path, needed_columns(["gas.toomre_q"]))
    assert some.gas.vel is None and some.gas.ids is None and some.gas.pressure is None and some.dust.stokes is None
    assert some.gas.density is not None
    whole = read_snapshot(path)
    assert np.array_equal(some.field("gas.toomre_q").value, whole.field("gas.toomre_q").value)


def test_every_field_says_what_it_is_and_reads_what_it_needs(path, snap):
    for name, unit, about in field_rows():
        assert ": " in about or about.endswith(": P"), name
        u.Unit(unit)
        if missing_reason(FIELDS[name], snap) is None:
            of_needs = read_snapshot(path, needed_columns([name])).field(name, pixels=30)
            assert of_needs.unit == u.Unit(unit) and np.isfinite(of_needs.value).any(), name


@pytest.mark.parametrize(
    "word, words",
    [
        ("toomreq", 'did you mean "gas.toomre_q"?'),
        ("dust.toomre_q", 'did you mean "gas.toomre_q"?'),
        ("mass", "expected one of gas.surface_density, "),
    ],
)
def test_an_unknown_field(word, words):
    with pytest.raises(FieldError) as error:
        matching_fields(word)
    assert words in str(error.value) and "\n" not in str(error.value) and f'"{word}"' in str(error.value)


def test_why_a_run_lacks_a_field(snap):
    def lacks(word, of):
        with pytest.raises(FieldError) as error:
            available_fields(word, of)
        return str(error.value)

    assert "the grains have one size" in lacks("dust.size", snap)
    assert "no [growth]" in lacks("small_dust.surface_density", snap)
    assert lacks("stokes", replace(snap, dust=None)) == "stokes: the run has no dust"
    assert "needs a run in two dimensions, but the run is in one dimension" in lacks("v_r", replace(snap, dimensions=1))
    assert available_fields("v_r", snap) == ["gas.v_r", "dust.v_r"]
    assert available_fields("v_r", replace(snap, gas=None)) == ["dust.v_r"]
    code = replace(snap, units=replace(snap.units, system="code"), gas=replace(snap.gas, temperature=None))
    assert "in code units, where gas has no temperature" in lacks("temperature", code)


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_gas_with_small_dust_has_the_temperature_and_mass_of_gas_alone(direction, tmp_path):
    """Small dust is no part of the gas's mass with one-way drag, and is subtracted from it with two-way drag."""
    sim = Simulation(growing.disc(gas=400, dust=300, ratio=0.8, direction=direction))
    sim.step()
    small = sim.gas.small.sum() / sim.gas.mass.sum()
    assert 0.01 < small < 0.3
    put_out(sim, tmp_path / "a.h5")
    snap = read_snapshot(tmp_path / "a.h5")
    r = np.hypot(*snap.gas.pos.T)
    np.testing.assert_allclose(snap.field("gas.aspect_ratio").value, 0.1 * r**0.25, rtol=1e-9)
    density = snap.field("gas.surface_density", edges=np.array([0.2, 3.0])).value
    whole = snap.gas.mass.sum() * (1.0 if direction == "one-way" else 1.0 - small)
    np.testing.assert_allclose(density, whole / (np.pi * (9.0 - 0.04)), rtol=1e-12)


def snapshot_at(radii, tmp_path):
    """A snapshot with gas and dust of equal masses at these radii (n,) each, and random angles."""
    rng = np.random.default_rng(31)

    def places(r):
        phi = rng.uniform(0.0, 2.0 * np.pi, len(r))
        return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)

    gas, dust = (places(r) for r in radii)
    (zero, one), still = (np.zeros_like(gas), np.ones(len(gas))), np.zeros_like(dust)
    state = {"h": 0.1 * one, "density": one, "gradh": one, "pressure": one, "sound_speed": one}
    path = tmp_path / "0000.h5"
    write_snapshot(
        path,
        load_scene(SCENE),
        0.0,
        Gas(pos=gas, vel=zero, acc=zero, mass=3e-6 * one, ids=np.arange(len(gas)), **state),
        Dust(pos=dust, vel=still, acc=still, mass=np.full(len(dust), 2e-7), ids=np.arange(len(dust)),
             species=np.zeros(len(dust), int)),
    )  # fmt: skip
    return read_snapshot(path, ()).about_centre()


def radii_of(sigma, outer, count):
    """Radii up to `outer` of `count` particles with the surface density sigma(r)."""
    edges = np.linspace(0.0, outer, 20_001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    within = np.concatenate([[0.0], np.cumsum(sigma(middle) * middle)])
    return np.interp((np.arange(count) + 0.5) / count * within[-1], within, edges)


def test_window_ends_where_gas_that_spread_out_is_a_tenth_of_the_discs_surface_density(tmp_path):
    """Sigma is constant within 1.7, and exp(-(r - 1.7) / 0.3) of it outside: a tenth at 1.7 + 0.3 ln 10."""
    gas = radii_of(lambda r: np.exp(-np.maximum(r - 1.7, 0.0) / 0.3), 5.0, 30_000)
    snap = snapshot_at((gas, gas[gas < 1.2]), tmp_path)
    # Smoothed over 0.6 particle distances, at most 3% of the radius, and seen on rings of 0.015.
    assert outer_radius(snap) == pytest.approx(1.7 + 0.3 * np.log(10.0), abs=0.05)
    assert full_radius(snap) > 3.0
    lower, upper = default_window(snap)
    np.testing.assert_allclose([-lower, upper], 1.1 * outer_radius(snap), rtol=1e-12)
    assert polar_range(snap)[1] == outer_radius(snap)


def test_window_has_nine_tenths_of_the_mass_although_a_ring_outshines_the_rest(tmp_path):
    """A ring at 1.3 has 70% of the dust, and 100 times the surface density of the rest, which reaches 4."""
    ring, rest = np.linspace(1.28, 1.32, 14_000), radii_of(np.ones_like, 4.0, 6000)
    snap = snapshot_at((np.linspace(1.0, 1.5, 500), np.concatenate([ring, rest])), tmp_path)
    # Two thirds of the rest are within 4 sqrt(2/3) = 3.27. Only 99.5% of the particles count: 3.26.
    assert outer_radius(snap) == pytest.approx(4.0 * np.sqrt(2 / 3), abs=0.04)


def test_window_of_grains_without_mass_has_all_of_them(tmp_path):
    snap = snapshot_at((np.linspace(0.4, 1.1, 900), np.linspace(0.7, 2.3, 4000)), tmp_path)
    snap.dust.mass[:] = 0.0
    assert outer_radius(snap) == full_radius(snap) == pytest.approx(0.7 + 0.995 * 1.6, abs=1e-3)
