"""Companions and the frame: orbits against exact ones, what pulls whom, momentum, both frames."""

import itertools
import math

import numpy as np
import pytest
from companions import GRAIN, PLANET, by_ids, disc, relative, tables, totals
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from discsim import Simulation
from discsim.exact import kepler
from discsim.physics.companions import mean_pull
from discsim.scene import SceneError, load_scene

# Orbits


@pytest.mark.parametrize("frame", ["star", "inertial"])
def test_a_fixed_orbit_is_keplers(frame):
    e, phase, m, t = 0.3, 40.0, 0.2, 6.3
    scene = tables(PLANET | {"mass": m, "eccentricity": e, "phase": phase}, star={"frame": frame})
    sim = Simulation(scene, particles={"dust": GRAIN})
    sim.run(t)

    def mean(anomaly):  # by the definition of the eccentric anomaly
        eccentric = 2 * math.atan2(math.sqrt(1 - e) * math.sin(anomaly / 2), math.sqrt(1 + e) * math.cos(anomaly / 2))
        return eccentric - e * math.sin(eccentric)

    wanted = mean(math.radians(phase)) + math.sqrt(1.0 + m) * t
    eccentric = brentq(lambda x: x - e * math.sin(x) - wanted, wanted - 1, wanted + 1, xtol=1e-15, rtol=1e-15)
    exact = np.array([math.cos(eccentric) - e, math.sqrt(1 - e * e) * math.sin(eccentric)])
    r, v = relative(sim)
    assert np.abs(r - exact).max() < 1e-12
    assert abs(v @ v / 2 - (1 + m) / math.hypot(*r) + (1 + m) / 2) < 1e-12
    star = -m / (1 + m) * exact if frame == "inertial" else np.zeros(2)
    assert np.abs(sim.bodies.pos[0] - star).max() < 1e-12


@pytest.mark.parametrize("frame", ["star", "inertial"])
def test_a_live_pair_keeps_its_orbit(frame):
    m, e = 0.3, 0.5
    scene = tables(PLANET | {"mass": m, "eccentricity": e, "orbit": "live"}, star={"frame": frame}, run={"until": 1.0})
    sim = Simulation(scene, particles={"dust": GRAIN})
    start = np.concatenate(relative(sim))
    sim.run(100 * 2 * math.pi / math.sqrt(1 + m))
    r, v = relative(sim)
    energy = v @ v / 2 - (1 + m) / math.hypot(*r)
    assert abs(energy / (-(1 + m) / 2) - 1) < 1e-8  # found: 1e-13
    # Found: 1e-11; the grain of 1e-12 moves it by as much.
    assert np.abs(np.concatenate([r, v]) - start).max() < 1e-5


def n_body(mass, pos, vel, until, softening=None):
    """Places and velocities of point masses by an integrator; softening[i, j] of pairs."""
    n = len(mass)
    soft = np.zeros((n, n)) if softening is None else softening

    def rhs(t, y):
        x = y[: 2 * n].reshape(n, 2)
        away = x[None] - x[:, None]
        d2 = (away**2).sum(axis=2) + soft**2 + np.eye(n)
        acc = (mass[None, :, None] * away / d2[..., None] ** 1.5).sum(axis=1)
        return np.concatenate([y[2 * n :], acc.ravel()])

    y = solve_ivp(rhs, (0, until), np.concatenate([pos.ravel(), vel.ravel()]), method="DOP853", rtol=1e-12, atol=1e-13)
    return y.y[: 2 * n, -1].reshape(n, 2), y.y[2 * n :, -1].reshape(n, 2)


