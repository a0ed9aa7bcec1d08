"""Drag between pairs of particles and towards interpolated velocities: exactness, conservation, waves."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from drags import BETWEEN_PAIRS, INTERPOLATING
from pairs import ISOTHERMAL, both, cloud, kicked, scene

from discsim import Simulation
from discsim.drag.dust_density import h_at_density
from discsim.drag.published.pairs import find_pairs
from discsim.exact import dustybox, dustywave
from discsim.kernels.drag.pairs import hump_norm, limited_slope, removed_fractions
from discsim.kernels.sph.smoothing import KERNELS, NORM, SUPPORT, shape

SCHEMES = (*BETWEEN_PAIRS, *INTERPOLATING)
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}
every_scheme = pytest.mark.parametrize("scheme", SCHEMES)
every_pair = pytest.mark.parametrize("scheme", BETWEEN_PAIRS)


# Pairs


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_pairs_are_all_within_the_support_of_the_gas(dimensions, boundary):
    """Against every distance between 500 and 400 particles, through the edges of a periodic box."""
    sim, _ = kicked("lab14", given=cloud(dimensions, boundary=boundary), boundary=boundary)
    found = find_pairs(*sim.effects["drag"].engine.arguments(sim.state), whole=True)
    assert len(found) == 2
    for pairs in found:
        away = pairs.particles.pos[:, None] - sim.gas.pos[None]
        if boundary == "periodic":
            away -= np.round(away)
        near = np.sqrt((away**2).sum(axis=2)) < SUPPORT[KERNELS["cubic"]] * sim.gas.h
        listed = np.zeros_like(near)
        listed[pairs.dust, pairs.gas] = True
        assert len(pairs.gas) == near.sum() > 400
        np.testing.assert_array_equal(listed, near)
        np.testing.assert_allclose(pairs.offset, away[pairs.dust, pairs.gas], atol=1e-15)
        # Parts of a particle's drag sum to one.
        np.testing.assert_allclose(np.bincount(pairs.dust, pairs.part), 1.0, rtol=1e-13)


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("kernel", KERNELS.values())
def test_double_hump_is_a_kernel(kernel, dimensions):
    """sigma' q^2 w integrates to one."""
    q = (np.arange(20000) + 0.5) / 20000 * SUPPORT[kernel]
    w = np.array([shape.py_func(kernel, dimensions, x)[0] for x in q])
    volume = 2.0 if dimensions == 1 else 2.0 * np.pi * q
    sigma = NORM[dimensions - 1][kernel] * hump_norm(kernel, dimensions)
    assert (sigma * q**2 * w * volume).sum() * SUPPORT[kernel] / 20000 == pytest.approx(1.0, rel=1e-7)


# DustyBox


def box_error(scheme, steps, offset=0.5, ratio=0.3, size=1.0, slowed=1.0, **drag):
    """Largest error of the velocities, of `size`, after two t_stop with accelerations; h is two spacings."""
    box = {"kind": "box", "gas_velocity": 0.3 * size, "dust_velocity": -1.0 * size}
    law = {"law": "stopping-time", "t_stop": 0.1, "scheme": scheme} | drag
    gas = {"particles": 40, "smoothing_length": 0.05, "eos": ISOTHERMAL}
    dust = {"particles": 40, "ratio": ratio, "offset": offset}
    forces = {"external": {"gas": 0.7 * size, "dust": -0.4 * size}}
    sim = Simulation(scene(law, gas, dust, initial=box, run={"timestep": 0.2 / steps}, **forces))
    sim.run(0.2)
    exact = dustybox.velocities(0.2, 0.3, -1.0, 1.0, ratio, ratio / (0.1 * slowed), 0.7, -0.4)
    return max(np.abs(p.vel / size - v).max() for p, v in zip(both(sim), exact, strict=True))


