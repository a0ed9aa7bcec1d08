"""The drift of particles on Kepler orbits, against the closed form and what orbits conserve."""

import math

import numpy as np
import pytest

from discsim.exact import kepler as exact
from discsim.kernels.gravity import kepler

MU = 1.3
MASSES, ALIKE = np.array([MU]), np.empty(0, np.int64)
NUMBER = kepler.BATCH + 9  # more than are moved at once


def orbits(e, sizes=(0.5, 2.0), seed=3):
    """Places and velocities (n, 2) on orbits of eccentricity e at any phase, every other one clockwise."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(NUMBER):
        at = exact.motion_at_mean_anomaly(MU, rng.uniform(*sizes), e, rng.uniform(-3.0, 3.0))
        turn = rng.uniform(0.0, 2.0 * math.pi)
        c, s, sense = math.cos(turn), math.sin(turn), (-1.0) ** i
        x, y, vx, vy = at.x, sense * at.y, at.vx, sense * at.vy
        found.append((x * c - y * s, x * s + y * c, vx * c - vy * s, vx * s + vy * c))
    table = np.array(found)
    return table[:, :2].copy(), table[:, 2:].copy()


def spin(pos, vel):
    return pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0]


def binding(pos, vel):
    return MU / np.hypot(*pos.T) - 0.5 * (vel**2).sum(axis=1)


CASES = [(e, dt) for e in (0.0, 0.1, 0.43, 0.9, 0.99, 1.5) for dt in (0.02, 0.3, 2.7)]


@pytest.mark.parametrize(("e", "dt"), [*CASES, (0.1, 400.0), (0.9, 400.0)])
def test_particles_move_as_the_closed_form_has_it(e, dt):
    """Steps of up to two hundred turns of the smallest orbit, and ones through the pericentre of the longest."""
    pos, vel = orbits(e)
    there = np.array([exact.drift(MU, exact.Motion(*x, *v), dt) for x, v in zip(pos, vel, strict=True)])
    before = spin(pos, vel), binding(pos, vel)
    kepler.drift(0, NUMBER, pos, vel, MASSES, ALIKE, dt)
    # Rounding: of a phase of 3.2 dt at most, and at e = .99 of a pericentre at which all is 1e4 times as fast.
    sharp, turned = 1.0 / abs(1.0 - e) ** 2, max(1.0, dt)
    assert np.abs(pos - there[:, :2]).max() < 3e-14 * sharp * turned
    assert np.abs(vel - there[:, 2:]).max() < 1e-13 * sharp**1.5 * turned
    np.testing.assert_allclose(spin(pos, vel), before[0], rtol=3e-15 * sharp**0.5)
    np.testing.assert_allclose(binding(pos, vel), before[1], rtol=1e-14 * sharp)


def test_only_its_part_of_the_particles_moves():
    pos, vel = orbits(0.2)
    first, last = 3, NUMBER - 2
    moved, faster = pos.copy(), vel.copy()
    kepler.drift(first, last, moved, faster, MASSES, ALIKE, 0.4)
    whole, quick = pos.copy(), vel.copy()
    kepler.drift(0, NUMBER, whole, quick, MASSES, ALIKE, 0.4)
    for part, before, all_of in ((moved, pos, whole), (faster, vel, quick)):
        np.testing.assert_array_equal(part[first:last], all_of[first:last])
        np.testing.assert_array_equal(part[:first], before[:first])
        np.testing.assert_array_equal(part[last:], before[last:])
        assert (part[first:last] != before[first:last]).all()


def test_many_steps_lose_no_angular_momentum():
    """3000 steps of e = .05: rounding of each, which does not add up in the mean."""
    pos, vel = orbits(0.05)
    before = spin(pos, vel), binding(pos, vel)
    for _ in range(3000):
        kepler.drift(0, NUMBER, pos, vel, MASSES, ALIKE, 0.21)
    for now, then in zip((spin(pos, vel), binding(pos, vel)), before, strict=True):
        assert abs((now / then - 1.0).mean()) < 3e-15
        assert (now / then - 1.0).std() < 3e-14


def test_backwards_is_the_way_back():
    pos, vel = orbits(0.6)
    back, slow = pos.copy(), vel.copy()
    for dt in (0.7, -0.7):
        kepler.drift(0, NUMBER, back, slow, MASSES, ALIKE, dt)
    np.testing.assert_allclose(back, pos, atol=2e-13)
    np.testing.assert_allclose(slow, vel, atol=1e-12)


def test_what_falls_on_to_the_star_stays_a_number():
    """Straight falls through the centre, where an orbit has no continuation, and a particle at the star."""
    pos = np.array([[0.4, 0.0], [-0.3, 0.3], [0.0, 0.0], [1.7, 0.0]])
    vel = np.array([[-0.2, 0.0], [0.0, 0.0], [0.3, 0.1], [0.0, (MU / 1.7) ** 0.5]])
    before, fast = pos[2].copy(), vel[2].copy()
    kepler.drift(0, 4, pos, vel, MASSES, ALIKE, 3.0)
    assert np.isfinite(pos).all() and np.isfinite(vel).all()
    np.testing.assert_array_equal(pos[2], before + 3.0 * fast)  # without a direction of the pull
    assert np.hypot(*pos[3]) == pytest.approx(1.7, rel=1e-14)


def test_each_population_has_the_central_mass_of_its_own():
    """What light leaves of the star's pull, also none of it, and less than none."""
    masses = np.array([MU, 0.4, -0.3, 0.0])
    species = np.arange(NUMBER) % 4
    pos, vel = orbits(0.2)
    moved, faster = pos.copy(), vel.copy()
    kepler.drift(0, NUMBER, moved, faster, masses, species, 0.4)
    for kind, mass in enumerate(masses):
        alone, fast = pos.copy(), vel.copy()
        kepler.drift(0, NUMBER, alone, fast, np.array([mass]), ALIKE, 0.4)
        np.testing.assert_array_equal(moved[species == kind], alone[species == kind])
        np.testing.assert_array_equal(faster[species == kind], fast[species == kind])
    before = 0.5 * (vel**2).sum(axis=1) + 0.3 / np.hypot(*pos.T)
    after = 0.5 * (faster**2).sum(axis=1) + 0.3 / np.hypot(*moved.T)
    np.testing.assert_allclose(after[species == 2], before[species == 2], rtol=1e-14)
    straight = (pos + 0.4 * vel)[species == 3]
    np.testing.assert_allclose(moved[species == 3], straight, rtol=1e-14)
