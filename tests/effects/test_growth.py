"""Dust that grows: one zone, where growth ends, what changes hands, starts, the same bits, bad keys."""

import numpy as np
import pytest
from growing import MATERIAL, SMALL, SMALLEST, disc, exchange, masses, one_zone, row_of, small_part, steady_flow
from runs import on_threads, put_out, state_bits
from scenes import changed, problems

from discsim import Simulation, load_scene
from discsim.effects.growth import GROWTH_STEP, Effect
from discsim.formulas import laws
from discsim.numerics.state import SubcycleClock
from discsim.preview.derived import gas_at_start
from discsim.scene import SceneError

ROOT = np.sqrt(2.0 * np.pi)


# One zone


@pytest.mark.parametrize("steps", [1, 40])
@pytest.mark.parametrize(("alpha", "slope"), [(1e-3, 2.0), (1e-5, 2.0), (0.1, 0.0)])
def test_one_zone_grows_as_its_ode(steps, alpha, slope):
    """Over six decades of sizes, in steps however long; small dust becomes grown dust on the way."""
    from discsim.kernels.dust import growth as kernels

    sigma, ratio, sound, until = 1e-3, 0.1, 0.05, 60.0
    law = np.array([MATERIAL * SMALL, 0.0, 0.0, 0.0, 0.0])
    grains = kernels.Grains(SMALL, SMALLEST, MATERIAL, 1e9, SMALL, laws.EPSTEIN, law, 0.0)
    size, wanted, place = np.array([SMALL]), np.empty(1), np.array([[1.0, 0.0]])
    field, dust = np.zeros((1, kernels.COLUMNS)), ratio * sigma
    for _ in range(steps):
        small = dust * small_part(size[0])
        field[0, :5] = sigma, small, dust - small, sound**2, -slope * sound**2
        about = place, np.zeros(2), field, np.array([alpha])
        kernels.grow(0, 1, until / steps, 1.0, 0.0, *about, grains, np.ones(1), size, wanted)
    expected = one_zone(SMALL, [until], sigma, ratio, sound, 1.0, alpha, 0.5 * slope * sound**2)
    assert size[0] > 50.0 * SMALL
    # Sub-steps are right to 1e-10 each, of which there are some dozens.
    assert size[0] == pytest.approx(expected[-1], rel=1e-7)


def test_large_grains_grow_by_the_speeds_of_stokes_drag():
    """Sizes from .1 to 30 times 9 lambda / 4, above which Stokes drag has longer stopping times than Epstein drag."""
    from discsim.kernels.dust import growth as kernels

    sigma, ratio, sound, alpha, omega, start, column = 1e-3, 0.1, 0.05, 1e-2, 0.7, 1e-6, 2.5e-8
    volume = sigma * omega / (ROOT * sound)
    edge = 9.0 * column / (4.0 * volume)
    assert 9.0 * start < edge < 11.0 * start
    law = np.array([MATERIAL * SMALL, 0.0, SMALL, column, 1.0])
    grains = kernels.Grains(SMALL, SMALLEST, MATERIAL, 1e9, SMALL, laws.EPSTEIN_STOKES, law, 0.0)
    size, wanted, place = np.array([start]), np.empty(1), np.array([[0.8, 0.6]])
    field, dust = np.zeros((1, kernels.COLUMNS)), ratio * sigma
    small = dust * small_part(start)
    field[0, :5] = sigma, small, dust - small, sound**2, -1.3 * sound**2
    about = place, np.zeros(2), field, np.array([alpha])
    kernels.grow(0, 1, 60.0, omega**2, 0.0, *about, grains, np.ones(1), size, wanted)
    given = sigma, ratio, sound, omega, alpha, 0.5 * 1.3 * sound**2 / omega
    expected = one_zone(start, [60.0], *given, edge=edge)[-1]
    assert expected > 30.0 * edge
    # Sub-steps are right to 1e-10 each, but for the one with the bend.
    assert size[0] == pytest.approx(expected, rel=1e-6)