@pytest.mark.parametrize("frame", ["star", "inertial"])
@pytest.mark.parametrize("orbit", ["fixed", "live"])
def test_a_grain_moves_as_an_n_body_code_says(frame, orbit):
    """A massless grain about a pair: of second order in the step."""
    errors = []
    for dt in (0.02, 0.01):
        companion = PLANET | {"mass": 0.1, "orbit": orbit, "eccentricity": 0.2}
        scene = tables(companion, star={"frame": frame}, run={"until": 1.0, "timestep": dt})
        sim = Simulation(scene, particles={"dust": GRAIN})
        b, soft = sim.bodies.copy(), np.zeros((3, 3))
        soft[1, 2] = soft[2, 1] = 0.02
        both = [np.vstack([a, c]) for a, c in ((b.pos, GRAIN["pos"]), (b.vel, GRAIN["vel"]))]
        if frame == "star":  # velocities of an inertial frame, the star's is what moves
            both[1] = both[1] - 0.1 / 1.1 * b.vel[1]
        sim.run(6.0)
        pos, _ = n_body(np.array([1.0, 0.1, 0.0]), *both, 6.0, soft)
        shift = pos[0] if frame == "star" else 0.0
        errors.append(np.abs(sim.dust.pos[0] - (pos[2] - shift)).max())
        assert np.abs(sim.bodies.pos[1] - (pos[1] - shift)).max() < 1e-9
    assert errors[0] < 3e-4
    assert 1.8 < math.log2(errors[0] / errors[1]) < 2.2


def test_several_live_companions_are_of_second_order():
    planets = [
        {"mass": 3e-3, "semi_major_axis": 1.0, "eccentricity": 0.1, "softening": "0.02", "orbit": "live"},
        {"mass": 1e-3, "semi_major_axis": 1.7, "phase": 100.0, "softening": "0.02", "orbit": "live"},
        {"mass": 1e-3, "semi_major_axis": 2.6, "phase": -70.0, "softening": "0.02", "orbit": "live"},
    ]
    errors = []
    for dt in (0.05, 0.025):
        scene = tables(
            planets, star={"frame": "inertial", "indirect": ["companions", "dust"]}, run={"until": 1.0, "timestep": dt}
        )
        sim = Simulation(scene, particles={"dust": {"pos": [[3.9, 0]], "vel": [[0, 0.5]], "mass": [1e-12]}})
        b = sim.bodies.copy()
        sim.run(20.0)
        pos, _ = n_body(b.mass, b.pos, b.vel, 20.0)
        errors.append(np.abs(sim.bodies.pos - pos).max())
        momentum, _, _ = totals(sim)
        assert np.abs(momentum - [0.0, 0.5e-12]).max() < 1e-16  # rounding of 800 steps at m v = 3e-3; the grain's own
    assert errors[0] < 1e-4
    assert 1.8 < math.log2(errors[0] / errors[1]) < 2.2


def test_a_passing_star_stays_on_its_hyperbola():
    companion = PLANET | {"mass": 0.5, "eccentricity": 1.5, "phase": -120.0, "orbit": "live", "semi_major_axis": 2.0}
    sims = []
    for orbit in ("live", "fixed"):
        sim = Simulation(tables(companion | {"orbit": orbit}), particles={"dust": GRAIN})
        sim.run(12.0)
        sims.append(sim)
    assert math.hypot(*sims[0].bodies.pos[1]) > 1.5
    assert np.abs(sims[0].bodies.pos[1] - sims[1].bodies.pos[1]).max() < 1e-10  # both exact


def test_what_a_companion_does_not_feel():
    """Without the star it moves straight; where the star does not feel it, GM is the star's."""
    live = PLANET | {"mass": 0.2, "orbit": "live"}
    sim = Simulation(tables(live | {"feels": []}, star={"indirect": []}), particles={"dust": GRAIN})
    start, speed = sim.bodies.pos[1].copy(), sim.bodies.vel[1].copy()
    sim.run(3.0)
    assert np.abs(sim.bodies.pos[1] - start - 3.0 * speed).max() < 1e-13
    sim = Simulation(tables(live, star={"indirect": []}), particles={"dust": GRAIN})
    sim.run(2 * math.pi)
    # What the grain of 1e-12 does in an orbit.
    assert np.abs(sim.bodies.pos[1] - [1.0, 0.0]).max() < 1e-10
    assert np.abs(sim.bodies.vel[1] - [0.0, 1.0]).max() < 1e-10


