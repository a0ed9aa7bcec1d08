"""Drag between pairs of particles: what is conserved, frames, order, threads, and how long its steps may be."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from drags import BETWEEN_PAIRS, INTERPOLATING, OF_PARTICLES
from numba.core.codegen import get_host_cpu_features
from operating import longest_step_of
from pairs import both, cloud, kicked, momentum, motion, scene, spin

from discsim import Simulation

SCHEMES = (*BETWEEN_PAIRS, *INTERPOLATING)
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}
every_scheme = pytest.mark.parametrize("scheme", SCHEMES)
every_pair = pytest.mark.parametrize("scheme", BETWEEN_PAIRS)


# What is conserved


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("kernel", ["gas", "double-hump"])
@every_pair
def test_pairs_conserve_momentum(scheme, kernel, dimensions):
    """Random places, velocities and masses, two populations, steps of a third of t_stop and of 30."""
    for dt in (0.01, 1.0) if scheme != "mk" else (0.01,):
        sim, kick = kicked(scheme, dt, given=cloud(dimensions), kernel=kernel)
        before, turning, energy = momentum(sim), spin(sim) if dimensions == 2 else 0.0, motion(sim)
        scale = sum(p.mass @ np.abs(p.vel).sum(axis=1) for p in both(sim))
        kick()
        assert np.abs(momentum(sim) - before).max() < 1e-12 * scale
        if dimensions == 2:
            assert abs(spin(sim) - turning) < 1e-12 * scale
        assert abs(motion(sim) / energy - 1) > 0.05


@pytest.mark.parametrize("scheme", INTERPOLATING)
def test_interpolation_does_not_conserve_momentum(scheme):
    sim, kick = kicked(scheme)
    before = momentum(sim)
    kick()
    # Seen: 2e-3 and 3e-3 of a total of 1.
    assert 1e-4 < np.abs(momentum(sim) - before).max() < 0.02


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("scheme", ["lab14", "reconstructed"])
def test_sparse_dust_makes_no_energy_of_motion(scheme, dimensions):
    """Forty particles of dust, each ten times as heavy as its gas, and a kick of 30 t_stop, beyond which nothing moves.

    Gas particles that got all that the few dust particles near them give would end with 3 to 10 times the energy.
    """
    sim, kick = kicked(scheme, 1.0, given=cloud(dimensions, n=(500, 40)))
    before, energy = momentum(sim), motion(sim)
    kick()
    assert 0.5 * energy < motion(sim) < energy
    assert np.abs(momentum(sim) - before).max() < 1e-12


@pytest.mark.parametrize(("dust", "left"), [(100, 0.51), (49, 0.60)])
@pytest.mark.parametrize("scheme", ["lab14", "reconstructed"])
def test_sparse_dust_brakes_a_box_of_gas(scheme, dust, left):
    """900 gas particles in two dimensions, eps = 1, 200 t_stop: half of the energy is left, and what the gas has of
    uneven pushes where few dust particles carry all the drag (.11 with 49, as also at t_stop = .1).
    """
    law = {"law": "stopping-time", "t_stop": 1e-3, "scheme": scheme}
    sim = Simulation(scene(law, 900, dust, dimensions=2, initial={"kind": "box", "gas_velocity": 1.0}))
    before, energy = momentum(sim), motion(sim)
    most = energy
    while sim.time < 0.2:
        sim.step()
        most = max(most, motion(sim))
    assert most <= energy * (1 + 1e-12)
    assert motion(sim) / energy == pytest.approx(left, abs=0.02)
    assert np.abs(momentum(sim) - before).max() < 1e-13


@pytest.mark.parametrize("law", [{"law": "constant", "K": 30.0}, {"law": "stopping-time", "t_stop": 0.05}])
@every_pair
def test_pairs_heat_the_gas_by_what_is_lost(scheme, law):
    """On a boost of 100: the energy of motion that is lost is all heat."""
    boost = 100.0
    sim, kick = kicked(scheme, eos=ADIABATIC, given=cloud(boost=boost), law=law)
    before, warm = motion(sim, boost), sim.gas.u.copy()
    kick()
    heat = sim.gas.mass @ (sim.gas.u - warm)
    # Rounding of the boosted velocities: 1e-16 of 100^2 against a loss of .05 and more.
    assert heat == pytest.approx(before - motion(sim, boost), rel=1e-10)
    assert heat > 0.05


@pytest.mark.parametrize("scheme", INTERPOLATING)
def test_interpolation_heats_to_first_order(scheme):
    """In a uniform box over t_stop / 5 (eps = 1): energy closes the better the shorter the step."""
    gas = {"particles": 40, "eos": ADIABATIC}
    box = {"kind": "box", "gas_velocity": 1.0, "dust_velocity": -1.0}
    drag = {"law": "stopping-time", "t_stop": 1.0, "scheme": scheme}
    misses = []
    for steps in (10, 20):
        sim = Simulation(scene(drag, gas, initial=box, run={"timestep": 0.2 / steps}))
        start = motion(sim), sim.gas.mass @ sim.gas.u
        sim.run(0.2)
        misses.append(motion(sim) + sim.gas.mass @ sim.gas.u - sum(start))
    assert abs(misses[1]) < 0.02 * (start[0] - motion(sim))
    assert misses[0] / misses[1] == pytest.approx(2.0, rel=0.15)  # next order


@pytest.mark.parametrize("scheme", INTERPOLATING)
def test_gas_that_heavy_dust_brakes_keeps_its_energy(scheme):
    """Against dust at rest that nothing moves all that motion loses is heat, in one kick of x = .3 of its drag."""
    gas = {"particles": 40, "eos": ADIABATIC}
    box = {"kind": "box", "gas_velocity": 1.7, "dust_velocity": 0.0}
    drag = {"law": "constant", "K": 3.0, "scheme": scheme}
    sim = Simulation(scene(drag, gas, ratio=1e9, initial=box))
    sim._prepare()
    before = sim.gas.u.copy()
    sim.operators.kick(0.1)
    left = 1.7 * 0.7 if scheme == "esph" else 1.7 / 1.3
    np.testing.assert_allclose(sim.gas.vel, left, rtol=1e-7)  # of dust that moves by 1e-9
    np.testing.assert_allclose(sim.gas.u - before, 0.5 * (1.7**2 - left**2), rtol=1e-6)


# Frames, order, threads


@every_scheme
def test_a_boost_changes_nothing(scheme):
    rest, kick = kicked(scheme)
    kick()
    moving, kick = kicked(scheme, given=cloud(boost=100.0))
    kick()
    for p, q in zip(both(rest), both(moving), strict=True):
        # 1e-16 of the boost and of the sums of 20 pairs.
        np.testing.assert_allclose(q.vel - 100.0, p.vel, rtol=0, atol=1e-11)


@every_scheme
def test_the_order_of_particles_does_not_matter(scheme):
    rng = np.random.default_rng(2)
    order = {"gas": rng.permutation(500), "dust": rng.permutation(400)}
    plain, kick = kicked(scheme)
    kick()
    mixed, kick = kicked(scheme, given=cloud(order=order))
    kick()
    for p, q, key in zip(both(plain), both(mixed), order, strict=True):
        # Sums in another order, and h to the tolerance of its iteration.
        np.testing.assert_allclose(q.vel, p.vel[order[key]], rtol=0, atol=1e-9)


SAME = """
import hashlib
from discsim import Simulation
from discsim.numerics import threads
from drags import OF_PARTICLES
from pairs import cloud, scene
threads.parallel_for.__kwdefaults__["least"] = 101  # as with 40 times the particles
for dimensions in (1, 2):
    given = cloud(dimensions, boundary="periodic", n=(600, 701))
    for scheme in OF_PARTICLES:
        tables = scene(
            {"law": "constant", "K": 30.0, "scheme": scheme}, 600, [{"particles": 1, "ratio": 0.5}] * 2,
            dimensions=dimensions, run={"threads": 1},
        )
        for number in (1, 3):
            tables["run"]["threads"] = number
            copies = {name: {key: value.copy() for key, value in arrays.items()} for name, arrays in given.items()}
            copies["gas"].pop("u")
            sim = Simulation(tables, particles=copies)
            for _ in range(5):
                sim.step()
            bits = b"".join(array.tobytes() for p in (sim.gas, sim.dust) for array in p.arrays().values())
            print(scheme, dimensions, hashlib.sha256(bits).hexdigest())
