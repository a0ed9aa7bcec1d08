"""Companions in a run: what they take, their rows and files, the same bits, what check says of them, bad keys."""

import csv
import math
from itertools import pairwise

import numpy as np
import pytest
from companions import GRAIN, PLANET, disc, relative, tables, totals

from discsim import Simulation, read_snapshot
from discsim.output.companions import COLUMNS, companion_rows
from discsim.preview.derived import effect_rows
from discsim.preview.forecast import expected_steps
from discsim.preview.warnings import warnings
from discsim.run.runner import run_scene
from discsim.scene import SceneError, load_scene

# Accretion


def cloud(seed=2, count=3000):
    rng = np.random.default_rng(seed)
    pos = np.array([1.0, 0.0]) + rng.uniform(-0.3, 0.3, (count, 2))
    return {"pos": pos, "vel": rng.normal(size=(count, 2)), "mass": np.full(count, 1e-5)}


def test_a_companion_takes_mass_and_momentum():
    live = PLANET | {"mass": 0.1, "orbit": "live", "accretion_radius": 0.1}
    scene = tables(live, star={"frame": "inertial", "indirect": ["companions", "dust"]})
    sim = Simulation(scene, particles={"dust": cloud()})
    before, _, mass = totals(sim)
    sim.run(0.2)
    after, size, left = totals(sim)
    taken = sim.bodies.accreted[1, 1]
    assert taken > 1e-3 and sim.bodies.mass[1] == pytest.approx(0.1 + taken, rel=1e-12)
    assert abs(left - mass) < 1e-13
    assert np.abs(after - before).max() < 1e-13 * size
    away = np.sqrt(((sim.dust.pos - sim.bodies.pos[1]) ** 2).sum(axis=1))
    assert away.min() >= 0.1


def test_a_share_is_taken_per_orbit():
    """Grains that go with the companion: of them exp(-rate t / P) are left."""
    planet = PLANET | {"mass": 1e-9, "accretion_radius": 0.2, "accretion_rate": 3.0, "softening": "0.1"}
    angle = np.linspace(-0.05, 0.05, 4000)
    pos = np.array([np.cos(angle), np.sin(angle)]).T
    grains = {"pos": pos, "vel": np.array([-pos[:, 1], pos[:, 0]]).T, "mass": np.full(4000, 1e-12)}
    sim = Simulation(tables(planet), particles={"dust": grains})
    sim.run(1.5)
    left = 4000 * math.exp(-3.0 * 1.5 / (2 * math.pi))
    assert abs(sim.dust.count - left) < 4 * math.sqrt(left * (1 - left / 4000))  # four sigma of a binomial
    again = Simulation(tables(planet), particles={"dust": grains})
    again.run(1.5)
    assert sim.dust.ids.tobytes() == again.dust.ids.tobytes()
    other = Simulation(tables(planet, run={"until": 1.0, "seed": 2}), particles={"dust": grains})
    other.run(1.5)
    assert set(other.dust.ids) != set(sim.dust.ids)


@pytest.mark.parametrize("frame", ["star", "inertial"])
def test_a_star_grows(frame):
    star = {"frame": frame, "grows": True, "accretion_radius": 0.9, "indirect": ["dust"]}
    sim = Simulation(tables(None, star=star), particles={"dust": cloud()})
    before, _, mass = totals(sim)
    sim.run(0.3)
    after, size, left = totals(sim)
    taken = sim.state.ledger.accreted_dust
    assert taken > 1e-3 and sim.bodies.mass[0] == pytest.approx(1.0 + taken, rel=1e-12)
    assert abs(left - mass) < 1e-13
    if frame == "inertial":
        assert np.abs(after - before).max() < 1e-13 * size


def test_what_a_moving_star_takes_keeps_angular_momentum():
    """About the origin, where the barycentre is: a star of a pair 1 : .3 is .23 of its distance away from there."""
    pair = PLANET | {"mass": 0.3, "semi_major_axis": 2.0, "eccentricity": 0.5, "phase": 70.0}
    star = {"frame": "inertial", "accretion_radius": 0.3}
    pos = 0.5 * np.random.default_rng(5).standard_normal((400, 2))
    grains = {"pos": pos, "vel": pos[:, ::-1] * [-1.3, 0.7] + [0.2, 0.5], "mass": np.full(400, 1e-6)}
    sim = Simulation(tables(pair, star=star), particles={"dust": grains})

    def spin():
        p = sim.dust
        return (p.mass * (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0])).sum()

    before = spin()
    assert np.hypot(*sim.bodies.pos[0]) > 0.2
    sim.effects["star"].event(sim.state)
    assert 20 < sim.dust.count < 380
    taken = sim.state.ledger.accreted_angular_momentum
    assert abs(taken) > 1e-6
    assert spin() + taken == pytest.approx(before, rel=1e-12)  # rounding of 400 terms