def test_grains_of_a_disc_grow_as_its_zones_do():
    """Sizes rise by a factor of 1e4: SPH's noise of some per cent in Sigma is .02 of ln a, and drift has begun."""
    sim = Simulation(disc(until=2.0, size=SMALL, direction="one-way", growth={"alpha": 0.1}))
    sim.run()
    r = np.hypot(*sim.dust.pos.T)
    middle = np.flatnonzero((r > 0.9) & (r < 1.3))
    chosen = middle[:: len(middle) // 10]
    expected = [
        one_zone(SMALL, [2.0], 1e-3 / x, 0.3, 0.1 * x**-0.25, x**-1.5, 0.1, 0.5 * 1.5 * 0.01 * x**0.5)[-1]
        for x in r[chosen]
    ]
    grown = np.log(sim.dust.size[chosen] / SMALL)
    np.testing.assert_allclose(grown, np.log(np.array(expected) / SMALL), rtol=0.02)
    assert grown.min() > 6.0


def test_grains_are_behind_by_their_share_at_most(monkeypatch):
    """Against growth in every step; where there is a tenth of the dust it comes once in some of them."""
    sizes, grew = {}, {}
    for share in (GROWTH_STEP, 0.0):
        monkeypatch.setattr("discsim.effects.growth.GROWTH_STEP", share)
        star = {"mass": 1.0, "accretion_radius": 0.3}  # which takes none
        sim = Simulation(disc(gas=400, dust=300, size=1e-4, ratio=0.03, star=star))
        grew[share], sizes[share] = 0, []
        for _ in range(12):
            sim.step()
            grew[share] += sim.state.subcycle_clock.since == 0.0
            sizes[share].append(sim.dust.size[np.argsort(sim.dust.ids)])
    assert grew[0.0] == 12 and 2 <= grew[GROWTH_STEP] <= 6
    behind = np.log(np.array(sizes[0.0]) / np.array(sizes[GROWTH_STEP]))
    # A step's growth more, which is half of the share here; and grains are where they drift to at other sizes.
    assert 0.5 * GROWTH_STEP < behind.max() < 1.5 * GROWTH_STEP and behind.min() > -0.2 * GROWTH_STEP


# Where growth ends


def test_grains_end_at_the_size_at_which_they_break():
    """From below and, at once, from above: a_frag = 2 Sigma_g v^2 / (3 pi rho_s alpha c_s^2)."""
    for size, until in ((1e-6, 5.0), (1e-3, 0.1)):
        sim = Simulation(disc(until=until, size=size, growth={"fragmentation_speed": 3e-4}))
        sim.run()
        gas, r = sim.gas, np.hypot(*sim.dust.pos.T)
        middle = (r > 0.9) & (r < 1.3)
        apart = ((sim.dust.pos[:, None, :] - gas.pos) ** 2).sum(axis=2)
        sigma = (gas.density * (1.0 - gas.small / gas.mass))[apart.argmin(axis=1)]
        limit = 2.0 * sigma * 9e-8 / (3.0 * np.pi * MATERIAL * 1e-3 * 0.01 / np.sqrt(r))
        # Sigma of the nearest gas particle is that of the place to some per cent, and higher as it counts itself.
        np.testing.assert_allclose((sim.dust.size / limit)[middle], 1.0, atol=0.1)
        assert np.median((sim.dust.size / limit)[middle]) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("p", "slope"), [(1.0, -1.25), (0.75, -1.125), (0.5, -1.0)])
def test_drifting_grains_settle_at_the_drift_limit(p, slope):
    """A steady flow of grown dust inwards: a = 1.085 / |d ln a / d ln r| of 2 Sigma_d (v_K / c_s)^2 / (pi rho_s gamma).

    There settled grains, which grow at the rate sqrt(3) Omega Sigma_d / Sigma_g (St by the papers), drift over d ln r
    as they grow by d ln a; Birnstiel et al. (2012) have 1, times a factor f_d that they fit. H/r = .05, c_s^2 ~ r^-1/2.
    """
    # Drift adds to the turbulence's speeds, and H_d is not quite as thin as without it: 2 to 4%.
    ratio = steady_flow(p, alpha=1e-3, aspect=0.05, stokes=0.04, outer=40.0, inner=0.5)
    assert ratio == pytest.approx(np.sqrt(3.0) * np.pi / (2.0 * ROOT) / -slope, rel=0.05)


