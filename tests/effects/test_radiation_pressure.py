"""Light on dust: lighter orbits, drift in given and in SPH gas, momentum, starts, and scenes that may name it."""

import numpy as np
import pytest
from operating import limits_of
from runs import assert_resumes

from discsim import Simulation
from discsim.exact import nsh
from discsim.numerics.operators import smallest_limits
from discsim.run.forces import acceleration_of
from discsim.scene import SceneError, load_scene

ASPECT = 0.05


def scene(beta=0.3, stokes=1e-3, **tables):
    """Dust of one radius in a given disc; `tables` take the place of its own, or are more."""
    eos = {"kind": "locally-isothermal", "aspect_ratio": ASPECT}
    base = {
        "units": {"system": "code"},
        "run": {"until": 5.0, "timestep": 100 * stokes},
        "space": {"size": 8.0},
        "background": {"surface_density": 1e-4, "eos": eos},
        "initial": {"kind": "disc", "mass": 1e-3, "inner": 0.99, "outer": 1.01},
        "dust": {"particles": 50, "ratio": 0.01},
        "star": {"mass": 1.0},
        "drag": {"law": "stokes-number", "stokes": stokes, "direction": "one-way"},
    }
    whole = base | ({} if beta is None else {"radiation_pressure": {"beta": beta}}) | tables
    return {name: table for name, table in whole.items() if table is not None}


def gaseous(beta, **tables):
    """The same light on dust in SPH gas."""
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.1}
    own = {"background": None, "gas": {"particles": 1000, "eos": eos, "viscosity": {}}, "run": {"until": 1.0}}
    initial = {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 2.0}
    return scene(beta, **({"initial": initial, "dust": {"particles": 800, "ratio": 0.1}} | own | tables))


def radii(sim):
    return np.linalg.norm(sim.dust.pos, axis=1)[np.argsort(sim.dust.ids)]


@pytest.mark.parametrize("beta", [0.3, 0.01, [0.0]])
def test_drift_in_given_gas_at_a_hundred_stopping_times(beta):
    """v_r = (beta - 2 eta) v_K / (St + 1 / St), eta = (p + q) (H/r)^2 / 2 (Takeuchi & Artymowicz 2001, eq. 23): at 50
    steps of 100 t_stop within 1e-4, of the order of St.
    """
    sim = Simulation(scene(beta))
    r = start = radii(sim)
    for _ in range(50):  # of the midpoint rule, where v changes by 1e-5 in each
        speed = [0.0]
        for _ in range(2):
            middle = r + 0.05 * speed[-1]
            eta = 0.75 * ASPECT**2 * middle**0.5
            speed.append((np.squeeze(beta) - 2 * eta) / (1e-3 + 1e3) * middle**-0.5)
        r = r + 0.1 * speed[-1]
    sim.run()
    assert sim.state.step == 50
    np.testing.assert_allclose((radii(sim) - start) / (r - start), 1.0, rtol=1e-4)


def test_each_population_has_its_own():
    dust = [{"particles": 20, "ratio": 0.01}] * 3
    sim = Simulation(scene([0.0, 0.1, 0.3], dust=dust))
    start = radii(sim)
    sim.run()
    moved = (radii(sim) - start).reshape(3, 20).mean(axis=1)
    alone = [Simulation(scene(beta)) for beta in (0.0, 0.1, 0.3)]
    for sim, found in zip(alone, moved, strict=True):
        start = radii(sim)
        sim.run()
        assert (radii(sim) - start).mean() == pytest.approx(found, rel=1e-3)  # they start on rings of their own


