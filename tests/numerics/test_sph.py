"""The SPH sums against direct sums over all particles and images, and what they conserve."""

import itertools
import math
import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import quad

from discsim import Simulation
from discsim.kernels.smoothing import KERNELS, NORM, SUPPORT, bend, shape

KERNEL_NAMES = tuple(KERNELS)


def w(kernel, dim, q):
    """w and dw/dq of the code's formula at an array of q."""
    flat = [shape.py_func(KERNELS[kernel], dim, min(x, SUPPORT[KERNELS[kernel]])) for x in q.ravel()]
    return np.array([a for a, _ in flat]).reshape(q.shape), np.array([b for _, b in flat]).reshape(q.shape)


def simulation(pos, dim, boundary, kernel="cubic", mass=None, vel=None, u=None, eos=None, cs=1.0, **gas):
    """A simulation of the given gas alone, its forces made."""
    n = len(pos)
    gas.setdefault("eos", eos or {"kind": "isothermal", "sound_speed": cs})
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"dimensions": dim, "size": 1.0, "boundary": boundary},
        "gas": {"particles": n, "kernel": kernel, **gas},
    }
    given = {
        "pos": pos,
        "vel": np.zeros((n, dim)) if vel is None else vel,
        "mass": np.full(n, 1.0 / n) if mass is None else mass,
    }
    if u is not None:
        given["u"] = u
    sim = Simulation(scene, particles={"gas": given})
    with sim.synchronised():
        return sim


