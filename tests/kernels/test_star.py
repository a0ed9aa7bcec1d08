"""Passes over particles about a star."""

import math

import numpy as np
import pytest

from discsim.kernels.common.totals import MAX_TERMS
from discsim.kernels.gravity import point_masses as star
from discsim.numerics.totals import rounded

NUMBER = 9 * MAX_TERMS + 7  # more than a kernel has room for at first


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.3, 3.0])
def test_positions_are_divided_by_their_distance(radius):
    """Also where some blocks of them have none within it."""
    rng = np.random.default_rng(5)
    pos = rng.uniform(-1.0, 1.0, (NUMBER, 2))
    pos[MAX_TERMS : 2 * MAX_TERMS] += np.where(rng.random(MAX_TERMS) < 0.5, -1.5, 1.5)[:, None]
    first, last = 3, NUMBER - 1
    least, inside = star.split_by_radius(first, last, pos, radius**2, 0.1, 0.0)
    distance2 = ((pos[:, 0] - 0.1) ** 2 + pos[:, 1] ** 2)[first:last]
    np.testing.assert_array_equal(inside, first + np.flatnonzero(distance2 < radius**2))
    assert least == pytest.approx(distance2[distance2 >= radius**2].min(initial=np.inf), rel=1e-14)


@pytest.mark.parametrize("number", range(1, 10))
def test_the_nearest_is_found_wherever_it_is(number):
    """The places are gone through four by four, and then one by one; (3, 4) and (0, 1) have exact distances."""
    for which in range(number):
        pos = np.full((number, 2), [3.0, 4.0])
        pos[which] = 0.0, 1.0
        assert star.nearest_squared(0, number, pos, 0.0, 0.0) == 1.0
        least, inside = star.split_by_radius(0, number, pos, 0.5, 0.0, 0.0)
        assert least == 1.0 and len(inside) == 0
        least, inside = star.split_by_radius(0, number, pos, 2.0, 0.0, 0.0)
        assert least == (25.0 if number > 1 else np.inf) and inside.tolist() == [which]


def test_a_star_pulls_as_it_is_pulled():
    """The same bits as of a star that feels nothing, and momentum is exact: both sums are of the same forces."""
    rng = np.random.default_rng(6)
    pos, mass, given = rng.normal(size=(NUMBER, 2)), rng.random(NUMBER), (2.0, 0.05, 0.1, -0.2)
    one, both = np.zeros((2, NUMBER, 2))
    star.attract(0, NUMBER, pos, one, False, *given)
    pulled = rounded(star.attract_mutually(0, NUMBER, pos, both, False, mass, *given))
    np.testing.assert_array_equal(one, both)
    first, mutual = np.full((2, NUMBER, 2), np.nan)  # whoever is the first does not look at what was there
    star.attract(3, NUMBER - 1, pos, first, True, *given)
    star.attract_mutually(3, NUMBER - 1, pos, mutual, True, mass, *given)
    for acc in (first, mutual):
        np.testing.assert_array_equal(acc[3:-1], one[3:-1])
        assert np.isnan(acc[:3]).all() and np.isnan(acc[-1:]).all()
    for c in range(2):
        forces = mass * both[:, c]
        # Rounding of each term, some 4 units in the last place of it.
        assert abs(2.0 * pulled[c] + math.fsum(forces)) < 1e-15 * np.abs(forces).sum()
