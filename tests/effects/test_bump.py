"""A given disc with a bump, a gap, a file and a radial flow: pressure in balance, dust where it should go."""

import numpy as np
import pytest
from scenes import problems

from discsim import Simulation

BUMP = {"radius": 2.0, "width": 0.2, "height": 0.6}


def scene(stokes=0.1, until=1.0, background=None, **tables):
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.05, "temperature_index": 0.5}
    return {
        "units": {"system": "code"},
        "run": {"until": until},
        "space": {"size": 8.0},
        "background": {"surface_density": 1e-3, "eos": eos, **(background or {})},
        "initial": {"kind": "disc", "surface_density": 1e-3, "inner": 1.0, "outer": 3.0},
        "dust": {"particles": 200, "ratio": 0.01},
        "star": {"mass": 1.0},
        "drag": {"law": "stokes-number", "stokes": stokes, "direction": "one-way"},
        **tables,
    }


def test_the_slope_of_the_pressure_is_that_of_the_profile():
    given = scene(background={"bump": BUMP, "gap": {"radius": 1.5, "width": 0.1, "depth": 0.5}})
    disc = Simulation(given).effects["drag"].disc
    r, d = np.linspace(1.0, 3.0, 101), 1e-6

    def pressure(x):
        return disc.surface_density(x) * disc.sound_speed(x) ** 2

    slope = -(pressure(r + d) - pressure(r - d)) / (2 * d) / disc.surface_density(r)
    np.testing.assert_allclose(disc._speed2_and_pull(r)[1] / r, slope, rtol=1e-6, atol=1e-9)  # of differences


def test_a_file_of_power_laws_drifts_as_power_laws(tmp_path):
    path, r = tmp_path / "disc.txt", np.geomspace(0.5, 4.0, 40)
    path.write_text("r Sigma\n" + "\n".join(f"{x:.17g} {1e-3 / x:.17g}" for x in r))
    plain = Simulation(scene())
    given = scene(background={"file": str(path)})
    del given["background"]["surface_density"]
    tabled = Simulation(given)
    # Between nodes of a table of 16,384 in ln r: (7e-4)^2 / 8 of the curvature.
    np.testing.assert_allclose(tabled.dust.vel, plain.dust.vel, atol=1e-8)
    for sim in (plain, tabled):
        sim.run()
    np.testing.assert_allclose(tabled.dust.pos, plain.dust.pos, atol=1e-6)


def test_dust_gathers_on_the_maximum_of_the_pressure():
    sim = Simulation(scene(stokes=1.0, until=300.0, background={"bump": BUMP}))
    disc, r = sim.effects["drag"].disc, np.linspace(1.7, 2.2, 50_001)
    pull = disc._speed2_and_pull(r)[1]
    trap = r[np.flatnonzero((pull[:-1] < 0) & (pull[1:] >= 0))[-1]]
    began = np.hypot(*sim.dust.pos.T)
    sim.run()
    ended = np.hypot(*sim.dust.pos.T)[(np.argsort(sim.dust.ids))]
    caught = np.abs(ended[(began > 1.9) & (began < 2.3)] - trap)
    assert caught.max() < 0.02  # a tenth of the bump's width


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"bump": {"radius": 2.0, "width": 0.0, "height": 1.0}}, "background.bump.width: 0"),
        ({"gap": {"radius": 2.0, "width": 0.1, "depth": 1.0}}, "expected less than 1"),
        ({"surface_density": None}, "no surface density is given"),
    ],
)
def test_bad_keys_end_in_one_message(keys, wrong):
    given = scene(background=keys)
    given["background"] = {k: v for k, v in given["background"].items() if v is not None}
    (message,) = problems(given)
    assert wrong in message


def test_a_given_disc_has_no_particles_to_be_resolved_by(tmp_path):
    path = tmp_path / "disc.txt"
    path.write_text("r Sigma resolution\n0.1 1 1\n100 1 2\n")
    given = scene(background={"file": str(path)})
    given["background"] = {k: v for k, v in given["background"].items() if not k.startswith("surface_density")}
    (message,) = problems(given)
    assert "background.file: the file has a column resolution, but [background] has no particles" in message
