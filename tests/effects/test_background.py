"""Dust in a given gas disc: drift at any stopping time, and scenes that may name [background]."""

import itertools

import drift as study
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from discsim import Simulation
from discsim.kernels.dust import background as kernels
from discsim.physics.given_disc import PrescribedDisc
from discsim.preview.derived import derived_rows
from discsim.preview.forecast import forecast
from discsim.preview.warnings import warnings
from discsim.scene import SceneError, load_scene


def scene(stokes=0.1, aspect=0.005, particles=8, **tables):
    eos = {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0}
    base = {
        "units": {"system": "code"},
        "run": {"until": 20 * np.pi, "courant": 0.03},
        "space": {"size": 4.0},
        "background": {"surface_density": 1e-4, "eos": eos},
        "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.99, "outer": 1.01},
        "dust": {"particles": particles, "ratio": 0.01},
        "star": {"mass": 1.0},
        "drag": {"law": "stokes-number", "stokes": stokes, "direction": "one-way"},
    }
    return base | tables


def test_a_force_may_name_gas_that_is_not_there():
    """It acts on the dust: the grain at rest beside one without it has gained what the force gives."""
    pushed, left = Simulation(scene(external={"dust": [0.0, 1e-3]})), Simulation(scene())
    for sim in (pushed, left):
        sim.operators.forces()
    np.testing.assert_allclose(pushed.dust.acc - left.dust.acc, [[0.0, 1e-3]] * 8, rtol=0, atol=1e-15)  # rounding at 1


LINEAR = [({"law": "stokes-number", "stokes": stokes}, {}) for stokes in (1e-6, 1e-3, 0.1, 1.0, 10.0, 1e3, 1e6)]
SIZES = [({"law": "epstein-stokes"}, {"grain_size": s, "grain_density": "3 g/cm3"}) for s in ("1 mm", "1 m", "1 km")]


@pytest.mark.parametrize(("drag", "grains"), LINEAR + SIZES)
def test_drift(drag, grains):
    """At the default step, .3/Omega at the inner edge, and H/r = .05 to .07; NSH's is of first order in (H/r)^2."""
    _, errors = study.background_errors(drag, grains)
    assert np.abs(errors).max() < 0.005


def exact(start, until, stokes):
    """Place and velocity of a grain in the gas of `scene`, by scipy; `start` is (x, y, vx, vy)."""

    def slope(_, z):
        r2 = z[0] ** 2 + z[1] ** 2
        kepler = r2**-0.75
        orbit = kepler * np.sqrt(1 - 2 * 0.1**2)  # p = q = 1, H/r = .1
        wind = np.array([-z[1], z[0]]) * orbit - z[2:]
        return np.concatenate([z[2:], -(kepler**2) * z[:2] + kepler / stokes * wind])

    return solve_ivp(slope, (0.0, until), start, rtol=1e-12, atol=1e-13).y[:, -1]


@pytest.mark.parametrize("softening", [0.0, 0.45])
def test_slips_of_a_drift_have_the_vorticity_of_the_gas(softening):
    """Drag turns grains as they fall, w = -v t B with B = (1/r) d(r v_g)/dr of the gas, about a softened star too."""
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.09, "temperature_index": 0.7}
    gas = {"surface_density": 1e-4, "surface_density_index": 1.4, "eos": eos}
    disc = Simulation(scene(0.3, star={"mass": 1.3, "softening": softening}, background=gas)).effects["drag"]

    def path(r):
        return kernels.path_at(0.6 * r, 0.8 * r, 0, disc.kernel_disc(1.3))

    for r in (0.6, 1.1, 2.3):
        here, near, far = path(r), path(r * (1 - 1e-4)), path(r * (1 + 1e-4))
        vorticity = (far.r * far.orbit - near.r * near.orbit) / (2e-4 * r * r)
        assert here.slip < 0.0
        assert here.azimuthal == pytest.approx(-here.slip * here.time * vorticity, rel=1e-6)  # differences over 2e-4 r