@pytest.mark.parametrize("softening", [0.0, 1e-9])
@pytest.mark.parametrize("beta", [0.2, 0.9])
def test_a_lighter_grain_keeps_its_circle(beta, softening):
    """Without gas a start in balance turns with sqrt(1 - beta) of Kepler's velocity, on a circle: in the drift, and
    about a softened star in kicks.
    """
    star = {"mass": 1.0, "softening": softening}
    sim = Simulation(scene(beta, background=None, drag=None, star=star, run={"until": 10.0, "courant": 0.02}))
    speed = np.linalg.norm(sim.dust.vel, axis=1) * radii(sim)[sim.dust.ids] ** 0.5
    np.testing.assert_allclose(speed, np.sqrt(1.0 - beta), rtol=1e-12)
    start = radii(sim)
    sim.run()
    # Of kicks with Omega dt = .01 (Omega dt)^2 / 8 = 1.25e-5 of its speed, and four times that of r at most.
    np.testing.assert_allclose(radii(sim), start, rtol=6e-5 if softening else 1e-12)


def test_energy_of_an_unbound_grain():
    """beta = 2: it is pushed as much as it was pulled, and leaves; kinetic and potential energy stay."""
    given = {"pos": [[1.0, 0.0]], "vel": [[0.0, 1.0]], "mass": [1e-6]}
    tables = scene(2.0, background=None, drag=None, initial=None, run={"until": 2.0, "courant": 0.01})
    sim = Simulation(tables, particles={"dust": given})

    def energy():
        return 0.5e-6 * (sim.dust.vel**2).sum() + sum(each.potential_energy(sim.state) for each in sim.effects.values())

    before = energy()
    sim.run()
    assert energy() == pytest.approx(before, rel=1e-4)
    assert radii(sim)[0] > 2.4


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_slip_in_sph_gas_at_a_hundred_stopping_times(scheme):
    """What light adds to the slip in a step: beta G M t_stop / r^2 outwards, the gas being the same to the last bit.

    As far as cells of drag have the mean of what varies within them: 1% by tsc, .3% by idic-linear.
    """
    found = []
    for beta in (None, 0.3):
        drag = {"law": "stokes-number", "stokes": 1e-3, "direction": "one-way", "scheme": scheme}
        many = {"dust": {"particles": 6000, "ratio": 0.1}, "run": {"until": 1.0, "timestep": 0.1}}
        tables = gaseous(beta, drag=drag, **many)
        tables["star"] = tables["star"] | {"softening": 1e-9}  # in the kick in both, as it is with light and drag
        tables["gas"]["particles"] = 6000  # in cells of 2 h, whose edges are to be near none of the ring looked at
        sim = Simulation(tables)
        sim.run(0.1)
        found.append((sim.dust.pos[np.argsort(sim.dust.ids)], sim.dust.vel[np.argsort(sim.dust.ids)], sim.gas.vel))
    np.testing.assert_array_equal(found[0][2], found[1][2])
    place = found[0][0]
    r = np.linalg.norm(place, axis=1)
    gained = ((found[1][1] - found[0][1]) * place).sum(axis=1) / r
    inside = (r > 1.2) & (r < 1.8)
    assert gained[inside].mean() == pytest.approx((0.3e-3 * r**-0.5)[inside].mean(), rel=0.02)


def test_light_is_softened_as_the_pull_that_it_is_a_share_of():
    """beta of the pull of a star of 1.7 with a softening of .4, of each of two populations; no gas is there."""
    dust = [{"particles": 30, "ratio": 0.01}, {"particles": 20, "ratio": 0.01}]
    star = {"mass": 1.7, "softening": 0.4}
    sim = Simulation(scene([0.3, 0.9], background=None, drag=None, dust=dust, star=star))
    pull, push = (sim.acceleration(name)[1] for name in ("star", "radiation_pressure"))
    share = np.array([0.3, 0.9])[sim.dust.species]
    np.testing.assert_allclose(push, -share[:, None] * pull, rtol=1e-13)
    r2 = (sim.dust.pos**2).sum(axis=1)
    np.testing.assert_allclose(pull, -1.7 * sim.dust.pos / ((r2 + 0.16) ** 1.5)[:, None], rtol=1e-13)


