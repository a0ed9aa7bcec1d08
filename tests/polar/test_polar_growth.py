"""Small dust in polar cells, and growth of dust that takes it: transport, conservation, one zone, bits."""

import numpy as np
import pytest
from growing import MATERIAL, SMALL, exchange, masses, one_zone, row_of, small_part
from polar_cells import MASS, Disc, polar, ring
from runs import assert_resumes, on_threads, state_bits
from scenes import changed

from discsim import Simulation, load_scene
from discsim.kernels.dust import growth as columns


def disc(size=1e-6, ratio=0.3, growth=None, direction="two-way", cells=1500, grid=None, **tables):
    """Code units, H/r = .1, Sigma about 1e-3: St = 2500 sizes and more."""
    return {
        "units": {"system": "code"},
        "run": {"until": 2.0, "courant": 0.3},
        "space": {"size": 5.0},
        "initial": {"kind": "disc", "surface_density": 1e-3, "inner": 0.6, "outer": 1.7, "surface_density_index": 1.0},
        "gas": {
            "method": "grid", "particles": cells, "grid": grid or {"edges": "closed"},
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1},
        },
        "dust": {"particles": 1200, "ratio": ratio, "grain_size": size, "grain_density": MATERIAL},
        "star": {"mass": MASS},
        "drag": {"law": "epstein", "convention": "papers", "direction": direction},
        "growth": {"fragmentation_speed": 0.02, "alpha": 1e-3, "small_size": SMALL, **(growth or {})},
        **tables,
    }  # fmt: skip


ADIABATIC = {"kind": "adiabatic", "gamma": 1.3, "aspect_ratio": 0.1}


# Small dust that moves with the gas


class Laden(Disc):
    """Gas in polar cells that carries small dust."""

    def __init__(self, cells, share, *given, **named):
        super().__init__(cells, *given, **named, share=share)
        self.lost = np.zeros((2, 5))

    def step(self, dt):
        self.lost += super().step(dt)


def rough(cells, share, seed=7):
    """Gas with shocks, and densities that differ by factors of ten from cell to cell."""
    rng, r = np.random.default_rng(seed), np.hypot(*cells.pos.T)
    density = np.exp(1.5 * rng.standard_normal(len(r)))
    return Laden(cells, share, density, rng.normal(0.0, 0.2, len(r)), r**-0.5, sound=np.full(len(r), 0.1))


@pytest.mark.parametrize("closed", [True, False])
def test_an_even_share_stays_even(closed):
    """Also in shocks, in rarefactions, and in cells that gas leaves through both sides."""
    gas = rough(ring(30, 90, 0.6, 1.7, closed), 0.37)
    for _ in range(60):
        gas.step(0.4 * gas.limit)
    assert np.allclose(gas.small / gas.mass, 0.37, rtol=1e-12)
    assert np.allclose(gas.lost[:, 4], 0.37 * gas.lost[:, 0], rtol=1e-12)


@pytest.mark.parametrize("closed", [True, False])
def test_small_dust_is_conserved_and_not_negative(closed):
    """For shares that differ from cell to cell, with no small dust in half of the cells."""
    cells = ring(30, 90, 0.6, 1.7, closed)
    rng = np.random.default_rng(8)
    gas = rough(cells, np.exp(2.0 * rng.standard_normal(2700)) * (rng.random(2700) < 0.5))
    whole = gas.small.sum()
    for _ in range(60):
        gas.step(0.4 * gas.limit)
        assert gas.small.min() >= 0.0
    assert gas.small.sum() + gas.lost[:, 4].sum() == pytest.approx(whole, rel=1e-13)
    assert closed or gas.lost[:, 4].min() > 1e-3 * whole


