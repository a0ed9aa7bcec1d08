"""Turbulent diffusion of dust: spreading, balance with gas and drifts, what is conserved, the same bits, bad keys."""

import numpy as np
import pytest
from problems import layer
from runs import on_threads, state_bits
from scenes import changed, problems

from discsim import Simulation
from discsim.drag.base import KickResult
from discsim.exact import diffusion

BUMP = {"radius": 1.0, "width": 0.1, "height": 4.0}


def box(dimensions=1, gas=100, dust=1000, until=0.5, D=1e-3, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box"},
        "gas": {"particles": gas, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": dust, "ratio": 0.01},
        "dust_diffusion": {"D": D},
        **tables,
    }


def given(stokes, alpha, until, dust=4000, inner=0.8, outer=1.2, **tables):
    """Dust on a bump of a given disc of H/r = .1, as wide as H, at every radius of one Stokes number."""
    return {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"size": 6.0},
        "background": {
            "surface_density": 1e-3,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": 1.0},
            "bump": BUMP,
        },
        "initial": {"kind": "disc", "surface_density": 1e-3, "inner": inner, "outer": outer},
        "dust": {"particles": dust, "ratio": 0.01},
        "star": {"mass": 1.0, "accretion_radius": 0.5},
        "drag": {"law": "stokes-number", "stokes": stokes, "direction": "one-way"},
        "dust_diffusion": {"alpha": alpha},
        **tables,
    }


def disc(until=1.0, gas=1200, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"size": 5.0},
        "initial": {"kind": "disc", "mass": 1e-3, "inner": 0.7, "outer": 1.6},
        "gas": {
            "particles": gas,
            "kernel": "cubic",
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1},
            "viscosity": {},
        },
        "dust": {"particles": 900, "ratio": 0.3},
        "star": {"mass": 1.0, "accretion_radius": 0.3},
        "drag": {"law": "stokes-number", "stokes": 0.1},
        "dust_diffusion": {"alpha": 0.05},
        **tables,
    }


@pytest.mark.parametrize("law,index", [("epstein", 0.0), ("epstein-stokes", 0.0), ("epstein", 1.7)])
def test_drift_of_stirred_dust_has_every_gradient(law, index):
    """grad D + D grad ln Sigma of D = alpha c^2 / (Omega (1 + St^2)), St about 1, by differences of D and Sigma.

    In Stokes' regime St ~ 1 / c, whose gradient is half that of c^2; about a softened star, in gas with a bump, with
    one alpha or one that is a power of the radius.
    """
    from discsim.kernels.dust import diffusion as kernels

    tables = given(1.0, 0.02, 1.0, star={"mass": 1.3, "softening": 0.3})
    tables["background"]["eos"] |= {"temperature_index": 0.8}
    tables["drag"] = {"law": law, "direction": "one-way"}
    tables["dust"] |= {"grain_size": 3e-4, "grain_density": 1.1}
    if law == "epstein-stokes":
        tables["drag"]["mean_free_column"] = 1e-8
        tables["dust"]["grain_size"] = 5e-5
    if index > 0.0:
        tables["dust_diffusion"], tables["alpha_viscosity"] = {}, {"alpha": 0.02, "index": index}
    sim = Simulation(tables)
    drag, stirs = sim.effects["drag"], sim.effects["dust_diffusion"]
    row, stirring = stirs._turbulence(sim.state)

    def at(r):
        """D, the drift and Sigma at places on a ray, and St."""
        pos = np.stack([0.6 * r, 0.8 * r], axis=1)
        field, strength = np.zeros((len(r), 7)), np.empty(len(r))
        drift, times, norm = np.empty((len(r), 2)), np.empty(len(r)), np.ones(len(r))
        kernels.write_gas_of_disc(0, len(r), pos, drag.kernel_disc(1.3), field)
        omega = np.sqrt(1.3 / (r * r + 0.09) ** 1.5)
        speed = np.sqrt(field[:, kernels.SPEED2])
        for i in range(len(r)):
            times[i] = drag.law.stopping_time(0, field[i : i + 1, 0], speed[i : i + 1], omega[i : i + 1], 0.01)[0]
        kernels.write_diffusivities(
            0, len(r), pos, np.zeros(4), row[: len(r)], field, times, norm, True, stirring, strength, drift
        )
        return strength, drift @ [0.6, 0.8], field[:, kernels.DENSITY].copy(), times * omega

    r = np.array([0.8, 0.95, 1.08, 1.3])
    strength, drift, _, stokes = at(r)
    assert stokes.min() > 0.1 and stokes.max() < 10.0
    (more, _, dense, _), (less, _, thin, _) = at(r * 1.002), at(r / 1.002)
    wide = r * (1.002 - 1 / 1.002)
    wanted = (more - less) / wide + strength * np.log(dense / thin) / wide
    np.testing.assert_allclose(drift, wanted, rtol=0.005, atol=0.005 * strength.max())  # differences over .004 r