def uneven(n, dim, seed=1):
    """Positions in the unit box, half of them in a clump of a hundredth of its size, and unequal masses."""
    rng = np.random.default_rng(seed)
    pos = rng.random((n, dim))
    pos[: n // 2] = (0.97 + 0.01 * rng.normal(size=(n // 2, dim))) % 1.0  # across the periodic edge
    return pos, rng.uniform(0.5, 2.0, n) / n


def separations(pos, periodic, images):
    """x_i - x_j - shift for all pairs and images (i, j, image, d)."""
    dim = pos.shape[1]
    span = range(-images, images + 1) if periodic else (0,)
    shifts = np.array(list(itertools.product(span, repeat=dim)), float)
    return pos[:, None, None] - pos[None, :, None] - shifts


def direct_density(pos, mass, h, kernel, periodic, images=2):
    """rho and Omega of eqs. (1, 2) by sums over everything."""
    dim = pos.shape[1]
    r = np.sqrt((separations(pos, periodic, images) ** 2).sum(axis=-1))
    q = r / h[:, None, None]
    value, slope = w(kernel, dim, q)
    norm = NORM[dim - 1][KERNELS[kernel]] / h**dim
    rho = norm * (value.sum(axis=2) @ mass)
    drho = -norm / h * ((dim * value + q * slope).sum(axis=2) @ mass)
    return rho, 1.0 + h / (dim * rho) * drho


def direct_force(gas, kernel, periodic, images=2):
    """Eq. (3) by sums over everything."""
    pos, h = gas.pos, gas.h
    dim = pos.shape[1]
    d = separations(pos, periodic, images)
    r = np.sqrt((d**2).sum(axis=-1))
    norm = NORM[dim - 1][KERNELS[kernel]] / h ** (dim + 1)
    own = norm[:, None, None] * w(kernel, dim, r / h[:, None, None])[1]
    other = norm[None, :, None] * w(kernel, dim, r / h[None, :, None])[1]
    press = gas.pressure / (gas.gradh * gas.density**2)
    pull = gas.mass[None, :, None] * (press[:, None, None] * own + press[None, :, None] * other)
    with np.errstate(invalid="ignore"):
        direction = np.where(r[..., None] > 0, d / r[..., None], 0.0)
    return -(pull[..., None] * direction).sum(axis=(1, 2))


# The formulas


@pytest.mark.parametrize("kernel", KERNEL_NAMES)
@pytest.mark.parametrize("dim", [1, 2])
def test_kernel_is_normalised(kernel, dim):
    number = KERNELS[kernel]
    measure = (lambda q: 2.0) if dim == 1 else (lambda q: 2.0 * math.pi * q)
    knots = [k * SUPPORT[number] / 6 for k in range(1, 6)]
    total, _ = quad(
        lambda q: measure(q) * shape.py_func(number, dim, q)[0], 0, SUPPORT[number], points=knots, epsabs=1e-13
    )
    # Polynomials between the knots: the quadrature is exact to rounding.
    assert NORM[dim - 1][number] * total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("kernel", KERNEL_NAMES)
@pytest.mark.parametrize("dim", [1, 2])
def test_kernel_slope_is_its_derivative(kernel, dim):
    number, step = KERNELS[kernel], 1e-5
    q = np.linspace(0.01, 0.999, 137) * SUPPORT[number]
    value = [w(kernel, dim, q + s * step)[0] for s in (1, -1)]
    slope = w(kernel, dim, q)[1]
    # Centred differences err by step^2 w'''/6 with w''' up to 60 times the slope's largest value.
    np.testing.assert_allclose((value[0] - value[1]) / (2 * step), slope, atol=1e-8 * np.abs(slope).max())
    assert w(kernel, dim, np.array([SUPPORT[number]]))[0] == 0.0
    slopes = [w(kernel, dim, q + s * step)[1] for s in (1, -1)]
    second = np.array([bend.py_func(number, dim, x) for x in q])
    # At a knot of the cubic its third derivative jumps: the difference errs by step times that.
    np.testing.assert_allclose((slopes[0] - slopes[1]) / (2 * step), second, atol=1e-4 * np.abs(second).max())


# Density and forces against direct sums

CASES = [("cubic", 1, "periodic"), ("wendland-c4", 2, "periodic"), ("cubic", 2, "open")]


@pytest.mark.parametrize(("kernel", "dim", "boundary"), CASES)
def test_density_and_force_equal_direct_sums(kernel, dim, boundary):
    pos, mass = uneven(120, dim)
    pos = pos if boundary == "periodic" else 0.3 * pos  # h stays below its cap
    sim = simulation(pos, dim, boundary, kernel, mass)
    gas, eta = sim.gas, sim.scene.gas.eta
    rho, omega = direct_density(gas.pos, gas.mass, gas.h, kernel, boundary == "periodic")
    solved = gas.h < sim.effects["gas"].sph.h_most * (1 - 1e-9)
    assert solved.mean() > 0.7 and gas.h.max() > 20 * gas.h.min()
    # The last step is below 4e-3 h; what it leaves is some times its cube.
    np.testing.assert_allclose(gas.density, rho, rtol=5e-6)
    np.testing.assert_allclose((gas.h / (eta * (gas.mass / rho) ** (1 / dim)))[solved], 1.0, rtol=5e-6)
    # Omega is taken along by its series, which is one order less than that of h.
    np.testing.assert_allclose(gas.gradh[solved], omega[solved], rtol=1e-2)
    acc = direct_force(gas, kernel, boundary == "periodic")
    np.testing.assert_allclose(gas.acc, acc, atol=1e-12 * np.abs(acc).max())


@pytest.mark.parametrize(("kernel", "dim"), [("cubic", 1), ("wendland-c4", 2)])
def test_support_over_many_images(kernel, dim):
    """h of 1.3 boxes: the support reaches over five boxes, where each particle meets its own images too."""
    pos = np.random.default_rng(2).random((12, dim))
    gas = simulation(pos, dim, "periodic", kernel, smoothing_length=1.3).gas
    rho, _ = direct_density(gas.pos, gas.mass, gas.h, kernel, True, images=4)
    np.testing.assert_allclose(gas.density, rho, rtol=1e-12)
    # The forces of images nearly cancel: compared with the largest one of a pair, P/rho^2 m dW.
    acc = direct_force(gas, kernel, True, images=4)
    np.testing.assert_allclose(gas.acc, acc, atol=1e-13)


@pytest.mark.parametrize("dim", [1, 2])
def test_lone_particles_are_capped(dim):
    """Without neighbours no h solves eq. (1): it stops at its cap, and the density is the particle's own."""
    pos = np.full((2, dim), 0.1)
    pos[1] = 0.9
    sim = simulation(pos, dim, "open")
    h = sim.effects["gas"].sph.h_most
    assert h == 0.125
    np.testing.assert_allclose(sim.gas.h, h, rtol=1e-12)
    rho, _ = direct_density(sim.gas.pos, sim.gas.mass, sim.gas.h, "cubic", False)
    np.testing.assert_allclose(sim.gas.density, rho, rtol=1e-12)


def test_h_does_not_depend_on_its_first_guess():
    pos, mass = uneven(120, 2)
    sims = [simulation(pos, 2, "periodic", "wendland-c4", mass) for _ in range(2)]
    for factor in (0.03, 20.0):
        sims[1].gas.h *= factor
        sims[1].effects["gas"].accelerate(sims[1].state)
        # Both are solved to some times the cube of the last step, 4e-3.
        np.testing.assert_allclose(sims[1].gas.h, sims[0].gas.h, rtol=5e-6)


# What the sums conserve

ALL = {
    "eos": {"kind": "adiabatic", "gamma": 1.4},
    "viscosity": {"alpha": 1.0, "beta": 2.0, "switch": "balsara"},
    "conductivity": {"alpha": 1.0},
}


def lively(boundary, **changes):
    """Uneven gas of random velocities and energies, with every term of eqs. (3-5)."""
    pos, mass = uneven(150, 2)
    rng = np.random.default_rng(3)
    given = {"vel": rng.normal(size=(150, 2)), "u": rng.uniform(0.5, 2.0, 150)} | changes
    return simulation(given.pop("pos", pos), 2, boundary, "cubic", given.pop("mass", mass), **given, **ALL)


@pytest.mark.parametrize("boundary", ["open", "periodic"])
def test_momentum_and_energy(boundary):
    gas = lively(boundary).gas
    force = gas.mass[:, None] * gas.acc
    # Pairs cancel to the rounding of the largest forces.
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).sum()
    work = (force * gas.vel).sum(axis=1)
    heating = gas.mass * gas.heating_rate
    assert abs(work.sum() + heating.sum()) < 1e-13 * (np.abs(work) + np.abs(heating)).sum()