def test_momentum_comes_from_the_star_alone():
    """Two-way drag in a kick of 20 t_stop: gas and dust gain what forces gave, and gas feels light by drag alone."""
    sim = Simulation(gaseous(0.3, drag={"law": "stopping-time", "t_stop": 0.01}))
    sim.step()
    push = sum(p.mass @ p.acc for p in (sim.gas, sim.dust))
    before = sum(p.mass @ p.vel for p in (sim.gas, sim.dust))
    sim.effects["drag"].kick(sim.state, 0.2)
    after = sum(p.mass @ p.vel for p in (sim.gas, sim.dust))
    size = sum(float(p.mass.sum()) for p in (sim.gas, sim.dust))
    np.testing.assert_allclose(after - before, 0.2 * push, rtol=0, atol=1e-14 * size)
    given, felt = sim.acceleration("radiation_pressure")
    assert not given.any()
    star = sim.acceleration("star")[1]
    np.testing.assert_allclose(felt, -0.3 * star, rtol=1e-14)


def test_dust_starts_with_the_drift_that_light_gives():
    """Two-way, two populations in SPH gas: NSH with a push, whose equations are checked below."""
    dust = [{"particles": 400, "ratio": 0.1}, {"particles": 400, "ratio": 0.2}]
    drag = {"law": "stokes-number", "stokes": 0.1}
    sim = Simulation(gaseous([0.1, 0.0], dust=dust, drag=drag))
    r = np.linalg.norm(sim.dust.pos, axis=1)
    radial = (sim.dust.pos * sim.dust.vel).sum(axis=1) / r
    headwind = 0.5 * 1.5 * 0.1**2 * np.ones(1)
    push = np.array([[0.1], [0.0]])
    wanted = nsh.velocities_of_populations(np.full((2, 1), 0.1), np.array([[0.1], [0.2]]), headwind, push)
    for number in (0, 1):
        own = (sim.dust.species == number) & (r > 1.3) & (r < 1.7)
        found = (radial * r**0.5)[own]  # of v_K; the headwind is a little that of the place
        assert found.mean() == pytest.approx(wanted.dust_radial[number, 0], abs=1e-3)
    assert wanted.dust_radial[0, 0] > 0.0 > wanted.dust_radial[1, 0]


def test_drift_with_a_push_balances():
    """The equations of motion of gas and dust about a circle, in units of its frequency, leave nothing."""
    rng = np.random.default_rng(3)
    stokes, ratios, push = rng.uniform(0.01, 3.0, (3, 4, 5))
    headwind = rng.uniform(0.1, 1.0, 5)
    v, w, vd, wd = nsh.velocities_of_populations(stokes, ratios, headwind, push)
    np.testing.assert_allclose(2 * wd - (vd - v) / stokes + push, 0.0, atol=1e-13)
    np.testing.assert_allclose(-0.5 * vd - (wd - w) / stokes, 0.0, atol=1e-13)
    np.testing.assert_allclose(2 * w + (ratios * (vd - v) / stokes).sum(axis=0) + 2 * headwind, 0.0, atol=1e-12)
    np.testing.assert_allclose(-0.5 * v + (ratios * (wd - w) / stokes).sum(axis=0), 0.0, atol=1e-12)


def test_one_way_dust_does_not_shorten_the_step():
    tables = gaseous(50.0, drag={"law": "stopping-time", "t_stop": 0.1, "direction": "one-way"})
    sim = Simulation(tables | {"run": tables["run"] | {"courant": 0.2}})
    sim.step()
    found = limits_of(sim, "radiation_pressure")
    assert smallest_limits(found, sim.state.dust_is_passive)[0] == np.inf
    assert found["dust"].step == pytest.approx(0.5 * (radii(sim).min() ** 3 / 50.0) ** 0.5)


def test_it_goes_on_from_a_checkpoint_to_the_bit(tmp_path):
    dust = [{"particles": 500, "ratio": 0.1}, {"particles": 500, "ratio": 0.2}]
    tables = gaseous([0.1, 0.3], dust=dust, drag={"law": "stopping-time", "t_stop": 0.01})
    assert_resumes(tables, tmp_path / "half.h5", 0.1, 0.2)


