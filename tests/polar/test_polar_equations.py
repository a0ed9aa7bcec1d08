"""Equations of gas in polar cells against Cartesian derivatives: pressure, viscous stress, motion, heat; and walls."""

import numpy as np
import polar_gas
import pytest
from polar_cells import Disc, ring

from discsim.kernels.polar import transport
from discsim.kernels.polar.geometry import DENSITY, SPIN
from discsim.numerics.polar import PolarCells

GAMMA, INNER, OUTER = 1.3, 0.7, 1.6


# Smooth fields of Cartesian positions (n, 2), without symmetry


def density(pos):
    x, y = pos.T
    return 1.3 + 0.3 * np.sin(1.7 * x + 0.4) * np.cos(1.3 * y)


def pressure(pos):
    x, y = pos.T
    return 0.7 + 0.2 * np.cos(1.4 * x - 0.9 * y + 0.3)


def velocity(pos):
    x, y = pos.T
    swirl = 0.6 * np.stack([-y, x], axis=1)
    return swirl + 0.2 * np.stack([np.sin(1.9 * y + 0.2) + x, np.cos(1.2 * x - 0.7 * y)], axis=1)


def energy(pos):
    return pressure(pos) / density(pos) / (GAMMA - 1.0)


def share(pos):
    x, y = pos.T
    return 0.3 + 0.1 * np.sin(1.6 * y - 0.8 * x)


def dynamic_viscosity(pos):
    x, y = pos.T
    return 0.02 + 0.006 * np.sin(1.5 * x) * np.sin(1.1 * y + 0.5)


def gradient(field, pos, step=2e-3):
    """Return the derivatives of `field(pos)` along x and y, in the last axis; the error is of fourth order."""
    found = []
    for along in step * np.eye(2):
        near, far = (field(pos + k * along) - field(pos - k * along) for k in (1, 2))
        found.append((8.0 * near - far) / (12.0 * step))
    return np.stack(found, axis=-1)


def divergence(field, pos):
    return np.trace(gradient(field, pos), axis1=-2, axis2=-1)


def stress(pos):
    slopes = gradient(velocity, pos)
    trace = np.trace(slopes, axis1=1, axis2=2)[:, None, None]
    shear = slopes + slopes.transpose(0, 2, 1) - 2.0 / 3.0 * trace * np.eye(2)
    return dynamic_viscosity(pos)[:, None, None] * shear


def orders(errors_of):
    """Return errors (kinds,) on the finer of two grids, and the orders of all errors."""
    coarse, fine = (np.array(errors_of(cells)) for cells in (ring(n, 5 * n, INNER, OUTER) for n in (24, 48)))
    return fine, np.log2(coarse / fine)


def error(found, exact, pos):
    """Return the rms error away from the edges, over the rms of the exact values."""
    r = np.hypot(*pos.T)
    inside = (r > 0.85) & (r < 1.4)
    return np.sqrt(np.mean((found - exact)[inside] ** 2) / np.mean(exact[inside] ** 2))


def test_pressure_force_and_heat():
    """a = -grad P / Sigma and du/dt = -P div v / Sigma, in cells longer in azimuth by 1.5."""

    def errors_of(cells):
        pos = cells.pos
        rho, p, acc, heat = density(pos), pressure(pos), np.zeros_like(pos), np.zeros(len(pos))
        cells.find_velocities(velocity(pos), np.zeros_like(pos), 0.0)
        cells.accelerate(rho, p, np.sqrt(GAMMA * p / rho), 0.25 * (GAMMA + 1.0), acc, heat)
        force = -gradient(pressure, pos) / rho[:, None]
        return error(acc, force, pos), error(heat, -p * divergence(velocity, pos) / rho, pos)

    fine, order = orders(errors_of)
    assert fine.max() < 2e-3
    assert order.min() > 1.8


def test_viscous_force_and_heat():
    """The full stress with unequal viscosity: a = div T / Sigma, and the heat T : grad v / Sigma."""

    def errors_of(cells):
        pos = cells.pos
        rho, acc, heat, unused = density(pos), np.zeros_like(pos), np.zeros(len(pos)), np.zeros_like(pos)
        cells.find_velocities(velocity(pos), np.zeros_like(pos), 0.0)
        cells.accelerate(rho, pressure(pos), np.ones(len(pos)), 0.5, unused, None)  # fills the ghost rings
        cells.add_viscosity(rho, dynamic_viscosity(pos) / rho, acc, heat)
        force = divergence(stress, pos) / rho[:, None]
        return error(acc, force, pos), error(heat, (stress(pos) * gradient(velocity, pos)).sum(axis=(1, 2)) / rho, pos)

    fine, order = orders(errors_of)
    assert fine.max() < 4e-3
    assert order.min() > 1.8