def test_a_heavy_companion_takes_its_share_in_the_orbit_of_both():
    """1 - exp(-rate dt / P) of what goes with it, P = 2 pi (r^3 / (M + m))^(1/2) at its present distance."""
    planet = PLANET | {"mass": 0.8, "semi_major_axis": 2.0, "eccentricity": 0.5, "accretion_radius": 0.2}
    scene = tables(planet | {"accretion_rate": 300.0, "softening": "0.1"}, star={"frame": "star"})
    start = Simulation(scene, particles={"dust": GRAIN}).bodies
    pos = start.pos[1] + 0.02 * np.random.default_rng(3).standard_normal((20_000, 2))
    grains = {"pos": pos, "vel": np.tile(start.vel[1], (20_000, 1)), "mass": np.full(20_000, 1e-12)}
    sim = Simulation(scene, particles={"dust": grains})
    dt = sim.step(0.005)
    assert np.hypot(*sim.bodies.pos[1]) == pytest.approx(1.0, rel=1e-3)  # near its pericentre
    left = math.exp(-300.0 * dt * math.sqrt(1.8) / (2.0 * math.pi))
    # Three sigma of a binomial, and what the distance changes in a step.
    assert sim.dust.count / 20_000 == pytest.approx(left, abs=0.012)
    assert 0.2 < left < 0.8


# Files


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def full_scene(tmp_path, **run):
    live = PLANET | {"mass": 1e-2, "orbit": "live", "softening": 0.6, "accretion_radius": 0.05, "accretion_rate": 5.0}
    second = PLANET | {"semi_major_axis": 1.8, "ramp": 0.45, "every": 0.1}
    star = {"frame": "inertial", "grows": True, "accretion_radius": 0.55, "indirect": ["companions", "gas", "dust"]}
    return load_scene(disc([live, second], star) | {"run": {"until": 0.6, "snapshots": 2} | run})


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


def test_a_run_goes_on_bit_for_bit(tmp_path):
    straight, parts = tmp_path / "straight", tmp_path / "parts"
    assert run_scene(full_scene(tmp_path), straight, quiet=True) == 0
    assert run_scene(full_scene(tmp_path, until=0.3, snapshots=1), parts, quiet=True) == 0
    assert run_scene(full_scene(tmp_path), parts, resume=True, quiet=True) == 0
    for file in ("companions.csv", "history.csv"):
        assert (straight / file).read_text() == (parts / file).read_text()
    one, other = (read_snapshot(out / "snapshots" / "0002.h5") for out in (straight, parts))
    for kind in ("gas", "dust", "bodies"):
        for name in ("pos", "vel", "mass", "ids"):
            assert getattr(getattr(one, kind), name).tobytes() == getattr(getattr(other, kind), name).tobytes()
    assert one.bodies.count == 3 and one.bodies.ids.tolist() == [0, 1, 2]
    rows = rows_of(straight / "companions.csv")
    steps = {row["step"] for row in rows}
    assert sum(row["number"] == "1" for row in rows) == len(steps)
    assert sum(row["number"] == "2" for row in rows) == 7  # the start, and every .1
    last = [row for row in rows if row["number"] == "1"][-1]
    sim = Simulation(full_scene(tmp_path))
    sim.evolve(0.3)
    sim.evolve(0.6)
    r, v = relative(sim)
    assert [float(last[name]) for name in ("x", "y", "vx", "vy")] == pytest.approx([*r, *v], abs=1e-12)
    torque = sim.bodies.mass[1] * np.cross(np.append(r, 0), np.append(sim.bodies.pulled[1, 0], 0))[2]
    assert float(last["torque_gas"]) == pytest.approx(torque, rel=1e-9)
    history = rows_of(straight / "history.csv")
    taken = sum(
        float(row["accretion_rate_gas"]) * (float(row["time"]) - float(before["time"]))
        for before, row in pairwise(history)
    )
    assert taken == pytest.approx(float(history[-1]["accreted_gas"]), rel=1e-9) and taken > 0.0


