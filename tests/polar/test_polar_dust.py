"""Dust in gas of a polar grid: turbulent diffusion, and the gas at grains that it needs."""

from types import SimpleNamespace

import numpy as np
import pytest
from polar_cells import MASS, ring
from runs import assert_resumes, on_threads, state_bits
from scenes import changed

from discsim import Simulation, load_scene
from discsim.kernels.dust import diffusion as columns
from discsim.kernels.polar import sampling
from discsim.numerics.polar import PolarGrains

SOUND, WIDTH, MIDDLE = 0.07, 0.1, 1.05  # of the gas; of the ring of gas and its radius


def ring_of_gas(folder, cells=2500, sound=SOUND, **tables):
    """A Gaussian ring of isothermal gas, balanced by its rotation: a pressure bump that stays as it is."""
    r = np.linspace(0.6, 1.6, 400)
    sigma = 1e-4 * np.exp(-0.5 * ((r - MIDDLE) / WIDTH) ** 2)
    file = folder / "ring.txt"
    file.write_text("# r Sigma\n" + "".join(f"{a!r} {b!r}\n" for a, b in zip(r.tolist(), sigma.tolist(), strict=True)))
    return {
        "units": {"system": "code"},
        "run": {"until": 1000.0},
        "space": {"size": 5.0},
        "initial": {"kind": "table", "file": str(file)},
        "star": {"mass": MASS},
        "gas": {
            "method": "grid", "particles": cells, "grid": {"inner": 0.7, "outer": 1.4, "edges": "closed"},
            "eos": {"kind": "isothermal", "sound_speed": sound},
        },
        "dust": {"particles": 3000, "ratio": 0.01},
        **tables,
    }  # fmt: skip


def place(sim, r, seed=4):
    """Put the dust on circular orbits at the radii r (n,)."""
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(r))
    sim.dust.pos[:] = r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    sim.dust.vel[:] = np.sqrt(MASS / r)[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)


def radii_of(density, number, low=0.72, high=1.38):
    """Radii of `number` grains with the surface density `density(r)`, at even fractions of the mass."""
    r = np.linspace(low, high, 4001)
    mass = np.cumsum(density(r) * r)
    return np.interp((np.arange(number) + 0.5) / number, mass / mass[-1], r)


def gaussian(r, width=WIDTH):
    return np.exp(-0.5 * ((r - MIDDLE) / width) ** 2)


def spin(particles):
    x, y = particles.pos.T
    return float(particles.mass @ (x * particles.vel[:, 1] - y * particles.vel[:, 0]))


def grains_at(cells, pos, ids=None):
    """Grains at `pos` among cells."""
    dust = SimpleNamespace(ids=np.arange(len(pos)) if ids is None else ids)
    return PolarGrains(cells.geometry, SimpleNamespace(gas=None, dust=dust), pos)


def fields_at(cells, pos, density, speed2):
    """The gas at `pos` by splines, of cells with the densities (n,) and c^2 (n,)."""
    places, out = grains_at(cells, pos).places, np.empty((len(pos), 7))
    mass = (density * cells.area).reshape(cells.shape)
    sampling.sample(0, len(pos), pos, places, mass, speed2.reshape(cells.shape), cells.geometry, out)
    return out


def places_within(number, inner, outer, seed=1):
    rng = np.random.default_rng(seed)
    r, angle = rng.uniform(inner, outer, number), rng.uniform(-np.pi, np.pi, number)
    return r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_the_gas_at_grains_is_of_second_order():
    """Density, c^2 and their gradients in a spiral, in cells of two sizes: errors fall by four."""

    def gas(pos):
        r, phi = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
        return 1.3 * r**-1.5 * (1.0 + 0.3 * np.cos(2.0 * phi - 5.0 * r)), 0.01 * r**-0.7 * (1.0 + 0.1 * np.sin(phi))

    pos, errors = places_within(400, 0.75, 1.3), []
    step = 1e-5 * np.eye(2)
    for rings in (40, 80):
        cells = ring(rings, 8 * rings, 0.6, 1.5)
        found = fields_at(cells, pos, *gas(cells.pos))
        density, speed2 = gas(pos)
        exact = np.zeros_like(found)
        exact[:, columns.DENSITY], exact[:, columns.SPEED2] = density, speed2
        exact[:, columns.LENGTH] = np.hypot(*pos.T) * np.sqrt(np.log(2.5) / rings * 2.0 * np.pi / (8 * rings))
        for axis in range(2):
            for k, (more, less) in enumerate(zip(gas(pos + step[axis]), gas(pos - step[axis]), strict=True)):
                exact[:, columns.SLOPES + 2 * k + axis] = np.log(more / less) / 2e-5
        errors.append(np.abs(found - exact).max(axis=0) / np.abs(exact).max(axis=0))
    assert errors[1][columns.LENGTH] < 1e-12
    # Of c^2 alone, with a tenth of the contrast, less than that.
    assert (errors[1][[0, 3, 4]] < 0.3 * errors[0][[0, 3, 4]]).all() and errors[1].max() < 0.01