def test_angular_momentum():
    gas = lively("open").gas
    force = gas.mass[:, None] * gas.acc
    torque = gas.pos[:, 0] * force[:, 1] - gas.pos[:, 1] * force[:, 0]
    assert abs(torque.sum()) < 1e-13 * np.abs(torque).sum()


def test_rotation_boost_and_order():
    """Turned by an angle, seen from a moving frame and stored in another order, it is the same gas."""
    gas = lively("open").gas
    rng = np.random.default_rng(5)
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    order = rng.permutation(150)
    pos, mass = uneven(150, 2)
    start = lively("open", pos=pos)
    vel, u = start.gas.vel, start.gas.u
    scale, rate = np.abs(gas.acc).max(), np.abs(gas.heating_rate).max()
    # The solution for h stops a step earlier or later: Omega, and with it the force, may differ by up to 1e-4.
    cases = {
        "turned": (lively("open", pos=pos @ turn, vel=vel @ turn), gas.acc @ turn, slice(None)),
        "boosted": (lively("open", vel=vel + np.array([3.0, -2.0])), gas.acc, slice(None)),
        "reordered": (lively("open", pos=pos[order], vel=vel[order], u=u[order], mass=mass[order]), gas.acc, order),
    }
    for name, (other, acc, index) in cases.items():
        np.testing.assert_allclose(other.gas.acc, acc[index], atol=1e-4 * scale, err_msg=name)
        np.testing.assert_allclose(other.gas.heating_rate, gas.heating_rate[index], atol=1e-4 * rate, err_msg=name)