def density(scene, r):
    return Simulation(scene).effects["drag"].disc.surface_density(r)


def test_a_line_spreads():
    """By 2 D t in gas at rest; the variance of 60,000 grains is known to .6%."""
    tables = box(dust=60_000, drag={"law": "stopping-time", "t_stop": 0.01, "direction": "one-way"})
    sim = Simulation(tables)
    sim.dust.pos[:] = 0.5
    sim.run()
    x = sim.dust.pos[:, 0] - 0.5
    assert x.var() == pytest.approx(2e-3 * 0.5, rel=0.02)
    assert abs(x.mean()) < 4.0 * np.sqrt(1e-3 / 60_000)
    edges = np.linspace(-0.1, 0.1, 21)
    found = np.histogram(x, edges)[0] / 60_000 / 0.01
    # Of 300 grains in the outermost bins.
    np.testing.assert_allclose(found, diffusion.line(edges[:-1] + 0.005, 0.5, 1e-3), rtol=0.25, atol=0.1)
    assert np.abs(sim.dust.vel).max() < 1e-13  # without a star velocities stay; the gas's have rounding


def test_a_line_spreads_where_a_step_has_many_of_the_walk():
    """By 2 D t as well: each of some ten parts of a step has random numbers of its own."""
    drag = {"law": "stopping-time", "t_stop": 0.01, "direction": "one-way"}
    sim = Simulation(box(dust=20_000, D=0.05, until=0.02, drag=drag))
    sim.dust.pos[:] = 0.5
    sim.run()
    assert sim.state.step < 8
    # The variance of 20,000 grains is known to 1%.
    assert sim.dust.pos[:, 0].var() == pytest.approx(2.0 * 0.05 * 0.02, rel=0.04)


@pytest.mark.slow
def test_dust_follows_the_gas_into_a_bump():
    """Grains that begin evenly end where Sigma_d ~ Sigma_g = 1 + cos(2 pi x) / 2, of which the mean of cos is 1/4."""
    sim = Simulation(box(gas=60, dust=30_000, D=0.05))
    x = np.linspace(0.0, 1.0, 4001)
    mass = x + 0.5 * np.sin(2 * np.pi * x) / (2 * np.pi)
    sim.gas.pos[:, 0] = np.interp((np.arange(60) + 0.5) / 60, mass, x)
    sim._prepare()
    moments = []
    for sim.state.step in range(250):  # 4.9 decay times, of 1 / (D k^2); the gas stays, as nobody moves it
        sim.effects["dust_diffusion"].move(sim.state, 0.01)
        if sim.state.step >= 200 and sim.state.step % 10 == 0:
            moments.append([f(n * 2 * np.pi * sim.dust.pos[:, 0]).mean() for f, n in ((np.cos, 1), (np.cos, 2))])
    one, two = np.mean(moments, axis=0)
    # 30,000 grains know it to .004, less by the mean; what is left of the start is .007 of it, all else h's width.
    assert one == pytest.approx(0.25, abs=0.03 * 0.25)
    assert abs(two) < 0.01