# What changes hands


def test_small_and_grown_dust_share_as_sizes_have_it():
    """Both ways: from all of it small, and from none of it."""
    for small in (None, 0.0):
        sim = Simulation(disc(size=1e-7, growth={"small_ratio": small, "fragmentation_speed": 1e-4}))
        for _ in range(6):
            sim.step()
        r = np.hypot(*sim.gas.pos.T)
        middle = (r > 0.9) & (r < 1.3)
        dust = (np.hypot(*sim.dust.pos.T) > 0.9) & (np.hypot(*sim.dust.pos.T) < 1.3)
        held, grown = sim.gas.small[middle].sum(), sim.dust.mass[dust].sum()
        expected = np.average(small_part(sim.dust.size[dust]), weights=sim.dust.mass[dust])
        assert held / (held + grown) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_mass_is_exact_with_what_is_accreted(direction):
    companion = {"mass": 1e-3, "semi_major_axis": 1.1, "softening": 0.05, "accretion_radius": 0.1}
    scene = disc(until=2.0, size=SMALL, direction=direction, companion=companion)
    sim = Simulation(changed(scene, star={"mass": 1.0, "accretion_radius": 0.7}))
    before = masses(sim)
    sim.run()
    row, bodies = row_of(sim), sim.bodies
    taken = bodies.accreted[1:].sum()
    assert row["accreted_small"] > 0.0 and bodies.accreted[1].min() > 0.0 and row["mass_dust"] > 1e-3 * before
    assert masses(sim) + taken == pytest.approx(before, rel=1e-13)  # rounding of some thousand sums
    np.testing.assert_allclose(row["mass_gas"] + row["accreted_gas"] + bodies.accreted[1, 0], before / 1.3, rtol=1e-13)


def test_a_body_gains_the_small_dust_of_the_gas_that_it_takes():
    """A companion and a star that grow weigh what they had, with gas, grown dust and the small dust in the gas."""
    companion = {"mass": 2e-3, "semi_major_axis": 1.1, "eccentricity": 0.2, "softening": 0.05, "accretion_radius": 0.1}
    scene = disc(until=0.4, size=SMALL, companion=companion)
    sim = Simulation(changed(scene, star={"mass": 1.3, "accretion_radius": 0.7, "grows": True, "indirect": []}))
    sim.run()
    taken = sim.bodies.accreted
    assert (taken[:, 1] > 0.1 * taken[:, 0]).all()  # a ratio of .3, all of it small at the start
    np.testing.assert_allclose(
        sim.bodies.mass, np.array([1.3, 2e-3]) + taken.sum(axis=1), rtol=1e-13
    )  # rounding of sums


def test_momentum_is_exact_and_angular_momentum_but_at_edges():
    """As small dust becomes grown dust, and as that breaks; rounding of sums of velocities of about 1 is 1e-15."""
    sim = Simulation(disc(size=1e-6))
    for _ in range(4):
        sim.step()
    dust = sim.dust
    inside = np.abs(np.hypot(*dust.pos.T) - 1.15) < 0.25
    for dt, speed in ((2.0, 1.0), (1e-9, 1e-4)):
        mass, momentum, spin, moved = exchange(sim, dt, speed)
        assert moved > 1e-3
        assert abs(mass) < 1e-14 and momentum < 1e-14
        assert 1e-12 < abs(spin) < 0.01 * moved  # of dust at the edges, with gas on one side of it
    keep = ~inside
    dust.remove(keep)
    mass, momentum, spin, moved = exchange(sim, 2.0, 1.0)
    assert moved > 1e-4
    assert max(abs(mass), momentum, abs(spin)) < 1e-14