def test_viscosity_acts_on_approach_only():
    """A pair that separates feels nothing; one that approaches is decelerated and heated."""
    pos = np.array([[0.45, 0.5], [0.55, 0.5]])
    for speed in (1.0, -1.0):
        vel = np.array([[speed, 0.0], [-speed, 0.0]])
        sim = simulation(pos, 2, "open", vel=vel, viscosity={"switch": "none"})
        push = sim.effects["gas"].viscous_acceleration(sim.state)[:, 0]
        assert push[0] < 0 < push[1] if speed > 0 else (push == 0).all()


@pytest.mark.parametrize(("alpha", "beta"), [(0.7, 0.0), (0.0, 1.9), (1.0, 2.0)])
def test_viscosity_of_a_pair(alpha, beta):
    """dv/dt = -m (-alpha c w + beta w^2) / rho dW/dr, eq. (5), of two that approach at w = -1.2, c = 0.5."""
    h, distance, speed = 0.1, 0.08, 1.2
    vel = np.array([[0.5 * speed], [-0.5 * speed]])
    viscosity = {"alpha": alpha, "beta": beta, "switch": "none"}
    pos = np.array([[0.5], [0.5 + distance]])
    sim = simulation(pos, 1, "periodic", vel=vel, cs=0.5, smoothing_length=h, viscosity=viscosity)
    value, slope = w("cubic", 1, np.array([0.0, distance / h]))
    rho = 0.5 * 2 / (3 * h) * value.sum()
    push = 0.5 * (alpha * 0.5 * speed + beta * speed**2) / rho * 2 / (3 * h**2) * slope[1]
    found = sim.effects["gas"].viscous_acceleration(sim.state)
    np.testing.assert_allclose(found[:, 0], [push, -push], rtol=1e-12)  # a sum of one


def lattice(n):
    x = (np.arange(n) + 0.5) / n
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)


ALONE = """
import importlib
from numba.core.registry import CPUDispatcher
from discsim import Simulation
Simulation({
    "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "box"}, "gas": {"particles": 16, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
}).step()
modules = [importlib.import_module(f"discsim.kernels.{name}") for name in ("smoothing", "sph", "sph_density")]
found = [entry for module in modules for entry in vars(module).values() if isinstance(entry, CPUDispatcher)]
inlined = [entry for entry in found if entry.targetoptions.get("inline") == "always"]
print(len(inlined) > 9, [entry for entry in inlined if entry.signatures])
"""


def test_what_sums_inline_is_never_compiled_alone():
    """No cache has it: each process would compile it anew, and start one beside it that compiles ahead."""
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
    assert done.stdout.split(maxsplit=1) == ["True", "[]\n"]


def test_balsara_switches_off_in_shear_alone():
    """A shear across the box loses its viscosity; a compression keeps it."""
    pos = lattice(24)
    wave = np.sin(2 * np.pi * pos[:, 1])
    pushes = {}
    for flow, vel in {
        "shear": np.stack([wave, 0 * wave], axis=1),
        "compression": np.stack([0 * wave, wave], axis=1),
    }.items():
        for switch in ("none", "balsara"):
            sim = simulation(pos, 2, "periodic", vel=vel, viscosity={"switch": switch}, cs=0.01)
            pushes[flow, switch] = np.abs(sim.effects["gas"].viscous_acceleration(sim.state)).max()
    # On a lattice the shear's divergence is rounding; in the compression |div| >> 1e-4 c/h at all but the nodes.
    assert pushes["shear", "none"] > 0.03 * pushes["compression", "none"]
    assert pushes["shear", "balsara"] < 1e-10 * pushes["shear", "none"]
    assert pushes["compression", "balsara"] == pytest.approx(pushes["compression", "none"], rel=1e-3)