@pytest.mark.parametrize("kernel", ["gas", "double-hump"])
@pytest.mark.parametrize("offset", [0.0, 0.5])
@pytest.mark.parametrize("scheme", ["lab14", "reconstructed"])
def test_relaxing_pairs_are_exact_in_a_box(scheme, offset, kernel):
    """Accelerations inside the relaxation: exact at any step, to rounding."""
    for steps in (1, 3):
        assert box_error(scheme, steps, offset, kernel=kernel) < 1e-12


def unclipped(h=0.05, spacing=0.025):
    """Share of the drag that eta^2 = .001 h^2 leaves: sum V W r^2 / (r^2 + eta^2) over a lattice off by half."""
    r = (np.arange(-10, 10) + 0.5) * spacing
    w = np.array([shape.py_func(KERNELS["cubic"], 1, min(abs(x) / h, 2.0))[0] for x in r]) * 2 / 3 / h
    return (spacing * w * r**2 / (r**2 + 1e-3 * h**2)).sum()


@pytest.mark.parametrize("scheme", ["mk", "esph", "isph"])
def test_first_order_in_a_box(scheme):
    """Velocities of 1e-6, so that pairs stay as they are: what is clipped of their drag depends on r."""
    slowed = 1.0 / unclipped() if scheme == "mk" else 1.0
    errors = [box_error(scheme, steps, size=1e-6, slowed=slowed) for steps in (40, 80, 160)]
    for one, next_one in itertools.pairwise(errors):
        assert one / next_one == pytest.approx(2.0, rel=0.05)  # next order: x = .05, .025, .0125
    assert errors[-1] < 0.01


@pytest.mark.parametrize(("scheme", "x"), [("isph", 0.5), ("isph", 30.0), ("esph", 0.5)])
def test_a_kick_towards_interpolated_velocities(scheme, x):
    """In a box, where an interpolated velocity is the velocity: the formulas of the two schemes, to rounding.

    Without the accelerations inside of isph waves travel too slowly: an error of .30 in place of .013.
    """
    box = {"kind": "box", "gas_velocity": 0.3, "dust_velocity": -1.0}
    drag = {"law": "stopping-time", "t_stop": 0.1, "scheme": scheme}
    gas = {"particles": 40, "smoothing_length": 0.05, "eos": ISOTHERMAL}
    sim = Simulation(scene(drag, gas, ratio=0.5, initial=box, external={"gas": 0.7, "dust": -0.4}))
    sim._prepare()
    dt = 0.1 * x
    sim.operators.kick(dt)
    v, u, gas_x = 0.3, -1.0, 0.5 * x
    if scheme == "isph":
        v, u = v + 0.7 * dt, u - 0.4 * dt
        v, u = (v + gas_x * u) / (1 + gas_x), (u + x * v) / (1 + x)
    else:
        v, u = v + 0.7 * dt + gas_x * (u - v), u - 0.4 * dt + x * (v - u)
    np.testing.assert_allclose(sim.gas.vel, v, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.dust.vel, u, rtol=0, atol=1e-12)


