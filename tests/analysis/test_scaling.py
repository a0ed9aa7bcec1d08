"""The model of analysis/scaling.py, on counts and times that are made up."""

from importlib import import_module as script

import numpy as np
import pytest

A, C = 100e-9, 3e-3  # of each part


@pytest.fixture
def scaling():
    return script("scaling")


def counts(ranks, particles, side=64):
    """Particles in equal parts but for the first rank, which has a tenth more, and rows to one neighbour."""
    share = np.full(ranks, particles / ranks)
    share[0] *= 1.1 if ranks > 1 else 1.0
    rows = np.full(ranks, 0.0 if ranks == 1 else np.sqrt(particles))
    names = [f"{exchange} {name}" for exchange in ("sph", "drag", "grid") for name in ("gas", "dust")]
    of_grid = dict.fromkeys(("density", "potential", "transforms"), 8.0 * rows)
    return {
        "side": side,
        "particles": {"gas": share, "dust": 10 * share},
        "received": dict.fromkeys(names, rows),
        "sent": dict.fromkeys(names, rows),
        "runs": {name: np.full(ranks, 7) for name in ("sph gas", "drag gas", "drag dust")},
        "rows": np.full(ranks, side / ranks),
        "window": np.full(ranks, side**2 / ranks),
        "bytes": of_grid,
        "messages": dict.fromkeys([*names, *of_grid], np.ones(ranks)),
    }


def measured(scaling, given):
    """Ranks whose times are those of the model."""
    seconds = {part: A * scaling.units(given, part) + C for part in scaling.PARTS}
    return [{"seconds": {part: float(each[r]) for part, each in seconds.items()}} for r in range(len(given["rows"]))]


@pytest.fixture
def runs(scaling):
    """What was measured and counted of two sizes."""
    both = []
    for particles, side in ((1e5, 512), (1e4, 128)):
        given = {n: counts(n, particles, side) for n in (1, 2, 3, 4, 8)}
        both.append(({n: measured(scaling, each) for n, each in given.items()}, given))
    return both


def test_the_fit_finds_what_the_times_were_made_of(scaling, runs):
    for part, found in scaling.fit(runs).items():
        assert found == pytest.approx((A, C), rel=1e-6), part  # rounding


def test_a_step_is_the_slowest_rank_of_each_part_and_what_it_sends(scaling, runs):
    costs = {"fit": scaling.fit(runs), "row": {"sph": 100.0, "drag": 200.0, "grid": 30.0}}
    costs |= {"sends": {"sph": 10, "drag": 20, "grid": 5}, "calls": 50}
    run, given = runs[0]
    network = scaling.Network("", 1e-6, 1e9)
    found = scaling.predict(given[4], costs, network)
    slowest = sum(max(rank["seconds"][part] for rank in run[4]) for part in scaling.PARTS)
    names = ["own work", "fetched particles", "calls", "uneven load"]
    assert sum(found[name] for name in names) == pytest.approx(slowest, rel=1e-6)
    rows = np.sqrt(1e5)
    assert found["bandwidth"] == pytest.approx((2 * (100 + 200 + 30) + 3 * 8) * rows / 1e9)
    assert found["latency"] == pytest.approx(1e-6 * (2 * (10 + 20 + 5) + 3 + 50 * 2))
    runs_of_all = 4 * 3 * 7
    assert found["lists of cells"] == pytest.approx(runs_of_all * (16 / 1e9 + scaling.SEARCH))


def test_more_particles_fetch_along_the_same_borders(scaling):
    """A hundred times the particles: as many times their own, ten times those that are fetched."""
    given = counts(4, 1e5)
    own = sum(given["particles"].values())
    found = scaling.units(given, "drag", particles=100.0)
    np.testing.assert_allclose(found, 100 * own + 10 * 2 * np.sqrt(1e5))
    np.testing.assert_allclose(scaling.units(given, "windows", side=128), 4 * given["window"])
