"""Every effect about a tight pair of stars against one star of the same mass, and a central mass that changes."""

import numpy as np
import pytest
from pair import EFFECTS, FIRST, GRAINS, LOCALLY, PASSIVE, SECOND, SOFT, differences, found, run, scene

from discsim import Simulation, read_snapshot
from discsim.initial import start_of
from discsim.output.snapshot_writer import write_snapshot
from discsim.parts import EFFECTS as ALL
from discsim.preview.derived import derived_rows
from discsim.scene import load_scene

BOTH = FIRST + SECOND
# The quadrupole of the pair is 3/4 M_1 M_2 / M^2 (a / r)^2 of the pull, 3.3e-4 at r = 1, of which velocities have half:
# found up to 1.4e-4.
SAME = 1e-3


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "drag, Stokes regime" else name for name in EFFECTS]
)
def test_an_effect_about_a_pair_is_that_about_one_star(name):
    """Energies, velocities, Stokes numbers, cooling, viscosity, sizes: by rings, after some of every effect's time."""
    off = differences(run(True, **EFFECTS[name]), run(False, **EFFECTS[name]))
    assert max(off.values()) < SAME, off


def test_every_effect_that_can_be_is_about_a_pair():
    given = {table for tables in EFFECTS.values() for table in scene(True, **tables)}
    # Without a star's part in them, and what needs the star at the origin.
    assert given | {"external", "background", "shearing_box"} >= {name.split(".")[0] for name in ALL}


@pytest.mark.parametrize("name", EFFECTS)
def test_check_tells_of_a_pair_what_it_tells_of_one_star(name):
    """To the four digits that it prints."""
    pair, star = (dict(derived_rows(load_scene(scene(pair, **EFFECTS[name])))) for pair in (True, False))
    own = {row: text for row, text in pair.items() if not row.startswith("companion")}
    assert own == star


@pytest.mark.parametrize("ramp", [0.0, 0.7])
def test_a_disc_turns_about_both_masses_from_the_start(ramp):
    """With a ramp they are one at the barycentre at first, then a pair: v_phi stays what it is at each radius."""
    tables = EFFECTS["cooling, beta"]
    star = run(False, until=1.4, **tables)
    sim = Simulation(scene(True, ramp=ramp, until=1.4, **tables))
    assert sim.state.central_mass == pytest.approx(BOTH, rel=1e-15)
    assert sim.bodies.felt.sum() == pytest.approx(BOTH, rel=1e-15)
    if ramp > 0.0:
        assert np.abs(sim.bodies.felt_pos[0]).max() < 1e-15 and sim.bodies.felt[1] == 0.0
    sim.step(1e-9)
    assert max(differences(found(sim), run(False, until=1e-9, **tables)).values()) < SAME
    sim.run()
    assert max(differences(found(sim), star).values()) < SAME


def test_a_star_that_grows_speeds_up_orbits_and_heats_nothing():
    """Its present mass is in t_cool, nu, Stokes numbers, H and zones; its first one in temperatures."""
    dust, drag = GRAINS | {"grain_size": 3e-5}, {"law": "epstein"}
    tables = {"dust": dust, "drag": drag, "alpha_viscosity": {"alpha": 0.05}, **EFFECTS["cooling, beta"],
              "damping": {"inner": [1.0, 1.5], "time": 0.2}}  # fmt: skip
    begun = scene(False, **tables)
    begun["star"] |= {"grows": True, "accretion_radius": 0.5}
    sim = Simulation(begun)
    start = BOTH, BOTH + 0.4
    sim.bodies.gained[0] = 0.4
    sim.effects["star"].orbits.set_bodies(sim.bodies, 0.0)
    state, gas = sim.state, sim.gas
    assert state.central_mass == state.star_pull == pytest.approx(start[1], rel=1e-15)
    sim.operators.forces()
    r = np.hypot(*gas.pos.T)
    omega = np.sqrt(start[1] / (r**2 + SOFT**2) ** 1.5)
    settled = PASSIVE["aspect_ratio"] ** 2 * BOTH / 1.7 * (r / 1.7) ** -0.4 / 0.4
    gas.kick_rate[:] = 0.0
    left = (state.cooled_energy(gas, 0.3) - settled) / (gas.u - settled)
    np.testing.assert_allclose(left, np.exp(-0.3 * omega / 5.0), rtol=1e-10)
    np.testing.assert_allclose(gas.nu, 0.05 * 0.4 * gas.u / omega, rtol=1e-10)  # c_T^2 = (gamma - 1) u
    stokes = sim.effects["drag"].columns(state)["dust"]
    away = np.hypot(*sim.dust.pos.T)
    about = np.sqrt(start[1] / (away**2 + SOFT**2) ** 1.5)
    np.testing.assert_allclose(stokes["stokes"], stokes["stopping_time"] * about, rtol=1e-12)
    assert sim.effects["drag"].engine.star == (state.central_mass, SOFT)
    before = gas.vel.copy()
    sim.effects["damping"].operate(state, 1e6)
    inside = r < 1.45
    faster = np.hypot(*gas.vel[inside].T) / np.hypot(*before[inside].T)
    np.testing.assert_allclose(faster, np.sqrt(start[1] / start[0]), rtol=1e-4)  # between nodes of the table in ln r