def test_companions_that_a_star_does_not_feel_feel_each_other_alone():
    """About a star that nothing pulls, masses 1 : .05 : .02: an N-body code whose star stays."""
    pair = [
        PLANET | {"mass": 0.05, "eccentricity": 0.3, "orbit": "live"},
        PLANET | {"mass": 0.02, "semi_major_axis": 2.5, "phase": -130.0, "orbit": "live"},
    ]
    scene = tables(pair, star={"indirect": []}, run={"until": 1.0, "timestep": 0.01})
    sim = Simulation(scene, particles={"dust": GRAIN})
    mass, start = sim.bodies.mass[1:].copy(), np.concatenate([sim.bodies.pos[1:], sim.bodies.vel[1:]])

    def slope(_, z):
        r, v = z.reshape(2, 2, 2)
        away = r[1] - r[0]
        pull = away / math.hypot(*away) ** 3
        acc = -r / np.hypot(*r.T)[:, None] ** 3 + np.array([mass[1] * pull, -mass[0] * pull])
        return np.concatenate([v, acc]).ravel()

    sim.run(5.0)
    end = solve_ivp(slope, (0.0, 5.0), start.ravel(), method="DOP853", rtol=1e-12, atol=1e-13).y[:4, -1]
    # Of second order in the step, as above; the star's recoil would be .05 of the pull.
    assert np.abs(sim.bodies.pos[1:] - end.reshape(2, 2)).max() < 1e-4


RAMP = 4.0


def test_a_ramp_is_in_what_grains_feel_alone():
    """As sin^2; the orbit is that of the whole mass: an ellipse about the barycentre, which stays."""
    m, e, a = 0.3, 0.5, 1.7
    live = PLANET | {"mass": m, "eccentricity": e, "semi_major_axis": a, "phase": 60.0, "ramp": RAMP, "orbit": "live"}
    for star in ({"frame": "star"}, {"frame": "inertial"}, {"frame": "inertial", "centre": "barycentre"}):
        sim = Simulation(tables(live, star=star), particles={"dust": GRAIN})
        for until in (1.0, 6.0):
            sim.run(until)
            with sim.synchronised() as state:
                b = state.bodies
                share = math.sin(math.pi * until / 2 / RAMP) ** 2 if until < RAMP else 1.0
                assert b.mass[1] == m and b.felt[1] == pytest.approx(share * m, rel=1e-14)
                r, v = relative(sim)
                orbit = kepler.elements(1.0 + m, *r, *v)
                # The grain of 1e-12 moves it by as much.
                assert orbit.semi_major_axis == pytest.approx(a, rel=1e-10)
                assert orbit.eccentricity == pytest.approx(e, rel=1e-10)
                if star["frame"] == "inertial":
                    assert np.abs(b.mass @ b.pos).max() < 1e-10 and np.abs(b.mass @ b.vel).max() < 1e-10


@pytest.mark.parametrize(("frame", "centre"), [("star", "star"), ("inertial", "star"), ("inertial", "barycentre")])
@pytest.mark.parametrize("orbit", ["fixed", "live"])
def test_a_grain_feels_a_ramp_as_an_integrator_says(frame, centre, orbit):
    """Second order in the step, so masses are those of the time at which they pull.

    About the star it feels f of the companion's pull, and has 1 - f of the star's acceleration; about the barycentre
    masses M + (1 - f) m and f m on the companion's orbit, whose barycentre rests.
    """
    m, mass = 0.3, 0.9
    companion = PLANET | {"mass": m, "orbit": orbit, "eccentricity": 0.2, "phase": 25.0, "ramp": RAMP}
    mu = mass + m

    def rhs(t, y, start):
        motion = kepler.drift(mu, kepler.Motion(*start), t)
        r, share = np.array(motion[:2]), math.sin(math.pi * min(t, RAMP) / 2 / RAMP) ** 2
        on_star = m * r / math.hypot(*r) ** 3
        if centre == "barycentre":
            pulls = ((mass + (1 - share) * m, -share * m / mu * r), (share * m, (1 - share * m / mu) * r))
            carried = np.zeros(2)
        else:
            pulls, carried = ((mass, np.zeros(2)), (share * m, r)), -share * on_star  # in the star's frame
        acc = carried
        for (body, place), soft in zip(pulls, (0.1, 0.02), strict=True):
            away = place - y[:2]
            acc = acc + body * away / (away @ away + soft**2) ** 1.5
        return np.concatenate([y[2:], acc])

    errors = []
    for dt in (0.02, 0.01):
        star = {"mass": mass, "frame": frame, "centre": centre, "softening": 0.1}
        sim = Simulation(tables(companion, star=star, run={"until": 1.0, "timestep": dt}), particles={"dust": GRAIN})
        b = sim.bodies.copy()
        start = np.concatenate([b.pos[1] - b.pos[0], b.vel[1] - b.vel[0]])
        about = np.zeros(4) if centre == "barycentre" else np.concatenate([b.pos[0], b.vel[0]])
        y = np.concatenate([GRAIN["pos"][0], GRAIN["vel"][0]]) - about
        end = solve_ivp(rhs, (0, 6.0), y, method="DOP853", rtol=1e-12, atol=1e-13, args=(start,)).y[:2, -1]
        sim.run(6.0)
        errors.append(np.abs(sim.dust.pos[0] - (sim.bodies.pos[0] if centre == "star" else 0.0) - end).max())
    assert errors[0] < 3e-4
    assert 1.8 < math.log2(errors[0] / errors[1]) < 2.2


