"""The cubic spline of a start's phases."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from discsim.numerics.spline import Spline


@pytest.mark.parametrize("count", [4, 5, 10, 31])
def test_spline_is_scipys(count):
    stream = np.random.default_rng(count)
    nodes = np.cumsum(0.2 + stream.random(count))
    values = 2 * np.pi * stream.random(count)
    x = np.concatenate([nodes, stream.uniform(nodes[0] - 0.1, nodes[-1] + 0.1, 500)])
    # Rounding, as another build of SciPy may fuse products and sums: with that of its wheels on x86-64 the bits agree.
    assert Spline(nodes, values)(x) == pytest.approx(make_interp_spline(nodes, values, k=3)(x), rel=1e-11, abs=1e-11)


def test_spline_of_a_cubic_is_the_cubic():
    nodes = np.array([0.0, 0.3, 1.1, 1.9, 2.0, 3.5])
    x = np.linspace(-0.2, 3.7, 101)

    def cubic(x):
        return 1.0 - 2.0 * x + 0.5 * x**2 - 0.25 * x**3

    # Rounding of numbers up to 10.
    assert Spline(nodes, cubic(nodes))(x) == pytest.approx(cubic(x), abs=1e-13)
