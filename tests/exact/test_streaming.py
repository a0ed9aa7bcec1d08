"""Drift and growth in a shearing box: published eigenvalues, the general drift, other units."""

import numpy as np
import pytest

from discsim.exact import nsh, streaming

# Youdin & Johansen (2007), table 1, and Benitez-Llambay, Krapp & Pessah (2019), table 4: t_stop, eps, K, rate.
PUBLISHED = {
    "linA": (0.1, 3.0, 30.0, 0.4190091323 - 0.3480181522j),
    "linB": (0.1, 0.2, 6.0, 0.0154862262 + 0.4998787515j),
    "lin3": ((0.0425, 0.1), (1.0, 0.5), 50.0, 0.3027262829 - 0.3242790653j),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_rates_are_the_published_ones(name):
    time, ratio, k, rate = PUBLISHED[name]
    assert streaming.fastest_mode(streaming.box(time, ratio), k, k).rate == pytest.approx(rate, abs=1e-9)


def test_rates_scale_with_the_units():
    """With Omega = 2.5 and a headwind of 0.3, lengths are in units of 0.12."""
    omega, wind = 2.5, 0.3
    box = streaming.box(0.1 / omega, 3.0, wind, 20.0 * wind, omega)
    mode = streaming.fastest_mode(box, 30.0 * omega / wind, 30.0 * omega / wind)
    assert mode.rate == pytest.approx(omega * PUBLISHED["linA"][3], rel=1e-8)
    same = streaming.fastest_mode(streaming.box(0.1, 3.0), 30.0, 30.0)
    assert mode.amplitudes[:, 1:] == pytest.approx(wind * same.amplitudes[:, 1:], rel=1e-6)


def test_drift_of_three_sizes_is_that_of_a_disc():
    stokes, ratios = np.array([0.03, 0.4, 2.7]), np.array([0.2, 0.7, 0.05])
    omega, wind = 1.7, -0.6
    found = streaming.drift(streaming.box(stokes / omega, ratios, wind, omega=omega))
    disc = nsh.velocities_of_populations(stokes, ratios, wind)
    assert found[0] == pytest.approx([disc.gas_radial, disc.gas_azimuthal], rel=1e-12)
    assert found[1:] == pytest.approx(np.column_stack([disc.dust_radial, disc.dust_azimuthal]), rel=1e-12)


def test_grains_without_drag_follow_the_shear_and_gas_has_the_headwind():
    found = streaming.drift(streaming.box([np.inf, np.inf], 0.3, 0.7, shear=1.2))
    assert found == pytest.approx(np.array([[0.0, -0.7], [0.0, 0.0], [0.0, 0.0]]), abs=1e-15)


def time_derivative(box, kx, kz, amplitudes, small=1e-6):
    """Rates of the amplitudes by eqs. (1) and (2), with differences in space taken exactly, as one wave has them."""
    n = 64
    phase = 2.0 * np.pi * np.arange(n) / n
    wave = np.exp(1j * phase)
    drift = streaming.drift(box)
    fields = (small * amplitudes[..., None] * wave).real  # (N + 1, 4, n)
    fields[:, 1:3] += drift[..., None]

    def along(values):  # i k of each harmonic
        return np.fft.ifft(1j * np.fft.fftfreq(n, 1.0 / n) * np.fft.fft(values)).real

    density = 1.0 + fields[:, 0]
    out = np.empty_like(fields)
    for row, (vx, vy, vz) in enumerate(fields[:, 1:]):
        out[row, 0] = -kx * along(density[row] * vx) - kz * along(density[row] * vz)
        push = 2.0 * box.omega * (vy + (box.headwind if row == 0 else 0.0))
        pressure = box.sound_speed**2 * along(np.log(density[0])) if row == 0 else np.zeros(n)
        forces = push - kx * pressure, -(2.0 - box.shear) * box.omega * vx, -kz * pressure
        for axis, (force, v) in enumerate(zip(forces, (vx, vy, vz), strict=True)):
            out[row, 1 + axis] = force - (kx * vx + kz * vz) * along(v)
    for j, (time, ratio) in enumerate(zip(box.stopping_times, box.ratios, strict=True)):
        slip = (fields[j + 1, 1:] - fields[0, 1:]) / time
        out[0, 1:] += ratio * density[j + 1] / density[0] * slip
        out[j + 1, 1:] -= slip
    return 2.0 * (out * wave.conj()).mean(axis=2) / small


def test_the_mode_solves_the_equations_of_motion():
    """Two sizes, oblique wave, another shear; differences of second order in the amplitude of 1e-6 are left."""
    box = streaming.box([0.2, 0.7], [0.9, 0.4], 0.8, 7.0, 1.3, 1.4)
    mode = streaming.fastest_mode(box, 9.0, 14.0)
    assert mode.rate.real > 0.05
    found = time_derivative(box, 9.0, 14.0, mode.amplitudes)
    assert found == pytest.approx(mode.rate * mode.amplitudes, abs=1e-4 * np.abs(mode.amplitudes).max())
    assert (mode.left * mode.amplitudes).sum() == pytest.approx(1.0, abs=1e-12)
