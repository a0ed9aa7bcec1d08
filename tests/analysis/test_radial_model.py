"""The model of gas and dust in radius alone, and what the ring's runs are compared with."""

from importlib import import_module as script
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from discsim.exact import nsh
from discsim.numerics.state import Dust
from discsim.output.snapshot_writer import write_snapshot
from discsim.physics import viscosity
from discsim.scene import load_scene

SETUPS = Path(__file__).parents[2] / "setups"
ORBIT = 2.0 * np.pi


def model(direction, cells=130, overrides=()):
    scene = load_scene(SETUPS / f"ring_{direction}.toml", list(overrides))
    return script("radial_model").Model(scene, cells)


def quantiles(disc):
    """Radii of a tenth, a half and nine tenths of the dust, between the edges of cells."""
    mass = np.append(0.0, np.cumsum(disc.dust * disc.area))
    return np.interp(np.array([0.1, 0.5, 0.9]) * mass[-1], mass, disc.edges)


def test_dust_that_does_not_push_follows_its_drift():
    """Gas at its steady state stays as it is, and grains that mark a share of the mass keep it on their way."""
    disc, start = model("oneway"), model("oneway")
    mass = (start.dust * start.area).sum()
    disc.advance(15 * ORBIT)
    np.testing.assert_allclose(disc.gas, start.gas, rtol=2e-3)  # of second order in cells of .02, at the step 1e-3
    assert disc.taken + (disc.dust * disc.area).sum() == pytest.approx(mass, rel=1e-12)
    scene = start.scene

    def drift(_, r):
        slope = np.log(viscosity.diffusivity(scene, r * 1.0001) / viscosity.diffusivity(scene, r / 1.0001)) / 2e-4
        headwind = 0.5 * 0.01 * (1.0 + slope) / np.sqrt(r)  # P ~ 1 / (r nu)
        nu = viscosity.diffusivity(scene, r)
        stokes = 0.5 * nu / viscosity.diffusivity(scene, np.ones(1))
        flow = -1.5 * nu / r
        return nsh.velocities(stokes, 0.0, headwind).dust_radial + flow / (1.0 + stokes**2)

    paths = solve_ivp(drift, (0.0, disc.time), quantiles(start), rtol=1e-8).y[:, -1]
    np.testing.assert_allclose(quantiles(disc), paths, atol=0.005)  # a quarter of a cell


@pytest.mark.parametrize(
    "direction, early, late, peak",
    [
        ("oneway", [0.96, 1.17, 1.40], [0.63, 0.94, 1.07], 1.01),
        ("twoway", [1.04, 1.32, 1.62], [0.92, 1.18, 1.38], 1.15),
    ],
)
def test_the_ring_of_a_two_fluid_model(direction, early, late, peak):
    """Figures of an independent model with both momentum equations and an open edge at .4, which differ from these by
    terms of H / r and by that edge; its peak is of a profile smoothed over .1, at half the height of a Gaussian.
    """
    disc = model(direction)
    disc.advance(20 * ORBIT)
    np.testing.assert_allclose(quantiles(disc), early, atol=0.03)
    disc.advance(40 * ORBIT)
    np.testing.assert_allclose(quantiles(disc), late, atol=0.04)
    found = script("radial_model").peak_radius(disc.edges, disc.dust, 0.1 / 2.355)
    assert found == pytest.approx(peak, abs=0.02)  # a cell


def test_a_linear_step_holds_the_ring_farther_out():
    """What decides the two-way peak: whether alpha or ln alpha has the tanh."""
    discs = [model("twoway", overrides=[f'alpha_viscosity.step="{step}"']) for step in ("logarithmic", "linear")]
    for disc in discs:
        disc.advance(40 * ORBIT)
    near, far = (disc.radius[disc.dust.argmax()] for disc in discs)
    assert far - near == pytest.approx(0.07, abs=0.03)


def test_run_beside_its_model(tmp_path, capsys):
    module = script("radial_model")
    text = (SETUPS / "ring_oneway.toml").read_text()
    (tmp_path / "run" / "snapshots").mkdir(parents=True)
    (tmp_path / "run" / "scene.toml").write_text(text)
    scene, rng = load_scene(tmp_path / "run" / "scene.toml"), np.random.default_rng(1)
    for k in range(2):
        r, phi = np.sqrt(rng.uniform(1.21, 4.0, 2000)), rng.uniform(0, ORBIT, 2000)
        pos, n = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1), len(r)
        zero = np.zeros_like(pos)
        dust = Dust(pos=pos, vel=zero, acc=zero, mass=np.full(n, 1.0 / n), ids=np.arange(n), species=np.zeros(n, int))
        write_snapshot(tmp_path / "run" / "snapshots" / f"{k:04d}.h5", scene, 0.1 * k, None, dust)
    arguments = [str(tmp_path / "run"), "-o", str(tmp_path), "--within", "1.2", "--cells", "60"]
    assert module.main(arguments) == 0
    assert "within 1.2" in capsys.readouterr().out
    assert (tmp_path / "radial_model.png").stat().st_size > 10_000
    (tmp_path / "run" / "scene.toml").write_text(text[: text.index("[drag]")])  # its last table
    assert module.main(arguments) == 2
    assert "no model of this" in capsys.readouterr().err