def test_lines_of_sight_add_up_to_the_whole_drag_in_two_dimensions():
    """d times what is along a line, over the pairs of a grain of mk: of even gas and dust on lattices half a spacing
    apart all of 1 / t_stop, but for r^2 / (r^2 + eta^2), whichever way the dust moves.
    """
    n, dt, time, slip = 16, 1e-3, 0.2, np.array([1.0, -2.0])
    x = np.stack(np.meshgrid((np.arange(n) + 0.25) / n, (np.arange(n) + 0.25) / n), axis=-1).reshape(-1, 2)
    mass = np.full(n * n, 1.0 / n**2)
    given = {"gas": {"pos": x, "vel": np.zeros((n * n, 2)), "mass": mass},
             "dust": {"pos": x + 0.5 / n, "vel": np.tile(slip, (n * n, 1)), "mass": 0.3 * mass}}  # fmt: skip
    drag = {"law": "stopping-time", "t_stop": time, "scheme": "mk"}
    sim = Simulation(scene(drag, n * n, n * n, 0.3, dimensions=2), particles=given)
    sim._prepare()
    h = sim.gas.h[0]
    away = np.stack(np.meshgrid(*[(np.arange(-6, 6) + 0.5) / n] * 2), axis=-1).reshape(-1, 2)
    r2 = (away**2).sum(axis=1)
    weight = np.array([shape.py_func(KERNELS["cubic"], 2, min(np.sqrt(d) / h, 2.0))[0] for d in r2])
    weight *= NORM[1][KERNELS["cubic"]] / h**2 / n**2 / sim.gas.density[0]
    share = (weight * r2 / (r2 + 1e-3 * h**2)).sum()
    assert 0.9 < share < 1.0
    sim.operators.kick(dt)
    np.testing.assert_allclose(sim.dust.vel, np.tile(slip * (1.0 - share * dt / time), (n * n, 1)), rtol=1e-9)
    np.testing.assert_allclose(sim.gas.vel.mean(axis=0), 0.3 * share * dt / time * slip, rtol=1e-9)


@every_scheme
def test_dust_without_gas_is_free_and_told(scheme):
    """Gas in one corner: the dust far from it keeps its velocity, and half the mass is uncoupled."""
    given = cloud()
    far = np.arange(400) % 2 == 0
    given["dust"]["mass"][:] = 1 / 400
    given["dust"]["pos"][:] = np.where(far[:, None], 0.45, 0.0) + 0.05 * given["dust"]["pos"]
    given["gas"]["pos"] = 0.1 * given["gas"]["pos"]
    start = given["dust"]["vel"].copy()
    sim, kick = kicked(scheme, given=given)
    kick()
    drag = sim.effects["drag"]
    assert (drag.stopping_times[far] == np.inf).all() and np.isfinite(drag.stopping_times[~far]).all()
    np.testing.assert_array_equal(sim.dust.vel[far], start[far])
    assert (sim.dust.vel[~far] != start[~far]).all()
    assert drag.uncoupled == pytest.approx(0.5)


# Linear fields


@pytest.mark.parametrize(
    ("slopes", "expected"), [((1, 2), 1.5), ((1, 9), 2.0), ((-3, -1), -2.0), ((-1, 2), 0.0), ((0, 2), 0.0)]
)
def test_limiter(slopes, expected):
    """The mean of two slopes, at most twice either, and none where they are of opposite signs."""
    assert limited_slope.py_func(*slopes) == limited_slope.py_func(*slopes[::-1]) == expected


def linear(pos):
    """Compression, shear and rotation together."""
    return pos @ np.array([[-1.0, 0.4], [2.0, 0.7]])


@pytest.mark.parametrize(("scheme", "bound"), [("reconstructed", 1e-12), ("lab14", None)])
def test_reconstruction_leaves_a_common_linear_field(scheme, bound):
    """Gas and dust that move alike have no drag: what lab14 damps is exactly none."""
    sim, kick = kicked(scheme, given=cloud(field=linear))
    kick()
    change = max(np.abs(p.vel - linear(p.pos)).max() for p in both(sim))
    assert change < bound if bound else change > 0.01


# DustyWave


def wave(scheme, h, kernel="cubic", boost=0.0, coefficient=500.0, **run):
    """The simulation at t = .5, and errors of gas and dust, rms over particles / max |exact|."""
    gas = {"particles": 600, "smoothing_length": h, "kernel": kernel, "eos": ISOTHERMAL}
    law = {"law": "constant", "K": coefficient, "scheme": scheme}
    sim = Simulation(scene(law, gas, 600, initial={"kind": "wave", "velocity": boost}, run=run))
    sim.run(0.5)
    errors = []
    for p, name in zip(both(sim), ("gas_velocity", "dust_velocity"), strict=True):
        exact = getattr(dustywave.solution(p.pos[:, 0], 0.5, coefficient, 1.0, boost=boost), name)
        errors.append(np.sqrt(((p.vel[:, 0] - exact) ** 2).mean()) / np.abs(exact - boost).max())
    return sim, errors