def test_torques_during_a_ramp_are_those_of_the_mass_that_is_felt():
    """sin^2 of .3 of a right angle of .4, about a star of 1.7: r x F, F by the grains' own places and masses."""
    pair = {"mass": 0.4, "semi_major_axis": 2.0, "eccentricity": 0.5, "softening": "0.15", "phase": 70.0, "ramp": 2.0}
    rng = np.random.default_rng(4)
    pos = np.array([1.1, 1.3]) + rng.uniform(-0.5, 0.5, (40, 2))
    grains = {"pos": pos, "vel": np.zeros((40, 2)), "mass": rng.uniform(1e-6, 3e-6, 40)}
    sim = Simulation(tables(pair, star={"mass": 1.7}), particles={"dust": grains})
    sim.evolve(0.6)
    felt = 0.4 * math.sin(0.3 * 0.5 * math.pi) ** 2
    with sim.synchronised() as state:
        row = dict(zip(COLUMNS, companion_rows(state, 0.6)[0], strict=True))
        r, away = state.bodies.pos[1] - state.bodies.pos[0], state.dust.pos - state.bodies.pos[1]
        pulls = state.dust.mass[:, None] * away / ((away**2).sum(axis=1) + 0.15**2)[:, None] ** 1.5
    force = felt * pulls.sum(axis=0)
    assert row["felt_mass"] == pytest.approx(felt, rel=1e-12) and row["mass"] == 0.4
    assert row["torque_dust"] == pytest.approx(r[0] * force[1] - r[1] * force[0], rel=1e-12)  # rounding of 40 terms
    assert abs(row["torque_dust"]) > 1e-8


def test_looking_changes_nothing(tmp_path):
    sims = [Simulation(full_scene(tmp_path)) for _ in range(2)]
    sims[0].run(0.1)
    looked = sims[1]

    def look():
        with looked.synchronised():
            pass
        return False

    looked.evolve(0.1, look)
    looked.run(0.1)
    for name, array in sims[0].bodies.arrays().items():
        assert array.tobytes() == getattr(looked.bodies, name).tobytes()


def test_the_same_bits_on_any_number_of_threads(monkeypatch):
    from discsim.numerics import thread_pool

    live = PLANET | {"mass": 0.05, "orbit": "live", "accretion_radius": 0.02, "accretion_rate": 9.0}
    star = {"frame": "inertial", "indirect": ["companions", "dust"], "grows": True, "accretion_radius": 0.5}
    found = []
    for number in (1, 3):
        monkeypatch.setattr(thread_pool, "number_of_threads", lambda number=number: number)
        sim = Simulation(tables(live, 20_000, star))
        sim.run(0.05)
        found.append(sim)
    for name, array in found[0].bodies.arrays().items():
        assert array.tobytes() == getattr(found[1].bodies, name).tobytes()
    assert found[0].dust.pos.tobytes() == found[1].dust.pos.tobytes()


# Bad keys


BARYCENTRE = {"mass": 1.0, "frame": "inertial", "centre": "barycentre"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"companion": [{"mass": 1e-3, "semi_major_axis": 1.0}]}, "companion.0.softening: missing"),
        ({"star": None, "self_gravity": {"softening": 0.1}}, "add a table [star]"),
        ({"companion": PLANET | {"eccentricity": 1.0}}, "companion.eccentricity: e = 1 is a parabola"),
        ({"companion": PLANET | {"eccentricity": 2.0, "phase": 130.0}}, "expected between -120 and 120"),
        ({"companion": PLANET | {"softening": 0.6}}, "companion.softening: a number means scale heights H"),
        ({"companion": PLANET | {"softening": "wide"}}, '"wide" is not a length'),
        ({"companion": PLANET | {"softening": -0.1}}, "expected at least 0"),
        ({"companion": PLANET | {"softening": "0"}}, "choose a value above 0, or add an accretion_radius"),
        ({"companion": PLANET | {"feels": ["dust"]}}, 'set orbit = "live"'),
        ({"companion": PLANET | {"orbit": "live", "feels": ["gas"]}}, "there is no table [gas]"),
        ({"companion": PLANET | {"orbit": "live", "feels": ["gsa"]}}, '"gsa" is unknown'),
        ({"companion": PLANET | {"accretion_rate": 1.0}}, "add the key accretion_radius"),
        ({"companion": PLANET | {"orbit": "alive"}}, 'did you mean "live"?'),
        ({"companion": PLANET | {"masss": 1.0}}, 'did you mean "mass"?'),
        ({"companions": [PLANET]}, 'did you mean "companion"?'),
        ({"star": {"mass": 1.0, "indirect": ["gas"]}}, "there is no table [gas]"),
        ({"star": {"mass": 1.0, "grows": True}}, "add star.accretion_radius"),
        ({"star": {"mass": 1.0, "centre": "barycentre"}}, 'set star.frame = "inertial"'),
        ({"companion": None, "star": {"mass": 1.0, "frame": "inertial", "centre": "barycentre"}}, "[[companion]]"),
        ({"star": BARYCENTRE | {"indirect": ["dust"]}}, 'add "companions" to star.indirect'),
        ({"star": BARYCENTRE, "companion": PLANET | {"eccentricity": 1.5, "ramp": 1.0}}, "companion.ramp: an unbound"),
    ],
)  # fmt: skip
def test_bad_keys_end_in_one_message(change, message):
    scene = {key: value for key, value in (tables(PLANET) | change).items() if value is not None}
    with pytest.raises(SceneError) as fault:
        load_scene(scene)
    assert message in str(fault.value) and len(fault.value.problems) == 1