"""


def test_threads_do_not_change_a_bit():
    """Loops of particles and of pairs in pieces of 101 and more, five steps of every scheme."""
    done = subprocess.run(
        [sys.executable, "-c", SAME], capture_output=True, text=True, check=True,
        cwd=Path(__file__).parents[1] / "helpers",
        env={**os.environ, "NUMBA_NUM_THREADS": "3"},
    )  # fmt: skip
    found = done.stdout.splitlines()
    assert len(found) == 2 * 2 * len(OF_PARTICLES) and len(set(found)) == 2 * len(OF_PARTICLES), done.stdout


PIECES = """
import numpy as np
from discsim.kernels.drag.pairs import weight_driver
rng = np.random.default_rng(1)
offset, h, gas = rng.uniform(-1, 1, (20001, 2)), rng.uniform(0.5, 1, 500), rng.integers(0, 500, 20001).astype(np.uint32)
for kernel in (0, 1):
    weigh = weight_driver(kernel, 2, False)
    whole, cut = np.empty((2, 20001))
    weigh(0, 20001, gas, offset, h, whole)
    for k in range(23):
        weigh(20001 * k // 23, 20001 * (k + 1) // 23, gas, offset, h, cut)
    print((whole != cut).sum())
"""


def test_a_weight_is_the_same_in_any_piece():
    """Compiled for a processor whose loops are unrolled in twos, if this one has its instructions: there a weight at
    the end of a piece was rounded differently from one within.
    """
    target = {"NUMBA_CPU_NAME": "znver3", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma"}
    done = subprocess.run(
        [sys.executable, "-c", PIECES], capture_output=True, text=True, check=True,
        env={**os.environ, **(target if "+fma" in get_host_cpu_features() else {})},
    )  # fmt: skip
    assert done.stdout.split() == ["0", "0"]


# Steps


@every_scheme
@pytest.mark.parametrize("direction", ["two-way", "one-way"])
def test_only_explicit_two_way_drag_limits_the_step(scheme, direction):
    """t_stop = .01 and eps = 2: the gas's rate is eps / t_stop."""
    drag = {"law": "stopping-time", "t_stop": 0.01, "scheme": scheme, "direction": direction}
    sim = Simulation(scene(drag, ratio=2.0, initial={"kind": "box"}))
    sim._prepare()
    limit = longest_step_of(sim, "drag")
    if scheme in ("mk", "esph") and direction == "two-way":
        # The density of a lattice whose h is no whole number of spacings is right to 2%.
        assert limit == pytest.approx(0.005, rel=0.02)
    else:
        assert limit == np.inf


@pytest.mark.parametrize("scheme", ["mk", "esph"])
def test_explicit_steps_are_stable_up_to_the_limit(scheme):
    """Random velocities die away at the whole limit; in a box, eps = 1, a slip grows at twice and a half of it."""
    sim, _ = kicked(scheme)
    limit, before = longest_step_of(sim, "drag"), motion(sim)
    for _ in range(30):
        sim.operators.kick(limit)
        assert motion(sim) < before
        before = motion(sim)
    box = {"kind": "box", "gas_velocity": 1.0, "dust_velocity": -1.0}
    sim = Simulation(scene({"law": "stopping-time", "t_stop": 0.1, "scheme": scheme}, initial=box))
    sim._prepare()
    sim.operators.kick(2.5 * longest_step_of(sim, "drag"))
    assert motion(sim) > 2.0


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_longest_step_of_mk_swaps_a_pair(dimensions):
    """A grain and gas of the same mass, alone: in a step of the limit their slip changes its sign, and never grows."""
    place = np.zeros((1, dimensions))
    given = {name: {"pos": place.copy(), "vel": place.copy(), "mass": np.ones(1)} for name in ("gas", "dust")}
    given["dust"]["pos"][0, 0], given["dust"]["vel"][0, 0] = 0.05, 1.0
    law = {"law": "stopping-time", "t_stop": 0.1, "scheme": "mk"}
    sim = Simulation(scene(law, 1, 1, dimensions=dimensions, boundary="open"), particles=given)
    sim._prepare()
    sim.operators.kick(longest_step_of(sim, "drag"))
    # But for what keeps r r / (r^2 + .001 h^2) finite, .6% of it at h = 1/8.
    assert sim.dust.vel[0, 0] - sim.gas.vel[0, 0] == pytest.approx(-1.0, abs=0.02)


@every_scheme
def test_one_way_dust_follows_at_long_steps(scheme):
    """Seven steps of 3 t_stop: stable, and the slip is gone; of an explicit scheme in short steps within the kick."""
    box = {"kind": "box", "gas_velocity": 0.3, "dust_velocity": -1.0}
    drag = {"law": "stopping-time", "t_stop": 0.01, "scheme": scheme, "direction": "one-way"}
    sim = Simulation(scene(drag, initial=box, run={"timestep": 0.03}))
    sim.run(0.21)
    np.testing.assert_allclose(sim.gas.vel, 0.3, atol=1e-13)
    # isph leaves most: (1 + 1.5)^-2 (1 + 3)^-6 = 4e-5 of a slip of 1.3.
    np.testing.assert_allclose(sim.dust.vel, 0.3, atol=1e-4)
