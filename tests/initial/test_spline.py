"""The spline of a start's phases is scipy's."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from discsim.initial import spline


@pytest.mark.parametrize("points", [4, 5, 10])
def test_it_is_that_of_scipy(points):
    rng = np.random.default_rng(points)
    x, y = np.cumsum(rng.random(points) + 0.1), 2.0 * np.pi * rng.random(points)
    at = np.concatenate([x, rng.uniform(x[0], x[-1], 500)])
    # The same numbers in the same order; some processors round a product and a sum as one.
    np.testing.assert_allclose(spline.through(x, y, at), make_interp_spline(x, y, k=3)(at), rtol=0, atol=4e-15)


def test_a_cubic_is_itself():
    x, at = np.array([1.0, 1.5, 3.0, 4.0, 4.5, 7.0]), np.linspace(1.0, 7.0, 31)
    found = spline.through(x, (x - 2.0) ** 3 - x, at)
    np.testing.assert_allclose(found, (at - 2.0) ** 3 - at, rtol=0, atol=1e-12 * 118)  # of the largest value
