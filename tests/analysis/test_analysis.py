"""The figures and the analysis of a run's snapshots, from synthetic discs whose surface density is known."""

import csv

import numpy as np
import pytest
import surface_density
from astropy import units as u
from scipy.ndimage import gaussian_filter

from discsim.exact import dustywave, riemann
from discsim.numerics.state import Dust, Gas
from discsim.output.bins import CUTOFF, density_range, gaussians
from discsim.output.fields.base import PlotError
from discsim.output.figure import last_state_figure
from discsim.output.snapshot import SnapshotError, read_snapshot
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

DISC = {
    "title": "Dusty disc",
    "run": {"until": "100 yr"},
    "space": {"size": "260 au", "cells": 64},
    "initial": {"kind": "disc", "mass": "0.1 Msun", "inner": "10 au", "outer": "100 au"},
    "gas": {
        "particles": 500,
        "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05, "reference_radius": "10 au"},
    },
    "dust": {"particles": 700, "ratio": 0.01},
    "star": {"mass": "1 Msun", "accretion_radius": "10 au"},
}
WAVE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "wave"},
    "gas": {"particles": 200, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    "dust": {"particles": 200, "ratio": 1.0},
    "drag": {"law": "constant", "K": 500},
}
SHOCK = {
    "units": {"system": "code"},
    "run": {"until": 0.2},
    "space": {"dimensions": 1, "size": 1.0},
    "initial": {"kind": "shock"},
    "gas": {"particles": 200, "eos": {"kind": "adiabatic", "gamma": 1.4}},
}
SHEET = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "sheet"},
    "gas": {"particles": 4096, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    "self_gravity": {"softening": 0.02},
}


def as_gas(pos, mass, density, rng):
    n, ones = len(pos), np.ones(len(pos))
    zero = np.zeros_like(pos)
    state = {"h": ones, "density": density, "gradh": ones, "pressure": ones, "sound_speed": ones}
    return Gas(pos=pos, vel=zero, acc=zero, mass=mass * ones, ids=rng.permutation(n), **state)


def as_dust(pos, mass, rng):
    zero = np.zeros_like(pos)
    ids, species = rng.permutation(len(pos)), np.zeros(len(pos), int)
    return Dust(pos=pos, vel=zero, acc=zero, mass=mass * np.ones(len(pos)), ids=ids, species=species)


def disc_positions(n, rng, spiral=0.0):
    """Sigma ~ 1/r from 10 to 100, on a spiral of golden angles (hence even), thickened along two arms."""
    r = 10 + 90 * (np.arange(n) + 0.5) / n
    phi = np.arange(n) * np.pi * (3 - np.sqrt(5)) + 0.02 * rng.normal(size=n)
    phi = phi - spiral * np.sin(2 * (phi + 3 * np.log(r)))
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def sheet_positions():
    """64 x 64 particles on a lattice pulled together in the middle of x."""
    pos = np.stack(np.meshgrid(*2 * [(np.arange(64) + 0.5) / 64]), axis=-1).reshape(-1, 2)
    pos[:, 0] += 0.05 * np.sin(2 * np.pi * pos[:, 0])
    return pos


def write_disc(path, n=3000, time=0.0, kinds=("gas", "dust")):
    rng = np.random.default_rng(7)
    gas = as_gas(disc_positions(n, rng, 0.2), 0.1 / n, np.ones(n), rng) if "gas" in kinds else None
    dust = as_dust(disc_positions(2 * n, rng, 0.5), 1e-3 / n / 2, rng) if "dust" in kinds else None
    tables = {table: keys for table, keys in DISC.items() if table in kinds or table not in ("gas", "dust")}
    write_snapshot(path, load_scene(tables), time, gas, dust)


def make_run(directory, kinds=("gas", "dust"), count=3):
    (directory / "snapshots").mkdir(parents=True)
    (directory / "scene.toml").write_text(load_scene(DISC).text)
    for index in range(count):
        write_disc(directory / "snapshots" / f"{index:04}.h5", time=30.0 * index, kinds=kinds)
    return directory


def is_png(path):
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