def test_a_ramp_gives_a_disc_no_push():
    """A ring of grains close to a star of two goes with it, as long as it does not feel the other.

    Of the other's whole pull on the star, .5, a ring that felt nothing of it itself would be off by that / Omega^2.
    """
    second = PLANET | {"mass": 0.5, "ramp": 20.0, "orbit": "live"}
    angle = np.linspace(0, 2 * math.pi, 40, endpoint=False)
    across = np.array([np.cos(angle), np.sin(angle)]).T
    for frame in ("star", "inertial"):
        star = np.array([[-1.0, 0.0], [0.0, -math.sqrt(1.5)]]) / 3 * (frame == "inertial")
        vel = math.sqrt(10.0) * across[:, ::-1] * [-1, 1]
        grains = {"pos": star[0] + 0.1 * across, "vel": star[1] + vel, "mass": np.full(40, 1e-12)}
        run = {"until": 2.0, "timestep": 2e-3}
        sim = Simulation(tables(second, star={"frame": frame}, run=run), particles={"dust": grains})
        sim.run(2.0)  # 10 orbits of the grains, f up to .024
        off = (sim.dust.pos - sim.bodies.pos[0]).mean(axis=0)
        assert math.hypot(*off) < 0.05 * 0.5 / 1000


@pytest.mark.parametrize("centre", ["star", "barycentre"])
def test_momentum_is_exact_during_a_ramp(centre):
    """Total momentum about the barycentre; about the star the disc is carried with 1 - f of the star's motion."""
    live = PLANET | {"mass": 0.02, "orbit": "live", "ramp": 3.0, "softening": "0.1"}
    star = {"frame": "inertial", "centre": centre, "indirect": ["companions", "gas", "dust"]}
    sim = Simulation(disc(live, star))
    before, _, _ = totals(sim)
    sim.run(1.5)
    after, size, _ = totals(sim)
    change = np.abs(after - before).max()
    assert change < 1e-14 * size if centre == "barycentre" else change > 1e-4 * size


def test_euler_moves_bodies_too():
    errors = []
    for dt in (0.01, 0.005):
        run = {"until": 1.0, "timestep": dt, "integrator": "euler"}
        scene = tables(PLANET | {"mass": 0.1, "orbit": "live"}, run=run, star={"frame": "star"})
        sim = Simulation(scene, particles={"dust": GRAIN})
        sim.run(1.0)
        assert np.abs(sim.bodies.pos[1] - np.array([math.cos(s := math.sqrt(1.1)), math.sin(s)])).max() < 1e-9
        best = Simulation(tables(PLANET | {"mass": 0.1, "orbit": "live"}, run={"until": 1.0, "timestep": 5e-3}),
                          particles={"dust": GRAIN})  # fmt: skip
        best.run(1.0)
        errors.append(np.abs(sim.dust.pos - best.dust.pos).max())
    assert 0.8 < math.log2(errors[0] / errors[1]) < 1.2


# Forces and frames


def test_pulls_are_mutual():
    """The companion's pull is the gradient of its potential energy, and the particles' on it is the opposite."""
    rng = np.random.default_rng(3)
    pos = rng.normal(size=(9000, 2))  # three blocks of sums
    grains = {"pos": pos, "vel": np.zeros_like(pos), "mass": rng.uniform(1, 2, 9000)}
    sim = Simulation(tables(PLANET | {"mass": 0.3, "softening": "0.2"}), particles={"dust": grains})
    _, acc = sim.acceleration("companion")
    away = pos - [1.0, 0.0]
    exact = -0.3 * away / ((away**2).sum(axis=1) + 0.04)[:, None] ** 1.5
    assert np.abs(acc - exact).max() < 1e-13
    sim.step(1e-9)
    force = (grains["mass"][:, None] * exact).sum(axis=0)
    assert np.abs(0.3 * sim.bodies.pulled[1, 1] + force).max() < 1e-7 * np.abs(force).max()  # of the step