@pytest.mark.parametrize("per_mass", ["u", "kick_rate", "radiated"])
def test_gas_keeps_its_heat(per_mass):
    """sum m u to rounding, as masses change; so of its rate, and of what the gas has radiated."""
    sim = Simulation(disc(size=1e-6))
    sim.step()
    setattr(sim.gas, per_mass, 1.0 + np.arange(sim.gas.count) / sim.gas.count)
    heat = sim.gas.mass @ getattr(sim.gas, per_mass)
    small, before = sim.gas.small.sum(), sim.gas.mass.copy()
    sim.state.subcycle_clock = SubcycleClock(2.0)
    sim.effects["growth"].event(sim.state)
    assert abs(sim.gas.small.sum() - small) > 1e-3 * small
    assert np.abs(sim.gas.mass / before - 1.0).max() > 1e-6
    assert sim.gas.mass @ getattr(sim.gas, per_mass) == pytest.approx(heat, rel=1e-14)


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_the_history_of_laden_gas_has_the_heat_of_the_gas_alone(direction):
    """K sigma^(gamma - 1) / (gamma - 1) of each mass of gas and its own sigma; of adiabatic gas, u of all the mass."""
    eos = {"kind": "polytropic", "gamma": 1.6, "constant": 0.4}
    scene = disc(ratio=1.0, gas=300, dust=300, direction=direction)
    sim = Simulation(scene | {"gas": scene["gas"] | {"eos": eos}})
    sim.step()
    gas = sim.gas
    share = 1.0 - gas.small / gas.mass if direction == "two-way" else 1.0
    wanted = (gas.mass * share) @ (0.4 * (gas.density * share) ** 0.6) / 0.6
    assert row_of(sim)["thermal"] == pytest.approx(wanted, rel=1e-12)
    eos = {"kind": "adiabatic", "gamma": 1.6, "aspect_ratio": 0.1}
    sim = Simulation(scene | {"gas": scene["gas"] | {"eos": eos}})
    with sim.synchronised() as state:
        wanted = state.gas.mass @ state.gas.u
    assert row_of(sim)["thermal"] == pytest.approx(wanted, rel=1e-12)


def test_small_dust_weighs_and_does_not_press():
    """The pressure of gas of one temperature, with as much small dust as gas, is half that of its density."""
    sim = Simulation(disc(gas=300, dust=300, ratio=1.0))
    sim._prepare()
    gas = sim.gas
    np.testing.assert_allclose(gas.small / gas.mass, 0.5, rtol=1e-9)
    np.testing.assert_allclose(gas.pressure, 0.5 * gas.density * gas.sound_speed**2, rtol=1e-9)
    alone = Simulation(changed(disc(gas=300), dust=None, drag=None, growth=None)).gas
    np.testing.assert_allclose(gas.mass, 2.0 * alone.mass, rtol=1e-9)


# Starts


def test_small_dust_starts_where_dust_is_and_in_balance():
    """Between the dust's radii, in all what the dust particles do not have; eta of gas and small dust is that of gas
    over 1 + their ratio.
    """
    scene = changed(disc(ratio=1.0, growth={"small_ratio": 0.75}), dust={"inner": 0.9, "outer": 1.3})
    sim = Simulation(scene)
    r = np.hypot(*sim.gas.pos.T)
    inside = (r > 0.9) & (r < 1.3)
    assert (sim.gas.small[~inside] == 0.0).all()
    gas = sim.gas.mass - sim.gas.small
    assert np.ptp(gas) < 1e-14 * gas[0] and np.ptp(sim.gas.small[inside]) < 1e-14 * sim.gas.small.max()
    # Of the smooth disc, of whose mass the particles within have theirs to some rings.
    whole = sim.gas.small.sum() + sim.dust.mass.sum()
    assert whole == pytest.approx(2.0 * np.pi * 1e-3 * 0.4, rel=1e-4)
    assert sim.gas.small.sum() == pytest.approx(0.75 * whole, rel=1e-13)
    all_small = Simulation(disc(ratio=1.0))
    r = np.hypot(*all_small.gas.pos.T)
    speed = (all_small.gas.pos[:, 0] * all_small.gas.vel[:, 1] - all_small.gas.pos[:, 1] * all_small.gas.vel[:, 0]) / r
    eta = 0.5 * 1.5 * 0.01 * np.sqrt(r)
    # The pressure moves twice its mass; dust particles are a seed of 1e-12.
    np.testing.assert_allclose(speed * np.sqrt(r), np.sqrt(1.0 - eta), atol=1e-10)