DAMPED = {
    "lab14": {0.025: 0.0365, 0.01: 0.0137}, "isph": {0.025: 0.0434, 0.01: 0.0134},
    "reconstructed": {0.025: 0.0017, 0.01: 0.0002},
    "mk": {0.025: 0.217, 0.01: 0.0418}, "esph": {0.025: 0.217, 0.01: 0.0418},
}  # fmt: skip


def slow_wave(scheme, h, boost):
    """Whether steps are many, or what a boost does not change is shown at another h."""
    return scheme in ("mk", "esph") or (h == 0.01 and boost > 0.0)


@pytest.mark.parametrize(
    ("scheme", "h", "expected", "boost"),
    [
        pytest.param(scheme, h, expected, boost, marks=[pytest.mark.slow] * slow_wave(scheme, h, boost))
        for scheme, row in DAMPED.items()
        for h, expected in row.items()
        for boost in (0.0, 1.0)
    ],
)
def test_waves_are_damped_each_step(scheme, h, expected, boost):
    """At the steps that the drag allows: k^2 h^2 a step for lab14 and isph, next to none when reconstructed."""
    _, errors = wave(scheme, h, boost=boost)
    assert max(errors) == pytest.approx(expected, rel=0.1, abs=5e-5)  # of the measured figure


def smoothed_error(sim, h, kernel):
    """arXiv:1811.06506, eq. (38): L2 of the SPH interpolant of the dust's velocity at 600 nodes, over max |exact|."""
    code, x = KERNELS[kernel], (np.arange(600) + 0.5) / 600
    away = x[:, None] - sim.dust.pos[None, :, 0]
    away -= np.round(away)
    near = np.abs(away) < SUPPORT[code] * h
    weight = np.zeros_like(away)
    weight[near] = [NORM[0][code] / h * shape.py_func(code, 1, q)[0] for q in np.abs(away[near]) / h]
    found = weight @ (sim.dust.vel[:, 0] * sim.dust.mass)  # the density is 1 to 1e-4
    exact = dustywave.solution(x, 0.5, 500.0, 1.0).dust_velocity
    return np.sqrt(((found - exact) ** 2).mean()) / np.abs(exact).max()


PUBLISHED = {
    "cubic": {0.01: 0.0395, 0.025: 0.217},
    "quintic-h": {0.01: 0.0056, 0.025: 0.0409},
    "quintic": {0.01: 0.0594, 0.025: 0.297},
}


