"""Accretion of gas of a polar grid: by the star through the inner edge, and by companions."""

import numpy as np
import pytest
from growing import MATERIAL, SMALL, row_of
from polar_cells import MASS, disc_scene
from runs import assert_resumes, on_threads, state_bits
from scenes import changed, problems

from discsim import Simulation, load_scene

PLANET = 2e-3
DISC = disc_scene(0.6, 1.7, 2500)
COMPANION = {"mass": PLANET, "semi_major_axis": 1.05, "eccentricity": 0.1, "softening": 0.6, "accretion_radius": 0.07}
LIVE = COMPANION | {"orbit": "live"}
DUST = {
    "dust": {"particles": 700, "ratio": 0.3, "grain_size": 1e-6, "grain_density": MATERIAL},
    "drag": {"law": "epstein"},
    "growth": {"fragmentation_speed": 0.02, "alpha": 1e-3, "small_size": SMALL},
}


def falling(scene, speed=0.05):
    """A disc whose gas moves inwards at `speed`."""
    sim = Simulation(scene)
    sim.gas.vel -= speed * sim.gas.pos
    return sim


def test_the_star_grows_by_what_leaves_the_inner_edge():
    """The ledger counts the gas that leaves both edges; the star gains only that of the inner one."""
    sim = falling(changed(DISC, star={"grows": True}))
    r = np.hypot(*sim.gas.pos.T)
    sim.gas.vel[r > 1.4] += 0.5 * sim.gas.pos[r > 1.4]
    whole = sim.gas.mass.sum()
    sim.run(1.5)
    taken, ledger = sim.bodies.accreted[0, 0], sim.state.ledger
    assert 0.01 * whole < taken < 0.9 * ledger.accreted_gas
    assert sim.gas.mass.sum() + ledger.accreted_gas == pytest.approx(whole, rel=1e-13)
    assert sim.bodies.mass[0] == pytest.approx(MASS + taken, rel=1e-15) and sim.state.star_mass == sim.bodies.mass[0]
    assert sim.bodies.gained[0] == taken and sim.bodies.accreted[0, 1] == 0.0
    assert (sim.bodies.pos[0] == 0.0).all() and (sim.bodies.vel[0] == 0.0).all()
    assert row_of(sim)["accreted_gas"] == ledger.accreted_gas


def test_a_star_that_does_not_grow_counts_what_it_accretes():
    sim = falling(changed(DISC, companion=COMPANION | {"accretion_radius": 0.0}))
    sim.run(0.7)
    assert sim.bodies.accreted[0, 0] > 0.0 and sim.bodies.mass[0] == MASS and sim.bodies.gained[0] == 0.0


def test_gas_orbits_the_mass_that_the_star_has_gained():
    """The pull of the star is that of its new mass."""
    scene = changed(DISC, star={"grows": True}, initial={"surface_density": 0.05})
    sim = falling(scene)
    before = sim.state.star_pull
    sim.run(0.7)
    assert sim.state.star_pull == sim.bodies.mass[0] > 1.003 * before


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_the_star_gains_small_dust_with_the_gas(direction):
    """The star counts it as dust. With one-way drag it does not change the mass of the star, as dust does not act."""
    dust = DUST | {"drag": {"law": "epstein", "direction": direction}}
    dust["growth"] = DUST["growth"] | {"fragmentation_speed": 0.0}  # all dust stays small
    sim = falling(changed(DISC, star={"grows": True}, **dust))
    start = [sim.gas.mass.sum(), sim.gas.small.sum()]
    sim.run(0.7)
    gas, small = sim.bodies.accreted[0]
    assert small == pytest.approx(0.3 * gas, rel=1e-6)
    gained = gas + (small if direction == "two-way" else 0.0)
    assert sim.bodies.mass[0] == pytest.approx(MASS + gained, rel=1e-15)
    assert start[0] - sim.gas.mass.sum() == pytest.approx(
        sim.state.ledger.accreted_gas + (sim.state.ledger.accreted_small if direction == "two-way" else 0.0), rel=0.01
    )


# Companions


def conserved(sim):
    """Mass, momentum, angular momentum with the spin in the ledger, and mass moment of gas and companions."""
    found = np.zeros(6)
    for p in (sim.gas, sim.bodies):
        rows = slice(1, None) if p is sim.bodies else slice(None)
        m, (x, y), (u, v) = p.mass[rows], p.pos[rows].T, p.vel[rows].T
        found += [m.sum(), m @ u, m @ v, m @ (x * v - y * u), m @ x, m @ y]
    found[3] += sim.state.ledger.accreted_angular_momentum
    return found


