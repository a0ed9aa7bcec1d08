"""Snapshots and checkpoints: what is read is what was written, and no damage goes unseen."""

import h5py
import numpy as np
import pytest
from runs import put_out

from discsim import Simulation
from discsim.numerics.state import Dust, Gas
from discsim.output.checkpoint import CheckpointError, read_checkpoint, write_checkpoint
from discsim.output.snapshot import SnapshotError, read_snapshot
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

DISC = {
    "title": "A disc – dusty",
    "run": {"until": "100 yr"},
    "space": {"size": "260 au", "cells": 64},
    "initial": {"kind": "disc", "mass": "0.1 Msun", "inner": "10 au", "outer": "100 au"},
    "gas": {
        "particles": 500,
        "kernel": "quintic",
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05, "reference_radius": "10 au"},
    },
    "dust": [{"particles": 700, "ratio": 0.01}] * 3,
    "star": {"mass": "1 Msun", "accretion_radius": "10 au"},
}
WAVE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "wave"},
    "gas": {"particles": 500, "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}},
}


def make_gas(n, dimensions, rng, u=False):
    def vector():
        return rng.normal(size=(n, dimensions))

    def positive():
        return rng.uniform(0.1, 2.0, n)

    density, pressure = positive(), positive()
    return Gas(
        pos=rng.uniform(0.01, 0.99, (n, dimensions)),
        vel=vector(),
        acc=vector(),
        mass=positive(),
        ids=rng.permutation(n),
        h=positive(),
        density=density,
        gradh=positive(),
        pressure=pressure,
        sound_speed=np.sqrt(pressure / density),
        u=positive() if u else None,
    )


def make_dust(n, dimensions, rng):
    pos, vel, acc = rng.uniform(0.01, 0.99, (3, n, dimensions))
    mass, ids, species = rng.uniform(1, 2, n), rng.permutation(n), rng.integers(0, 3, n)
    return Dust(pos=pos, vel=vel, acc=acc, mass=mass, ids=ids, species=species)


@pytest.fixture
def rng():
    return np.random.default_rng(42)


@pytest.fixture
def disc(tmp_path, rng):
    """A scene, its particles and the path of their snapshot."""
    scene, gas, dust = load_scene(DISC), make_gas(500, 2, rng), make_dust(700, 2, rng)
    gas.pos = 200 * (gas.pos - 0.5)
    gas.pos[7] = [-400.0, 20.0]  # gone through the open boundary
    gas.pos[8] = [150.0, 300.0]
    names = ("stopping_time", "stokes", "density")
    extra = {"dust": {name: rng.uniform(1, 2, 700) for name in names}}
    path = tmp_path / "0003.h5"
    write_snapshot(path, scene, 1.25, gas, dust, extra)
    return scene, gas, dust, extra["dust"], path


def test_round_trip(disc):
    scene, gas, dust, extra, path = disc
    snap = read_snapshot(path)
    assert snap.time == 1.25
    assert snap.scene_text == scene.text
    assert snap.tables["star"]["mass"] == "1 Msun"
    for kind, written in (("gas", gas), ("dust", dust)):
        order, read = np.argsort(written.ids), snap.species[kind]
        for name in ("ids", "mass", "vel"):
            np.testing.assert_array_equal(getattr(read, name), getattr(written, name)[order])
        # The shift into the box, 530 au wide, rounds: 530 * 2^-53, twice.
        np.testing.assert_allclose(read.pos, written.pos[order], rtol=0, atol=2e-13)
    order = np.argsort(gas.ids)
    for name in ("density", "pressure", "sound_speed"):
        np.testing.assert_array_equal(getattr(snap.gas, name), getattr(gas, name)[order])
    # (3 h)/3 may round once more.
    np.testing.assert_allclose(snap.gas.h, gas.h[order], rtol=3e-16)
    assert snap.gas.u is None
    order = np.argsort(dust.ids)
    np.testing.assert_array_equal(snap.dust.species, dust.species[order])
    for name, array in extra.items():
        np.testing.assert_array_equal(getattr(snap.dust, name), array[order])
    assert [p.name for p in path.parent.iterdir()] == ["0003.h5"]