@pytest.mark.parametrize(
    ("scheme", "h", "expected"),
    [
        ("lab14", 0.025, 0.148), ("lab14", 0.01, 0.0241), ("isph", 0.025, 0.1532), ("isph", 0.01, 0.0241),
        ("reconstructed", 0.025, 0.0035), ("reconstructed", 0.01, 0.003),
        ("esph", 0.025, 0.2173), ("esph", 0.01, 0.0391),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_the_other_schemes_where_mk_is_published(scheme, h, expected):
    """The same run, as measured; what reconstruction leaves at h = .01 is forward Euler's own, as with tsc."""
    sim, _ = wave(scheme, h, integrator="euler", timestep=0.001)
    assert smoothed_error(sim, h, "cubic") == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("kernel", "h"),
    [
        pytest.param(kernel, h, marks=[] if (kernel, h) == ("cubic", 0.01) else pytest.mark.slow)
        for kernel, row in PUBLISHED.items()
        for h in row
    ],
)
def test_published_damping_of_mk(kernel, h):
    """arXiv:1811.06506, table 3: forward Euler, tau = .001, to half a unit of the last published digit and 1%."""
    sim, _ = wave("mk", h, kernel, integrator="euler", timestep=0.001)
    assert smoothed_error(sim, h, kernel) == pytest.approx(PUBLISHED[kernel][h], rel=0.01, abs=5e-5)


def test_dust_on_gas_has_less_drag_with_mk():
    """The pair at one place has no line of sight: at h = .02, W(0) / 600 = 5.6% of the drag is not there."""
    _, errors = wave("mk", 0.02, coefficient=5.0)
    _, other = wave("esph", 0.02, coefficient=5.0)
    assert errors[1] > 0.04 and max(other) < 0.01


def oblique(scheme, along=32, until=0.1):
    """Error of an oblique wave in two dimensions, K = 500, h = 1.44 spacings: rms over particles / max |exact|."""
    gas = {"particles": along**2, "kernel": "quintic", "smoothing_length": 1.44 / along, "eos": ISOTHERMAL}
    law = {"law": "constant", "K": 500.0, "scheme": scheme}
    start = {"kind": "wave", "direction": [1, 1]}
    sim = Simulation(scene(law, gas, along**2, dimensions=2, initial=start, run={"until": until}))
    sim.run()
    unit, worst = np.sqrt([0.5, 0.5]), 0.0
    for p, name in zip(both(sim), ("gas_velocity", "dust_velocity"), strict=True):
        exact = getattr(dustywave.solution(p.pos @ unit, until, 500.0, 1.0, wavenumber=np.sqrt(2)), name)
        rest = p.vel - np.outer(exact, unit)
        worst = max(worst, np.sqrt((rest**2).sum(axis=1).mean()) / np.abs(exact).max())
    return worst


@pytest.mark.parametrize(
    ("scheme", "expected"),
    [
        ("lab14", 0.156), ("reconstructed", 0.0212), ("isph", 0.176), ("esph", 0.59),
        pytest.param("mk", 0.65, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_oblique_wave(scheme, expected):
    """Damping across a lattice, as measured: k^2 h^2 = .16 a step for lab14, a tenth of that when reconstructed."""
    assert oblique(scheme) == pytest.approx(expected, rel=0.1)


def test_oblique_wave_of_mk():
    """A few steps: as esph, whose damping is that of the same pairs, but for the pair at one place."""
    assert oblique("mk", 16, 0.02) == pytest.approx(oblique("esph", 16, 0.02), rel=0.3)


def test_pairs_take_most_in_the_direction_of_the_largest_eigenvalue():
    """numpy's eigenvalue of sum c r^ r^T / m over the pairs of each particle; one pair has no line of sight."""
    rng = np.random.default_rng(6)
    begin, pull, mass = np.array([0, 1, 3, 20]), rng.uniform(0.2, 3.0, 20), np.array([0.7, 1.9, 0.4])
    offset = rng.normal(size=(20, 2)) * [2.0, 0.5]
    offset[2] = 0.0
    found = np.empty(3)
    removed_fractions(0, 3, begin, np.empty(0, np.uint32), offset, pull, mass, found)
    for i, (first, last) in enumerate(itertools.pairwise(begin)):
        r2 = (offset**2).sum(axis=1)
        each = [np.eye(2) if r2[k] == 0.0 else np.outer(offset[k], offset[k]) / r2[k] for k in range(first, last)]
        most = np.linalg.eigvalsh(np.tensordot(pull[first:last], each, 1))[-1] / mass[i]
        assert found[i] == pytest.approx(most, rel=1e-13)  # rounding of 17 terms


def test_dust_in_gas_of_next_to_no_density_reaches_as_far_as_it_may():
    """As in gas that a huge sound speed has blown apart."""
    sph = SimpleNamespace(eta=1.2, dim=2, h_most=3.0)
    cloud = SimpleNamespace(sph=sph, mass=np.array([1.0, 1.0, 1.0]))
    np.testing.assert_allclose(h_at_density(cloud, np.array([0.0, 1e-310, 4.0])), [3.0, 3.0, 0.6])
