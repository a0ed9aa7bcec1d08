"""Sums over neighbours in single precision beside those in double precision, and what stays as it was."""

import numpy as np
import pytest
from runs import on_threads, state_bits
from sums import uneven

from discsim import Simulation
from discsim.kernels.common.candidates import LANES, padded_count
from discsim.kernels.sph.packs import CHUNK

ALL = {
    "eos": {"kind": "adiabatic", "gamma": 1.4},
    "conductivity": {"alpha": 1.0},
}
# Of the largest: a pair has some roundings of 6e-8, and in the clump forces of pairs are a hundred times their sum.
NEAR = 3e-5


BALSARA, RECONSTRUCTED = {"switch": "balsara"}, {"pairs": "reconstructed"}


def lively(precision, mass=1.0, length=1.0, speed=1.0, boost=0.0, boundary="periodic", viscosity=BALSARA):
    """Uneven gas of unequal masses with every term of the forces, in units of mass, length and speed."""
    pos, masses = uneven(150, 2)
    rng = np.random.default_rng(3)
    vel, u = rng.normal(size=(150, 2)) + boost, rng.uniform(0.5, 2.0, 150)
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1e30},
        "space": {"size": length, "boundary": boundary},
        "gas": {
            "particles": 150,
            "kernel": "cubic",
            "precision": precision,
            **ALL,
            "viscosity": {"alpha": 1.0} | viscosity,
        },
        "alpha_viscosity": {"nu": 0.02 * length * speed},
    }
    given = {"pos": length * pos, "vel": speed * vel, "mass": mass * masses, "u": speed**2 * u}
    return Simulation(scene, particles={"gas": given})


def found_in(sim):
    with sim.synchronised():
        gas, sums = sim.gas, sim.effects["gas"].sph.found
    found = {"h": gas.h, "density": gas.density, "Omega": gas.gradh, "acc": gas.acc, "heating": gas.heating_rate}
    derivatives = {"div": sums.div, "curl": sums.curl, "slopes": sums.slopes}
    return found | {name: values for name, values in derivatives.items() if len(values) > 0}


def assert_near(one, other, times=None):
    for name, values in one.items():
        scale = 1.0 if times is None else times[name]
        np.testing.assert_allclose(
            other[name] / scale, values, atol=NEAR * np.abs(values).max(), rtol=0.0, err_msg=name
        )


def test_every_sum_is_that_of_double_precision():
    double, single = (found_in(lively(precision)) for precision in ("double", "single"))
    assert_near(double, single)
    assert not np.array_equal(double["acc"], single["acc"])
    # Relative to each: both solve for h to 5e-6 (some times the cube of the last step, 4e-3).
    for name in ("h", "density"):
        np.testing.assert_allclose(single[name], double[name], rtol=1e-5, err_msg=name)


@pytest.mark.parametrize(("mass", "length", "speed"), [(2e27, 1e15, 1e5), (1e-31, 1e-20, 1e-12)])
@pytest.mark.parametrize("viscosity", [BALSARA, RECONSTRUCTED], ids=["balsara", "reconstructed"])
def test_units_do_not_matter(mass, length, speed, viscosity):
    """Those of cgs, in which a density is 1e-3, its square over a pressure 1e-17, and a force 1e-43 of a mass."""
    own = found_in(lively("single", viscosity=viscosity))
    density, rate = mass / length**2, speed / length
    times = {
        "h": length, "density": density, "Omega": 1.0, "acc": speed * rate, "heating": speed**2 * rate, "div": rate,
        "curl": rate, "slopes": rate,
    }  # fmt: skip
    assert_near(own, found_in(lively("single", mass, length, speed, viscosity=viscosity)), times)


@pytest.mark.parametrize("viscosity", [BALSARA, RECONSTRUCTED], ids=["balsara", "reconstructed"])
def test_a_moving_frame_does_not_matter(viscosity):
    """What is lost of velocities is lost of their differences: at Mach 1e4 they would be known to 1e-3 otherwise."""
    own = found_in(lively("single", viscosity=viscosity))
    assert_near(own, found_in(lively("single", boost=1e4, viscosity=viscosity)))


def test_momentum_is_kept_to_the_rounding_of_sums():
    """Each particle's sum is rounded by itself, one way or the other: they nearly cancel, but do so no more exactly."""
    sim = lively("single", boundary="open")
    with sim.synchronised():
        gas = sim.gas
    force = gas.mass[:, None] * gas.acc
    torque = gas.pos[:, 0] * force[:, 1] - gas.pos[:, 1] * force[:, 0]
    for values in (force[:, 0], force[:, 1], torque):
        assert abs(values.sum()) < 1e-7 * np.abs(values).sum()


@pytest.mark.parametrize("precision, viscosity", [("single", BALSARA), ("double", RECONSTRUCTED)])
def test_threads_and_resumes_keep_every_bit(tmp_path, monkeypatch, precision, viscosity):
    found = []
    for _ in on_threads(monkeypatch):
        sim = lively(precision, viscosity=viscosity)
        for step in range(4):
            if step == 2:
                sim.save(tmp_path / "here.h5")
            sim.step()
        found.append(state_bits(sim))
    resumed = lively(precision, viscosity=viscosity)
    resumed.restore(tmp_path / "here.h5")
    for _ in range(2):
        resumed.step()
    assert found[0] == found[1] == state_bits(resumed)


def test_padded_counts_are_the_next_multiples_of_a_vector():
    for n in range(CHUNK + 1):
        padded = padded_count.py_func(n)
        assert n <= padded < n + LANES and padded % LANES == 0