def test_one_dimension_with_energy_and_walls(tmp_path, rng):
    gas = make_gas(300, 1, rng, u=True)
    gas.immobile = gas.pos[:, 0] > 0.9
    write_snapshot(tmp_path / "a.h5", load_scene(WAVE), 0.0, gas, None)
    snap = read_snapshot(tmp_path / "a.h5")
    order = np.argsort(gas.ids)
    assert snap.dust is None
    assert snap.gas.pos.shape == snap.gas.vel.shape == (300, 1)
    # The box of [0, 1) is not shifted, so nothing rounds.
    np.testing.assert_array_equal(snap.gas.pos, gas.pos[order])
    np.testing.assert_array_equal(snap.gas.u, gas.u[order])
    np.testing.assert_array_equal(snap.gas.immobile, gas.immobile[order])
    assert snap.gas.immobile.dtype == bool
    assert snap.gas.temperature is None


def test_all_dust_gone(tmp_path, rng):
    dust = make_dust(0, 2, rng)
    write_snapshot(tmp_path / "a.h5", load_scene(DISC), 0.0, make_gas(10, 2, rng), dust)
    assert read_snapshot(tmp_path / "a.h5").dust.count == 0


def test_quantities(disc):
    from astropy import constants
    from astropy import units as u

    *_, path = disc
    snap = read_snapshot(path)
    sigma = snap.quantity("gas.density").to_value("g/cm2")
    # 1 Msun/au^2 in g/cm2: 1.98841e33/1.495978707e13^2.
    np.testing.assert_allclose(sigma, snap.gas.density * 8.88497e6, rtol=1e-5)
    assert snap.quantity("time").to_value("yr") == pytest.approx(1.25 / (2 * np.pi), rel=1e-4)  # astropy's own GM
    assert snap.dust.quantity("stopping_time").unit.is_equivalent(u.s)
    assert snap.dust.quantity("stokes").unit == u.dimensionless_unscaled
    c2 = (snap.quantity("gas.sound_speed") ** 2).to("m2/s2")
    expected = (c2 * 2.34 * (constants.m_p + constants.m_e) / constants.k_B).to("K")
    np.testing.assert_allclose(snap.quantity("gas.temperature").to_value("K"), expected.value, rtol=1e-12)
    with pytest.raises(KeyError, match="has no 'u'"):
        snap.quantity("gas.u")


def test_gas_that_carries_small_dust_is_as_warm_as_without(tmp_path):
    """T = mu m_H c_s^2 / k of the gas alone, (H/r)^2 G M / r at 5 au, where half as much small dust as gas weighs with
    it and does not press.
    """
    from astropy import constants
    from astropy import units as u

    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.07, "reference_radius": "5 au", "mean_molecular_weight": 2.1}
    tables = {
        "run": {"until": "1 yr"}, "space": {"size": "40 au"}, "star": {"mass": "1.6 Msun"},
        "initial": {"kind": "disc", "mass": "0.001 Msun", "inner": "5 au", "outer": "15 au"},
        "gas": {"particles": 300, "kernel": "cubic", "eos": eos, "viscosity": {}},
        "dust": {"particles": 200, "ratio": 0.8, "grain_size": "1 mm", "grain_density": "1 g/cm3"},
        "drag": {"law": "epstein"},
        "growth": {"fragmentation_speed": "10 m/s", "alpha": 1e-3, "small_size": "1 um", "small_ratio": 0.5},
    }  # fmt: skip
    sim = Simulation(tables)
    sim._prepare()
    put_out(sim, tmp_path / "0.h5")
    gas = read_snapshot(tmp_path / "0.h5").gas
    np.testing.assert_allclose(gas.small / gas.mass, 1.0 / 3.0, rtol=1e-9)
    speed2 = 0.07**2 * constants.G * 1.6 * u.Msun / (5 * u.au) * (gas.radius / 5.0) ** -0.5
    expected = (speed2 * 2.1 * (constants.m_p + constants.m_e) / constants.k_B).to_value("K")
    np.testing.assert_allclose(gas.temperature, expected, rtol=1e-6)  # of sums of single masses, and units