@pytest.mark.parametrize("rate", [(1.0, -0.3, 2.0, 0.5), (0.2, 1.0, 1.0, 0.0), (0.2, -1.0, 1.0, 0.0)])
def test_balsara_tells_rotation_from_strain(rate):
    """|div v| and |curl v| of a linear flow, v_x = a x + b y and v_y = c x + d y: |a + d| and |c - b|."""
    a, b, c, d = rate
    pos = lattice(16)
    x, y = pos.T - 0.5
    vel = np.stack([a * x + b * y, c * x + d * y], axis=1)
    sim = simulation(pos, 2, "open", vel=vel, viscosity={"switch": "balsara"})
    middle = np.abs(sim.gas.pos - 0.5).max(axis=1) < 0.2  # whose neighbours are all there
    for found, expected in zip(sim.effects["gas"].sph.shear, (abs(a + d), abs(c - b)), strict=True):
        np.testing.assert_allclose(found[middle], expected, atol=0.05)  # the sums of a lattice are off by some percent


def test_viscosity_of_all_pairs_makes_no_pressure():
    """In a shear half of the pairs approach: they alone brake half as much, and push from where the shear is strong."""
    pos = lattice(24)
    wave = np.sin(2 * np.pi * pos[:, 1])
    push = {}
    for pairs in ("approaching", "all"):
        viscosity = {"alpha": 1.0, "beta": 0.0, "pairs": pairs}
        vel = np.stack([0.01 * wave, 0 * wave], axis=1)
        sim = simulation(pos, 2, "periodic", "wendland-c4", vel=vel, viscosity=viscosity)
        acc = sim.effects["gas"].viscous_acceleration(sim.state)
        push[pairs] = acc[np.argsort(sim.gas.ids)]
    along = {pairs: (acc[:, 0] * wave).mean() for pairs, acc in push.items()}
    assert along["all"] < 0
    assert along["approaching"] == pytest.approx(0.5 * along["all"], rel=1e-10)
    # Across: the gradient of that pressure, and rounding.
    assert np.abs(push["approaching"][:, 1]).max() > 0.3 * np.abs(push["all"][:, 0]).max()
    assert np.abs(push["all"][:, 1]).max() < 1e-12 * np.abs(push["all"][:, 0]).max()


def test_conduction_evens_energy_out():
    """Heat flows from hot to cold, and none is made; gas at rest has no viscosity."""
    pos = lattice(16)
    u = 1.0 + 0.5 * np.sin(2 * np.pi * pos[:, 0])
    rate = simulation(
        pos, 2, "periodic", "wendland-c4", u=u, eos={"kind": "adiabatic", "gamma": 1.4}, conductivity={"alpha": 1.0},
        viscosity={"pairs": "all"},
    ).gas.heating_rate  # fmt: skip
    assert np.corrcoef(rate, u)[0, 1] < -0.7
    assert abs(rate.sum()) < 1e-12 * np.abs(rate).sum()


@pytest.mark.parametrize("dim", [1, 2])
def test_adiabatic_oscillation_keeps_its_energy(dim):
    """With the grad-h terms the energy error is that of the time integration: second order in dt."""
    n = 64 if dim == 1 else 16
    grid = ((np.arange(n) + 0.5) / n)[:, None] if dim == 1 else lattice(n)
    grid[:, 0] += 0.05 * np.sin(2 * np.pi * grid[:, 0])  # density contrast 2
    eos = {"kind": "adiabatic", "gamma": 1.4}
    errors = []
    for steps in (50, 100):
        sim = simulation(grid, dim, "periodic", u=np.full(len(grid), 1.0), eos=eos)

        def energy(gas):
            return (gas.mass * (gas.u + 0.5 * (gas.vel**2).sum(axis=1))).sum()

        start, worst = energy(sim.gas), 0.0
        for _ in range(steps):
            sim.step(most=0.5 / steps)
            worst = max(worst, abs(energy(sim.gas) - start))
        errors.append(worst / start)
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)


