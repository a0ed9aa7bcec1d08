"""Gas in polar cells without effects: reconstruction, transport, waves, shocks, orbits, conservation."""

import numba
import numpy as np
import pytest
from polar_cells import Disc, ring, rotating

from discsim.exact import riemann
from discsim.kernels.polar import transport
from discsim.kernels.polar.geometry import DENSITY, GHOSTS, PRESSURE, RADIAL, SPIN
from discsim.kernels.polar.parabola import EVEN, side_coefficients
from discsim.numerics import threads
from discsim.numerics.polar import PolarCells


@numba.njit
def sides_of_ring(values, i, weights, low, high):
    """The subroutine, which only compiled code can call."""
    transport.sides_of_ring(values, i, weights, low, high)


def test_cells_fill_the_annulus_and_centroids_are_exact():
    cells = ring(7, 12, 0.3, 1.7)
    assert np.isclose(cells.area.sum(), np.pi * (1.7**2 - 0.3**2), rtol=1e-14)
    low, high = cells.geometry.sides[:-1], cells.geometry.sides[1:]
    expected = 2.0 / 3.0 * (high**3 - low**3) / (high**2 - low**2)
    assert np.allclose(cells.geometry.radius, expected, rtol=1e-14)
    assert np.ptp(np.diff(np.log(cells.geometry.sides))) < 1e-14


def test_coefficients_of_equal_cells_are_those_of_the_paper():
    assert np.allclose(side_coefficients(np.full(9, 0.37))[4], EVEN, rtol=1e-14)


def test_the_parabola_of_a_cubic_is_exact_at_the_sides():
    """Eq. (1) is of fourth order: exact for means of a cubic in the volume, if no slope is limited."""
    cells = ring(40, 8, 1.0, 3.0)
    x = 0.5 * cells.geometry.sides**2

    def integral(x):
        return 5.0 * x + x**2 + 0.3 * x**3 / 3.0 + 0.05 * x**4 / 4.0

    mean = np.diff(integral(x)) / np.diff(x)
    fields = np.zeros((40 + 2 * GHOSTS, 8))
    fields[GHOSTS:-GHOSTS] = mean[:, None]
    low, high = np.empty((2, 8))
    sides_of_ring(fields, 20 + GHOSTS, cells.geometry.weights, low, high)
    for found, at in ((low, x[20]), (high, x[21])):
        assert np.allclose(found, 5.0 + 2.0 * at + 0.3 * at**2 + 0.05 * at**3, rtol=1e-13)


def turned(angles, steps, turns):
    """The rms error of a smooth pattern after `turns` turns of a ring, relative to its amplitude."""
    cells = ring(5, angles, 1.0, 1.2)
    fields = np.zeros((4, 5 + 2 * GHOSTS, angles))
    edges = np.arange(angles + 1) * cells.geometry.angle
    pattern = 1.0 + 0.3 * np.diff(-np.cos(3.0 * edges) / 3.0) / cells.geometry.angle
    fields[DENSITY], fields[PRESSURE] = pattern, 1e-30
    fields[RADIAL], fields[SPIN, GHOSTS:-GHOSTS] = 0.5, (cells.geometry.radius**2)[:, None]  # Omega = 1
    new = fields.copy()
    for _ in range(steps):
        step = 2.0 * np.pi * turns / steps
        cells.for_rings(transport.sweep_around, fields, 1.0, step, cells.geometry, new, cells.passed)
        fields, new = new, fields
    assert np.allclose(fields[RADIAL], 0.5, rtol=1e-12)
    return np.sqrt(np.mean((fields[DENSITY, GHOSTS] - pattern) ** 2)) / 0.3