@pytest.mark.parametrize(
    ("tables", "wrong"),
    [
        (scene(-0.1), r"radiation_pressure\.beta: -0\.1 is out of range; expected at least 0"),
        (scene([]), r"radiation_pressure\.beta: the list is empty; expected a number"),
        (scene("0.3"), r"radiation_pressure\.beta: \"0\.3\" is not a number"),
        (
            scene([0.1, 0.2]),
            r"radiation_pressure\.beta: 2 numbers for 1 populations of dust; give one number",
        ),
        (scene(None, radiation_pressure={}), r"radiation_pressure\.beta: missing"),
        (scene(None, radiation_pressure={"beta": 0.1, "betta": 1.0}), r"betta: unknown key; .* did you mean \"beta\""),
    ],
)
def test_bad_keys(tables, wrong):
    with pytest.raises(SceneError, match=wrong) as fault:
        load_scene(tables)
    assert len(fault.value.problems) == 1


def test_scenes_without_star_or_dust():
    tables = gaseous(0.1, dust=None, drag=None)
    with pytest.raises(SceneError, match=r"radiation pressure acts on dust; add a table \[dust\]"):
        load_scene(tables)
    box = {
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box"}, "dust": {"particles": 10, "ratio": 1.0}, "radiation_pressure": {"beta": 0.1},
        "gas": {"particles": 100, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    }  # fmt: skip
    with pytest.raises(SceneError, match=r"radiation pressure needs a star; add a table \[star\]"):
        load_scene(box)


def test_light_at_the_start_is_a_share_of_a_softened_pull():
    """Circles of grains without drag, v^2 = (1 - beta) M r^2 / (r^2 + s^2)^(3/2), and the drift in cold gas."""
    mass, soft, beta, stokes = 1.7, 0.9, 0.3, 0.4
    star, start = {"mass": mass, "softening": soft}, {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 2.0}
    own = {"background": None, "dust": {"particles": 300, "ratio": 0.1}, "initial": start, "star": star}
    sim = Simulation(scene(beta, **own, drag=None))
    r = np.hypot(*sim.dust.pos.T)
    circle = np.sqrt(mass * r**2 / (r**2 + soft**2) ** 1.5)
    speed = (sim.dust.pos[:, 0] * sim.dust.vel[:, 1] - sim.dust.pos[:, 1] * sim.dust.vel[:, 0]) / r
    np.testing.assert_allclose(speed, np.sqrt(1.0 - beta) * circle, rtol=1e-12)
    # With gas so cold that it has no headwind: grains get beta g outwards, of which NSH's drift is St / (1 + St^2).
    cold = {"particles": 400, "eos": {"kind": "isothermal", "sound_speed": 1e-4}}
    drag = {"law": "stokes-number", "stokes": stokes, "direction": "one-way"}
    sim = Simulation(scene(beta, **own | {"gas": cold, "drag": drag}))
    dust = sim.dust
    r = np.hypot(*dust.pos.T)
    out = (dust.pos * dust.vel).sum(axis=1) / r
    circle = np.sqrt(mass * r**2 / (r**2 + soft**2) ** 1.5)
    np.testing.assert_allclose(out, beta * circle * stokes / (1.0 + stokes**2), rtol=0.01)  # of first order in beta


def test_light_comes_from_the_star_where_that_is():
    """beta G M d / d^3 from a star that its companion has moved off the origin."""
    star = {"mass": 1.4, "frame": "inertial"}
    other = {"mass": 0.5, "semi_major_axis": 0.3, "phase": 70.0, "orbit": "live", "softening": 0.05}
    sim = Simulation(gaseous(0.35, star=star, companion=other))
    sim.step()
    away = sim.dust.pos - sim.bodies.pos[0]
    assert np.hypot(*sim.bodies.pos[0]) > 0.05
    wanted = 0.35 * 1.4 * away / np.hypot(*away.T)[:, None] ** 3
    found = acceleration_of(sim.effects["radiation_pressure"], sim.state)["dust"]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