def test_the_energy_of_a_companion_is_that_of_its_pull():
    """By differences of its potential energy, within its softening and beyond."""
    pair = PLANET | {"mass": 0.3, "semi_major_axis": 2.0, "eccentricity": 0.5, "softening": "0.4"}
    grains = {"pos": [[1.1, 0.1], [0.2, -1.4]], "vel": np.zeros((2, 2)), "mass": [2.0, 3.0]}
    sim = Simulation(tables(pair, star={"mass": 1.7}), particles={"dust": grains})
    force = sim.dust.mass[:, None] * sim.acceleration("companion")[1]
    energy, step = sim.effects["companion"].potential_energy, 1e-5
    found = np.empty((2, 2))
    for at in np.ndindex(2, 2):
        ends = []
        for way in (step, -2.0 * step, step):
            sim.dust.pos[at] += way
            ends.append(energy(sim.state))
        found[at] = (ends[1] - ends[0]) / (2.0 * step)
    np.testing.assert_allclose(found, force, rtol=1e-7)  # step^2 / softening^2, and rounding / step


@pytest.mark.parametrize("species", ["gas", "dust"])
def test_momentum_is_exact(species):
    """Star, two live companions, gas and dust that push each other, in the inertial frame."""
    live = [PLANET | {"mass": 0.02, "orbit": "live"},
            PLANET | {"mass": 0.01, "orbit": "live", "semi_major_axis": 1.8, "eccentricity": 0.3}]  # fmt: skip
    star = {"frame": "inertial", "indirect": ["companions", "dust"] + ["gas"] * (species == "gas")}
    scene = disc(live, star) if species == "gas" else tables(live, 300, star)
    sim = Simulation(scene)
    before, _, _ = totals(sim)
    sim.run(1.0)
    after, size, _ = totals(sim)
    assert np.abs(after - before).max() < 1e-14 * size  # rounding of the sums


def test_a_grain_that_flies_by_limits_the_step():
    """Light companions too: at ten times the speed it is past in a tenth of the time; half of it, as for all kicks."""
    grain = {"pos": [[1.1, 0.0]], "vel": [[-10.0, math.sqrt(1.001)]], "mass": [1e-12]}
    sim = Simulation(tables(PLANET | {"ramp": 0.0}), particles={"dust": grain})
    sim.step(1e-12)
    crossing = math.sqrt(0.01 + 0.02**2) / 10.0
    assert sim.limited_by == "companion" and sim.limit == pytest.approx(0.5 * crossing, rel=1e-6)


def test_a_grain_that_goes_with_a_companion_limits_the_step_by_its_pull():
    """Half of ((d^2 + eps^2)^(3/2) / G m)^(1/2) at half a softening: the time in which it falls through that."""
    second = PLANET | {"mass": 0.3, "semi_major_axis": 3.0, "softening": "0.2"}
    begin = Simulation(tables(second), particles={"dust": GRAIN}).bodies
    grain = {"pos": begin.pos[1:] + np.array([0.06, 0.08]), "vel": begin.vel[1:], "mass": [1e-12]}
    sim = Simulation(tables(second), particles={"dust": grain})
    sim.step(1e-12)
    assert sim.limited_by == "companion"
    assert sim.limit == pytest.approx(0.5 * math.sqrt((0.1**2 + 0.2**2) ** 1.5 / 0.3), rel=1e-9)  # of a step of 1e-12


def test_orbits_of_companions_limit_the_step_by_the_masses_of_both():
    """1 / Omega = (d^3 / (M + m))^(1/2) of each about the star, and of two live ones about each other."""
    heavy = {"mass": 0.7, "semi_major_axis": 2.2, "softening": "0.1", "orbit": "live"}
    light = {"mass": 0.4, "semi_major_axis": 2.9, "phase": 50.0, "softening": "0.1", "orbit": "live"}
    for companions in ([heavy], [heavy, light], [light, heavy]):
        sim = Simulation(tables(companions, star={"mass": 1.3}), particles={"dust": GRAIN})
        pairs = list(itertools.combinations(zip(sim.bodies.mass, sim.bodies.pos, strict=True), 2))
        wanted = [math.dist(x, y) ** 3 / (m + n) for (m, x), (n, y) in pairs]
        found = sim.effects["companion"].orbits.limit(sim.bodies)
        assert found == pytest.approx(min(wanted) ** 0.5, rel=1e-12)