def test_layout(disc):
    """What readers of the SWIFT layout look for."""
    _, gas, dust, _, path = disc
    with h5py.File(path) as file:
        header = file["Header"].attrs
        assert header["Code"] == b"SWIFT"
        assert header["Dimension"] == [3]
        assert header["Time"].shape == (1,)
        assert list(header["NumPart_ThisFile"]) == [500, 0, 0, 700, 0, 0, 0]
        for group in ("Units", "InternalCodeUnits"):
            assert sorted(file[group].attrs) == [
                "Unit current in cgs (U_I)",
                "Unit length in cgs (U_L)",
                "Unit mass in cgs (U_M)",
                "Unit temperature in cgs (U_T)",
                "Unit time in cgs (U_t)",
            ]
        assert file["Units"].attrs["Unit length in cgs (U_L)"] == pytest.approx(1.495978707e13)
        assert file["Policy"].attrs["cosmological integration"] == [0]
        assert file["Parameters"].attrs["InitialConditions:periodic"] == b"0"
        assert file["Cosmology"].attrs["Cosmological run"] == [0]
        assert {"HydroScheme", "SubgridScheme"} <= set(file)
        assert set(file["PartType0"]) >= {
            "Coordinates", "Masses", "Densities", "SmoothingLengths", "InternalEnergies", "ParticleIDs",
            "Velocities", "SoundSpeeds", "Temperatures",
        }  # fmt: skip
        # Readers make the pressure of ideal gas from its energy.
        gas_file, index = file["PartType0"], file["HydroScheme"].attrs["Adiabatic index"][0]
        made = (index - 1) * gas_file["Densities"][()] * gas_file["InternalEnergies"][()]
        np.testing.assert_allclose(made, gas_file["Pressures"], rtol=1e-12)
        assert "DustDensities" in file["PartType3"]
        assert "Densities" not in file["PartType3"]
        for part, particles in (("PartType0", gas), ("PartType3", dust)):
            coordinates = file[part]["Coordinates"][()]
            assert coordinates.shape == (particles.count, 3)
            assert np.all((coordinates >= 0) & (coordinates <= header["BoxSize"]))
            assert np.all(np.diff(file[part]["ParticleIDs"]) > 0)
        # The quintic kernel reaches 3 h.
        np.testing.assert_array_equal(file["PartType0/SmoothingLengths"], 3 * gas.h[np.argsort(gas.ids)])
        powers = file["PartType0/Densities"].attrs
        assert [powers[f"{b} exponent"][0] for b in ("U_M", "U_L", "U_t", "U_T", "U_I")] == [1, -2, 0, 0, 0]
        sets = []
        file.visititems(lambda _, item: sets.append(item) if isinstance(item, h5py.Dataset) else None)
        assert len(sets) > 15
        assert all(item.fletcher32 for item in sets)


def flipped_bits(path, rng, count):
    """The file's bytes, `count` times, with one bit wrong."""
    content = path.read_bytes()
    for place in rng.integers(0, len(content), count):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        yield


def same(a, b):
    arrays = [
        np.array_equal(array, getattr(b.species[kind], name))
        for kind, particles in a.species.items()
        for name, array in vars(particles).items()
        if isinstance(array, np.ndarray)
    ]
    return a.time == b.time and a.scene_text == b.scene_text and a.units == b.units and all(arrays)


@pytest.mark.parametrize("gamma", [0.5, 2.0])
def test_readers_find_the_pressure_of_a_polytrope(tmp_path, gamma):
    """As (gamma - 1) rho u, with the index of the file."""
    scene = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box", "density": 3.0},
        "gas": {"particles": 30, "eos": {"kind": "polytropic", "gamma": gamma, "constant": 0.7}},
    }  # fmt: skip
    sim = Simulation(scene)
    sim.step(1e-3)
    write_snapshot(tmp_path / "a.h5", sim.scene, sim.time, sim.gas, None)
    with h5py.File(tmp_path / "a.h5") as file:
        gas, index = file["PartType0"], file["HydroScheme"].attrs["Adiabatic index"][0]
        found = (index - 1.0) * gas["Densities"][()] * gas["InternalEnergies"][()]
        np.testing.assert_allclose(found, gas["Pressures"][()], rtol=1e-13)
        np.testing.assert_allclose(gas["Pressures"][()], 0.7 * gas["Densities"][()] ** gamma, rtol=1e-13)