def test_map_and_profile_hold_the_disc(tmp_path):
    write_disc(tmp_path / "a.h5", 20_000)
    gas = read_snapshot(tmp_path / "a.h5").gas
    edges = np.linspace(20, 90, 15)
    radius = (edges[1:] + edges[:-1]) / 2
    expected = 0.1 / 90 / (2 * np.pi * radius)  # mass per radius over the circumference
    # One spiral of particles, 222 a unit of radius: the ring's ends round by one of 1100.
    found = gas.radial_profile(edges)
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    au = gas.units.quantity(1.0, "length").to_value("au")
    for given in (edges * gas.units.length, (edges * au / 1e3) * u.Unit("1000 au")):
        np.testing.assert_allclose(gas.radial_profile(given), found, rtol=1e-9)
    for wrong, words in ((edges * u.yr, "edges: "), (edges[::-1], "increasing numbers"), ([-1, 2], "radii of 0 or mo")):
        with pytest.raises(PlotError, match=words):
            gas.radial_profile(wrong)
    window = np.array([-120.0, -120.0]), np.array([120.0, 120.0])
    sigma = gas.surface_density_map(*window, 200)
    pixel = 240 / 200
    # The tail of the Gaussians beyond 3.5 widths is cut and made up for; nothing reaches the window's edge.
    assert sigma.sum() * pixel**2 == pytest.approx(0.1, rel=1e-6)
    centres = -120 + pixel * (np.arange(200) + 0.5)
    r = np.hypot(*np.meshgrid(centres, centres))
    ring = (r > 50) & (r < 60)
    assert sigma[ring].mean() == pytest.approx(0.1 / 90 / (2 * np.pi * 55), rel=0.01)
    # The arms are a sine of amplitude .2 * 2; shot noise of 12 neighbours would add more than half of that.
    assert sigma[ring].std() / sigma[ring].mean() == pytest.approx(0.3, abs=0.06)


def test_map_of_a_periodic_sheet(tmp_path):
    """Smooth over the edges of the box, and where the width of the Gaussians changes."""
    rng = np.random.default_rng(3)
    sheet = as_gas(sheet_positions(), 1 / 4096, np.ones(4096), rng)
    write_snapshot(tmp_path / "a.h5", load_scene(SHEET), 0.5, sheet, None)
    gas = read_snapshot(tmp_path / "a.h5").gas
    sigma = gas.surface_density_map(np.zeros(2), np.ones(2), 256, periodic=True)
    start = np.linspace(0, 1, 65)
    x = start + 0.05 * np.sin(2 * np.pi * start)
    exact = np.interp((np.arange(256) + 0.5) / 256, (x[1:] + x[:-1]) / 2, 1 / 64 / np.diff(x))
    # The Gaussians, .03 wide, blur (2 pi .03)^2/2 = 2% of the amplitude; pixels round places by 1/512: 1%.
    np.testing.assert_allclose(sigma, np.broadcast_to(exact[:, None], sigma.shape), rtol=0.03)
    assert sigma.mean() == pytest.approx(1.0)


def test_map_of_a_single_particle(tmp_path):
    rng = np.random.default_rng(1)
    write_snapshot(tmp_path / "a.h5", load_scene(DISC), 0.0, None, as_dust(np.array([[3.0, -7.0]]), 2.0, rng))
    dust = read_snapshot(tmp_path / "a.h5").dust
    sigma = dust.surface_density_map(np.array([-10.0, -10.0]), np.array([10.0, 10.0]), 20)
    assert sigma.sum() == pytest.approx(2.0)
    assert np.unravel_index(sigma.argmax(), sigma.shape) == (13, 3)