def test_gradients_are_those_of_the_sampled_gas():
    """By differences, in gas that is rough from cell to cell, at edges and across azimuth 0 too."""
    cells, rng = ring(9, 23, 0.6, 1.5), np.random.default_rng(3)
    density, speed2 = np.exp(rng.standard_normal((2, len(cells.area))))
    pos = np.concatenate([places_within(200, 0.61, 1.49), [[-1.0, 1e-4], [1.0, -1e-4], [0.6001, 0.0]]])
    found, step = fields_at(cells, pos, density, speed2), 1e-7
    for axis in range(2):
        more, less = (fields_at(cells, pos + sign * step * np.eye(2)[axis], density, speed2) for sign in (1.0, -1.0))
        for k, value in ((0, columns.DENSITY), (2, columns.SPEED2)):
            slope = np.log(more[:, value] / less[:, value]) / (2.0 * step)
            scale = np.abs(slope).max()
            # Rounding over 1e-7; and the second derivative jumps between cells.
            assert np.allclose(found[:, columns.SLOPES + k + axis], slope, rtol=1e-5, atol=1e-5 * scale)


def test_sums_over_grains_are_complete():
    """Sums over grains on the grid are exact, uniform gas is sampled exactly, and there is no gas beyond the edges."""
    cells, pos = ring(7, 19, 0.6, 1.5), places_within(500, 0.6001, 1.4999)
    grains = grains_at(cells, pos, np.arange(500)[::-1].copy())
    values = np.random.default_rng(2).uniform(0.5, 2.0, 500)
    assert grains.spread(values).sum() == pytest.approx(values.sum(), rel=1e-13)
    assert np.allclose(grains.sum_weights(np.full(7 * 19, 1.7)), 1.7, rtol=1e-13)
    # The two are transposes of each other.
    other = np.random.default_rng(5).uniform(0.5, 2.0, 7 * 19)
    assert grains.spread(values) @ other == pytest.approx(values @ grains.sum_weights(other), rel=1e-13)
    beyond = np.array([[0.59, 0.0], [0.0, 1.51], [0.0, 0.0], [1.0, 0.2]])
    grains = grains_at(cells, beyond)
    assert grains.outside.tolist() == [True, True, True, False]
    assert grains.spread(np.ones(4)).sum() == pytest.approx(1.0, rel=1e-13)
    assert (fields_at(cells, beyond, np.ones(7 * 19), np.ones(7 * 19))[:3] == 0.0).all()


def test_dust_mixed_with_a_ring_of_gas_stays_mixed(tmp_path):
    """Sigma_d / Sigma_g stays even in a ring that falls to 1/400 of its density, for 2 w^2 / D."""
    number, strength = 20_000, 1e-3
    scene = ring_of_gas(tmp_path, dust_diffusion={"D": strength})
    sim = Simulation(changed(scene, dust={"particles": number}))
    place(sim, radii_of(gaussian, number))
    edges = np.array([0.8, 0.9, 1.0, 1.05, 1.1, 1.2, 1.3])
    expected = np.histogram(radii_of(gaussian, 100_000), edges)[0] / 100_000
    counts = []
    for until in (10.0, 15.0, 20.0):
        sim.run(until * WIDTH**2 / strength / 10.0)
        counts.append(np.histogram(np.hypot(*sim.dust.pos.T), edges)[0] / number)
    # 1000 to 4000 grains a bin, three times: 1 to 2%. Without grad ln Sigma the outermost bins double.
    assert np.allclose(np.mean(counts, axis=0), expected, rtol=0.06)