@pytest.mark.parametrize("stokes", [0.3, 3.0, 1e4])
def test_any_orbit_is_second_order_in_the_step(stokes):
    """A grain thrown off its drift, with a tenth of the speed of its orbit."""
    start = np.array([1.0, 0.0, 0.1, 0.95])
    errors = []
    for dt in (0.1, 0.05):
        tables = scene(stokes, 0.1, 1, run={"until": 2.0, "timestep": dt}, initial=None)
        tables = {key: value for key, value in tables.items() if value is not None}
        given = {"pos": start[None, :2], "vel": start[None, 2:], "mass": np.array([1e-9])}
        sim = Simulation(tables, particles={"dust": given})
        sim.run()
        found = np.concatenate([sim.dust.pos[0], sim.dust.vel[0]])
        errors.append(np.abs(found - exact(start, 2.0, stokes)).max())
    assert errors[0] < 0.01
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_what_feels_no_drag_keeps_its_angular_momentum():
    """On an eccentric orbit, at steps that change: it is a variable of the scheme."""
    tables = scene(1e12, particles=1)
    del tables["initial"]
    given = {"pos": np.array([[1.0, 0.0]]), "vel": np.array([[0.0, 1.3]]), "mass": np.array([1e-9])}
    sim = Simulation(tables | {"run": {"until": 1e3}}, particles={"dust": given})
    far = []
    for k in range(400):
        sim.step(0.1 + 0.1 * np.sin(k))
        far.append(np.hypot(*sim.dust.pos[0]))
    spin = sim.dust.pos[0, 0] * sim.dust.vel[0, 1] - sim.dust.pos[0, 1] * sim.dust.vel[0, 0]
    assert spin == pytest.approx(1.3, rel=1e-11)  # drag takes 1e-12 in a turn; rounding of 400 steps
    assert max(far) == pytest.approx(1.69 / 0.31, rel=0.01)  # e = .69


def test_kicks_compose():
    """A kick cut in two by somebody who looks ends where the whole one does, to rounding."""
    whole, cut = (Simulation(scene(0.5, run={"until": 1.0, "timestep": 0.02})) for _ in range(2))
    whole.evolve(0.4)
    whole.run(until=0.4)
    for _ in range(20):
        cut.step()
    assert whole.time == pytest.approx(cut.time)
    np.testing.assert_allclose(whole.dust.vel, cut.dust.vel, rtol=0, atol=1e-14)


def test_epstein_in_the_given_density():
    tables = scene()
    tables["drag"] = {"law": "epstein", "direction": "one-way"}
    tables["dust"] = {"particles": 50, "ratio": 0.01, "grain_size": 1e-6, "grain_density": 2.0}
    sim = Simulation(tables)
    found = sim.effects["drag"].current_stopping_times(sim.state)
    r = np.sqrt((sim.dust.pos**2).sum(axis=1))
    # t = (pi/2) s rho_s / (Sigma Omega).
    np.testing.assert_allclose(found, 2e-6 * 0.5 * np.pi / (1e-4 / r * r**-1.5), rtol=1e-12)


@pytest.mark.parametrize(
    ("eos", "pressure"),
    [
        ({"kind": "isothermal", "sound_speed": 0.03}, lambda r, sigma: 0.03**2 * sigma),
        (
            {"kind": "locally-isothermal", "aspect_ratio": 0.03, "temperature_index": 0.4, "reference_radius": 1.9},
            lambda r, sigma: 0.03**2 / 1.9 * (r / 1.9) ** -0.4 * sigma,
        ),
        ({"kind": "polytropic", "gamma": 1.5, "constant": 0.1}, lambda r, sigma: 0.1 * sigma**1.5),
    ],
    ids=lambda eos: eos["kind"] if isinstance(eos, dict) else "",
)
def test_given_gas_of_any_kind_is_in_balance(eos, pressure):
    """f c_T^2 / r is -(1/Sigma) dP/dr with c_T^2 = P / Sigma; c_s^2 is dP/dSigma at constant entropy."""
    background = {"surface_density": 0.01, "surface_density_index": 1.3, "eos": eos}
    disc = PrescribedDisc(load_scene(scene(background=background)))
    r, dr = np.array([0.5, 1.0, 3.0]), 1e-5
    sigma = disc.surface_density(r)
    np.testing.assert_allclose(sigma, 0.01 * r**-1.3)
    slope = (pressure(r + dr, disc.surface_density(r + dr)) - pressure(r - dr, disc.surface_density(r - dr))) / (2 * dr)
    thermal2 = disc.thermal_speed(r) ** 2
    np.testing.assert_allclose(thermal2, pressure(r, sigma) / sigma, rtol=1e-12)
    np.testing.assert_allclose(disc.laws[4] * thermal2 / r, -slope / sigma, rtol=1e-8)  # dr^2 / r^2
    stiffness = (pressure(r, 1.0001 * sigma) - pressure(r, 0.9999 * sigma)) / (0.0002 * sigma)
    np.testing.assert_allclose(disc.sound_speed(r) ** 2, stiffness, rtol=1e-8)


