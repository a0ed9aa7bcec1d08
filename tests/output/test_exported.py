"""Snapshots for other tools, without these: what they are given, and what is refused. With them: tests/tools/."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from discsim import load_scene, read_snapshot
from discsim.numerics.state import Dust, Gas
from discsim.output.snapshot_writer import write_snapshot
from discsim.output.tools import NEIGHBOUR_AT_R, _radius_and_density

DISC = {
    "run": {"until": "100 yr"},
    "space": {"size": "20 au"},
    "initial": {"kind": "disc", "mass": "0.1 Msun", "inner": "1 au", "outer": "9 au"},
    "gas": {
        "particles": 400, "kernel": "quintic",
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05, "reference_radius": "10 au"},
    },
    "dust": {"particles": 300, "ratio": 0.01},
    "star": {"mass": "1 Msun", "accretion_radius": "1 au"},
}  # fmt: skip
BOX = {
    "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 2.0, "boundary": "periodic"},
    "initial": {"kind": "box", "density": 1.0}, "dust": {"particles": 300, "ratio": 1.0},
}  # fmt: skip
WAVE = {
    "units": {"system": "code"}, "run": {"until": 1.0},
    "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"}, "initial": {"kind": "wave"},
    "gas": {"particles": 30, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
}  # fmt: skip


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def gas_of(rng, n, dimensions=2):
    pos, vel, acc = rng.uniform(-9, 9, (3, n, dimensions))
    mass, h, density, gradh, pressure = rng.uniform(1, 2, (5, n))
    return Gas(
        pos=pos, vel=vel, acc=acc, mass=mass, ids=np.arange(n), h=h, density=density, gradh=gradh, pressure=pressure,
        sound_speed=np.sqrt(pressure / density),
    )  # fmt: skip


def dust_of(rng, n, lower=-9.0, upper=9.0):
    pos = rng.uniform(lower, upper, (n, 2))
    return Dust(pos=pos, vel=0 * pos, acc=0 * pos, mass=np.ones(n), ids=np.arange(n), species=np.zeros(n, int))


def written(path, scene, gas, dust):
    extra = {} if dust is None else {"dust": {"stokes": np.linspace(0.1, 1.0, len(dust.mass))}}
    write_snapshot(path / "0.h5", load_scene(scene), 0.5, gas, dust, extra)
    return read_snapshot(path / "0.h5")


@pytest.mark.parametrize("tool", ["yt", "pynbody", "sarracen"])
def test_without_a_tool_one_is_told(tmp_path, rng, monkeypatch, tool):
    monkeypatch.setitem(sys.modules, tool, None)
    snap = written(tmp_path, DISC, gas_of(rng, 400), None)
    with pytest.raises(ImportError, match=rf"to_{tool}\(\) needs {tool}.*pip install -e '[.]\[tools\]'"):
        getattr(snap, f"to_{tool}")()


@pytest.mark.parametrize("tool", ["yt", "pynbody", "sarracen"])
def test_one_dimension_is_refused(tmp_path, rng, tool):
    snap = written(tmp_path, WAVE, gas_of(rng, 30, 1), None)
    with pytest.raises(ValueError, match=rf"to_{tool}\(\) needs a snapshot in two dimensions.*use to_pandas\(\)"):
        getattr(snap, f"to_{tool}")()


@pytest.mark.parametrize("tool", ["yt", "sarracen"])
def test_a_species_that_is_not_there_is_refused(tmp_path, rng, monkeypatch, tool):
    monkeypatch.setitem(sys.modules, tool, SimpleNamespace())
    snap = written(tmp_path, DISC, gas_of(rng, 400), None)
    with pytest.raises(KeyError, match="the snapshot has no 'dust'; expected 'gas'"):
        getattr(snap, f"to_{tool}")("dust")


@pytest.fixture
def given(tmp_path, rng, monkeypatch):
    """A snapshot, and what yt and sarracen are given of it."""
    monkeypatch.setitem(sys.modules, "yt", SimpleNamespace(load_particles=lambda data, **more: (data, more)))
    monkeypatch.setitem(sys.modules, "sarracen", SimpleNamespace(SarracenDataFrame=lambda data, params: (data, params)))
    return written(tmp_path, DISC, gas_of(rng, 400), dust_of(rng, 300))


def test_yt_is_given_layers_one_code_length_thick(given):
    data, more = given.to_yt()
    gas = {name: array for (group, name), array in data.items() if group == "PartType0"}
    assert gas["density"][1] == "code_mass**1*code_length**-3"
    assert gas["Pressures"][1] == "code_mass**1*code_length**-1*code_time**-2"
    assert gas["temperature"][1] == "K**1" and gas["particle_mass"][1] == "code_mass**1"
    np.testing.assert_array_equal(gas["density"][0], given.gas.density)
    # The quintic kernel reaches 3 h.
    np.testing.assert_allclose(gas["smoothing_length"][0], 3 * given.gas.h, rtol=1e-15)
    np.testing.assert_array_equal(gas["particle_position_y"][0], given.gas.pos[:, 1])
    np.testing.assert_array_equal(gas["particle_position_z"][0], 0.0)
    assert data["PartType3", "StokesNumbers"][1] == ""
    assert more["length_unit"] == pytest.approx(1.495978707e13) and more["sim_time"] == 0.5
    np.testing.assert_array_equal(more["bbox"], [(-10, 10)] * 3)
    # yt smooths one species.
    for species, group in (("gas", "PartType0"), ("dust", "PartType3")):
        held = {group for group, name in given.to_yt(species)[0] if name == "smoothing_length"}
        assert held == {group} == {group for group, name in given.to_yt(species)[0] if name == "density"}


def test_sarracen_is_given_its_own_smoothing_lengths(given):
    frame, params = given.to_sarracen()
    np.testing.assert_allclose(frame["h"], 1.5 * given.gas.h, rtol=1e-15)
    np.testing.assert_array_equal(frame["density"], given.gas.density)
    np.testing.assert_array_equal(frame[["x", "y"]], given.gas.pos)
    assert params["time"] == 0.5 and params["umass"] == pytest.approx(1.98841e33, rel=1e-5)
    assert {"stokes", "species", "h", "density", "mass"} <= set(given.to_sarracen("dust")[0])


def test_what_was_not_read_is_left_out(tmp_path, given):
    snap = read_snapshot(tmp_path / "0.h5", columns=("gas.pressure",))
    data, _ = snap.to_yt()
    names = {name for group, name in data if group == "PartType0"}
    assert {"Pressures", "density", "particle_mass"} <= names
    assert "particle_velocity_x" not in names and "particle_index" not in names
    assert set(snap.to_sarracen()[0]) == {"x", "y", "mass", "pressure", "h", "density"}


def test_neighbours_give_dust_a_density(tmp_path, rng):
    """Uniform at random in a periodic box, and so at its edges too."""
    snap = written(tmp_path, BOX, None, dust_of(rng, 20_000, 0.0, 2.0))
    found = _radius_and_density(snap, snap.dust)
    # The density from 32 neighbours is off by 1/sqrt(32) = 18%; the mean over 20,000, of which 625 are apart, by 0.7%.
    assert found["density"].mean() == pytest.approx(5000.0, rel=0.02)
    assert np.pi * np.mean(found["h"] ** 2) * 5000.0 == pytest.approx(NEIGHBOUR_AT_R, rel=0.02)
    # Of the 800 nearest to an edge some 50 are apart; with nothing beyond the edge these would find a third less.
    edge = np.any((snap.dust.pos < 0.01) | (snap.dust.pos > 1.99), axis=1)
    assert found["density"][edge].mean() == pytest.approx(5000.0, rel=0.08)


@pytest.mark.parametrize("n", [0, 1, 5])
def test_hardly_any_dust_has_finite_densities(tmp_path, rng, n):
    snap = written(tmp_path, DISC, gas_of(rng, 400), dust_of(rng, n))
    found = _radius_and_density(snap, snap.dust)
    assert found["h"].shape == found["density"].shape == (n,)
    assert np.all(found["h"] > 0) and np.all(np.isfinite([found["h"], found["density"]]))


def test_dust_in_one_place_has_finite_densities(tmp_path, rng):
    dust = dust_of(rng, 300)
    dust.pos[:] = 3.0
    found = _radius_and_density(snap := written(tmp_path, DISC, gas_of(rng, 400), dust), snap.dust)
    assert np.all(found["h"] > 0) and np.all(np.isfinite([found["h"], found["density"]]))