def average_rings(sim):
    """Set mass and polar velocity of each cell to the means over its ring: Rossby waves grow in a ring like this."""
    gas, rings = sim.gas, sim.effects["gas"].cells.shape[0]
    r = np.hypot(*gas.pos.T)[:, None]
    out = gas.pos / r
    across = out[:, ::-1] * [-1.0, 1.0]

    def mean(values):
        return np.repeat(values.reshape(rings, -1).mean(axis=1), len(values) // rings)

    radial, around = mean((gas.vel * out).sum(axis=1)), mean((gas.vel * across).sum(axis=1))
    gas.mass[:], gas.vel[:] = mean(gas.mass), radial[:, None] * out + around[:, None] * across


@pytest.mark.parametrize(
    "stokes, alpha, sound, cells, scheme",
    [
        (0.1, 0.03, 0.07, 2500, "idic-linear"),
        pytest.param(0.01, 0.02, 0.07, 2500, "tsc", marks=pytest.mark.slow),
        pytest.param(0.1, 0.03, 0.07, 10_000, "tsc", marks=pytest.mark.slow),
        # The drift of grains of St = 1 follows their place after 1/Omega; it adds 2.8% to the width at H / w = 1/3, by
        # the moments of their linear equations of motion, and 12% at 2/3.
        pytest.param(1.0, 0.03, 0.035, 10_000, "idic-linear", marks=pytest.mark.slow),
    ],
)
def test_a_dust_ring_in_a_pressure_bump_has_its_width(tmp_path, stokes, alpha, sound, cells, scheme):
    """w_d / w_g = sqrt(alpha / (alpha + St)) of drift and diffusion (Dullemond et al. 2018), within 5%."""
    number = 2000
    drag = {"law": "stokes-number", "stokes": stokes, "direction": "one-way", "scheme": scheme}
    scene = ring_of_gas(tmp_path, cells, sound, drag=drag, dust_diffusion={"alpha": alpha})
    sim = Simulation(changed(scene, dust={"particles": number}))
    width = WIDTH * np.sqrt(alpha / (alpha + stokes))
    place(sim, radii_of(lambda r: gaussian(r, 0.9 * width + 0.01), number))
    time = (1.0 + stokes**2) * WIDTH**2 * np.sqrt(MASS / MIDDLE**3) / ((alpha + stokes) * sound**2)  # of relaxation
    found = []
    for until in np.arange(0.5, 4.6, 0.5):
        sim.run(until * time)
        average_rings(sim)
        found += [np.hypot(*sim.dust.pos.T)] if until > 2.0 else []
    r = np.linspace(0.72, 1.38, 2001)
    weight = r * gaussian(r, width)
    middle = np.average(r, weights=weight)
    exact = np.sqrt(np.average((r - middle) ** 2, weights=weight))
    # Some 3 independent sets of 2000: to 1%. The start differed by 20% at most, of which exp(-2.5) is left.
    assert np.std(found) == pytest.approx(exact, rel=0.05)
    assert np.mean(found) == pytest.approx(middle, abs=0.15 * width)


DUSTY = {
    "dust": {"particles": 1500, "ratio": 0.3},
    "drag": {"law": "stokes-number", "stokes": 0.2, "scheme": "tsc"},
    "dust_diffusion": {"alpha": 0.05},
}


def test_the_cells_lose_the_angular_momentum_that_grains_gain(tmp_path):
    """To rounding, also if grains walk across the edges."""
    sim = Simulation(ring_of_gas(tmp_path, **DUSTY))
    sim.step()
    place(sim, np.linspace(0.705, 1.395, 1500))
    before, gas = (spin(sim.gas), spin(sim.dust)), sim.gas.vel.copy()
    sim.effects["dust_diffusion"].move(sim.state, 0.1)
    gained = spin(sim.dust) - before[1]
    assert abs(gained) > 1e-6 * before[1] and np.abs(sim.gas.vel - gas).max() > 1e-7
    assert spin(sim.gas) + spin(sim.dust) == pytest.approx(sum(before), rel=1e-14)
    radial = ((sim.gas.vel - gas) * sim.gas.pos).sum(axis=1)
    assert np.abs(radial).max() < 1e-15


def test_one_way_dust_does_not_change_the_gas_by_its_walk(tmp_path):
    drag = DUSTY["drag"] | {"direction": "one-way"}
    sim = Simulation(ring_of_gas(tmp_path, 900, **DUSTY | {"drag": drag}))
    sim.step()
    gas, dust = sim.gas.vel.copy(), spin(sim.dust)
    sim.effects["dust_diffusion"].move(sim.state, 0.1)
    assert abs(spin(sim.dust) - dust) > 1e-6 * abs(dust)
    assert np.array_equal(sim.gas.vel, gas)


def test_grains_on_circles_are_on_circles_after_a_walk(tmp_path):
    """The walk changes velocities as the polar leapfrog needs, in which only radial velocities lag behind."""
    sim = Simulation(ring_of_gas(tmp_path, dust_diffusion={"D": 1e-3}))
    place(sim, np.linspace(0.75, 1.3, 3000))
    for _ in range(5):
        sim.step()
    with sim.synchronised() as state:
        r = np.hypot(*state.dust.pos.T)
        x, y = state.dust.pos.T / r
        speed = np.sqrt(MASS / r)
        assert np.abs(r - np.linspace(0.75, 1.3, 3000)).max() > 0.01
        # Rounding; the Cartesian lag would leave (Omega dt)^2 of the displacements, 1e-5.
        assert np.abs(state.dust.vel - speed[:, None] * np.stack([-y, x], axis=1)).max() < 1e-12


def test_the_walk_has_the_same_bits_on_threads_and_after_a_resume(tmp_path, monkeypatch):
    scene = ring_of_gas(tmp_path, 900, **DUSTY)
    assert_resumes(load_scene(scene), tmp_path / "checkpoint", 0.31, 0.7)
    monkeypatch.setattr("discsim.numerics.polar.CHUNK", 100)
    found = []
    for _ in on_threads(monkeypatch, (1, 3), 40):
        sim = Simulation(scene)
        sim.run(0.5)
        found.append(state_bits(sim))
    assert found[0] == found[1]
