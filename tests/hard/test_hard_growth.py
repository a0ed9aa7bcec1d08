"""Pace where there is nothing to grow, nothing to grow in, or no end to it."""

import numpy as np
import pytest
from growing import SMALL, disc, totals

from discsim import Simulation
from discsim.numerics.state import SubcycleClock


def run(scene, steps=3):
    sim = Simulation(scene)
    for _ in range(steps):
        sim.step()
    return sim


def is_finite(sim):
    return all(np.isfinite(a).all() for p in sim.state.species.values() for a in p.arrays().values())


@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
@pytest.mark.parametrize("small", [None, 0.0])
def test_grains_that_break_at_any_speed_are_all_small(small, scheme):
    """Dust particles keep a seed of 1e-12 of their share and follow the gas; what was in them is in the gas."""
    growth = {"fragmentation_speed": 0.0, "small_ratio": small}
    sim = Simulation(disc(gas=400, dust=300, growth=growth, drag={"law": "epstein", "scheme": scheme}))
    whole = sim.gas.mass.sum() + sim.dust.mass.sum()
    for _ in range(4):
        sim.step()
    assert (sim.dust.size == SMALL).all()
    assert (sim.dust.mass > 0.0).all() and sim.dust.mass.sum() < 1e-11 * whole
    accreted = sum(getattr(sim.state.ledger, f"accreted_{name}") for name in ("gas", "dust", "small"))
    assert totals(sim)[0] + accreted == pytest.approx(whole, rel=1e-13)
    assert is_finite(sim) and np.hypot(*sim.dust.vel.T).max() < 2.0


@pytest.mark.parametrize("alpha", [0.0, 1e-30, 1.0])
@pytest.mark.parametrize("size", [SMALL, 1e-3, 1e3])
def test_turbulence_that_is_none_or_all(alpha, size):
    """Without any grains break at no size, and meet by drift alone."""
    sim = run(disc(gas=400, dust=300, size=size, growth={"alpha": alpha}))
    assert is_finite(sim)
    assert (sim.gas.small >= 0.0).all() and (sim.gas.small < sim.gas.mass).all()
    assert sim.dust.size.min() >= size or alpha == 1.0


def test_sizes_over_twelve_decades():
    """In one cell; and one step that grows a grain through most of them."""
    sim = Simulation(disc(gas=400, dust=300, growth={"fragmentation_speed": 1e9}))
    sim.dust.size = np.geomspace(SMALL, 1e3, 300)
    for _ in range(3):
        sim.step()
    sim.state.subcycle_clock = SubcycleClock(1e3)
    before = totals(sim)[0]
    sim.effects["growth"].event(sim.state)
    assert is_finite(sim) and sim.dust.size.min() > 1e4 * SMALL
    assert totals(sim)[0] == pytest.approx(before, rel=1e-13)


def test_all_gas_is_accreted():
    sim = Simulation(disc(gas=100, dust=100))
    sim.step()
    sim.gas.pos[:] = 0.01
    sim.step()
    assert sim.gas.count == 0 and sim.dust.count > 0 and sim.state.ledger.accreted_small > 0.0
    size = dict(zip(sim.dust.ids.tolist(), sim.dust.size.tolist(), strict=True))
    sim.step(most=0.01)
    left = [size[number] for number in sim.dust.ids.tolist()]  # some are accreted
    np.testing.assert_array_equal(sim.dust.size, left)


def test_dust_beyond_the_gas_waits():
    """A cell of pure dust, and one grain on the star's centre: their sizes and masses stay."""
    sim = Simulation(disc(gas=400, dust=300))
    sim.step()
    sim.dust.pos[:20] = 2.3, 0.0
    sim.dust.pos[20] = 0.0
    mass, size = sim.dust.mass[:21].copy(), sim.dust.size[:21].copy()
    sim.state.subcycle_clock = SubcycleClock(1.0)
    sim.effects["growth"].event(sim.state)
    np.testing.assert_array_equal(sim.dust.mass[:21], mass)
    np.testing.assert_array_equal(sim.dust.size[:21], size)
    assert (sim.dust.mass[21:] != 0.0).all() and is_finite(sim)


def test_more_is_asked_of_a_gas_particle_than_it_has():
    """Dust of which most is at one place takes no more than there is there."""
    sim = Simulation(disc(gas=400, dust=300, size=1e-3))
    sim._prepare()
    sim.dust.mass[:] *= np.where(np.arange(300) % 30 == 0, 1e3, 1e-3)
    before = totals(sim)
    sim.state.subcycle_clock = SubcycleClock(1.0)
    sim.effects["growth"].event(sim.state)
    after = totals(sim)
    assert (sim.gas.small >= 0.0).all() and sim.gas.small.min() < 1e-10 * sim.gas.small.max()
    assert after[0] == pytest.approx(before[0], rel=1e-13)
    assert np.abs(after[1] - before[1]).max() < 1e-14