def test_grown_dust_at_the_start_loads_gas_with_its_small_dust():
    """Grown and small dust of .75 and .25 of the gas: nothing flows through a circle, and so v_g = -.6 v_d."""
    sim = Simulation(disc(ratio=1.0, size=1e-5, growth={"small_ratio": 0.25}))
    falls = []
    for p in (sim.gas, sim.dust):
        r = np.hypot(*p.pos.T)
        middle = (r > 0.9) & (r < 1.3)
        # Nearly as a power of r there.
        fit = np.polyfit(np.log(r[middle]), ((p.pos * p.vel).sum(axis=1) / r)[middle], 2)
        falls.append(np.polyval(fit, np.log(1.1)))
    gas, dust = falls
    assert gas > 1e-5 > 0.0 > dust
    assert gas / dust == pytest.approx(-0.75 / 1.25, rel=1e-3)  # of the fit


# Runs


def test_one_way_gas_notices_no_growth():
    grows = Simulation(disc(size=SMALL, direction="one-way", growth={"alpha": 0.1}))
    alone = Simulation(changed(disc(), dust=None, drag=None, growth=None))
    for _ in range(5):
        grows.step()
        alone.step()
    assert grows.dust.mass.sum() > 1e-3 * grows.gas.small.sum()
    for name, values in alone.gas.arrays().items():
        assert getattr(grows.gas, name).tobytes() == values.tobytes(), name


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_the_same_bits_on_any_number_of_threads_and_after_resume(monkeypatch, tmp_path, direction):
    scene = disc(direction=direction, gas=400, dust=300, ratio=0.03)  # so that growth does not come in every step
    found, saved = [], 3
    for _ in on_threads(monkeypatch):
        sim, clocks = Simulation(scene), []
        for step in range(8):
            if step == saved:
                sim.save(tmp_path / "checkpoint.h5")
            sim.evolve(1.0, after_step=lambda: True)
            clocks.append(sim.state.subcycle_clock)
        found.append(state_bits(sim))
        resumed, again = Simulation(scene), []
        resumed.restore(tmp_path / "checkpoint.h5")
        for _ in range(8 - saved):
            resumed.evolve(1.0, after_step=lambda: True)
            again.append(resumed.state.subcycle_clock)
        found.append(state_bits(resumed))
        # Dust does not grow in the first step after: without the rate of the last growth a clock would have it grow.
        assert clocks[saved].since > clocks[saved - 1].since and again == clocks[saved:]
    assert all(bits == found[0] for bits in found[1:])


def test_a_start_from_a_snapshot_brings_small_dust_and_sizes(tmp_path):
    """Refined too, and with drag the other way, for which small dust leaves the masses of the gas."""
    sim = Simulation(disc(gas=300, dust=200))
    for _ in range(3):
        sim.step()
    path = tmp_path / "0.h5"
    put_out(sim, path)
    scene = disc(gas=300, dust=200, initial={"kind": "snapshot", "file": str(path)})
    on = Simulation(scene)
    for of, name in ((sim.gas, "small"), (sim.gas, "mass"), (sim.dust, "mass"), (sim.dust, "size")):
        theirs = getattr(on.gas if of is sim.gas else on.dust, name)
        np.testing.assert_array_equal(theirs, getattr(of, name)[np.argsort(of.ids)])
    finer = Simulation(changed(scene, initial={"refine": 2}))
    assert finer.gas.small.sum() == pytest.approx(sim.gas.small.sum(), rel=1e-13)
    assert finer.gas.small.max() < 0.51 * sim.gas.small.max()
    apart = Simulation(changed(scene, drag={"direction": "one-way"}))
    assert apart.gas.small.sum() == pytest.approx(sim.gas.small.sum(), rel=1e-13)
    assert apart.gas.mass.sum() == pytest.approx(sim.gas.mass.sum() - sim.gas.small.sum(), rel=1e-13)


