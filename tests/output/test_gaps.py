"""Edges of gaps, Hill radii and orbits of companions in snapshots, where they are known in closed form."""

import math

import numpy as np
import planets
import pytest
from planets import AXIS, RATIO

from discsim.formulas.companions import gap_width, hill_radius
from discsim.output import gaps
from discsim.output.snapshot import read_snapshot
from discsim.physics import companions
from discsim.scene import load_scene

RING = 4.0 ** (1.0 / gaps.RINGS) - 1.0  # width of a ring over its radius


def test_the_hill_radius_is_where_tide_and_planet_balance():
    """In the frame of the planet the tide 3 G M d / r^3 of star and rotation is as strong as G m / d^2."""
    hill = hill_radius(5.2, 3e-4)
    assert 3.0 * hill / 5.2**3 == pytest.approx(3e-4 / hill**2, rel=1e-12)
    scene = load_scene({**base(), "companion": {"mass": 4.8e-4, "semi_major_axis": 5.2, "softening": 0.6}})
    assert companions.hill_radius(scene, scene.table("companion")[0]) == pytest.approx(hill, rel=1e-12)


def base():
    return {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 20.0}, "star": {"mass": 1.6},
        "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 1.0, "outer": 8.0},
        "gas": {"particles": 500, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    }  # fmt: skip


def test_the_width_of_a_gap_is_that_of_kanagawa_et_al():
    """0.33 a at q = 1e-3, H/r = 1/20 and alpha = 0.01; proportional to q^(1/2) (H/r)^(-3/4) alpha^(-1/4)."""
    assert gap_width(1e-3, 0.05, 0.01) == pytest.approx(0.41 * 0.0316228 * 9.457416 * 3.162278, rel=1e-5)
    assert gap_width(4e-3, 0.05 * 16, 0.01 * 81) == pytest.approx(gap_width(1e-3, 0.05, 0.01) * 2 / 8 / 3, rel=1e-12)


@pytest.mark.parametrize("depth", [0.05, 0.3])
def test_edges_of_a_gap_are_where_half_of_the_start_is_left(tmp_path, depth):
    """A Gaussian gap has them at a +- width sqrt(2 ln((1 - depth) / 0.5)); the planet's own disc changes nothing."""
    width = 0.2
    run = planets.write_gap_run(tmp_path / "run", depth, width)
    start, snap = (read_snapshot(run / "snapshots" / f"{k:04}.h5") for k in (0, 1))
    (planet,) = gaps.companion_orbits(snap)
    half = width * math.sqrt(2.0 * math.log((1.0 - depth) / 0.5))
    # Smoothing over two rings of 0.9% of the radius lowers the depth of this gap by 1%, and 200 particles a ring
    # scatter by less than 1%, as they are evenly spread. The slope at the edge is at least 0.7 / width.
    assert gaps.planet_gap(start, snap, planet) == pytest.approx((AXIS - half, AXIS + half), abs=RING * AXIS)


def test_a_gap_shallower_than_half_has_no_edges(tmp_path):
    run = planets.write_gap_run(tmp_path / "run", depth=0.6)
    start, snap = (read_snapshot(run / "snapshots" / f"{k:04}.h5") for k in (0, 1))
    (planet,) = gaps.companion_orbits(snap)
    assert np.isnan(gaps.planet_gap(start, snap, planet)).all()


def test_a_ridge_along_the_orbit_is_within_the_gap():
    """Horseshoe orbits keep gas at the orbit itself; the edges are those of the whole gap, interpolated."""
    radius = np.linspace(0.7, 1.9, 241)
    away = np.abs(radius - AXIS)
    left = np.where(away < 0.03, 0.9, np.clip((away - 0.1) / 0.2, 0.1, 1.0))  # 0.5 at a distance of 0.2
    assert gaps.gap_edges(radius, left, AXIS, 0.15) == pytest.approx((AXIS - 0.2, AXIS + 0.2), abs=1e-12)


def test_a_gap_that_reaches_the_end_of_the_disc_has_one_edge():
    radius = np.linspace(0.7, 1.9, 241)
    left = np.where(radius < 0.9, np.nan, np.clip((radius - 1.2) / 0.6, 0.1, 1.0))
    inner, outer = gaps.gap_edges(radius, left, AXIS, 0.15)
    assert math.isnan(inner) and outer == pytest.approx(1.5, abs=1e-12)


def test_orbits_are_those_of_the_bodies(tmp_path):
    """An eccentric planet away from its apsides, and a star that flies by, about a star that is not at the origin."""
    orbits = [(1.6 * RATIO, 1.3, 0.35, 2.0, 0.7), (0.4, 2.2, 1.8, 0.5, -1.0)]
    bodies = planets.bodies_of(1.6, orbits, shift=(0.3, -0.2))
    text = planets.SCENE.replace("mass = 1.6", 'mass = 1.6\nframe = "inertial"') + 2 * planets.PLANET
    path = planets.write(tmp_path / "0000.h5", text, 0.0, planets.gas_of(planets.even(50), 1e-6), None, bodies)
    planet, star = gaps.companion_orbits(read_snapshot(path).about_centre())
    assert (planet.radius, planet.eccentricity, planet.ratio) == pytest.approx((1.3, 0.35, RATIO), rel=1e-9)
    r = 1.3 * (1.0 - 0.35**2) / (1.0 + 0.35 * math.cos(2.0))
    assert planet.hill == pytest.approx(r * (RATIO / 3.0) ** (1.0 / 3.0), rel=1e-9)
    assert planet.place == pytest.approx((r * math.cos(2.7), r * math.sin(2.7)), rel=1e-9)
    assert planet.is_planet and not star.is_planet
    assert star.radius == pytest.approx(2.2 * (1.8**2 - 1.0) / (1.0 + 1.8 * math.cos(0.5)), rel=1e-9)
    assert star.eccentricity == 0.0


def test_a_second_star_is_as_far_from_the_barycentre_as_its_mass_says(tmp_path):
    bodies = planets.bodies_of(1.6, [(0.4, 1.5, 0.2, 1.1, 0.3)], shift=(0.1, 0.4))
    text = planets.SCENE.replace("mass = 1.6", 'mass = 1.6\nframe = "inertial"\ncentre = "barycentre"')
    text += planets.PLANET.replace("3.2e-3", "0.4")
    path = planets.write(tmp_path / "0000.h5", text, 0.0, planets.gas_of(planets.even(50), 1e-6), None, bodies)
    (star,) = gaps.companion_orbits(read_snapshot(path).about_centre())
    assert (star.radius, star.eccentricity) == pytest.approx((1.5 * 1.6 / 2.0, 0.2), rel=1e-9)