def third(star=None, **tables):
    """The disc about the pair, which a third star passes on a hyperbola."""
    held = scene(True, **tables)
    passing = {
        "mass": 0.6,
        "semi_major_axis": 4.0,
        "eccentricity": 1.5,
        "phase": -60.0,
        "softening": "0.3",
        "orbit": "live",
    }
    held["companion"] = [held["companion"][0] | {"orbit": "live"}, passing]
    held["star"] |= star or {}
    return held


@pytest.fixture(scope="module")
def passed(tmp_path_factory):
    """A run whose barycentre moves, and a snapshot of it."""
    sim, path = Simulation(third(gas=LOCALLY)), tmp_path_factory.mktemp("pair") / "0001.h5"
    assert sim.state.central_mass == pytest.approx(BOTH, rel=1e-15)
    assert np.abs(sim.state.centre).max() < 1e-15
    for _ in range(40):
        sim.step()
    with sim.synchronised() as state:
        bodies = state.bodies.copy()
        write_snapshot(path, sim.scene, sim.time, state.gas, None, {}, bodies)
        order = np.argsort(state.gas.ids)
        (place, speed), at = state.centre, (state.gas.pos[order].copy(), state.gas.vel[order].copy())
    assert np.hypot(*place) > 1e-3 and np.hypot(*speed) > 1e-3
    own = bodies.mass[:2] / BOTH
    np.testing.assert_allclose([place, speed], [own @ bodies.pos[:2], own @ bodies.vel[:2]], atol=1e-14)
    return sim, path, at[0] - place, at[1] - speed


def test_fields_are_about_the_barycentre_of_what_is_bound(passed):
    """In a frame in which it moves: radius, v_phi, v_phi - v_K with both masses, Toomre's Q."""
    sim, path, pos, vel = passed
    snap = read_snapshot(path)
    r, spin = np.hypot(*pos.T), pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]
    omega = np.sqrt(BOTH / (r**2 + SOFT**2) ** 1.5)
    order = np.argsort(sim.gas.ids)
    exact = {
        "gas.radius": r, "gas.v_phi": spin / r, "gas.v_phi_excess": spin / r - omega * r,
        "gas.eccentricity": np.sqrt(1 + (vel**2).sum(axis=1) * (spin / BOTH) ** 2 - 2 / r * spin**2 / BOTH),
        "gas.toomre_q": sim.gas.sound_speed[order] * omega / (np.pi * sim.gas.density[order]),
    }  # fmt: skip
    for name, values in exact.items():
        np.testing.assert_allclose(snap.field(name).value, values, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("frame", [{}, {"frame": "star", "centre": "star"}])
def test_a_start_from_a_snapshot_is_about_the_barycentre_of_what_is_bound(passed, frame):
    """Its gas turns about the centre of the disc in the new run; check tells of radii from there."""
    _, path, pos, vel = passed
    tables = third(frame) | {"alpha_viscosity": {"alpha": 0.01}, "initial": {"kind": "snapshot", "file": str(path)}}
    tables["gas"] = third(gas=LOCALLY)["gas"]
    sim = Simulation(tables)
    order = np.argsort(sim.gas.ids)
    place, speed = (np.zeros(2), np.zeros(2)) if sim.state.centre is None else sim.state.centre
    np.testing.assert_allclose(sim.gas.pos[order] - place, pos, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.gas.vel[order] - speed, vel, rtol=0, atol=1e-12)
    r = np.sort(np.hypot(*pos.T))
    inner, outer = start_of(sim.scene).edges(sim.scene)
    # Middles of the first and last of 40 rings of as many particles.
    assert r[0] < inner < r[len(r) // 40 + 1] and r[-len(r) // 40 - 1] < outer < r[-1]


def test_light_of_a_disc_about_a_pair_is_that_about_one_star():
    """Radiative cooling in physical units: T_irr and, in Bell & Lin's opacity, Omega are of both masses."""

    def cooled(pair):
        star = {"mass": "0.9 Msun" if pair else "1.17 Msun", "frame": "inertial"}
        tables = {
            "run": {"until": "1 yr"}, "space": {"size": "40 au"},
            "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "5 au", "outer": "10 au"},
            "gas": {"particles": 300, "eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.05,
                                              "reference_radius": "7 au"}},
            "cooling": {"kind": "radiative", "opacity": "bell-lin", "aspect_ratio": 0.03},
        }  # fmt: skip
        if pair:
            star["centre"] = "barycentre"
            second = {"mass": "0.27 Msun", "semi_major_axis": "0.2 au", "softening": "0.1 au"}
            tables["companion"] = [second]
        sim = Simulation(tables | {"star": star})
        sim._prepare()
        gas = sim.gas.copy()
        gas.kick_rate[:] = 0.0
        hot = gas.u.copy()
        ends = [sim.state.cooled_energy(gas, dt) for dt in (1e3, 1e9)]  # some of it, and all down to T_irr
        assert (ends[0] < 0.99 * hot).any() and (ends[1] < 0.4 * hot).all()
        return np.array(ends)

    np.testing.assert_allclose(cooled(True), cooled(False), rtol=SAME)