def test_nothing_of_the_gas_is_made():
    sim = Simulation(scene())
    assert sim.gas is None and sim.state.grid is None and "gas" not in sim.effects


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gas": {"particles": 9, "eos": {"kind": "isothermal", "sound_speed": 1.0}}}, "[gas] is also given"),
        ({"drag": {"law": "stokes-number", "stokes": 0.1}}, 'set drag.direction = "one-way"'),
        ({"drag": {"law": "stokes-number", "stokes": 0.1, "direction": "one-way", "scheme": "tsc"}}, "no drag cells"),
        ({"star": None}, "add a table [star]"),
        ({"drag": None}, "add a table [drag]"),
        ({"space": {"size": 4.0, "boundary": "periodic"}}, "[background] is a 2D disc"),
        ({"run": {"until": 1.0, "integrator": "euler"}}, '"kdk"'),
    ],
)
def test_scenes_that_cannot_be(change, message):
    tables = {key: value for key, value in (scene() | change).items() if value is not None}
    with pytest.raises(SceneError) as caught:
        load_scene(tables)
    assert message in str(caught.value)


TABLES = {
    "companion": [{"mass": 1e-3, "semi_major_axis": 1.4, "softening": 0.6, "ramp": 0.2, "orbit": "live"}],
    "alpha_viscosity": {"inner_alpha": 0.0, "outer_alpha": 0.01, "radius": 1.6, "width": 1e-3},
    "dust_diffusion": {"alpha": 0.01},
    "damping": {"inner": [0.9, 1.0]},
    "radiation_pressure": {"beta": 0.1},
    "self_gravity": {"softening": 0.1},
    "external": {"dust": [0.0, 0.01]},
    "bump": {"radius": 1.2, "width": 0.1, "height": 0.5},
    "gap": {"radius": 1.4, "width": 0.1, "depth": 0.5},
    "isothermal": {"kind": "isothermal", "sound_speed": 0.07},
    "polytropic": {"kind": "polytropic", "gamma": 1.4, "constant": 0.02},
    "sizes": {"grain_size": {"smallest": 1e-6, "largest": 1e-4, "bins": 3}, "grain_density": 2.0},
}


@pytest.mark.parametrize("pair", [*itertools.combinations(TABLES, 2)], ids="-".join)
def test_any_two_tables_go_with_a_given_disc(pair):
    """Check, its warnings, the forecast and steps take the given gas where there is no other."""
    tables = scene()
    given = dict(tables["background"])
    for name in pair:
        if name in ("bump", "gap"):
            given[name] = TABLES[name]
        elif name in ("isothermal", "polytropic"):
            given["eos"] = TABLES[name]
        elif name == "sizes":
            tables["dust"] = tables["dust"] | TABLES[name]
            tables["drag"] = {"law": "epstein", "direction": "one-way"}
        else:
            tables[name] = TABLES[name]
    held = load_scene(tables | {"background": given, "run": {"until": 0.1}, "space": {"size": 4.0, "cells": 32}})
    assert derived_rows(held) and forecast(held) is not None
    for line in warnings(held):
        assert "\n" not in line
    sim = Simulation(held)
    sim.step()
    assert np.isfinite(sim.dust.vel).all()