@pytest.mark.parametrize("rate", [{}, {"accretion_rate": 3.0}])
def test_accretion_conserves_mass_momentum_and_angular_momentum(rate):
    """One accretion event, with unequal masses, u and small dust: totals of gas and live companions to rounding.

    The gas that stays keeps its energy, and what the gas of the cell has radiated.
    """
    second = LIVE | rate | {"mass": 7e-4, "semi_major_axis": 1.3, "phase": 40.0}
    eos = {"kind": "adiabatic", "gamma": 1.3, "aspect_ratio": 0.07}
    scene = changed(DISC, **DUST) | {"companion": [LIVE | rate, second]}
    sim = Simulation(scene | {"gas": scene["gas"] | {"eos": eos}, "cooling": {"kind": "beta", "beta": 5.0}})
    sim.step()
    rng, gas, effect = np.random.default_rng(3), sim.gas, sim.effects["companion"]
    factor = rng.uniform(0.3, 3.0, gas.count)
    for array in (gas.mass, gas.small, gas.density):
        array *= factor
    gas.vel += rng.normal(0.0, 0.1, gas.vel.shape)
    kept = {name: getattr(gas, name).copy() for name in ("vel", "u")}
    gas.radiated[:] = rng.uniform(0.5, 2.0, gas.count)
    share, radiated = gas.small / gas.mass, gas.mass * gas.radiated
    sim.dust.remove(np.ones(sim.dust.count, bool))
    before, mass, earlier = conserved(sim), gas.mass.copy(), sim.bodies.accreted[1:].copy()
    effect._dt = 0.2
    effect.event(sim.state)
    after = conserved(sim)
    taken = (mass - gas.mass).sum()
    assert taken > 1e-4 * PLANET and (sim.bodies.accreted[1:] > earlier).all()
    scale = np.abs(before).max()
    assert np.abs(after - before).max() < 1e-14 * scale
    assert abs(sim.state.ledger.accreted_angular_momentum) > 1e-12  # the companions have no spin
    assert all((getattr(gas, name) == values).all() for name, values in kept.items())
    assert np.allclose(gas.small / gas.mass, share, rtol=1e-14)
    assert np.allclose(gas.mass * gas.radiated, radiated, rtol=1e-14)
    assert (sim.bodies.accreted[1:] - earlier).sum() == pytest.approx(taken, rel=1e-11)


def test_a_companion_takes_gas_at_its_rate():
    """Well within the radius exp(-f t / P) of gas at rest is left, in one step or ten; beyond it all of the gas."""
    found = []
    for steps in (1, 10):
        sim = Simulation(changed(DISC, companion=COMPANION | {"accretion_radius": 0.2, "accretion_rate": 2.0}))
        sim.step()
        effect, gas, before = sim.effects["companion"], sim.gas, sim.gas.mass.copy()
        r = np.hypot(*(sim.bodies.pos[1] - sim.bodies.pos[0]))
        effect._dt = 0.9 * np.sqrt(r**3 / MASS) / steps
        for _ in range(steps):
            effect.event(sim.state)
        away = np.hypot(*(gas.pos - sim.bodies.pos[1]).T)
        left = gas.mass / before
        assert (left[away > 0.25] == 1.0).all()
        found.append(left[away < 0.15])
        assert np.allclose(found[-1], np.exp(-2.0 * 0.9 / (2.0 * np.pi)), rtol=2e-3)  # of 1 + m / M in P
    assert np.allclose(*found, rtol=1e-5)  # the floor of 1e-6 of the density, in each step


def test_without_a_rate_gas_is_taken_at_the_frequency_of_the_radius():
    sim = Simulation(changed(DISC, companion=COMPANION | {"accretion_radius": 0.2}))
    sim.step()
    effect, gas, before = sim.effects["companion"], sim.gas, sim.gas.mass.copy()
    mass = sim.bodies.mass[1]
    effect._dt = 0.8
    effect.event(sim.state)
    near = np.hypot(*(gas.pos - sim.bodies.pos[1]).T) < 0.15
    assert np.allclose((gas.mass / before)[near], np.exp(-0.8 * np.sqrt(mass / 0.2**3)), rtol=1e-5)


def test_a_radius_within_a_cell_accretes_at_any_place():
    """Cells count in part: wherever the companion is, the accreting area is 0.1 to 4 times pi R^2."""
    radius = 0.02
    areas = []
    for phase in np.linspace(0.0, 10.0, 7):
        companion = COMPANION | {"accretion_radius": radius, "accretion_rate": 1.0, "phase": float(phase)}
        sim = Simulation(changed(DISC, companion=companion))
        sim.step()
        gas, before = sim.gas, sim.gas.mass.copy()
        sim.effects["companion"]._dt = 1e3
        sim.effects["companion"].event(sim.state)
        areas.append(((before - gas.mass) / gas.density).sum() / (np.pi * radius**2))
    assert min(areas) > 0.1 and max(areas) < 4.0


@pytest.mark.parametrize("rate", [{}, {"accretion_rate": 50.0}])
def test_an_accreting_planet_runs_to_an_empty_neighbourhood(rate):
    """Mass is positive and conserved with what the companion and the edges take, over three orbits."""
    sim = Simulation(changed(DISC, companion=LIVE | {"accretion_radius": 0.12} | rate))
    whole = sim.gas.mass.sum()
    sim.run(16.0)
    taken = sim.bodies.accreted[1, 0]
    assert sim.gas.mass.min() > 0.0 and taken > 0.01 * whole
    assert sim.bodies.mass[1] == pytest.approx(PLANET + taken, rel=1e-14)
    assert sim.gas.mass.sum() + taken + sim.state.ledger.accreted_gas == pytest.approx(whole, rel=1e-12)


def test_accretion_has_the_same_bits_on_threads_and_after_a_resume(tmp_path, monkeypatch):
    scene = changed(DISC, star={"grows": True}, **DUST) | {"companion": [LIVE, COMPANION | {"semi_major_axis": 0.8}]}
    sim = assert_resumes(load_scene(scene), tmp_path / "checkpoint", 0.21, 0.5)
    assert (sim.bodies.accreted > 0.0).all()
    monkeypatch.setattr("discsim.numerics.polar.CHUNK", 100)
    found = []
    for _ in on_threads(monkeypatch, (1, 3), 40):
        sim = Simulation(scene)
        sim.run(0.4)
        found.append(state_bits(sim))
    assert found[0] == found[1]


def test_a_star_behind_closed_edges_cannot_grow():
    closed = {"gas": {"grid": {"edges": "closed"}}, "star": {"grows": True}}
    (message,) = problems(changed(DISC, **closed))
    assert "star.grows: the star accretes nothing; add star.accretion_radius, or remove grows" in message
