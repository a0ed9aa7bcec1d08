"""The model of analysis/scaling.py, on counts and times that are made up."""

from importlib import import_module as script

import numpy as np
import pytest

A, G, C = 100e-9, 170e-9, 3e-3  # of each part


@pytest.fixture
def scaling():
    return script("scaling")


def counts(ranks, particles, side=64, borders=1.0):
    """Particles in equal parts but for the first rank, which has a tenth more; all send rows to one neighbour, a
    quarter of them to another machine.
    """
    share = np.full(ranks, particles / ranks)
    share[0] *= 1.1 if ranks > 1 else 1.0
    rows = np.full(ranks, 0.0 if ranks == 1 else borders * np.sqrt(particles))
    names = [f"{exchange} {name}" for exchange in ("sph", "drag", "grid") for name in ("gas", "dust")]
    sent = dict.fromkeys(names, (rows, rows / 4, np.ones(ranks)))
    return {
        "side": side,
        "particles": {"gas": share, "dust": 10 * share},
        "received": dict.fromkeys(names, rows),
        "sent": sent | dict.fromkeys(("density", "potential"), (8.0 * rows, 2.0 * rows, np.ones(ranks))),
        "runs": {name: np.full(ranks, 7) for name in ("sph gas", "drag gas", "drag dust")},
        "window": np.full(ranks, side**2 / ranks),
    }


def measured(scaling, given):
    """Ranks whose times are those of the model."""
    seconds = {part: np.array([A, G]) @ scaling.units(given, part) + C for part in scaling.PARTS}
    return [{"seconds": {part: float(each[r]) for part, each in seconds.items()}} for r in range(len(given["window"]))]


@pytest.fixture
def runs(scaling):
    """What was measured and counted of two sizes, with few borders and many."""
    given = [counts(2, particles, side, borders) for particles, side in ((1e5, 512), (1e4, 128)) for borders in (1, 8)]
    return [(measured(scaling, each), each) for each in given]


def test_the_fit_finds_what_the_times_were_made_of(scaling, runs):
    for part, found in scaling.fit(runs).items():
        fetches = scaling.PARTS[part][1] is not None
        assert found == pytest.approx((A, G * fetches, C), rel=1e-6), part  # rounding


def test_of_runs_in_turn_the_least_is_taken(scaling, monkeypatch):
    made = iter([3.0, 7.0, 4.0, 5.0])  # of two runs, and again
    monkeypatch.setattr(scaling, "ROUNDS", 2)
    monkeypatch.setattr(scaling, "measure", lambda run, scheme: [{"seconds": {"gas": (t := next(made))}, "wall": t}])
    found = scaling.measure_in_turn({"one": None, "other": None}, "tsc")
    assert {name: (rank["seconds"]["gas"], rank["wall"]) for name, [rank] in found.items()} == {
        "one": (3.0, 3.0), "other": (5.0, 5.0)
    }  # fmt: skip


def test_a_step_is_the_slowest_rank_of_each_part_and_what_it_sends(scaling, runs):
    costs = {"fit": scaling.fit(runs), "row": {"sph": 100.0, "drag": 200.0, "grid": 30.0}}
    costs |= {"sends": {"sph": 10, "drag": 20, "grid": 5}, "calls": 50}
    given = counts(4, 1e5)
    given["window"] *= [0.7, 0.8, 1.0, 1.5]
    network = scaling.Network("", 1e-6, 1e9)
    found = scaling.predict(given, costs, network)
    of_ranks = [rank["seconds"] for rank in measured(scaling, given)]
    alone = [part for part in scaling.PARTS if part not in ("grid particles", "windows")]
    slowest = sum(max(rank[part] for rank in of_ranks) for part in alone)
    slowest += max(rank["grid particles"] + rank["windows"] for rank in of_ranks)
    names = ["own work", "fetched particles", "calls", "uneven load"]
    assert sum(found[name] for name in names) == pytest.approx(slowest, rel=1e-6)
    runs_of_all = 4 * 3 * 7
    assert found["lists of cells"] == pytest.approx(runs_of_all * (16 / 1e9 + 16 / scaling.MEMORY + scaling.SEARCH))


