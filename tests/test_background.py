"""Dust in a given gas disc: drift at any stopping time, and scenes that may name [background]."""

import drift as study
import numpy as np
import pytest

from discsim import Simulation
from discsim.scene import SceneError, load_scene


def scene(stokes=0.1, aspect=0.005, particles=8, **tables):
    eos = {"kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": 1.0}
    base = {
        "units": {"system": "code"},
        "run": {"until": 20 * np.pi, "courant": 0.03},
        "space": {"size": 4.0},
        "background": {"surface_density": 1e-4, "eos": eos},
        "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.99, "outer": 1.01},
        "dust": {"particles": particles, "ratio": 0.01},
        "star": {"mass": 1.0},
        "drag": {"law": "stokes-number", "stokes": stokes, "direction": "one-way"},
    }
    return base | tables


@pytest.mark.parametrize("stokes", [1e-8, 1e-4, 0.01, 0.1, 1.0, 10.0, 1e3, 1e5])
def test_drift(stokes):
    """Within .1%, in steps of .03/Omega that no stopping time shortens: at St = 1e-8 the drift is 1e-12 of v_K."""
    assert abs(study.background_error(stokes)) < 1e-3


@pytest.mark.parametrize("stokes", [1e-4, 0.1, 10.0])
def test_drift_is_second_order_in_the_step(stokes):
    # At courant .06 and .12 the rest (3 eta = 7.5e-5, one orbit's waves) is below a tenth of the error.
    coarse, fine = (study.background_error(stokes, courant=courant) for courant in (0.12, 0.06))
    assert coarse / fine == pytest.approx(4.0, rel=0.2)


def test_kicks_compose():
    """A kick cut in two by somebody who looks ends where the whole one does, to rounding."""
    whole, cut = (Simulation(scene(0.5, run={"until": 1.0, "timestep": 0.02})) for _ in range(2))
    whole.evolve(0.4)
    whole.run(until=0.4)
    for _ in range(20):
        cut.step()
    assert whole.time == pytest.approx(cut.time)
    np.testing.assert_allclose(whole.dust.vel, cut.dust.vel, rtol=0, atol=1e-14)


def test_epstein_in_the_given_density():
    tables = scene()
    tables["drag"] = {"law": "epstein", "direction": "one-way"}
    tables["dust"] = {"particles": 50, "ratio": 0.01, "grain_size": 1e-6, "grain_density": 2.0}
    sim = Simulation(tables)
    found = sim.effects["drag"].current_stopping_times(sim.state)
    r = np.sqrt((sim.dust.pos**2).sum(axis=1))
    # t = s rho_s sqrt(2 pi) / (Sigma Omega).
    np.testing.assert_allclose(found, 2e-6 * np.sqrt(2 * np.pi) / (1e-4 / r * r**-1.5), rtol=1e-12)


def test_nothing_of_the_gas_is_made():
    sim = Simulation(scene())
    assert sim.gas is None and sim.state.grid is None and "gas" not in sim.effects


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gas": {"particles": 9, "eos": {"kind": "isothermal", "sound_speed": 1.0}}}, "[gas] is there too"),
        ({"drag": {"law": "stokes-number", "stokes": 0.1}}, 'expected direction = "one-way"'),
        ({"drag": {"law": "stokes-number", "stokes": 0.1, "direction": "one-way", "scheme": "tsc"}}, "no drag cells"),
        ({"star": None}, "expected a table [star] too"),
        ({"drag": None}, "expected a table [drag] too"),
        ({"space": {"size": 4.0, "boundary": "periodic"}}, "a [background] is a disc"),
        ({"run": {"until": 1.0, "integrator": "euler"}}, '"kdk"'),
    ],
)
def test_scenes_that_cannot_be(change, message):
    tables = {key: value for key, value in (scene() | change).items() if value is not None}
    with pytest.raises(SceneError) as caught:
        load_scene(tables)
    assert message in str(caught.value)