@pytest.mark.parametrize("sigma", [1.0, 7.3])
def test_gaussians_one_by_one_are_those_of_the_filter(sigma):
    """Cut at as many pixels, and open at the edges; to the rounding of sums of five numbers below 1."""
    rng = np.random.default_rng(5)
    shape, mass = (40, 23), rng.random(5)
    cell = rng.integers(0, shape, (5, 2))
    cell[1] = cell[0]  # two in one pixel
    deposit = np.zeros(shape)
    np.add.at(deposit, tuple(cell.T), mass)
    expected = gaussian_filter(deposit, sigma, mode="constant", truncate=CUTOFF)
    np.testing.assert_allclose(gaussians(cell, mass, sigma, shape), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kinds", [("gas", "dust"), ("gas",), ("dust",)])
def test_figure_of_a_disc(tmp_path, kinds):
    write_disc(tmp_path / "a.h5", kinds=kinds)
    last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert is_png(tmp_path / "a.png")


def test_figure_of_a_wave(tmp_path):
    rng = np.random.default_rng(3)
    x = (np.arange(200) + 0.5) / 200
    wave = dustywave.solution(x, 0.3, 500, 1.0)
    gas, dust = as_gas(x[:, None], 1 / 200, wave.gas_density, rng), as_dust(x[:, None], 1 / 200, rng)
    gas.vel, dust.vel = wave.gas_velocity[:, None], wave.dust_velocity[:, None]
    write_snapshot(tmp_path / "a.h5", load_scene(WAVE), 0.3, gas, dust)
    last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert is_png(tmp_path / "a.png")


def test_figure_of_a_shock(tmp_path):
    rng = np.random.default_rng(3)
    x = np.linspace(-0.6, 0.6, 300)
    tube = riemann.solution(x, 0.15)
    gas = as_gas(x[:, None], 1 / 200, tube.density, rng)
    gas.vel, gas.u, gas.immobile = tube.velocity[:, None], np.ones(300), np.abs(x) > 0.5
    write_snapshot(tmp_path / "a.h5", load_scene(SHOCK), 0.15, gas, None)
    last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert is_png(tmp_path / "a.png")


def test_figure_of_a_sheet(tmp_path):
    """No centre, hence no profile; and an almost uniform density must not be drawn as noise."""
    rng = np.random.default_rng(3)
    pos = sheet_positions()
    write_snapshot(tmp_path / "a.h5", load_scene(SHEET), 0.5, as_gas(pos, 1 / 4096, np.ones(4096), rng), None)
    last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert is_png(tmp_path / "a.png")


def test_range_of_mass():
    """The last per cent of the mass, outliers and zeros do not set the colours."""
    sigma = np.append(np.full(1000, 5.0), [0.0, 1e-9, 5.0])
    low, high = density_range(sigma)
    assert (low, high) == pytest.approx((5 / 1.05, 5 * 1.05))
    low, high = density_range(np.logspace(-9, 0, 1000))
    assert high == pytest.approx(1.0)
    # 99% of a geometric series is in its last two decades.
    assert low == pytest.approx(0.5e-2, rel=0.05)
    assert density_range(np.zeros(4)) == (0.1, 1.0)


def test_a_small_clump_does_not_set_the_colour_scale():
    """A clump with 11% of the mass in one pixel of 10,000; the median of the mass is 2."""
    sigma = np.append(np.full(9999, 2.0), 2500.0)
    assert density_range(sigma)[1] == 2500.0
    assert density_range(sigma, clump=30.0)[1] == 60.0


def test_figure_of_a_damaged_snapshot(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"nothing")
    with pytest.raises(SnapshotError):
        last_state_figure(tmp_path / "a.h5", tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("kinds", [("gas", "dust"), ("gas",), ("dust",)])
def test_surface_density(tmp_path, capsys, kinds):
    run, out = make_run(tmp_path / "run", kinds), tmp_path / "out"
    assert surface_density.main([str(run), "-o", str(out), "--rings", "20"]) == 0
    assert "3 snapshots" in capsys.readouterr().out
    for name in ("profiles", "map", "radius-time"):
        assert is_png(out / f"run-{name}.png")
    with (out / "run-profiles.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 20
    assert {name for name in rows[0] if name.startswith("sigma")} == {f"sigma_{kind}_g_cm2" for kind in kinds}
    near = [row for row in rows if 40 < float(row["radius_au"]) < 60]
    for row in near:
        mass = {"gas": 0.1, "dust": 1e-3}
        for kind in kinds:
            # 1 Msun/au^2 = 8.885e6 g/cm2; a ring of 5.7 au at 1/r: its mean is that of its middle.
            expected = 8.885e6 * mass[kind] / 90 / (2 * np.pi * float(row["radius_au"]))
            assert float(row[f"sigma_{kind}_g_cm2"]) == pytest.approx(expected, rel=0.01)
    assert max(float(row["time_yr"]) for row in rows) == pytest.approx(60 / (2 * np.pi), rel=1e-4)


def test_surface_density_of_a_quiet_start_is_smooth(tmp_path):
    """Particles on rings 1.6 au apart, as in a disc of 10^4: Sigma ~ 1/r, by default and with a given width."""
    rings = np.arange(10.8, 100.0, 1.6)
    count = np.round(2 * np.pi * rings / 1.6 * 50 / rings).astype(int)  # Sigma ~ 1/r, 196 particles a ring
    radius = np.repeat(rings, count)
    angle = np.concatenate([2 * np.pi * np.arange(n) / n for n in count])
    pos = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    run, scene = tmp_path / "run", load_scene(DISC)
    (run / "snapshots").mkdir(parents=True)
    (run / "scene.toml").write_text(scene.text)
    write_snapshot(
        run / "snapshots/0000.h5",
        scene,
        0.0,
        as_gas(pos, 0.1 / len(pos), np.ones(len(pos)), np.random.default_rng(3)),
        None,
    )

    def residuals(*options):
        assert surface_density.main([str(run), "-o", str(tmp_path / "out"), *options]) == 0
        rows = list(csv.DictReader((tmp_path / "out/run-profiles.csv").read_text().splitlines()))
        r, sigma = (np.array([float(row[name]) for row in rows]) for name in ("radius_au", "sigma_gas_g_cm2"))
        shown = (r > 25) & (r < 85)
        return (sigma * r)[shown] / (8.885e6 * 0.1 / (2 * np.pi * 1.6 * len(rings))) - 1

    # exp(-2 pi^2 s^2) of twice the mean for s = 0.6 rings is 0.2%; n^(-1/2) falls from 1.1 to 2.1 au, s from 0.41: 3%.
    assert np.abs(residuals()).max() < 0.08
    assert np.abs(residuals("--smooth", "2 au")).max() < 0.01  # the mean of 1/r over 2 au at r = 25: 0.6%
    assert np.abs(residuals("--rings", "200")).max() > 0.5
    np.testing.assert_array_equal(residuals("--smooth", "3e8 km"), residuals("--smooth", str(3e8 / 149597870.7)))


@pytest.mark.parametrize(
    ("text", "message"),
    [("0.001 au", "expected 0.02"), ("2 s", "a time; expected a length"), ("2 aus", "unknown unit")],
)
def test_surface_density_refuses_a_wrong_width(tmp_path, capsys, text, message):
    run = make_run(tmp_path / "run", count=1)
    assert surface_density.main([str(run), "-o", str(tmp_path / "out"), "--smooth", text]) == 2
    said = capsys.readouterr().err
    assert message in said and said.startswith("surface_density: --smooth") and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_surface_density_of_one_snapshot(tmp_path):
    run = make_run(tmp_path / "run", count=1)
    assert surface_density.main([str(run)]) == 0
    assert is_png(run / "run-radius-time.png")


@pytest.mark.parametrize("fault", ["absent", "empty", "damaged", "one dimension"])
def test_surface_density_refuses(tmp_path, capsys, fault):
    run = tmp_path / "run"
    if fault != "absent":
        (run / "snapshots").mkdir(parents=True)
        (run / "scene.toml").write_text(load_scene(WAVE).text)
    if fault == "damaged":
        (run / "snapshots" / "0000.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    if fault == "one dimension":
        dust = as_dust(np.array([[0.5]]), 1.0, np.random.default_rng(1))
        write_snapshot(run / "snapshots" / "0000.h5", load_scene(WAVE), 0.0, None, dust)
    assert surface_density.main([str(run), "-o", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert str(run) in message
    assert not (tmp_path / "out").exists()