def test_drag_sees_all_relative_to_the_moving_star():
    """Of one-way dust the gas's own velocities come back with all their bits."""
    sim = Simulation(disc(PLANET | {"mass": 0.1}, {"frame": "inertial"}, gas=100, dust=20))
    state, star = sim.state, sim.bodies.vel[0].copy()
    gas, dust, copied = sim.gas.vel.copy(), sim.dust.vel.copy(), sim.gas.vel.copy()
    places = sim.gas.pos
    assert np.abs(star).max() > 0.05
    with state.about_centre(copied):
        assert np.abs(state.gas.vel - (gas - star)).max() == 0.0 == np.abs(copied - state.gas.vel).max()
        assert np.abs(state.dust.vel - (dust - star)).max() == 0.0
        assert np.abs(state.gas.pos - (places - sim.bodies.pos[0])).max() == 0.0
    assert state.gas.vel.tobytes() == gas.tobytes() and state.gas.pos is places
    assert np.abs(state.dust.vel - dust).max() < 1e-15


def test_both_frames_are_one_run():
    live = PLANET | {"mass": 1e-2, "orbit": "live", "softening": 0.6, "eccentricity": 0.1}
    sims = {}
    for frame in ("star", "inertial"):
        star = {"frame": frame, "indirect": ["companions", "gas", "dust"]}
        sims[frame] = Simulation(disc(live, star, gas=200, dust=50))
        sims[frame].run(2 * math.pi)
    star, inertial = sims["star"], sims["inertial"]
    assert star.state.step == inertial.state.step
    shift = inertial.bodies.pos[0]
    assert np.abs(shift).max() > 3e-3
    for name in ("gas", "dust"):
        one, other = (by_ids(getattr(sim, name), "pos") for sim in (star, inertial))
        assert np.abs(one - (other - shift)).max() < 1e-6  # rounding, that noise multiplies
    assert np.abs(star.bodies.pos[1] - (inertial.bodies.pos[1] - shift)).max() < 1e-6


def test_a_heavy_disc_pulls_its_star():
    """Where a disc gravitates its pull on the star counts by default, and no companion is needed."""
    clump = {"pos": [[1.5, 0.0], [-1.0, 0.5]], "vel": [[0.0, 0.8], [0.0, -0.9]], "mass": [0.05, 0.01]}
    own = {"self_gravity": {"softening": 0.3}, "space": {"size": 8.0, "cells": 128}}
    sims = [
        Simulation(tables(None, star={"frame": frame, "softening": 0.1}, **own), particles={"dust": clump})
        for frame in ("star", "inertial")
    ]
    for sim in sims:
        sim.run(3.0)
    momentum, _, _ = totals(sims[1])
    start = np.array([0.0, 0.05 * 0.8 - 0.01 * 0.9])
    assert np.abs(momentum - start).max() < 1e-15 * 30
    r = np.array([[1.5, 0.0], [-1.0, 0.5]])
    mass = np.array([0.05, 0.01])
    pull = (mass[:, None] * r / ((r**2).sum(axis=1) + 0.01)[:, None] ** 1.5).sum(axis=0)
    sim = Simulation(tables(None, star={"softening": 0.1}, **own), particles={"dust": clump})
    _, acc = sim.acceleration("star")
    assert np.abs(acc + pull + r / ((r**2).sum(axis=1) + 0.01)[:, None] ** 1.5).max() < 1e-14
    # The frames differ by where the grid is.
    assert np.abs(sims[0].dust.pos - (sims[1].dust.pos - sims[1].bodies.pos[0])).max() < 2e-3
    sim = Simulation(tables(None, star={"softening": 0.1, "indirect": []}, **own), particles={"dust": clump})
    assert sim.bodies is None


def test_a_star_alone_has_no_bodies():
    sim = Simulation(tables(None), particles={"dust": GRAIN})
    assert sim.bodies is None and sim.state.centre is None


