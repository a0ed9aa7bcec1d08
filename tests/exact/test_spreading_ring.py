"""The spreading ring solves its equation, and keeps its mass."""

import numpy as np

from discsim.exact import spreading_ring

TAU, NU = 0.1, 1e-3


def test_the_ring_solves_the_equation_of_viscous_discs():
    """dSigma/dt = (3/r) d/dr [sqrt(r) d(nu Sigma sqrt(r))/dr], with tau = 12 nu t / R^2, by central differences."""
    radius = 1.3
    r = np.linspace(0.6, 2.4, 3001)
    step = r[1] - r[0]

    def sigma(tau):
        return spreading_ring.surface_density(r, tau, 2.0, radius)

    rate = (sigma(TAU + 1e-5) - sigma(TAU - 1e-5)) / 2e-5 * 12.0 * NU / radius**2
    flux = np.sqrt(r) * np.gradient(NU * sigma(TAU) * np.sqrt(r), step)
    expected = 3.0 / r * np.gradient(flux, step)
    inside = slice(2, -2)
    # Differences are off by (step / width)^2 of it, the width of the ring being sqrt(tau).
    np.testing.assert_allclose(rate[inside], expected[inside], atol=1e-4 * np.abs(rate).max())
    # The flow is what moves that mass: v_r Sigma = -3 / sqrt(r) d(nu Sigma sqrt(r))/dr.
    flow = spreading_ring.radial_velocity(r, TAU, NU, radius) * sigma(TAU)
    np.testing.assert_allclose(flow[inside], (-3.0 * flux / r)[inside], atol=1e-4 * np.abs(flow).max())


def test_the_ring_has_its_mass_and_angular_momentum():
    r = np.linspace(1e-4, 6.0, 60_001)
    sigma = spreading_ring.surface_density(r, TAU, 2.0, 1.0)
    # What has fallen to the centre took nothing of the angular momentum; at this tau it is 2e-6 of the mass.
    assert abs(np.trapezoid(2.0 * np.pi * r * sigma, r) / 2.0 - 1.0) < 1e-5
    assert abs(np.trapezoid(2.0 * np.pi * r**1.5 * sigma, r) / 2.0 - 1.0) < 1e-6