def test_dust_of_an_even_ratio_stays_so_in_a_disc():
    """St = 1e-9, so that nothing drifts, for the time of diffusion over a bump: Sigma_d / Sigma_g stays even."""
    n = 16_000
    sim = Simulation(given(1e-9, 0.1, until=10.0, dust=n, inner=0.5, outer=1.8))
    r = np.linspace(0.5, 1.8, 4001)
    sigma = sim.effects["drag"].disc.surface_density(r)
    mass = np.concatenate([[0.0], np.cumsum(np.diff(r) * (0.5 * (sigma * r)[1:] + 0.5 * (sigma * r)[:-1]))])
    rng = np.random.default_rng(2)
    start, angle = np.interp((np.arange(n) + 0.5) / n, mass / mass[-1], r), rng.uniform(0.0, 2 * np.pi, n)
    sim.dust.pos[:] = start[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    sim.dust.vel[:] = np.stack([-np.sin(angle), np.cos(angle)], axis=1) / np.sqrt(start)[:, None]
    edges = np.array([0.83, 0.93, 1.07, 1.2])
    expected = n * np.diff(np.interp(edges, r, mass)) / mass[-1]
    counts = []
    for until in (4.0, 7.0, 10.0):
        sim.run(until)
        counts.append(np.histogram(np.hypot(*sim.dust.pos.T), edges)[0])
    # 2500 grains a bin or more, three times: 1.5%. Without grad ln Sigma the bump would lose a third of what it holds.
    np.testing.assert_allclose(np.mean(counts, axis=0), expected, rtol=0.03)


def test_a_ring_is_as_wide_as_drift_and_diffusion_have_it():
    """Sigma_d ~ Sigma_g P^(St / alpha) on a bump as wide as H."""
    stokes, alpha = 0.1, 0.02
    scene = given(stokes, alpha, until=160.0)
    sim = Simulation(scene)
    r = np.linspace(0.8, 1.17, 2001)  # beyond are 2% of them, or not yet
    sigma = sim.effects["drag"].disc.surface_density(r)
    weight = r * diffusion.ring(sigma, sigma * 0.01 / r, alpha, stokes)
    middle = np.average(r, weights=weight)
    width = np.sqrt(np.average((r - middle) ** 2, weights=weight))
    found = []
    for until in np.arange(80.0, 161.0, 10.0):
        sim.run(until)
        found.append(np.hypot(*sim.dust.pos.T))
    found = np.concatenate(found)
    near = (found > r[0]) & (found < r[-1])
    assert near.mean() > 0.95
    # Some 10 independent sets of 4000: to .4%.
    assert found[near].std() == pytest.approx(width, rel=0.03)
    assert found[near].mean() == pytest.approx(middle, abs=0.05 * width)


@pytest.mark.slow
@pytest.mark.parametrize("stokes", [0.03, 0.5])
def test_a_layer_is_as_thick_as_settling_and_diffusion_have_it(stokes):
    alpha = 0.03
    exact = diffusion.layer_height(1.0, alpha, stokes)
    tables = layer(stokes, 30.0, particles=70)
    sim = Simulation(tables | {"dust": {"particles": 3000, "ratio": 1e-6}, "dust_diffusion": {"alpha": alpha}})
    sim.dust.pos *= exact  # from near its end
    squares = []
    for until in np.arange(6.0, 31.0, 4.0):
        sim.run(until)
        squares.append((sim.dust.pos**2).mean())
    # 3000 grains, two or more of the seven times independent: 1%; St alpha, which eq. (3) leaves out, .5%.
    assert np.sqrt(np.mean(squares)) == pytest.approx(exact, rel=0.03)


@pytest.mark.parametrize("softening", [0.0, 1e-9])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_circles_stay_circles(sense, softening):
    """Grains on circles are on circles after a walk, with velocities half a step behind their places where the pull is
    in the kick, as that of a softened star; clockwise too.
    """
    tables = disc()
    sim = Simulation(tables | {"star": tables["star"] | {"softening": softening}})
    sim._prepare()
    effect, dust, lag = sim.effects["dust_diffusion"], sim.dust, 0.03

    def circles():
        r = np.hypot(*dust.pos.T)
        x, y = dust.pos.T / r
        sine = r**-1.5 * lag if softening else 0.0 * r
        cosine = np.sqrt(1.0 - sine**2)
        radial, azimuthal = sine, sense * cosine
        return np.stack([x * radial - y * azimuthal, y * radial + x * azimuthal], axis=1) / np.sqrt(r)[:, None]

    dust.vel[:] = circles()
    before = dust.pos.copy()
    sim.effects["drag"].engine.record(dust, KickResult(np.arange(0), np.full(dust.count, 0.1)))
    sim.state.velocity_lag = -lag
    effect.move(sim.state, 2.0 * lag)
    assert np.abs(dust.pos - before).max() > 0.01
    np.testing.assert_allclose(dust.vel, circles(), atol=1e-12)


@pytest.mark.parametrize("stokes", [0.3, 1.0, 3.0])
def test_grains_walk_towards_where_they_are_stirred_more(stokes):
    """grad D by the slope of 1 / (1 + St^2): of grains of one stopping time St falls outwards as r^-3/2, and beside
    those of one Stokes number, which have the same D and random numbers, they move by dt 3 D St^2 / (1 + St^2) / r.
    """
    found, alpha, r, dt = [], 0.02, 1.3, 1e-3
    laws = {"law": "stokes-number", "stokes": stokes}, {"law": "stopping-time", "t_stop": stokes * r**1.5}
    for law in laws:
        sim = Simulation(given(stokes, alpha, 1.0, dust=40, drag=law | {"direction": "one-way"}))
        angle = np.arange(40.0)
        sim.dust.pos[:] = r * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        sim.effects["drag"].stopping_times = np.full(40, stokes * r**1.5)
        sim.effects["dust_diffusion"].move(sim.state, dt)
        found.append(sim.dust.pos.copy())
    outwards = ((found[1] - found[0]) * np.stack([np.cos(angle), np.sin(angle)], axis=1)).sum(axis=1)
    strength = alpha * 0.01 * np.sqrt(r) / (1.0 + stokes**2)  # alpha c_s^2 / Omega with H/r = .1, c_s^2 = .01 / r
    expected = dt * 3.0 * strength * stokes**2 / (1.0 + stokes**2) / r
    np.testing.assert_allclose(outwards, expected, rtol=1e-3)  # slopes by differences over 1e-4


def spin(p):
    return float(p.mass @ (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]))