def test_a_pattern_of_small_dust_turns_with_its_ring():
    """A wave of the share in cold gas on circular orbits, until its ring has turned once: of third order."""
    errors = []
    for n in (64, 128):
        cells = ring(8, n, 0.9, 1.1)
        r, phi = np.hypot(*cells.pos.T), np.arctan2(cells.pos[:, 1], cells.pos[:, 0])
        sound = np.full(len(r), 1e-9)
        gas = Laden(cells, 0.2 + 0.1 * np.cos(3.0 * phi), np.ones(len(r)), np.zeros(len(r)), r**-0.5, sound=sound)
        for _ in range(n // 2):
            gas.step(4.0 * np.pi / n)
        turned = gas.small / gas.mass - 0.2 - 0.1 * np.cos(3.0 * (phi - 2.0 * np.pi * r**-1.5))
        errors.append(np.abs(turned).max() / 0.1)
    assert errors[1] < errors[0] / 5.0 and errors[1] < 0.01


# Growth


def test_the_gas_and_small_dust_around_grains():
    """Sigma ~ 1/r and c^2 ~ r^-1/2 of the start, at grains away from the edges: errors of (d ln r)^2."""
    sim = Simulation(disc(size=1e-7, ratio=0.2, direction="one-way", growth={"small_ratio": 0.07}, cells=6000))
    field = sim.effects["growth"].gas_around(sim.state).find(np.zeros(2))
    r, _, _ = polar(sim.dust)
    inside = (r > 0.75) & (r < 1.5)
    sigma, speed2 = 1e-3 / r, 0.01 * MASS * r**-0.5
    exact = {
        columns.GAS: sigma, columns.SMALL: 0.07 * sigma, columns.SPEED2: speed2, columns.PULL: -1.5 * speed2 / r,
    }  # fmt: skip
    for column, values in exact.items():
        np.testing.assert_allclose(field[inside, column], values[inside], rtol=2e-3)
    # Small dust moves with the gas, whose rotation is slower than the Keplerian one by 1.5 c^2 / 2 v_K^2.
    speed = np.sqrt(MASS / r - 1.5 * speed2)[:, None] * sim.dust.pos[:, ::-1] * [-1.0, 1.0] / r[:, None]
    flow = field[:, columns.VEL : columns.VEL + 2]
    np.testing.assert_allclose(flow[inside], speed[inside], atol=2e-3 * np.sqrt(MASS))


def test_grains_of_a_disc_grow_as_its_zones_do():
    """Sizes rise by a factor of 1e4; cells have no noise, and drift has begun."""
    sim = Simulation(disc(size=SMALL, direction="one-way", growth={"alpha": 0.1}))
    sim.run()
    r = np.hypot(*sim.dust.pos.T)
    middle = np.flatnonzero((r > 0.9) & (r < 1.3))
    chosen, root = middle[:: len(middle) // 10], np.sqrt(MASS)
    expected = [
        one_zone(
            SMALL, [2.0], 1e-3 / x, 0.3, 0.1 * root * x**-0.25, root * x**-1.5, 0.1, 0.75 * 0.01 * root * x**0.5
        )[-1]
        for x in r[chosen]
    ]  # fmt: skip
    grown = np.log(sim.dust.size[chosen] / SMALL)
    # Growth comes once in 3% of growth; positions change by drift.
    np.testing.assert_allclose(grown, np.log(np.array(expected) / SMALL), rtol=0.01)
    assert grown.min() > 6.0


def test_the_mass_ratio_of_small_and_grown_dust_is_that_of_the_sizes():
    """Starting with small dust only, and with grown dust only."""
    for small in (None, 0.0):
        sim = Simulation(disc(size=1e-7, growth={"small_ratio": small, "fragmentation_speed": 1e-4}))
        for _ in range(6):
            sim.step()
        r, place = np.hypot(*sim.gas.pos.T), np.hypot(*sim.dust.pos.T)
        middle, dust = (r > 0.9) & (r < 1.3), (place > 0.9) & (place < 1.3)
        held, grown = sim.gas.small[middle].sum(), sim.dust.mass[dust].sum()
        expected = np.average(small_part(sim.dust.size[dust]), weights=sim.dust.mass[dust])
        assert held / (held + grown) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_mass_is_exact_with_what_leaves_and_is_accreted(direction):
    companion = {"mass": 1e-3, "semi_major_axis": 1.1, "softening": 0.05, "accretion_radius": 0.1}
    star = {"mass": MASS, "accretion_radius": 0.6}
    sim = Simulation(disc(SMALL, direction=direction, grid={"edges": "open"}, companion=companion, star=star))
    r = np.hypot(*sim.gas.pos.T)
    sim.gas.vel += 0.2 * (r - 1.1)[:, None] * sim.gas.pos
    before = masses(sim)
    sim.run(1.0)
    row, bodies = row_of(sim), sim.bodies
    assert row["accreted_small"] > 0.0 and bodies.accreted[1].min() > 0.0 and row["mass_dust"] > 1e-3 * before
    assert masses(sim) + bodies.accreted[1:].sum() == pytest.approx(before, rel=1e-13)
    gas = row["mass_gas"] + row["accreted_gas"] + bodies.accreted[1, 0]
    np.testing.assert_allclose(gas, before / 1.3, rtol=1e-13)


@pytest.mark.parametrize("eos", [None, ADIABATIC])
def test_momentum_is_exact_and_angular_momentum_but_at_edges(eos):
    """While dust grows, and while it fragments; rounding of sums of velocities of about 1 is 1e-15."""
    scene = disc(size=1e-6)
    sim = Simulation(scene | ({} if eos is None else {"gas": scene["gas"] | {"eos": eos}}))
    for _ in range(3):
        sim.step()
    sim.dust.remove(np.abs(np.hypot(*sim.dust.pos.T) - 1.15) > 0.5)
    # Smooth and enough: in exhausted cells angular momentum is exact only to 1% of what is exchanged.
    sim.gas.small[:] = 0.012 * sim.gas.mass * (1.0 + 0.3 * sim.gas.pos[:, 0])
    heat = None if eos is None else sim.gas.mass @ sim.gas.u
    # In a time in which no cell has to give all its small dust, and then as all grains break.
    for dt, speed in ((0.01, 1.0), (1e-9, 1e-4)):
        mass, momentum, spin, moved = exchange(sim, dt, speed)
        assert moved > 1e-4
        assert max(abs(mass), momentum, abs(spin)) < 2e-14
        assert sim.gas.small.min() >= 0.0
    assert eos is None or sim.gas.mass @ sim.gas.u == pytest.approx(heat, rel=1e-14)


def test_a_disc_with_small_dust_starts_in_balance():
    """Rotation balances the pressure force on gas and small dust together; there is almost no grown dust."""
    scene = disc(ratio=1.0, growth={"fragmentation_speed": 0.0})
    sim = Simulation(scene)
    assert np.allclose(sim.gas.small / sim.gas.mass, 0.5)
    sim.run(1.0)
    r = np.hypot(*sim.gas.pos.T)
    with sim.synchronised() as state:
        radial = (state.gas.vel * state.gas.pos).sum(axis=1) / r
    assert np.abs(radial / sim.gas.sound_speed).max() < 1e-8  # grown dust has 1e-12 of the mass


def test_one_way_gas_does_not_change_by_growth():
    grows = Simulation(disc(SMALL, direction="one-way", growth={"alpha": 0.1}))
    alone = Simulation(changed(disc(), dust=None, drag=None, growth=None))
    for _ in range(4):
        grows.step()
        alone.step()
    assert grows.dust.mass.sum() > 1e-3 * grows.gas.small.sum()
    for name, values in alone.gas.arrays().items():
        assert getattr(grows.gas, name).tobytes() == values.tobytes(), name


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_growth_has_the_same_bits_on_threads_and_after_a_resume(tmp_path, monkeypatch, direction):
    scene = disc(direction=direction, cells=700, ratio=0.03)
    assert_resumes(load_scene(scene), tmp_path / "checkpoint", 0.11, 0.3)
    monkeypatch.setattr("discsim.numerics.polar.CHUNK", 100)
    found = []
    for _ in on_threads(monkeypatch, (1, 3), 40):
        sim = Simulation(scene)
        sim.run(0.3)
        found.append(state_bits(sim))
    assert found[0] == found[1]