def test_a_companion_beside_self_gravity():
    live = PLANET | {"mass": 1e-2, "orbit": "live", "softening": 0.6}
    sim = Simulation(disc(live, {"frame": "inertial"}, dust=50, self_gravity={"softening": 0.1}))
    before, _, _ = totals(sim)
    sim.run(1.0)
    after, size, _ = totals(sim)
    assert np.abs(after - before).max() < 1e-12 * size  # of the transforms


def test_one_way_dust_leaves_the_gas_alone():
    live = PLANET | {"mass": 1e-2, "orbit": "live", "softening": 0.6, "accretion_radius": 0.1}
    star = {"grows": True, "accretion_radius": 0.3, "frame": "inertial", "indirect": ["companions", "gas"]}
    one_way = {"drag": {"law": "stokes-number", "stokes": 0.3, "scheme": "idic-linear", "direction": "one-way"}}
    full = disc(live, star) | one_way
    bare = {key: value for key, value in full.items() if key not in ("dust", "drag")}
    with_dust, without = Simulation(full), Simulation(bare)
    for sim in (with_dust, without):
        sim.run(1.0)
    assert with_dust.dust.count < 100  # some is taken
    for name in ("pos", "vel", "ids"):
        assert getattr(with_dust.gas, name).tobytes() == getattr(without.gas, name).tobytes()
    for name in ("mass", "pos", "vel"):
        assert getattr(with_dust.bodies, name).tobytes() == getattr(without.bodies, name).tobytes()


def test_a_number_of_heights_is_a_length():
    pos = {"pos": [[1.2, 0.1]], "vel": [[0.0, 0.9]], "mass": [1e-9]}
    gas = {"particles": 1, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 0.0}}
    found = []
    for softening in (0.6, str(0.6 * 0.1 * 2.0**1.5)):
        scene = tables(PLANET | {"softening": softening, "semi_major_axis": 2.0}, dust=None, gas=gas)
        found.append(Simulation(scene, particles={"gas": pos}).acceleration("companion")[0])
    assert np.abs(found[0] / found[1] - 1).max() < 1e-13


@pytest.mark.parametrize("centre", ["star", "barycentre"])
def test_softening_counts_the_height_where_the_companion_is(centre):
    """On an ellipse, H of c_T ~ r^-.2 given at r = 2 and of orbits about what the disc turns about, softened."""
    mass, m, a, e, phase, soft = 1.7, 0.5, 3.0, 0.5, math.radians(100.0), 0.4
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 0.4, "reference_radius": 2.0}
    star = {"mass": mass, "softening": soft, "frame": "inertial", "centre": centre}
    companion = {"mass": m, "semi_major_axis": a, "eccentricity": e, "phase": 100.0, "softening": 0.6}
    scene = tables(companion, star=star, dust=None, gas={"particles": 1, "eos": eos})
    sim = Simulation(scene, particles={"gas": {"pos": [[1.2, 0.1]], "vel": [[0.0, 0.9]], "mass": [1e-9]}})
    away = a * (1 - e**2) / (1 + e * math.cos(phase)) * (mass / (mass + m) if centre == "barycentre" else 1.0)
    central = mass + (m if centre == "barycentre" else 0.0)
    height = 0.1 * math.sqrt(central / 2.0) * (away / 2.0) ** -0.2 / math.sqrt(central / (away**2 + soft**2) ** 1.5)
    to = sim.bodies.pos[1] - [1.2, 0.1]
    exact = m * to / (to @ to + (0.6 * height) ** 2) ** 1.5
    np.testing.assert_allclose(sim.acceleration("companion")[0][0], exact, rtol=1e-12)