def test_conduction_of_a_pair():
    """du_i/dt = m_j alpha sqrt(|P_i - P_j| / rho_ij) (u_i - u_j) dW/dr / rho_ij (Price 2008, eq. 28), at rest."""
    h, distance, u = 0.1, 0.08, np.array([1.0, 3.0])
    sim = simulation(
        np.array([[0.5], [0.5 + distance]]), 1, "periodic", u=u, eos={"kind": "adiabatic", "gamma": 1.4},
        smoothing_length=h, conductivity={"alpha": 0.7}, viscosity={},
    )  # fmt: skip
    value, slope = w("cubic", 1, np.array([0.0, distance / h]))
    rho = 0.5 * 2 / (3 * h) * value.sum()
    pressure = 0.4 * rho * u
    speed = 0.7 * math.sqrt(abs(pressure[0] - pressure[1]) / rho)
    rate = 0.5 * speed * (u[0] - u[1]) * 2 / (3 * h**2) * slope[1] / rho
    np.testing.assert_allclose(sim.gas.heating_rate, [rate, -rate], rtol=1e-12)


def test_the_longest_step_of_conduction_swaps_a_pair():
    """Heat alone takes both in it to the energy of the particle that they meet, and never beyond."""
    u = np.array([1.0, 3.0])
    sim = simulation(
        np.array([[0.45], [0.55]]), 1, "periodic", u=u, eos={"kind": "adiabatic", "gamma": 1.4}, smoothing_length=0.1,
        conductivity={"alpha": 50.0}, viscosity={},
    )  # fmt: skip
    # No sum but that over the pair: to rounding.
    np.testing.assert_allclose(u + sim.effects["gas"].limit(sim.state) * sim.gas.heating_rate, u[::-1], rtol=1e-12)


def test_an_order_in_memory_hangs_on_places_and_ids_alone():
    """Particles that are shuffled before they are sorted come into the same order, and h stops where it did."""
    pos, mass = uneven(300, 2)
    sim = simulation(pos, 2, "open", mass=mass)
    gas, sph = sim.gas, sim.effects["gas"].sph
    gas.sort(*sph.keys(gas))
    ids, least = gas.ids, sph.least(gas)
    gas.take(np.random.default_rng(2).permutation(gas.count))
    assert not np.array_equal(gas.ids, ids)
    assert sph.least(gas) == least
    gas.sort(*sph.keys(gas))
    np.testing.assert_array_equal(gas.ids, ids)


@pytest.mark.parametrize(
    ("gone", "left"),
    [
        ([], [0, 1, 2, 3, 4, 5]),
        ([5], [0, 1, 2, 3, 4]),
        ([0, 2], [4, 1, 5, 3]),
        ([1, 4, 5], [0, 3, 2]),
        ([0, 1, 2, 3, 4], [5]),
        ([0, 1, 2, 3, 4, 5], []),
    ],
)
def test_the_last_take_the_places_of_those_that_go(gone, left):
    pos, _ = uneven(6, 2)
    gas = simulation(pos, 2, "open").gas
    before = gas.copy()
    gas.remove(np.isin(np.arange(6), gone))
    for name, array in gas.arrays().items():
        np.testing.assert_array_equal(array, before.arrays()[name][left])


@pytest.mark.parametrize("leaving", [[], [1], [0, 5], [2, 3, 4, 5]])
@pytest.mark.parametrize("number", [0, 1, 2, 5])
def test_those_that_come_take_the_places_of_those_that_leave(leaving, number):
    """Then the last ones do; or, where more come than leave, the others are the last."""
    gas, other = (simulation(uneven(6, 2)[0], 2, "open").gas for _ in range(2))
    before, other.ids = gas.ids.copy(), np.arange(100, 106)
    gas.replace(np.array(leaving, int), {name: array[:number] for name, array in other.arrays().items()})
    stay = set(range(6)) - set(leaving)
    assert set(gas.ids.tolist()) == {*before[sorted(stay)].tolist(), *range(100, 100 + number)}
    assert gas.count == len(stay) + number
    for name, array in gas.arrays().items():
        assert len(array) == gas.count, name
