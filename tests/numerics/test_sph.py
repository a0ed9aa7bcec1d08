"""The SPH sums against direct sums over all particles and images, and what they conserve."""

import itertools
import math
import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import quad
from sums import lattice, simulation, uneven, w

from discsim.kernels.sph.smoothing import KERNELS, NORM, SUPPORT, curvature, shape
from discsim.numerics.operators import accelerate

KERNEL_NAMES = tuple(KERNELS)


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
    second = np.array([curvature.py_func(number, dim, x) for x in q])
    # At a knot of the cubic its third derivative jumps: the difference errs by step times that.
    np.testing.assert_allclose((slopes[0] - slopes[1]) / (2 * step), second, atol=1e-4 * np.abs(second).max())


# Density and forces against direct sums

CASES = [("wendland-c2", 1, "periodic"), ("wendland-c4", 2, "periodic"), ("wendland-c2", 2, "open")]


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
        accelerate(sims[1].effects["gas"], sims[1].state)
        # Both are solved to some times the cube of the last step, 4e-3.
        np.testing.assert_allclose(sims[1].gas.h, sims[0].gas.h, rtol=5e-6)


# What the sums conserve

ALL = {
    "eos": {"kind": "adiabatic", "gamma": 1.4},
    "conductivity": {"alpha": 1.0},
}


BALSARA, RECONSTRUCTED = {"switch": "balsara"}, {"pairs": "reconstructed"}


def lively(boundary, viscosity=BALSARA, **changes):
    """Uneven gas of random velocities and energies, with every term of eqs. (3-5)."""
    terms = ALL | {"viscosity": {"alpha": 1.0, "beta": 2.0} | viscosity}
    pos, mass = uneven(150, 2)
    rng = np.random.default_rng(3)
    given = {"vel": rng.normal(size=(150, 2)), "u": rng.uniform(0.5, 2.0, 150)} | changes
    return simulation(given.pop("pos", pos), 2, boundary, "wendland-c4", given.pop("mass", mass), **given, **terms)


@pytest.mark.parametrize("viscosity", [BALSARA, RECONSTRUCTED], ids=["balsara", "reconstructed"])
@pytest.mark.parametrize("boundary", ["open", "periodic"])
def test_momentum_and_energy(boundary, viscosity):
    gas = lively(boundary, viscosity).gas
    force = gas.mass[:, None] * gas.acc
    # Pairs cancel to the rounding of the largest forces.
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).sum()
    work = (force * gas.vel).sum(axis=1)
    heating = gas.mass * gas.heating_rate
    assert abs(work.sum() + heating.sum()) < 1e-13 * (np.abs(work) + np.abs(heating)).sum()


@pytest.mark.parametrize("viscosity", [BALSARA, RECONSTRUCTED], ids=["balsara", "reconstructed"])
def test_angular_momentum(viscosity):
    gas = lively("open", viscosity).gas
    force = gas.mass[:, None] * gas.acc
    torque = gas.pos[:, 0] * force[:, 1] - gas.pos[:, 1] * force[:, 0]
    assert abs(torque.sum()) < 1e-13 * np.abs(torque).sum()


@pytest.mark.parametrize("viscosity", [BALSARA, RECONSTRUCTED], ids=["balsara", "reconstructed"])
def test_rotation_boost_and_order(viscosity):
    """Turned by an angle, seen from a moving frame and stored in another order, it is the same gas."""
    gas = lively("open", viscosity).gas
    rng = np.random.default_rng(5)
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    order = rng.permutation(150)
    pos, mass = uneven(150, 2)
    start = lively("open", viscosity, pos=pos)
    vel, u = start.gas.vel, start.gas.u
    scale, rate = np.abs(gas.acc).max(), np.abs(gas.heating_rate).max()
    # The solution for h stops a step earlier or later: Omega, and with it the force, may differ by up to 1e-4.
    cases = {
        "turned": (lively("open", viscosity, pos=pos @ turn, vel=vel @ turn), gas.acc @ turn, slice(None)),
        "boosted": (lively("open", viscosity, vel=vel + np.array([3.0, -2.0])), gas.acc, slice(None)),
        "reordered": (
            lively("open", viscosity, pos=pos[order], vel=vel[order], u=u[order], mass=mass[order]),
            gas.acc,
            order,
        ),
    }
    for name, (other, acc, index) in cases.items():
        np.testing.assert_allclose(other.gas.acc, acc[index], atol=1e-4 * scale, err_msg=name)
        np.testing.assert_allclose(other.gas.heating_rate, gas.heating_rate[index], atol=1e-4 * rate, err_msg=name)


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


# How they compile

ALONE = """
import importlib
from numba.core.registry import CPUDispatcher
from discsim import Simulation
Simulation({
    "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 1.0, "boundary": "periodic"},
    "initial": {"kind": "box"}, "gas": {"particles": 16, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
}).step()
modules = [importlib.import_module(f"discsim.kernels.sph.{name}") for name in ("smoothing", "forces", "density")]
found = [entry for module in modules for entry in vars(module).values() if isinstance(entry, CPUDispatcher)]
inlined = [entry for entry in found if entry.targetoptions.get("inline") == "always"]
print(len(inlined) > 2, [entry for entry in inlined if entry.signatures])
"""


def test_what_sums_inline_is_never_compiled_alone():
    """No cache holds it: each process would compile it again."""
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
    assert done.stdout.split(maxsplit=1) == ["True", "[]\n"]
