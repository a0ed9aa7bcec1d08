"""Particles in memory: in what order they come, and who takes the places of those that go."""

import numpy as np
import pytest
from sums import simulation, uneven


def test_an_order_in_memory_hangs_on_places_and_ids_alone():
    """Particles that are shuffled before they are sorted come into the same order, and h stops where it did."""
    pos, mass = uneven(300, 2)
    sim = simulation(pos, 2, "open", mass=mass)
    gas, sph = sim.gas, sim.effects["gas"].sph
    gas.sort(*sph.keys(gas))
    ids, least = gas.ids, sph.lower_bound_of_h(gas)
    gas.take(np.random.default_rng(2).permutation(gas.count))
    assert not np.array_equal(gas.ids, ids)
    assert sph.lower_bound_of_h(gas) == least
    gas.sort(*sph.keys(gas))
    np.testing.assert_array_equal(gas.ids, ids)


@pytest.mark.parametrize(
    ("gone", "left"),
    [
        ([], [0, 1, 2, 3, 4, 5]),
        ([5], [0, 1, 2, 3, 4]),
        ([0, 2], [4, 1, 5, 3]),
        ([1, 4, 5], [0, 3, 2]),
        ([0, 1, 2, 3, 4], [5]),
        ([0, 1, 2, 3, 4, 5], []),
    ],
)
def test_the_last_take_the_places_of_those_that_go(gone, left):
    pos, _ = uneven(6, 2)
    before = simulation(pos, 2, "open").gas
    for those in (np.isin(np.arange(6), gone), np.array(gone, int)):
        gas = before.copy()
        gas.remove(those)
        for name, array in gas.arrays().items():
            np.testing.assert_array_equal(array, before.arrays()[name][left])


@pytest.mark.parametrize("leaving", [[], [1], [0, 5], [2, 3, 4, 5]])
@pytest.mark.parametrize("number", [0, 1, 2, 5])
def test_those_that_come_take_the_places_of_those_that_leave(leaving, number):
    """Then the last ones do; or, where more come than leave, the others are the last."""
    gas, other = (simulation(uneven(6, 2)[0], 2, "open").gas for _ in range(2))
    before, other.ids = gas.ids.copy(), np.arange(100, 106)
    gas.replace(np.array(leaving, int), {name: array[:number] for name, array in other.arrays().items()})
    stay = set(range(6)) - set(leaving)
    assert set(gas.ids.tolist()) == {*before[sorted(stay)].tolist(), *range(100, 100 + number)}
    assert gas.count == len(stay) + number
    for name, array in gas.arrays().items():
        assert len(array) == gas.count, name