def test_the_gas_loses_what_dust_gains():
    """Angular momentum of a walk to rounding, and none of it where drag is one-way."""
    sim = Simulation(disc())
    sim._prepare()
    sim.operators.kick(0.01)
    before = spin(sim.gas), spin(sim.dust)
    gas, dust = sim.gas.vel.copy(), sim.dust.vel.copy()
    sim.effects["dust_diffusion"].move(sim.state, 0.02)
    moved = spin(sim.dust) - before[1]
    assert abs(moved) > 1e-5 * before[1] and np.abs(sim.gas.vel - gas).max() > 1e-5
    assert spin(sim.gas) + spin(sim.dust) == pytest.approx(sum(before), rel=1e-14)
    assert not (sim.dust.vel == dust).all()


def test_the_recoil_is_that_of_the_flux():
    """Dust of a ring in even gas diffuses out of it, and the gas gains -F dl/dr, F = -D dSigma_d/dr: what is within the
    ring is braked, and without it hastened, as much as gas that is to come in its place.
    """
    tables = disc(gas=4000)
    tables["dust"] = {"particles": 3000, "ratio": 0.3, "inner": 1.0, "outer": 1.2}
    tables["gas"] = {"particles": 4000, "kernel": "cubic", "eos": {"kind": "isothermal", "sound_speed": 0.1}}
    tables["dust_diffusion"] = {"D": 1e-3}
    sim = Simulation(tables)
    sim._prepare()
    sim.operators.kick(0.0)
    gas, dust = sim.gas, sim.dust
    start, vel = dust.pos.copy(), gas.vel.copy()
    r = np.hypot(*gas.pos.T)
    width, x = 0.12, np.hypot(*start.T)
    # A smooth ring of the grains' own: the flux of a Gaussian about 1.1.
    angle = np.arctan2(start[:, 1], start[:, 0])
    place = 1.1 + width * np.sort(np.random.default_rng(1).standard_normal(len(x)))[np.argsort(np.argsort(x))]
    pos = place[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rounds = 200
    for sim.state.step in range(rounds):
        dust.pos[:] = pos
        dust.vel[:] = np.stack([-np.sin(angle), np.cos(angle)], axis=1) / np.sqrt(place)[:, None]
        sim.effects["dust_diffusion"].move(sim.state, 0.01)
    kick = gas.vel - vel
    change = (gas.pos[:, 0] * kick[:, 1] - gas.pos[:, 1] * kick[:, 0]) * gas.mass
    gained = np.array([change[r < 1.1].sum(), change[r > 1.1].sum()])
    # On each side half of the dust at D |x| / width^2, with dl/dr = .5 r^-.5; kernels smooth 5% of it away.
    # With all taken from the gas where a grain starts it would be twice as much, or none.
    flux = 1e-3 * 0.5 * np.sqrt(2 / np.pi) / width * dust.mass.sum() * rounds * 0.01
    np.testing.assert_allclose(gained, np.array([1.0, -1.0]) * flux * 0.5 / np.sqrt(1.1), rtol=0.15)


def test_one_way_dust_leaves_the_gas_alone():
    drag = {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}
    whole = Simulation(disc(0.2, drag=drag))
    alone = Simulation(changed(disc(0.2), dust=None, drag=None, dust_diffusion=None))
    for sim in (whole, alone):
        sim.run()
    assert whole.state.step == alone.state.step
    assert state_bits(whole)["gas"] == state_bits(alone)["gas"]


def test_bits_are_those_of_ids_and_steps(tmp_path, monkeypatch):
    """After a resume, and on any number of threads in any pieces."""
    scene = disc(0.3)
    whole = Simulation(scene)
    whole.evolve(0.1)
    whole.save(tmp_path / "a.h5")
    whole.evolve(0.3)
    again = Simulation(scene)
    again.restore(tmp_path / "a.h5")
    again.evolve(0.3)
    assert state_bits(again) == state_bits(whole)
    next(on_threads(monkeypatch, (3,), 40))
    again.restore(tmp_path / "a.h5")
    again.evolve(0.3)
    assert state_bits(again) == state_bits(whole)


def test_the_viscosity_and_its_dead_zone_are_the_default():
    dead = {"alpha": 0.01, "dead_alpha": 1e-4, "dead_inner": 0.9, "dead_outer": 1.3, "dead_width": 0.02}
    found = []
    for tables in ({"alpha_viscosity": dead, "dust_diffusion": {}}, {"dust_diffusion": {"alpha": 0.01}}):
        sim = Simulation(given(0.1, 0.01, 0.02) | tables)
        start = sim.dust.pos.copy()
        sim.effects["drag"].stopping_times = np.full(sim.dust.count, 0.1)
        sim.effects["dust_diffusion"].move(sim.state, 1e-3)
        found.append((np.hypot(*start.T), sim.dust.pos - start))
    (r, slow), (_, fast) = found
    inside, outside = (r > 0.98) & (r < 1.18), r < 0.84
    # The same xi: a hundredth of D has a tenth of the walk, but for 1e-3 of the drift's.
    np.testing.assert_allclose(slow[inside], 0.1 * fast[inside], rtol=0.05, atol=2e-5)
    np.testing.assert_allclose(slow[outside], fast[outside], rtol=0.05, atol=2e-5)


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"dust_diffusion": {"alpha": 0.01, "D": 1e-3}}, "alpha is also given"),
        (
            {"dust_diffusion": {}},
            "no strength of the turbulence is given; add the key alpha or D, or a table [alpha_viscosity]",
        ),
        ({"dust_diffusion": {"alpha": 0}}, "expected more than 0"),
        ({"dust_diffusion": {"D": -1}}, "expected more than 0"),
        ({"dust_diffusion": {"aplha": 0.1}}, 'did you mean "alpha"'),
        ({"drag": None}, "turbulent gas does not act on dust without drag"),
        ({"dust": None, "drag": None}, "dust diffusion needs dust"),
    ],
)
def test_bad_keys_end_in_one_message(change, wrong):
    tables = {name: table for name, table in (disc() | change).items() if table is not None}
    (message,) = [line for line in problems(tables) if "dust_diffusion" in line]
    assert wrong in message


@pytest.mark.parametrize(
    ("tables", "wrong"),
    [
        (
            {"dust_diffusion": {"alpha": 0.1, "D": None}, "drag": {"law": "stopping-time", "t_stop": 1.0}},
            "needs an orbital frequency",
        ),
        ({"dust_diffusion": {"alpha": 0.1, "D": None}, "gas": None}, "alpha c_s H needs gas"),
        (
            {"drag": {"law": "constant", "K": 1.0, "scheme": "emsi-ppm"}, "dust": {"particles": 100}},
            "does not allow dust diffusion",
        ),
    ],
)
def test_boxes_that_cannot_be(tables, wrong):
    messages = problems(changed(box(), **tables))
    assert any(wrong in message for message in messages)