def test_one_way_dust_may_not_pull():
    one_way = {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}
    scene = disc(PLANET | {"orbit": "live", "feels": ["star", "dust"]}, {"indirect": ["dust"]}) | {"drag": one_way}
    with pytest.raises(SceneError) as fault:
        load_scene(scene)
    assert len(fault.value.problems) == 2
    assert all('remove "dust" from the list, or set drag.direction' in text for text in fault.value.problems)


def test_two_bodies_at_one_place_are_told():
    twins = [PLANET | {"orbit": "live"}, PLANET | {"orbit": "live"}]
    sim = Simulation(tables(twins), particles={"dust": GRAIN})
    with pytest.raises(Exception, match="perhaps two bodies collide"):
        sim.run(0.1)


# What check says


def planet_disc(companion=None, **tables):
    """Gas about a planet, in balance with it: H = .05 at r = 1."""
    return {
        "units": {"system": "code"}, "run": {"until": 10.0}, "space": {"size": 6.0},
        "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.5, "outer": 2.0},
        "gas": {"particles": 20_000, "kernel": "quintic", "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
        "star": {"mass": 1.0}, "alpha_viscosity": {"alpha": 0.01},
        "companion": [PLANET | {"softening": 0.6} | (companion or {})],
    } | tables  # fmt: skip


def of_companion(scene, number=1):
    prefix = f"companion {number}: "
    return {name.removeprefix(prefix): text for name, text in effect_rows(scene) if name.startswith(prefix)}


def test_check_has_its_lengths_and_its_gap():
    rows = of_companion(load_scene(planet_disc()))
    sigma, mass = 1e-4, 1e-4 * 2 * math.pi * 1.5 / 20_000  # Sigma = 1e-4 / r from .5 to 2
    h = 1.1 * math.sqrt(mass / sigma)
    hill = (1e-3 / 3) ** (1 / 3)
    assert rows["period"] == f"{2 * math.pi / math.sqrt(1.001):.4g}"
    assert rows["Hill radius"] == f"{hill:.4g} ({hill / 0.05:.3g} H, {hill / h:.3g} h)"
    assert rows["softening"] == f"0.03 (0.6 H, {0.03 / h:.3g} h)"
    depth = 1e-6 / 0.05**5 / 0.01
    assert rows["gap"] == f"K = {depth:.3g}: Sigma in the gap falls to a fraction of {1 / (1 + 0.04 * depth):.2g}"
    inviscid = of_companion(load_scene({k: v for k, v in planet_disc().items() if k != "alpha_viscosity"}))
    assert set(inviscid) == set(rows) - {"gap"}


@pytest.mark.parametrize("felt", [True, False])
@pytest.mark.parametrize("orbit", ["fixed", "live"])
def test_elements_and_period_are_those_of_its_orbit(orbit, felt):
    """During its ramp too, and of the star's mass alone where the star does not feel it."""
    companion = {"mass": 0.3, "semi_major_axis": 1.7, "eccentricity": 0.5, "phase": 70.0, "softening": "0.1"}
    star = {"mass": 0.9, "indirect": ["companions"] if felt else []}
    scene = load_scene(tables(companion | {"ramp": 3.0, "orbit": orbit}, star=star))
    sim = Simulation(scene, particles={"dust": GRAIN})
    sim.run(1.0)
    mass = 1.2 if felt else 0.9
    assert of_companion(scene)["period"] == f"{2 * math.pi * math.sqrt(1.7**3 / mass):.4g}"
    row = dict(zip(COLUMNS, companion_rows(sim.state, sim.time)[0], strict=True))
    assert row["mass"] == 0.3 and row["felt_mass"] == pytest.approx(0.3 * math.sin(math.pi / 6) ** 2, rel=1e-13)
    # The grain of 1e-12 pulls it.
    found = [row["semi_major_axis"], row["eccentricity"], row["pericentre"]]
    np.testing.assert_allclose(found, [1.7, 0.5, 0.0], rtol=1e-9, atol=1e-7)


def test_check_says_what_it_can():
    """Of a second star no Hill radius, in a cavity no h, of one that flies by no period, without gas no H."""
    star = {"mass": 1.0, "frame": "inertial", "centre": "barycentre"}
    second = load_scene(planet_disc({"mass": 0.5, "semi_major_axis": 0.3}, star=star))
    # H is about both stars.
    assert set(of_companion(second)) == {"period", "softening"} and "h)" not in of_companion(second)["softening"]
    assert set(of_companion(load_scene(tables(PLANET | {"eccentricity": 1.5})))) == {"Hill radius", "softening"}
    assert of_companion(load_scene(tables(PLANET)))["softening"] == "0.02"
    rows = of_companion(load_scene(planet_disc() | {"companion": [PLANET, PLANET | {"semi_major_axis": 1.5}]}), 2)
    assert rows["period"] == f"{2 * math.pi * math.sqrt(1.5**3 / 1.001):.4g}"
    assert warnings(load_scene(tables(PLANET))) == []


@pytest.mark.parametrize(
    ("companion", "expected"),
    [
        ({}, []),
        ({"softening": "0.01"}, ["companion.softening of companion 1 is"]),
        ({"softening": "0.01", "accretion_radius": 0.1}, []),
        ({"mass": 1e-5, "softening": "0.001", "accretion_radius": 0.1}, ["the Hill radius of companion 1 is"]),
        ({"mass": 1e-5}, []),  # its softening hides it
        ({"softening": "0.01", "semi_major_axis": 3.0}, []),  # beyond the gas
    ],
)
def test_check_warns_where_gas_is_too_coarse(companion, expected):
    said = [line for line in warnings(load_scene(planet_disc(companion))) if "companion 1" in line]
    assert len(said) == len(expected)
    for line, start in zip(said, expected, strict=True):
        assert line.startswith(start)
        needed = float(
            line.rpartition("about ")[2].removesuffix(" gas.particles")
        )  # with as many particles there is no warning, but for rounding
        more = planet_disc(companion) | {"gas": planet_disc()["gas"] | {"particles": int(1.05 * needed)}}
        assert not [line for line in warnings(load_scene(more)) if "companion 1" in line]


def test_the_forecast_knows_the_companion_s_step():
    """Of gas within a short softening; nothing of a companion outside it."""
    heavy = {"mass": 0.02, "softening": "0.01"}
    alone = {name: table for name, table in planet_disc().items() if name != "companion"}
    alone["star"] = alone["star"] | {"frame": "inertial"}  # with its pull in the kick, as beside a companion
    outside = planet_disc(heavy | {"semi_major_axis": 2.5})
    alone, near, away = (expected_steps(load_scene(scene)) for scene in (alone, planet_disc(heavy), outside))
    assert near.number > 2 * alone.number and near.where == "near companion 1"
    assert away.number == pytest.approx(alone.number, rel=1e-9)
    wide = planet_disc({"mass": 0.02, "softening": "0.03"})
    wide["gas"]["kernel"] = "cubic"  # whose sums other tests have
    sim = Simulation(wide)
    sim.step()
    assert sim.limited_by == "companion"
    # Of the first steps, in which gas falls into the softening: later it is as dense there as nothing but SPH limits.
    sim.evolve(math.inf, lambda: sim.state.step == 10)
    assert 1.0 / 1.5 < expected_steps(load_scene(wide), sim.time).number / 10 < 1.5
    # On an eccentric orbit it is its own motion near the star, and else the gas: the mean over the time.
    eccentric = expected_steps(load_scene(planet_disc({"mass": 1e-6, "softening": "0.05", "eccentricity": 0.95})))
    anomaly, gas = (np.arange(40_000) + 0.5) * 2.0 * np.pi / 40_000, alone.number * 0.6 / 10.0
    distance = 1.0 - 0.95 * np.cos(anomaly)
    expected = 10.0 / 0.6 * np.mean(distance * np.maximum(2.0 * distance**-1.5, gas))
    assert eccentric.number == pytest.approx(expected, rel=0.05)
