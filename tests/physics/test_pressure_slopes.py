"""Slopes of the pressure: integrated over height, which moves a razor-thin disc, and in the midplane."""

import numpy as np
import pytest
from runs import put_out
from scenes import changed

from discsim import Simulation, load_scene
from discsim.physics import growth
from discsim.physics.given_disc import PrescribedDisc
from discsim.physics.profile import kepler_omega, pressure_slopes
from discsim.preview.derived import derived_rows, gas_at_start

R = np.array([0.9, 1.3, 2.2])


def disc(p=0.8, q=0.7, **more):
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.07, "temperature_index": q, "reference_radius": 2.0}
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 9.0},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 0.6, "outer": 3.0, "surface_density_index": p},
        "gas": {"particles": 2000, "eos": eos},
        "star": {"mass": 1.4},
    } | more


def test_the_midplane_of_power_laws_is_steeper():
    """P ~ r^-(p + q) over height and r^-(p + q/2 + 3/2) in the midplane, as Sigma c_s Omega: 1.5 and 2.75 usually."""
    for p, q in ((0.8, 0.7), (1.0, 0.5)):
        whole, midplane = pressure_slopes(load_scene(disc(p, q)), R)
        np.testing.assert_allclose(whole, p + q, rtol=1e-12)
        np.testing.assert_allclose(midplane, p + 0.5 * q + 1.5, rtol=1e-7)  # SLOPE^2 of a central difference


@pytest.mark.parametrize("gamma", [1.4, 2.5])
def test_slopes_of_a_polytrope(gamma):
    """P = K Sigma^gamma; c_T^2 = P / Sigma ~ r^-((gamma - 1) p)."""
    eos = {"kind": "polytropic", "gamma": gamma, "constant": 0.3}
    tables = disc()
    tables["gas"] = {"particles": 2000, "eos": eos}
    given = {"surface_density": 0.02, "surface_density_index": 0.8, "eos": eos}
    dust = {"particles": 10, "ratio": 0.1}
    drag = {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}
    beside = changed(tables, gas=None) | {"background": given, "dust": dust, "drag": drag}
    for scene in load_scene(tables), load_scene(beside):
        whole, midplane = pressure_slopes(scene, np.append(R, 3.0))  # to the outer edge
        np.testing.assert_allclose(whole, 0.8 * gamma, rtol=1e-12)
        np.testing.assert_allclose(midplane, 0.8 * gamma + 1.5 - 0.4 * (gamma - 1.0), rtol=1e-7)


def test_slopes_on_a_bump_of_a_given_disc():
    """By differences of P and of P / (sqrt(2 pi) H), about a softened star."""
    background = {"surface_density": 0.02, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.06}}
    tables = changed(disc(), gas=None, star={"softening": 0.5}) | {
        "background": background | {"bump": {"radius": 1.3, "width": 0.2, "height": 0.9}},
        "dust": {"particles": 10, "ratio": 0.1},
        "drag": {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"},
    }
    scene = load_scene(tables)
    given = PrescribedDisc(scene)

    def logs(r):
        pressure = given.surface_density(r) * given.thermal_speed(r) ** 2
        return np.log([pressure, pressure * kepler_omega(scene, r) / given.thermal_speed(r)])

    expected = -(logs(R * 1.00001) - logs(R / 1.00001)) / (2.0 * np.log(1.00001))
    np.testing.assert_allclose(pressure_slopes(scene, R), expected, rtol=1e-6, atol=1e-6)


def test_slopes_of_a_snapshot_are_those_of_its_rings(tmp_path):
    """A start without functions of the radius: the slopes of its rings, within their width and noise."""
    sim = Simulation(disc())
    put_out(sim, tmp_path / "a.h5")
    scene = load_scene(disc(initial={"kind": "snapshot", "file": str(tmp_path / "a.h5")}))
    at = gas_at_start(scene)
    wanted = 0.01 * 1.2 / (2.0 * np.pi) / (3.0**1.2 - 0.6**1.2) * at.radius**-0.8
    np.testing.assert_allclose(at.density, wanted, rtol=0.05)  # a ring of particles more or less
    whole, midplane = pressure_slopes(scene, np.array([1.0, 1.6, 2.3]))
    np.testing.assert_allclose(whole, 1.5, atol=0.15)
    np.testing.assert_allclose(midplane - whole, 1.15, atol=1e-7)


def test_rings_of_a_snapshot_have_the_masses_of_their_own_particles(tmp_path):
    """Particles come in no order of radius, and those beyond 1.7 have .3 of the others' mass."""
    sim = Simulation(disc())
    gas = sim.state.gas
    gas.mass[np.hypot(*gas.pos.T) > 1.7] *= 0.3
    gas.ids[:] = np.random.default_rng(4).permutation(gas.ids)
    put_out(sim, tmp_path / "a.h5")
    at = gas_at_start(load_scene(disc(initial={"kind": "snapshot", "file": str(tmp_path / "a.h5")})))
    wanted = 0.01 * 1.2 / (2.0 * np.pi) / (3.0**1.2 - 0.6**1.2) * at.radius**-0.8
    wanted[at.radius > 1.7] *= 0.3
    away = np.abs(at.radius - 1.7) > 0.2  # from the ring with both
    np.testing.assert_allclose(at.density[away], wanted[away], rtol=0.05)  # a ring of particles more or less
    assert (at.radius[away] > 1.7).any() and (at.radius[away] < 1.7).any()


def test_check_has_the_headwind_of_both():
    """eta v_K = (H/r)^2 v_K / 2 times the slope, at the places that `check` names."""
    tables = disc()
    scene = load_scene(tables)
    at, rows = gas_at_start(scene), dict(derived_rows(scene))
    unit = 0.5 * at.thermal_speed**2 / (at.radius * at.omega)
    for name, slope in (("headwind eta v_K", 1.5), ("headwind from midplane pressure", 2.65)):
        found = [float(word) for word in rows[name].split(", ")]
        np.testing.assert_allclose(found, slope * unit, rtol=1e-3)  # digits of the text


def test_the_drift_limit_of_growth_has_the_pressure_that_moves_the_gas(tmp_path):
    """Also of a start from a snapshot: 2 Sigma_d (v_K / c_s)^2 / (pi rho_s gamma), gamma = p + q, no midplane's."""
    more = {
        "dust": {"particles": 2000, "ratio": 0.03, "grain_size": 1e-5, "grain_density": 1.7},
        "drag": {"law": "epstein"},
        "growth": {"fragmentation_speed": 1.0, "alpha": 1e-3, "small_size": 1e-8},
    }
    sim = Simulation(disc(**more))
    put_out(sim, tmp_path / "a.h5")
    again = disc(**more, initial={"kind": "snapshot", "file": str(tmp_path / "a.h5")})
    for tables, near in ((disc(**more), 1e-9), (again, 0.1)):
        scene = load_scene(tables)
        at = gas_at_start(scene)
        found = growth.limits(scene, at).drift
        wanted = 2.0 * 0.03 * at.density * (at.radius * at.omega / at.thermal_speed) ** 2 / (np.pi * 1.7 * 1.5)
        np.testing.assert_allclose(found, wanted, rtol=near)  # noise of rings