def test_own_particles_bring_what_they_like():
    start = Simulation(disc(gas=300, dust=200))
    own = {
        name: {key: getattr(p, key) for key in ("pos", "vel", "mass")}
        for name, p in (("gas", start.gas), ("dust", start.dust))
    }
    scene = changed(disc(), initial=None)
    sim = Simulation(scene, particles=own)
    assert sim.gas.small.sum() == 0.0 and (sim.dust.size == 1e-6).all()
    own["gas"]["small"], own["dust"]["size"] = 0.1 * own["gas"]["mass"], np.full(200, 1e-5)
    sim = Simulation(scene, particles=own)
    sim.step()
    assert sim.gas.small.sum() > 0.0 and sim.dust.size.max() > 0.9e-5
    own["gas"]["small"] = own["gas"]["mass"]
    with pytest.raises(SceneError, match=r"small\[0\] is .* not below mass"):
        Simulation(scene, particles=own)
    with pytest.raises(SceneError, match=r"small is given, but there is no table \[growth\]"):
        Simulation(changed(scene, growth=None), particles=own)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"growth": {"alpha": None}}, "growth: no strength of the turbulence is given"),
        ({"growth": {"fragmentation_speed": -1.0}}, "growth.fragmentation_speed: "),
        ({"growth": {"small_size": None}}, "growth.small_size: missing; the default 1 um"),
        ({"growth": {"smallest": 2e-9}}, "growth.smallest: the size is not smaller than growth.small_size"),
        ({"growth": {"small_ratio": 0.4}}, "growth.small_ratio: the ratio is larger than dust.ratio = 0.3"),
        ({"dust": {"grain_size": 1e-10}}, "dust.grain_size: the initial size is smaller than growth.small_size"),
        (
            {"dust": {"grain_size": {"smallest": 1e-6, "largest": 1e-3}}},
            "dust.grain_size: a size distribution is not allowed with growth",
        ),
        ({"drag": {"scheme": "lab14"}}, 'growth: growth needs a scheme with a size per particle, and "lab14"'),
        (
            {"drag": {"law": "stokes-number", "stokes": 0.1}},
            'growth needs a drag law that depends on grain size, and "stokes-number"',
        ),
        ({"drag": None}, "growth: collision velocities need drag; add a table [drag]"),
    ],
)
def test_what_does_not_go_together_is_said(change, says):
    found = problems(changed(disc(), **change))
    assert any(says in problem for problem in found), found


def test_two_populations_and_a_given_disc_are_refused():
    scene = disc()
    scene["dust"] = [scene["dust"], scene["dust"]]
    assert any("2 populations of dust, but growth allows one; keep one" in problem for problem in problems(scene))
    given = {"surface_density": 1e-3, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}}
    found = problems(changed(disc(direction="one-way"), gas=None, background=given))
    assert any("but [background] has none" in problem for problem in found), found


def test_check_says_where_growth_ends():
    """a_frag and the drift limit at 1.15, the middle of the start's disc: Sigma 1e-3 / r, c_s^2 = .01 / sqrt(r)."""
    scene = load_scene(disc())
    assert not list(Effect.report(scene, gas_at_start(scene)).warnings)
    (warning,) = Effect.report(load_scene(disc(size=1.0)), gas_at_start(scene)).warnings
    assert warning.startswith("grains fragment above ")
    rows = dict(Effect.report(scene, gas_at_start(scene)).rows)
    breaks = [float(text.split()[0]) for text in rows["grain size at fragmentation limit"].split(", ")]
    r = 1.15
    assert breaks[1] == pytest.approx(2e-3 / r * 4e-4 / (3 * np.pi * 1e-3 * 0.01 / np.sqrt(r)), rel=0.01)
    drift = [float(text.split()[0]) for text in rows["grain size at drift limit"].split(", ")]
    assert drift[1] == pytest.approx(2 * 0.3e-3 / r / (np.pi * 1.5) / (0.01 * np.sqrt(r)), rel=0.01)