@pytest.mark.parametrize("radial_first", [True, False])
def test_the_rates_of_motion(radial_first):
    """dSigma/dt = -div(Sigma v), and dq/dt = -v . grad q of velocity, energy and the share of small dust."""
    dt = 1e-6

    def errors_of(cells):
        pos = cells.pos
        mass, vel, u = density(pos) * cells.area, velocity(pos), energy(pos)
        small = mass * share(pos)
        before = mass.copy(), vel.copy(), u.copy(), share(pos)
        cells.move(mass, vel, pressure(pos), u, GAMMA, dt, radial_first, small)
        rates = [(new - old) / dt for new, old in zip((mass, vel, u, small / mass), before, strict=True)]
        exact = [-divergence(lambda at: density(at)[:, None] * velocity(at), pos)]
        exact += [-np.einsum("n...i,ni->n...", gradient(q, pos), velocity(pos)) for q in (velocity, energy, share)]
        rates[0] /= cells.area
        return [error(*pair, pos) for pair in zip(rates, exact, strict=True)]

    fine, order = orders(errors_of)
    assert fine.max() < 4e-3  # rounding over dt is 1e-10
    assert order[:3].min() > 1.8
    assert fine[3] < 1e-3 and order[3] > 1.4  # the limits of parabolas at extrema: 3e-4, elsewhere 3e-6


def test_the_step_limit_of_a_cell():
    cells = PolarCells(9, 31, 0.4, 1.9, True)
    rng, n = np.random.default_rng(6), 9 * 31
    sound, vel = rng.uniform(0.1, 2.0, n), rng.standard_normal((n, 2))
    cells.find_velocities(vel, np.zeros((n, 2)), 0.0)
    limit = cells.accelerate(np.ones(n), np.ones(n), sound, 0.5, np.zeros((n, 2)), None)
    r = np.hypot(*cells.pos.T)
    dr, side = np.repeat(np.diff(cells.geometry.sides), 31), r * 2.0 * np.pi / 31
    radial = (vel * cells.pos).sum(axis=1) / r
    around = ((cells.pos[:, 0] * vel[:, 1] - cells.pos[:, 1] * vel[:, 0]) / r).reshape(9, 31)
    beyond = np.abs(around - around.mean(axis=1, keepdims=True)).ravel()
    rate = sound * np.hypot(1.0 / dr, 1.0 / side) + np.abs(radial) / dr + 2.0 * beyond / side
    assert limit == pytest.approx(1.0 / rate.max(), rel=1e-13)


# Long steps


@pytest.mark.parametrize("rate", [0.35, -0.35])
def test_free_expansion_is_exact_in_long_steps(rate):
    """Cold gas with v = H r: Sigma = (1 + H t)^-2 and v = H r / (1 + H t), in steps of 0.6 of a cell."""
    cells = ring(40, 8, 0.5, 2.0)
    r = np.hypot(*cells.pos.T)
    mass, vel, cold = 1.3 * cells.area, rate * cells.pos, np.full(len(r), 1e-30)
    dt, steps = 0.6 * np.log(4.0) / 40 / abs(rate), 5
    for step in range(steps):
        cells.move(mass, vel, cold, None, 1.0, dt, step % 2 == 0)
    grown = 1.0 + rate * steps * dt
    inside = (r > 0.75) & (r < 1.4)
    # Of parabolas. A step in which the swept area were a rectangle would be wrong by (H dt)^2 / 2 = 2e-4.
    assert np.allclose((mass / cells.area)[inside], 1.3 / grown**2, rtol=2e-5)
    assert np.allclose(vel[inside], (rate * cells.pos / grown)[inside], atol=2e-5 * abs(rate))


