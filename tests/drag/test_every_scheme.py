"""Every drag scheme and law, both ways: what a kick keeps, and what it leaves alone."""

import numpy as np
import pytest
from drags import BETWEEN_PAIRS, INTERPOLATING, OF_PARTICLES, ON_GRID, POLAR
from stepping import LOCALLY, assert_sane, choices, disc, momentum, scene, totals

from discsim import Simulation, load_scene
from discsim.scene.tables import TABLES

LAWS = {
    "constant": {"K": 3.0},
    "stopping-time": {"t_stop": 0.3},
    "epstein": {},
    "epstein-stokes": {"mean_free_column": 1e-3, "supersonic": True},
    "stokes-number": {"stokes": 0.3},
    "stokes-over-density": {"stokes": 0.3},
}
OF_DISCS = ("stokes-number", "stokes-over-density")


def dragged(dimensions, law, **drag):
    """A wave in 1D, a disc in 2D, with stopping times of about .1 (in the disc grains are small in its units)."""
    drag = {"law": law, **LAWS[law], **drag}
    dust = {"particles": 90, "ratio": 0.5, "grain_density": 1.0}
    if dimensions == 2:
        gas = {"particles": 400, "kernel": "cubic", "eos": LOCALLY}  # in which pairs have sums of other tests
        return disc(gas=gas, dust=dust | {"particles": 500, "grain_size": 1e-4}, drag=drag)
    return scene({"kind": "wave", "amplitude": 0.1}, dust=dust | {"grain_size": 0.1}, drag=drag)


SIZES = {"smallest": 0.01, "largest": 1.0}
KEEPING = {  # dimensions, law, and what is laid over tables of the scene
    "line": (1, "stopping-time", {}),
    "disc": (2, "stokes-number", {}),
    "one-way": (2, "stokes-number", {"drag": {"direction": "one-way"}}),
    "heated": (1, "epstein", {"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}}}),
    "grain by grain": (1, "epstein", {"dust": {"grain_size": SIZES}}),
    "of few sizes": (1, "epstein", {"dust": {"grain_size": SIZES | {"bins": 2}, "particles": 2000}}),
}


def test_every_drag_law_is_stepped_here():
    assert set(LAWS) == set(choices(TABLES["drag"], "law"))
    # Those of the fixed grid are in tests/numerics/test_ppm.py, those of polar cells in tests/polar/test_polar_drag.py.
    assert {*OF_PARTICLES, *ON_GRID, *POLAR} == set(choices(TABLES["drag"], "scheme"))


every_drag = pytest.mark.parametrize(
    ("dimensions", "law"),
    [(d, law) for d in (1, 2) for law in LAWS if d == 2 or law not in OF_DISCS],  # no orbits in 1D
)


CONSERVING = [name for name in OF_PARTICLES if name not in INTERPOLATING]
INTEGRATED = [(name, {"integration": way}) for name in CONSERVING for way in choices(TABLES["drag"], "integration")]


@every_drag
@pytest.mark.parametrize(("scheme", "more"), [*[pair for pair in INTEGRATED if pair[0] != "mk"], ("mk", {})])
def test_two_way_drag_conserves_momentum(dimensions, law, scheme, more):
    sim = Simulation(dragged(dimensions, law, scheme=scheme, **more))
    sim.step()
    assert_sane(sim)
    sim.dust.vel += 0.3
    before, dt = totals(sim), 0.2
    push = sum(p.mass @ p.acc for p in (sim.gas, sim.dust))
    start = momentum(sim)
    undragged = sim.dust.vel + dt * sim.dust.acc
    sim.effects["drag"].kick(sim.state, dt)
    # All that the kick adds is the forces' own momentum: rounding of a sum of 900 terms, or of 20,000 pairs.
    gained = momentum(sim) - start
    rounding = (1e-13 if scheme in BETWEEN_PAIRS else 1e-14) * before["size"]
    np.testing.assert_allclose(gained, dt * push, rtol=0, atol=rounding)
    assert np.abs(sim.dust.vel - undragged).max() > 0.01


@every_drag
@pytest.mark.parametrize("scheme", OF_PARTICLES)
def test_one_way_drag_leaves_the_gas_alone(dimensions, law, scheme):
    source = dragged(dimensions, law, scheme=scheme, direction="one-way")
    sim, alone = Simulation(load_scene(source)), Simulation(load_scene(source, without=("drag", "dust")))
    start = sim.dust.vel.copy()
    for one in (sim, alone):
        one.step()
        one.step()
    assert_sane(sim)
    # To the last bit.
    for name, array in alone.gas.arrays().items():
        np.testing.assert_array_equal(getattr(sim.gas, name), array, err_msg=name)
    assert np.abs(sim.dust.vel - start).max() > 0


@pytest.mark.parametrize(("dimensions", "law", "tables"), KEEPING.values(), ids=KEEPING)
def test_what_kept_arrays_hold_from_the_kick_before_does_not_matter(dimensions, law, tables):
    """They are as they were left, and of what particles lack they hold anything."""
    ends = []
    for left in (0.0, np.nan):
        given = dragged(dimensions, law, scheme="tsc")
        for name, more in tables.items():
            given[name] = given[name] | more
        sim = Simulation(given)
        drag = sim.effects["drag"]
        for _ in range(3):
            sim.step()
            assert drag.engine.buffers
            times = drag.stopping_times.copy()
            for kept in drag.engine.buffers.values():
                kept[:] = left
        assert_sane(sim)
        ends.append(np.concatenate([sim.gas.vel, sim.dust.vel, times[:, None]], axis=None))
    np.testing.assert_array_equal(*ends)