def test_a_companion_in_a_given_disc():
    """It reaches the relaxation of dust with the disc: nearly the same drift in steps of one and of five t_stop."""
    grain = {"dust": {"pos": [[1.0, 0.0]], "vel": [[0.0, 1.0]], "mass": [1e-9]}}

    def drift(mass, dt):
        scene = tables(
            PLANET | {"mass": mass, "semi_major_axis": 2.0, "softening": "0.3"},
            run={"until": 2.0, "timestep": dt},
            background={"surface_density": 1e-3, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
            drag={"law": "stokes-number", "stokes": 0.01, "direction": "one-way"},
        )
        sim = Simulation(scene, particles=grain)
        sim.run(2.0)
        return math.hypot(*sim.dust.pos[0]) - 1.0

    done = drift(0.02, 0.01) - drift(1e-12, 0.01)
    assert done > 3e-5
    assert abs(drift(0.02, 0.05) - drift(0.02, 0.01)) < 0.1 * done  # found: .05


def test_the_mean_pull_is_that_of_a_ring():
    scene = load_scene(tables([PLANET | {"mass": 0.1}, PLANET | {"ramp": 1.0}]))
    radius = np.array([0.2, 0.97, 1.3, 3.0])
    for r, found in zip(radius, mean_pull(scene, radius), strict=True):

        def pull(angle, r=r):
            return (r - math.cos(angle)) / (r * r + 1 - 2 * r * math.cos(angle) + 0.02**2) ** 1.5

        exact = 0.1 * quad(pull, 0, math.pi, limit=500, epsabs=1e-12)[0] / math.pi
        assert found == pytest.approx(exact, rel=2e-3)  # between the radii that it is tabulated at
    assert mean_pull(scene, np.array([40.0]))[0] == pytest.approx(0.1 / 1600, rel=1e-3)


def test_fixed_orbits_of_several_have_no_barycentre_at_rest():
    """Each is Kepler's about the star alone: of companions of .5 and .1 at 1 and 5 the barycentre is .14 off."""
    fixed = [PLANET | {"mass": m, "semi_major_axis": a, "orbit": "fixed"} for m, a in ((0.5, 1.0), (0.1, 5.0))]
    star = {"frame": "inertial", "centre": "barycentre", "softening": 0.05}
    for second in ("fixed", "live"):
        bodies = [fixed[0], fixed[1] | {"orbit": second}]
        with pytest.raises(SceneError, match=r'star\.centre: with 2 bound companions.*orbit = "live" in'):
            load_scene(disc(bodies, star, dust=50))
    live = [body | {"orbit": "live"} for body in fixed]
    b = Simulation(disc(live, star, dust=50)).bodies
    assert np.abs(b.mass @ b.pos).max() < 1e-15
    unbound = fixed[1] | {"eccentricity": 1.4, "phase": -40.0}
    load_scene(disc([fixed[0], unbound], star, dust=50))


def test_the_mean_pull_about_a_barycentre_is_that_of_two_rings():
    """Masses 1.4 : .3 on circles of their own about it, each with its softening, less that of 1.4 at the centre."""
    second = PLANET | {"mass": 0.3, "semi_major_axis": 2.0, "softening": "0.1"}
    star = {"mass": 1.4, "softening": 0.2, "frame": "inertial", "centre": "barycentre"}
    scene = load_scene(tables(second, star=star))

    def ring(r, distance, length):
        def pull(angle):
            away2 = r * r + distance * distance - 2.0 * r * distance * math.cos(angle) + length * length
            return (r - distance * math.cos(angle)) / away2**1.5

        return quad(pull, 0.0, math.pi, limit=500, epsabs=1e-13)[0] / math.pi

    radius = np.array([0.45, 1.1, 2.3, 3.7])
    own, other = 2.0 * 0.3 / 1.7, 2.0 * 1.4 / 1.7
    exact = [0.3 * ring(r, other, 0.1) + 1.4 * (ring(r, own, 0.2) - ring(r, 0.0, 0.2)) for r in radius]
    # Between 4096 radii, over which pulls change by softenings of .1 and .2.
    np.testing.assert_allclose(mean_pull(scene, radius), exact, rtol=1e-4)


def test_a_disc_about_the_barycentre():
    second = PLANET | {"mass": 1.0, "semi_major_axis": 0.5, "softening": "0.05"}
    star = {"frame": "inertial", "centre": "barycentre", "softening": 0.05}
    sim = Simulation(disc(second, star, dust=50))
    assert np.abs(sim.bodies.pos - [[-0.25, 0.0], [0.25, 0.0]]).max() < 1e-15
    centre = (sim.gas.mass[:, None] * sim.gas.pos).sum(axis=0) / sim.gas.mass.sum()
    assert np.abs(centre).max() < 0.02
    assert sim.state.central_mass == 2.0
    # c_s is that of both masses.
    sim.step()
    r = np.sqrt((sim.gas.pos**2).sum(axis=1))
    assert np.abs(sim.gas.sound_speed - 0.1 * math.sqrt(2.0) * r**-0.25).max() < 1e-12