def test_free_motion_around_a_ring_in_long_steps():
    """Cold gas whose angular velocity varies along a ring, in a step of 5.6 cells: third order in the size of cells."""
    errors = []
    for n in (64, 128):
        cells = ring(5, n, 1.0, 1.02)
        r, phi = np.hypot(*cells.pos.T), np.tile(cells.azimuth, 5)
        dt, change = 5.2 * 2.0 * np.pi / n, 0.08
        start = phi - dt
        for _ in range(60):  # of the gas that is now at phi
            start = phi - dt * (1.0 + change * np.sin(start))
        vel = (1.0 + change * np.sin(phi))[:, None] * cells.pos[:, ::-1] * [-1.0, 1.0]
        mass = (1.0 + 0.3 * np.cos(phi)) * cells.area
        # The centrifugal acceleration makes a radial velocity; a sweep across the rings would move gas by it.
        fields = np.zeros((4, 9, n))
        gas = mass.reshape(5, n), vel.reshape(5, n, 2), np.full((5, n), 1e-30), np.empty((0, 0))
        cells.for_rings(transport.unpack, *gas, 0.0, cells.geometry, fields)
        new = fields.copy()
        cells.for_rings(transport.sweep_around, fields, 1.0, dt, cells.geometry, new, cells.passed)
        found = new[:, 2:-2].reshape(4, -1)
        exact = (1.0 + 0.3 * np.cos(start)) / (1.0 + dt * change * np.cos(start)), r**2 * (1.0 + change * np.sin(start))
        errors.append([np.abs(found[k] / e - 1.0).max() for k, e in ((DENSITY, exact[0]), (SPIN, exact[1]))])
    errors = np.array(errors)
    assert errors[1].max() < 4e-4
    assert np.log2(errors[0] / errors[1]).min() > 2.7


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("part", [0.0, 0.45])
def test_sound_around_a_ring_that_rotates(part, direction):
    """Waves with and against the rotation keep their amplitude, 16 cells a wavelength, also if a step moves cells by a
    part of a cell.
    """
    n, mode, size, dt = 128, 8, 1e-4, 0.35 * 2.0 * np.pi / 128
    cells = ring(5, n, 0.88, 1.12)
    r, phi = np.hypot(*cells.pos.T), np.tile(cells.azimuth, 5)
    wave, omega = size * np.cos(mode * phi), part / 0.35
    pull = omega**2 * r[:, None] ** 3  # for solid rotation
    gas = Disc(cells, 1.0 + wave, 0.0 * r, omega * r + direction * wave, sound=np.ones_like(r), star=pull)
    for _ in range(2 * 16 * 20 // 7):  # two periods
        gas.step(dt)
    left = np.abs(np.fft.rfft(gas.density.reshape(5, n).mean(axis=0))[mode]) / (0.5 * n * size)
    # The limits of parabolas take 0.6%, the rotation adds or takes 2%.
    assert left == pytest.approx(1.0, abs=0.04)


# Edges


@pytest.mark.parametrize("eos", [{"kind": "isothermal", "sound_speed": 1e-6}, {"kind": "adiabatic", "gamma": GAMMA}])
@pytest.mark.parametrize("speed", [0.7, -0.7])
def test_cold_gas_at_a_wall_has_the_pressure_of_a_strong_shock(eos, speed):
    """Sigma v^2 (gamma + 1) / 2 behind an adiabatic shock, and Sigma v^2 behind an isothermal one."""
    cells = ring(10, 16, 0.9, 1.4)
    r = np.hypot(*cells.pos.T)
    heat = None if eos["kind"] == "isothermal" else np.full(len(r), 1e-12)
    sim = polar_gas.in_cells(cells, 1.0, eos, np.full(len(r), 1.3), speed * cells.pos / r[:, None], heat)
    found = (sim.acceleration("gas")[0] * cells.pos).sum(axis=1) / r
    i = 9 if speed > 0.0 else 0
    sides, volume = cells.geometry.sides, cells.geometry.volume[i]
    pressure = 1.3 * speed**2 * (1.0 if heat is None else 0.5 * (GAMMA + 1.0))
    expected = -np.sign(speed) * pressure * 0.5 * (sides[i] + sides[i + 1]) / (1.3 * volume)
    assert np.allclose(found.reshape(10, 16)[i], expected, rtol=1e-5)  # c_s / v


def test_the_momentum_that_leaves_the_edges():
    """Mass, momentum and angular momentum are those of uneven gas beside both edges, which rotates as a solid body."""
    cells = ring(30, 41, 0.6, 1.7, closed=False)
    r, phi = np.hypot(*cells.pos.T), np.tile(cells.azimuth, 30)
    out = cells.pos / r[:, None]
    across = out[:, ::-1] * [-1.0, 1.0]
    vel = 0.4 * np.sign(r - 1.1)[:, None] * out + 0.7 * r[:, None] * across
    weight = 1.0 + 0.5 * np.cos(phi - 1.0)
    dt = 1e-4
    lost = cells.move(weight * cells.area, vel.copy(), np.full(len(r), 1e-20), None, 1.0, dt, True)
    for edge, radius, rows in ((0, 0.6, slice(0, 41)), (1, 1.7, slice(-41, None))):
        mass = weight[rows] * 0.4 * dt * radius * 2.0 * np.pi / 41
        speed = np.sign(edge - 0.5) * 0.4 * out[rows] + 0.7 * radius * across[rows]
        exact = [mass.sum(), *(mass @ speed), 0.7 * radius**2 * mass.sum()]
        # The density, velocity and angular momentum at an edge are extrapolated over half a ring.
        assert np.allclose(lost[edge, :4], exact, rtol=3e-3, atol=3e-3 * mass.sum())