def test_what_goes_to_other_machines_shares_their_links(scaling, runs):
    """The rest is copied in memory. Each of 64 ranks on two machines also has 1 / 64 of the transforms' 4096 rows, and
    sends each of the others 1 / 64 of what is half transformed of them, both ways.
    """
    costs = {"fit": scaling.fit(runs), "row": {"sph": 100.0, "drag": 200.0, "grid": 30.0}}
    costs |= {"sends": {"sph": 10, "drag": 20, "grid": 5}, "calls": 50}
    found = scaling.predict(counts(64, 1e5, 4096), costs, scaling.Network("", 1e-6, 1e9))
    row, rows = 2 * (100 + 200 + 30) + 2 * 8, np.sqrt(1e5)
    of_transforms = 2 * 16 * 4096 / 64 * 4097 / 64
    expected = 32 * (row * rows / 4 + 32 * of_transforms) / 1e9
    expected += (row * rows * 3 / 4 + 31 * of_transforms) / scaling.MEMORY
    assert found["bandwidth"] == pytest.approx(expected, rel=0.07)  # rows and columns are in whole pieces
    assert found["latency"] == pytest.approx(1e-6 * (2 * (10 + 20 + 5) + 2 + 2 * 63 + 50 * 6))


def test_what_is_sent_goes_to_ranks_of_this_machine_or_another(scaling):
    """Each of 64 ranks sends its number to the next one and twice that to the last: [receiver, sender]."""
    sends = np.diag(np.arange(63.0), -1)
    sends[63, :62] = 2 * np.arange(62)
    found = scaling.Sent.of(sends)
    r = np.arange(64)
    np.testing.assert_array_equal(found.total, np.where(r < 62, 3 * r, r * (r < 63)))
    np.testing.assert_array_equal(found.away, np.where(r < 32, 2 * r + 31 * (r == 31), 0))
    np.testing.assert_array_equal(found.messages, np.where(r < 62, 2, r < 63) * (r > 0))


def test_more_particles_fetch_along_the_same_borders(scaling):
    """A hundred times the particles: as many times their own, ten times those that are fetched."""
    given = counts(4, 1e5)
    own = sum(given["particles"].values())
    found = scaling.units(given, "drag", particles=100.0)
    np.testing.assert_allclose(found, [100 * own, np.full(4, 10 * 2 * np.sqrt(1e5))])
    np.testing.assert_allclose(scaling.units(given, "windows", side=128), [4 * given["window"], np.zeros(4)])


def test_ranks_wait_for_the_slowest_after_each_part_but_those_beside_each_other(scaling):
    seconds = {"gas": [1.0, 2.0], "drag": [4.0, 3.0], "grid particles": [5.0, 7.0], "windows": [2.0, 1.0]}
    assert scaling.slowest(seconds) == 2.0 + 4.0 + (7.0 + 1.0)


def test_what_hangs_on_the_grid_is_that_of_the_finer_one_where_it_is_as_fine(scaling):
    given, fine = counts(4, 1e5), counts(4, 3e5, side=256)
    given["fine"] = {name: fine[name] for name in ("side", "window", "sent")}
    costs = {"row": {"sph": 100.0, "drag": 200.0, "grid": 30.0}}
    for side, of in ((128, given), (256, fine), (512, fine)):
        more = (side / of["side"]) ** 2
        np.testing.assert_allclose(scaling.units(given, "windows", side=side)[0], more * of["window"])
        sent = scaling._sent(given, costs, 3.0, side)
        np.testing.assert_allclose(sent["density"].total, more * of["sent"]["density"][0])
        np.testing.assert_allclose(sent["sph gas"].total, 300.0 * given["sent"]["sph gas"][0])  # rows of particles
