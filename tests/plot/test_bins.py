"""Particles on pixels and in rings: sums are kept, means are right, and nothing depends on blocks of particles."""

import numpy as np
import pytest

from discsim.output import bins


def ring(count, seed, inner=1.0, outer=3.0):
    """Random places of an even density between two radii."""
    rng = np.random.default_rng(seed)
    r, phi = np.sqrt(rng.uniform(inner**2, outer**2, count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def test_all_mass_is_on_the_pixels_and_in_the_rings():
    pos, mass = ring(4000, 1), np.random.default_rng(2).random(4000)
    radius = np.hypot(*pos.T)
    plane = bins.square_pixels(pos, (np.full(2, -6.0), np.full(2, 6.0)), 120)
    polar = bins.polar_pixels(pos, 0.0, 6.0, 200)
    smooth = bins.SmoothRings(radius, (0.0, 6.0), 2)
    rings = bins.Rings(radius, np.linspace(0.0, 6.0, 31))
    # Of the widest Gaussians in angle and radius a little is beyond r = 0.
    assert polar.sum(mass).sum() == pytest.approx(mass.sum(), rel=1e-4)
    for found in (plane, smooth, rings):
        # Sums of 4000 numbers; Gaussians that are cut are made up for.
        assert found.sum(mass).sum() == pytest.approx(mass.sum(), rel=1e-9)
    np.testing.assert_allclose(rings.sum(mass), np.histogram(radius, np.linspace(0.0, 6.0, 31), weights=mass)[0])


def test_an_even_disc_is_even_in_every_kind_of_bins():
    """4e4 particles over an area of 8 pi: 12 of them make a Gaussian of .05.

    Its noise is 1/sqrt(48), and somewhat more as it is narrower where chance has put many.
    """
    count = 40_000
    pos = ring(count, 3)
    expected = count / (8 * np.pi)
    plane = bins.square_pixels(pos, (np.full(2, -4.0), np.full(2, 4.0)), 200)
    centres = -4.0 + 8.0 / 200 * (np.arange(200) + 0.5)
    r = np.hypot(*np.meshgrid(centres, centres))
    inside = (plane.sum(np.ones(count)) / plane.measure)[(r > 1.4) & (r < 2.6)]
    assert inside.mean() == pytest.approx(expected, rel=0.01)
    assert 0.1 < inside.std() / expected < 0.22
    polar = bins.polar_pixels(pos, 0.5, 3.5, 300)
    along = (polar.sum(np.ones(count)) / polar.measure)[:, 50:100]  # r of 1.5 to 2.5
    assert along.mean() == pytest.approx(expected, rel=0.02)  # 2e4 particles are between them
    smooth = bins.SmoothRings(np.hypot(*pos.T), (0.0, 4.0), 2)
    profile = smooth.sum(np.ones(count)) / smooth.measure
    # A Gaussian of .02 at r = 2 has 400 particles: 5%, and 3 of that among 75 bins.
    np.testing.assert_allclose(profile[85:160], expected, rtol=0.15)


def test_rings_of_a_quiet_start_are_not_seen():
    """Circles .1 apart, as many particles on each as make the density even; the profile levels them."""
    circles = np.arange(1.0, 3.0, 0.1) + 0.05
    radius = np.concatenate([np.full(round(2 * np.pi * r / 0.1), r) for r in circles])
    smooth = bins.SmoothRings(radius, (0.0, 4.0), 2)
    profile = (smooth.sum(np.ones(len(radius))) / smooth.measure)[75:165]  # r of 1.25 to 2.75
    # exp(-2 pi^2 .6^2) of the modulation, twice, and numbers of particles that are whole: one in 2 pi r/.1.
    np.testing.assert_allclose(profile, 100.0, rtol=0.02)
    assert np.ptp(np.histogram(radius, np.linspace(1.25, 2.75, 91))[0]) > 100  # plain bins see them


@pytest.mark.parametrize("apart", [0.0567, 0.043])
def test_rings_that_beat_with_the_bins_are_not_seen(apart):
    """Circles 3.4 and 2.6 bins apart, as in a disc of 10^4: in plain bins they are 3 and 4 apart by turns."""
    circles = np.arange(1.0, 3.0, apart) + 0.5 * apart
    radius = np.concatenate([np.full(round(2 * np.pi * r / apart), r) for r in circles])
    smooth = bins.SmoothRings(radius, (0.0, 4.0), 2)
    profile = (smooth.sum(np.ones(len(radius))) / smooth.measure)[75:165]
    # As above: 1 in 2 pi r / apart is .5%; 20% and 26% if all of a particle is in one bin.
    np.testing.assert_allclose(profile * apart**2, 1.0, rtol=0.02)


@pytest.mark.parametrize("width", [0.031, 0.27])
def test_a_given_width_is_that_of_a_thin_ring(width):
    """A ring of dust seen through it: mean radius and spread, of the mass per radius; sums stay, at an edge too."""
    radius = np.full(50, 2.17)
    smooth = bins.SmoothRings(radius, (0.0, 4.0), 2, width=width)
    seen = smooth.sum(np.full(50, 0.3))
    assert seen.sum() == pytest.approx(15.0, rel=1e-12)
    middle = 0.5 * (smooth.edges[1:] + smooth.edges[:-1])
    sigma = seen / smooth.measure
    assert middle @ sigma / sigma.sum() == pytest.approx(2.17, abs=0.002)  # a tenth of a bin
    spread = (sigma @ (middle - 2.17) ** 2 / sigma.sum()) ** 0.5
    assert spread == pytest.approx(width, rel=0.02)  # it is cut at 3.5 widths, 1%
    edge = bins.SmoothRings(np.array([0.0, 3.99]), (0.0, 4.0), 2, width=width)
    assert edge.sum(np.array([0.7, 1.9])).sum() == pytest.approx(2.6, rel=1e-12)


def test_a_particle_on_a_line_is_as_wide_as_three_fifths_of_their_distance():
    """In one dimension that is one over their number density: what is seen of one among even ones, .13 apart."""
    place = 0.7 + 0.13 * (np.arange(40) + 0.5)
    smooth = bins.SmoothRings(place, (0.7, 5.9), 1)
    seen = smooth.sum(np.where(np.arange(40) == 17, 2.3, 0.0))
    middle = 0.5 * (smooth.edges[1:] + smooth.edges[:-1])
    assert seen.sum() == pytest.approx(2.3, rel=1e-12)  # rounding
    assert middle @ seen / 2.3 == pytest.approx(place[17], abs=0.011)  # half a bin
    # Cut at 3.5 of its widths, 1%; levels of the density that is seen are even to .1%.
    assert (seen @ (middle - middle @ seen / 2.3) ** 2 / 2.3) ** 0.5 == pytest.approx(0.6 * 0.13, rel=0.02)


def test_a_window_within_the_disc_is_the_middle_of_the_whole():
    """Particles beside it reach into it: no darker border."""
    pos = ring(40_000, 5, 0.0, 3.0)
    near = bins.square_pixels(pos, (np.full(2, -1.0), np.full(2, 1.0)), 60)
    sigma = near.sum(np.ones(len(pos))) / near.measure
    border = np.concatenate([sigma[0], sigma[-1], sigma[:, 0], sigma[:, -1]])
    # 240 pixels of noise 1/7, a few Gaussians long: 3%; without what is beside they would have half.
    assert border.mean() == pytest.approx(40_000 / (9 * np.pi), rel=0.1)


def test_blocks_change_nothing(monkeypatch):
    pos, mass = ring(3000, 7), np.ones(3000)
    window = np.full(2, -4.0), np.full(2, 4.0)
    whole = bins.square_pixels(pos, window, 50).sum(mass)
    monkeypatch.setattr(bins, "_BLOCK", 256)
    assert np.array_equal(bins.square_pixels(pos, window, 50).sum(mass), whole)


def test_no_particles_and_particles_beyond_the_window():
    window = np.full(2, -1.0), np.full(2, 1.0)
    assert not bins.square_pixels(np.empty((0, 2)), window, 20).sum(np.empty(0)).any()
    far = bins.square_pixels(np.array([[50.0, 0.0], [np.nan, 0.0]]), window, 20)
    assert not far.sum(np.ones(2)).any()