def test_no_flipped_bit_goes_unseen(disc, rng):
    *_, path = disc
    whole, caught = read_snapshot(path), 0
    for _ in flipped_bits(path, rng, 200):
        try:
            read = read_snapshot(path)
        except SnapshotError:
            caught += 1
        else:
            # A bit that nobody needs: padding, or an attribute that is for other readers.
            assert same(whole, read)
    assert caught > 150


def test_every_flipped_bit_of_an_array_is_seen(disc, rng):
    _, gas, *_, path = disc
    content = path.read_bytes()
    start = content.index(gas.mass[np.argsort(gas.ids)].tobytes())
    for place in start + rng.integers(0, gas.mass.nbytes, 30):
        damaged = bytearray(content)
        damaged[place] ^= 16
        path.write_bytes(damaged)
        with pytest.raises(SnapshotError, match="damaged snapshot"):
            read_snapshot(path)


def test_not_a_snapshot(disc, tmp_path):
    *_, path = disc
    content = path.read_bytes()
    for length in (0, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(SnapshotError, match=r"0003\.h5: not a snapshot, or a damaged snapshot"):
            read_snapshot(path)
    with pytest.raises(SnapshotError, match=r"none\.h5: file not found"):
        read_snapshot(tmp_path / "none.h5")
    write_checkpoint(path, {}, {})
    with pytest.raises(SnapshotError, match=r"0003\.h5: a checkpoint, not a snapshot; restore it with Simulation"):
        read_snapshot(path)


def test_a_failed_write_leaves_the_old_file(disc, rng):
    scene, gas, dust, _, path = disc
    before = path.read_bytes()
    with pytest.raises(IndexError):
        write_snapshot(path, scene, 2.0, gas, dust, {"dust": {"stokes": np.ones(3)}})
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["0003.h5"]


GROUPS = {"gas": ("pos", (100, 2)), "dust": ("pos", (0, 2))}
ATTRS = {"time": 0.1 + 0.2, "step": 3, "scene": "title = 'é'\n" * 9000, "merged": True, "note": ""}


def test_checkpoint_bit_for_bit(tmp_path, rng):
    groups = {group: {name: rng.normal(size=shape)} for group, (name, shape) in GROUPS.items()}
    groups["gas"] |= {
        "mask": rng.random(100) > 0.5,
        "ids": rng.permutation(100),
        "odd": np.array([np.nan, -0.0]),
    }
    groups["nothing"] = {}
    write_checkpoint(tmp_path / "c.h5", groups, ATTRS)
    read, attrs = read_checkpoint(tmp_path / "c.h5")
    assert attrs == ATTRS
    assert {name: type(value) for name, value in attrs.items()} == {n: type(v) for n, v in ATTRS.items()}
    assert read.keys() == groups.keys()
    for group, arrays in groups.items():
        assert read[group].keys() == arrays.keys()
        for name, array in arrays.items():
            assert read[group][name].tobytes() == array.tobytes()
            assert read[group][name].dtype == array.dtype
            assert read[group][name].shape == array.shape


def test_checkpoint_damage_is_seen(tmp_path, rng):
    path = tmp_path / "c.h5"
    arrays = rng.normal(size=(500, 2))
    write_checkpoint(path, {"gas": {"pos": arrays}}, {"time": 0.5, "scene": "x" * 500})
    caught = 0
    for _ in flipped_bits(path, rng, 200):
        try:
            groups, attrs = read_checkpoint(path)
        except CheckpointError:
            caught += 1
        else:
            np.testing.assert_array_equal(groups["gas"]["pos"], arrays)
            assert attrs == {"time": 0.5, "scene": "x" * 500}
    assert caught > 100  # the rest is padding: this file is small
    with pytest.raises(CheckpointError, match="file not found"):
        read_checkpoint(tmp_path / "none.h5")