def test_a_pattern_turns_with_its_ring_with_third_order():
    """Steps of 5.37 cells of a ring, so that the rest beyond whole cells is moved by parabolas."""
    errors = [turned(n, round(n / 5.37), 1.0) for n in (32, 64, 128)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 3e-5
    assert np.all(orders > 2.9)


def test_whole_cells_are_exact():
    assert turned(48, 16, 25.0) < 1e-11  # 3 cells a step, 400 steps


def test_mass_and_angular_momentum_are_exact_between_walls():
    rng = np.random.default_rng(7)
    cells = ring(11, 29, 0.37, 1.9)
    r = np.hypot(*cells.pos.T)
    n = len(r)
    disc = Disc(
        cells, 10.0 ** rng.uniform(-2, 0, n), 0.1 * rng.standard_normal(n), r**-0.5 + 0.1 * rng.standard_normal(n),
        u=0.1 * 2.0 ** rng.uniform(-1, 1, n), gamma=1.4,
    )  # fmt: skip
    mass, spin = disc.mass.sum(), disc.angular_momentum()
    for _ in range(100):
        lost = disc.step(0.3 * disc.limit)
        assert not lost.any()
    assert np.isclose(disc.mass.sum(), mass, rtol=1e-13)
    assert np.isclose(disc.angular_momentum(), spin, rtol=1e-13)
    assert disc.mass.min() > 0.0


def test_what_leaves_open_edges_is_counted():
    cells = ring(10, 16, 1.0, 2.0, closed=False)
    r = np.hypot(*cells.pos.T)
    disc = Disc(cells, 1.0 + 0.0 * r, 3.0 * np.cos(np.arctan2(*cells.pos.T)), 0.3 * r, sound=np.ones_like(r), star=0.0)
    before = disc.mass.sum(), disc.angular_momentum()
    lost = sum(disc.step(0.3 * disc.limit) for _ in range(60)).sum(axis=0)
    assert lost[0] > 0.3 * before[0]
    assert np.isclose(disc.mass.sum() + lost[0], before[0], rtol=1e-13)
    assert np.isclose(disc.angular_momentum() + lost[3], before[1], rtol=1e-13)


def test_a_cold_ring_keeps_its_place():
    """100 orbits, so cold that pressure (c_s = 1e-13 v_K) does nothing: rounding is all that moves the gas."""
    cells = ring(12, 55, 0.5, 1.0)
    r = np.hypot(*cells.pos.T)
    disc = Disc(cells, 1e-3 + np.exp(-(((r - 0.7) / 0.1) ** 2)), 0.0 * r, r**-0.5, sound=np.full(len(r), 1e-13))
    mass = disc.mass.copy()
    step = 0.3 * 0.5**1.5
    for _ in range(int(100 * 2.0 * np.pi * 0.7**1.5 / step)):
        disc.step(step)
    assert np.abs(disc.mass / mass - 1.0).max() < 1e-10
    assert np.abs(disc.v_r).max() < 1e-11
    assert np.abs(disc.v_phi * np.sqrt(r) - 1.0).max() < 1e-11


def test_uniform_pressure_has_no_force_and_a_power_law_nearly_the_exact_one():
    cells = ring(30, 40, 0.5, 2.0)
    r = np.hypot(*cells.pos.T)
    for index, tolerance in ((0.0, 1e-13), (1.5, 2e-3)):  # (d ln r)^2 = 2e-3
        disc = Disc(cells, r**-index, 0.0 * r, 0.0 * r, sound=np.ones_like(r), star=0.0)
        force = (disc.acc * disc.out).sum(axis=1)
        assert np.abs((disc.acc * disc.across).sum(axis=1)).max() < 1e-12
        inside = (r > 0.6) & (r < 1.7)
        assert np.abs(force * r - index)[inside].max() < max(tolerance * index, tolerance)


def standing_wave(n):
    """The error of a standing sound wave between two walls after one period, over its amplitude."""
    cells = ring(n, 8, 1e5, 1e5 + 1.0)
    x, size = np.hypot(*cells.pos.T) - 1e5, 1e-4
    wave = size * np.cos(np.pi * x) * np.sin(0.5 * np.pi / n) / (0.5 * np.pi / n)
    disc = Disc(cells, 1.0 + wave, 0.0 * x, 0.0 * x, sound=np.ones_like(x), star=0.0)
    steps = 6 * n
    for _ in range(steps):
        disc.step(2.0 / steps)
    return np.abs(disc.density - 1.0 - wave).mean() / size


def test_sound_is_of_second_order():
    errors = [standing_wave(n) for n in (32, 64, 128)]
    assert errors[-1] < 4e-4
    assert np.log2(errors[0] / errors[1]) > 1.5
    assert np.log2(errors[1] / errors[2]) > 1.8


def test_an_epicycle_has_the_epicyclic_frequency():
    """A small radial velocity of a whole ring: v_r turns at kappa = Omega, and at nothing else."""
    cells = ring(60, 8, 0.5, 2.0)
    r = np.hypot(*cells.pos.T)
    around = r**-0.5
    bump = 1e-6 * np.exp(-(((r - 1.0) / 0.15) ** 2))
    disc = Disc(cells, np.ones_like(r), bump, around, sound=np.full(len(r), 1e-6))
    steps = 100
    for _ in range(steps):
        disc.step(2.0 * np.pi / steps)
    at = np.argmax(bump)
    # dt^2 / 24 of the leapfrog and (d ln r / width)^2 / 12 of face averages: a phase of 2 pi times half their sum.
    assert np.isclose(disc.v_r[at], bump[at], rtol=0.02)


def shock_tube(n, u):
    cells = ring(n, 8, 1e6, 1e6 + 1.0, closed=False)
    x = np.hypot(*cells.pos.T) - 1e6 - 0.5
    left = x < 0.0
    if u:
        heat = np.where(left, 1.0 / 0.4, 0.1 / (0.4 * 0.125))
        disc = Disc(cells, np.where(left, 1.0, 0.125), 0.0 * x, 0.0 * x, u=heat, gamma=1.4, star=0.0)
        exact = riemann.solution(x, 0.2)
    else:
        disc = Disc(cells, np.where(left, 1.0, 0.1), 0.0 * x, 0.0 * x, sound=np.ones_like(x), star=0.0)
        exact = riemann.isothermal_solution(x, 0.2, right=(0.1, 0.0))
    disc.run(0.2)
    return disc, exact


@pytest.mark.parametrize("u", [True, False])
def test_shock_tubes(u):
    """Sod's tube and an isothermal one at a radius of 1e6: L1 errors of first order, as shocks have."""
    errors = []
    for n in (100, 200):
        disc, exact = shock_tube(n, u)
        errors.append((np.abs(disc.density - exact.density).mean(), np.abs(disc.v_r - exact.velocity).mean()))
        assert disc.v_r.max() < 1.01 * exact.velocity.max()  # no overshoot
    assert np.all(np.array(errors[0]) < (0.0085, 0.02))
    assert np.all(np.array(errors[1]) < 0.6 * np.array(errors[0]))


def test_the_energy_of_a_shock_tube():
    disc, _ = shock_tube(100, True)
    energy = (disc.mass * (disc.u + 0.5 * (disc.vel**2).sum(axis=1))).sum()
    begun = disc.cells.area * np.where(np.hypot(*disc.cells.pos.T) < 1e6 + 0.5, 2.5, 0.25)
    assert np.isclose(energy, begun.sum(), rtol=5e-4)  # of a leapfrog, at the Courant factor .5


def test_colliding_streams_are_as_dense_as_the_shocks_make_them():
    """Mach 3 from both sides: density 10.9 in isothermal gas, behind shocks that move at 0.3 c_s."""
    cells = ring(200, 8, 1e6, 1e6 + 1.0, closed=False)
    x = np.hypot(*cells.pos.T) - 1e6 - 0.5
    disc = Disc(cells, np.ones_like(x), np.where(x < 0.0, 3.0, -3.0), 0.0 * x, sound=np.ones_like(x), star=0.0)
    disc.run(0.13)
    exact = riemann.isothermal_solution(x, disc.time, left=(1.0, 3.0), right=(1.0, -3.0))
    middle = np.abs(x) < 0.03
    assert np.isclose(disc.density[middle].mean(), exact.density.max(), rtol=0.03)
    assert disc.density.max() < 1.15 * exact.density.max()


def test_the_same_bits_on_any_number_of_threads(four_cores, monkeypatch):
    monkeypatch.setattr("discsim.numerics.polar.CHUNK", 32)
    found = []
    for number in (1, 3, 4):
        threads.set_threads(number)
        disc = rotating(PolarCells(13, 31, 0.4, 1.6, False), noise=0.1)
        for _ in range(5):
            disc.step(0.3 * disc.limit)
        found.append((disc.mass.tobytes(), disc.vel.tobytes(), disc.u.tobytes()))
    assert found[0] == found[1] == found[2]
