"""What runs without an exact solution are compared by, on made-up discs."""

from types import SimpleNamespace

import numpy as np
import pytest

from discsim import Simulation, load_scene
from discsim.effects.models import SPH
from discsim.study.errors import RINGS, binned_masses
from discsim.study.measures import MODES, mean_run, measures_of, structure_of

SIZE = 2.0


def sim_of(**species):
    space = SimpleNamespace(dimensions=2, size=(SIZE, SIZE))
    scene = SimpleNamespace(centred=True, space=space, model=SPH)
    made = {kind: SimpleNamespace(pos=pos, mass=np.full(len(pos), 1.0 / len(pos))) for kind, pos in species.items()}
    return SimpleNamespace(scene=scene, state=SimpleNamespace(species=made))


def disc(n, rng, amplitude=0.0, m=2):
    """Radii even in area within 0.8, and a density 1 + amplitude cos(m phi)."""
    radius = 0.8 * np.sqrt(rng.random(n))
    phi = np.linspace(0.0, 2.0 * np.pi, 4001)
    below = phi + amplitude * np.sin(m * phi) / m
    angle = np.interp(2.0 * np.pi * rng.random(n), below, phi)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_amplitudes_are_those_of_the_density():
    rng = np.random.default_rng(1)
    for m in MODES:
        found = structure_of(sim_of(gas=disc(40_000, rng, 0.3, m)))["modes"]["gas"]
        # |A_m| of 1 + a cos(m phi) is a / 2; noise of 40,000 particles in 20 rings, of which squares are taken off.
        assert found[m - 1] == pytest.approx(0.15, abs=0.02)
        assert max(a for k, a in zip(MODES, found, strict=True) if k != m) < 0.04


def test_rings_divide_the_cells_of_a_polar_grid():
    """A uniform disc in 9 rings of cells has its density in each of the rings that runs are compared by."""
    disc = {"kind": "disc", "surface_density": 3e-7, "surface_density_index": 0.0, "inner": 0.7, "outer": 2.3}
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.2}
    tables = {"units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 5.0}, "initial": disc}
    sim = Simulation(tables | {"star": {"mass": 1.3}, "gas": {"method": "grid", "particles": 432, "eos": eos}})
    edges = np.clip(np.linspace(0.0, 2.5, RINGS + 1), 0.7, 2.3)
    expected = 3e-7 * np.pi * np.diff(edges**2)
    np.testing.assert_allclose(binned_masses(sim)["gas"], expected, rtol=1e-12, atol=1e-18)


def test_mass_in_clumps():
    rng = np.random.default_rng(2)
    smooth = disc(40_000, rng)
    assert structure_of(sim_of(gas=smooth))["clumps"]["gas"] == [0.0]
    clump = np.array([0.3, 0.2]) + 0.004 * rng.normal(size=(8000, 2))
    found = structure_of(sim_of(gas=np.concatenate([smooth, clump])))["clumps"]["gas"][0]
    assert found == pytest.approx(8000 / 48_000, rel=0.1)
    # Few particles, most pixels of a ring without any: none of them is a clump.
    assert structure_of(sim_of(gas=disc(300, rng)))["clumps"]["gas"][0] < 0.05


def test_measures_of_a_scene_by_name():
    assert list(measures_of(load_scene("setups/dusty_wave.toml"))) == ["exact", "dust-profile", "gas-profile"]
    names = ["dust-profile", "gas-profile", "dust-modes", "gas-modes", "dust-clumps", "gas-clumps"]
    assert list(measures_of(load_scene("setups/twin_twoway.toml"))) == names
    assert list(measures_of(load_scene("setups/gas_disc.toml"))) == names[1::2]


def test_errors_against_a_reference():
    rng = np.random.default_rng(3)
    one, other = (structure_of(sim_of(dust=disc(20_000, rng, amplitude))) for amplitude in (0.0, 0.4))
    known = measures_of(load_scene("setups/twin_twoway.toml"))
    assert known["dust-modes"].error(other, one) == pytest.approx(0.2, abs=0.02)
    assert known["dust-profile"].error(other, one) < 0.03  # the same in rings
    assert known["dust-profile"].error(one, one) == known["dust-clumps"].error(one, one) == 0.0
    both = mean_run([one, other])
    assert both["modes"]["dust"] == pytest.approx(np.mean([one["modes"]["dust"], other["modes"]["dust"]], axis=0))
