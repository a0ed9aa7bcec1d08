"""The whole kick of gas and dust, cells and nodes included, for any masses, places, velocities, K and dt."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kicks import barycentre, kicked, momentum_and_energy, start

from discsim.drag import cells

SCHEMES = ["tsc", "idic", "idic-linear"]
ANY = {
    "seed": st.integers(0, 2**32 - 1),
    "coefficient": st.floats(-8, 12).map(lambda e: 10.0**e),
    "dt": st.floats(-4, 1).map(lambda e: 10.0**e),
    "ratio": st.floats(-6, 6).map(lambda e: 10.0**e),
    "step": st.integers(0, 1000),
}
few = settings(deadline=None, max_examples=40, derandomize=True)


def mixture(seed, ratio, gas=60, dust=40):
    """Particles at random in a unit square; masses within a species differ by up to 100, velocities are of order 1."""
    rng = np.random.default_rng(seed)
    out = {}
    for name, count, total in (("gas", gas, 1.0), ("dust", dust, ratio)):
        mass = 10.0 ** rng.uniform(-1, 1, count)
        vel = rng.normal(size=(count, 2)) + 3.0 * rng.normal(size=2)
        out[name] = {"pos": rng.random((count, 2)), "vel": vel, "mass": total * mass / mass.sum()}
    return out


@pytest.mark.parametrize("scheme", SCHEMES)
@few
@given(**ANY)
def test_momentum_stays_and_energy_never_rises(scheme, seed, coefficient, dt, ratio, step):
    """Momentum to rounding of its terms; drag takes from the energy of relative motion and gives it nothing."""
    particles = mixture(seed, ratio)
    after = kicked(scheme, particles, coefficient, dt, step)
    assert all(np.isfinite(v).all() for v in after)
    frame = barycentre(particles)
    before, scale, energy = momentum_and_energy(particles, start(particles), frame)
    momentum, _, left = momentum_and_energy(particles, after, frame)
    assert np.abs(momentum - before).max() <= 1e-12 * scale
    assert left <= energy * (1.0 + 1e-12) + 1e-14 * scale


@pytest.mark.parametrize("scheme", SCHEMES)
@few
@given(**ANY, boost=st.tuples(*[st.floats(-100, 100)] * 2))
def test_kick_is_the_same_in_a_moving_frame(scheme, seed, coefficient, dt, ratio, step, boost):
    particles = mixture(seed, ratio)
    still = kicked(scheme, particles, coefficient, dt, step)
    for p in particles.values():
        p["vel"] = p["vel"] + boost
    for rest, moved in zip(still, kicked(scheme, particles, coefficient, dt, step), strict=True):
        # Rounding of the boost, times the mass ratio where a slope about a heavy grain is that of its light gas.
        np.testing.assert_allclose(moved - boost, rest, atol=1e-9 + 1e-14 * ratio * np.abs(boost).max())


@pytest.mark.parametrize("scheme", SCHEMES)
@few
@given(**ANY)
def test_kick_does_not_depend_on_the_order_of_particles(scheme, seed, coefficient, dt, ratio, step):
    particles = mixture(seed, ratio)
    first = kicked(scheme, particles, coefficient, dt, step)
    rng = np.random.default_rng(seed + 1)
    orders = [rng.permutation(len(p["mass"])) for p in particles.values()]
    for p, order in zip(particles.values(), orders, strict=True):
        p.update({key: array[order] for key, array in p.items()})
    second = kicked(scheme, particles, coefficient, dt, step)
    for a, b, order in zip(first, second, orders, strict=True):
        np.testing.assert_allclose(b, a[order], atol=1e-9)  # sums in another order


@pytest.mark.parametrize("scheme", SCHEMES)
@few
@given(**ANY)
def test_kick_turns_with_its_particles_and_lattice(scheme, seed, coefficient, dt, ratio, step):
    """By 90 degrees about the middle of the square, where the lattice falls on itself if its origin turns as well.

    The moving origin has a direction of its own, so that at a given step a turned configuration alone would meet other
    cells: what holds is this, and for `idic`, whose cells stand still, without turning anything but the particles.
    """
    particles = mixture(seed, ratio)
    first = kicked(scheme, particles, coefficient, dt, step)
    for p in particles.values():
        p["pos"] = np.stack([1.0 - p["pos"][:, 1], p["pos"][:, 0]], axis=1)
        p["vel"] = np.stack([-p["vel"][:, 1], p["vel"][:, 0]], axis=1)
    shift = cells.SHIFT_STEP
    try:
        cells.SHIFT_STEP = np.array([-shift[1], shift[0]])
        second = kicked(scheme, particles, coefficient, dt, step)
    finally:
        cells.SHIFT_STEP = shift
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(b, np.stack([-a[:, 1], a[:, 0]], axis=1), atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES)
@few
@given(**(ANY | {"coefficient": st.floats(-8, 12)}))
def test_kick_tends_to_the_barycentre(scheme, seed, coefficient, dt, ratio, step):
    """Dust on the gas, everywhere in the same proportion, each species at one velocity: DustyBox at every particle.

    The slip is that at the start times exp(-(1 + eps) dt / t_stop), the barycentre stays: at rounding from dt of 40
    stopping times on.
    """
    particles = mixture(seed, 1.0)
    gas = particles["gas"]
    rng = np.random.default_rng(seed)
    v, u = rng.normal(size=(2, 2))
    gas["vel"] = np.tile(v, (60, 1))
    particles["dust"] = {"pos": gas["pos"], "mass": ratio * gas["mass"], "vel": np.tile(u, (60, 1))}
    time = dt / 10.0**coefficient
    after = kicked(scheme, particles, time, dt, step, law="stopping-time")
    frame = (v + ratio * u) / (1.0 + ratio)
    slip = (u - v) * np.exp(-(1.0 + ratio) * 10.0**coefficient)
    np.testing.assert_allclose(after[0], np.tile(frame - ratio / (1 + ratio) * slip, (60, 1)), atol=1e-9)
    np.testing.assert_allclose(after[1], np.tile(frame + slip / (1 + ratio), (60, 1)), atol=1e-9)


@few
@given(**ANY)
def test_one_cell_goes_to_its_barycentre(seed, coefficient, dt, ratio, step):
    """idic with the whole square as one cell: any velocities end at the one of the barycentre as K dt grows."""
    particles = mixture(seed, ratio)
    frame = barycentre(particles)
    stiff = 10.0 ** (1.0 + abs(np.log10(coefficient))) * (1.0 + 1.0 / ratio)  # 10 and more of the slower rate
    after = kicked("idic", particles, dt / stiff, dt, step, law="stopping-time", cell_length=1.0)
    worst = max(np.abs(p["vel"] - frame).max() for p in particles.values())
    left = worst * np.exp(-stiff * min(1.0, ratio))
    for v in after:
        np.testing.assert_allclose(v, np.tile(frame, (len(v), 1)), atol=2.0 * left + 1e-9)
