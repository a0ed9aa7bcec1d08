"""Sums of gas over grains and of grains over gas, against sums over all pairs."""

import numpy as np
import pytest
from growing import disc

from discsim import Simulation
from discsim.kernels.dust import diffusion, growth
from discsim.kernels.sph.packs import CHUNK
from discsim.kernels.sph.smoothing import CUBIC, NORM, shape
from discsim.numerics import meeting
from discsim.numerics.sph import Sph

ROUNDING = {"rtol": 1e-12, "atol": 1e-13}  # of sums of thousands of terms in another order, in units of the largest


def weights(grains, gas, h):
    """W and (dW/dr) / r of each gas particle at each grain, and the way from it to the grain."""
    way = grains[:, None, :] - gas[None, :, :]
    r = np.sqrt((way**2).sum(axis=2))
    w, steep = np.vectorize(lambda q: shape(CUBIC, 2, q))(r / h)
    return NORM[1][CUBIC] * w / h**2, NORM[1][CUBIC] * steep / h**3 / r, way


def alike(found, expected):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found / scale, expected / scale, **ROUNDING)


@pytest.fixture(params=[(2500, 40), (100, 5000)], ids=["much gas", "many grains"])
def sim(request):
    gas, dust = request.param
    sim = Simulation(disc(gas=gas, dust=dust, growth={"small_ratio": 0.3}))
    sim.step()
    return sim


def most_listed(lists):
    return max(np.diff(part.begin).max() for part in lists)


def test_growth_sums_what_is_about_a_grain_and_a_gas_particle(sim):
    gas, dust, around = sim.gas, sim.dust, sim.effects["growth"].gas_around(sim.state)
    met, field = around.met, around.find(np.zeros(2))
    assert max(most_listed(met.gas_about), most_listed(met.grains_about)) > CHUNK  # packs are filled more than once
    w, steep, way = weights(dust.pos, gas.pos, gas.h)
    own, volume, there = gas.mass - gas.small, gas.mass / gas.density, w.sum(axis=1) > 0.0
    w, steep, way, field, pos = w[there], steep[there], way[there], field[there], dust.pos[there]
    alike(field[:, growth.GAS], w @ own)
    alike(field[:, growth.SMALL], w @ gas.small)
    deposited = dust.mass[there] @ w
    alike(field[:, growth.GROWN], w @ (volume * deposited) / (w @ volume))
    alike(field[:, growth.SPEED2], w @ (volume * gas.pressure) / (w @ own))
    along = steep * np.einsum("jid,jd->ji", way, pos / np.linalg.norm(pos, axis=1)[:, None])
    mean = w @ (volume * gas.pressure) / (w @ volume)
    pull = (along @ (volume * gas.pressure) - mean * (along @ volume)) / (w @ own)
    alike(field[:, growth.PULL], pull)
    for mass, kind in ((gas.small, growth.TAKE), (own, growth.GIVE)):
        shares = field[:, kind, None] * w * mass * (1.0 - np.einsum("jid,jd->ji", way, field[:, kind + 1 : kind + 3]))
        assert shares.min() >= 0.0
        alike(shares.sum(axis=1), np.ones(len(shares)))
        if kind == growth.TAKE:
            alike(field[:, growth.VEL : growth.VEL + 2], shares @ gas.vel)


def test_what_grains_take_is_what_gas_gives(sim):
    """Pair by pair, also where more is asked than there is."""
    gas, dust, effect = sim.gas, sim.dust, sim.effects["growth"]
    around = effect.gas_around(sim.state)
    field, before = around.find(np.zeros(2)), dust.mass.copy()
    w, _, way = weights(dust.pos, gas.pos, gas.h)
    bent = 1.0 - np.einsum("jid,jd->ji", way, field[:, growth.TAKE + 1 : growth.TAKE + 3])
    wanted = np.where(np.arange(dust.count) % 3 == 0, -0.1, 0.4) * dust.mass * (w.sum(axis=1) > 0.0)
    parts = w * bent * (field[:, growth.TAKE] * np.maximum(wanted, 0.0))[:, None]
    asked = parts.sum(axis=0)
    small, own = gas.small.copy(), gas.mass - gas.small
    bent = 1.0 - np.einsum("jid,jd->ji", way, field[:, growth.GIVE + 1 : growth.GIVE + 3])
    come = own * (w * bent * (field[:, growth.GIVE] * np.maximum(-wanted, 0.0))[:, None]).sum(axis=0)
    effect._change_gas(sim.state, *around.exchange(wanted))
    alike(dust.mass - before, np.minimum(wanted, 0.0) + parts @ (small / np.maximum(1.0, asked)))
    alike(gas.small - small, come - small * np.minimum(1.0, asked))


def test_diffusion_sums_the_gas_about_a_grain(sim):
    gas, dust, sph = sim.gas, sim.dust, Sph(sim.scene)
    met = meeting.GasCells(sph, gas).neighbours_of(dust.pos, dust.global_index)
    field, speed2, part = np.zeros((dust.count, 7)), gas.sound_speed**2, met.gas_about[0]
    filled = met.grain_cells.filled
    driver = diffusion.gas_driver(sph.kernel, 2)
    assert len(met.gas_about) == 1
    driver(0, len(filled), part, met.grain_cells, met.cells, met.grain_pos, gas.h, gas.mass, speed2, field)
    w, steep, way = weights(dust.pos, gas.pos, gas.h)
    there = w.sum(axis=1) > 0.0
    s, c2 = (w @ gas.mass)[there], (w @ (gas.mass * speed2))[there]
    slope = np.einsum("ji,jid->jd", steep * gas.mass, way)[there]
    steeper = np.einsum("ji,jid->jd", steep * gas.mass * speed2, way)[there]
    assert not field[~there].any()
    field = field[there]
    alike(field[:, diffusion.DENSITY], s)
    alike(field[:, diffusion.LENGTH], (w @ (gas.mass * gas.h))[there] / s)
    alike(field[:, diffusion.SPEED2], c2 / s)
    alike(field[:, diffusion.SLOPES : diffusion.SLOPES + 2], slope / s[:, None])
    alike(field[:, diffusion.SLOPES + 2 :], steeper / c2[:, None] - slope / s[:, None])
