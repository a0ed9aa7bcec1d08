"""Viscosity and conduction: what a pair of gas particles does, and what the sums over pairs do to a flow."""

import math

import numpy as np
import pytest
from operating import limits_of
from sums import lattice, simulation, w

from discsim.numerics.operators import accelerate

# Viscosity


def test_viscosity_acts_on_approach_only():
    """A pair that separates feels nothing; one that approaches is decelerated and heated."""
    pos = np.array([[0.45, 0.5], [0.55, 0.5]])
    for speed in (1.0, -1.0):
        vel = np.array([[speed, 0.0], [-speed, 0.0]])
        sim = simulation(pos, 2, "open", vel=vel, viscosity={"pairs": "approaching"})
        push = sim.effects["gas"].viscous_acceleration(sim.state)[:, 0]
        assert push[0] < 0 < push[1] if speed > 0 else (push == 0).all()


@pytest.mark.parametrize(("alpha", "beta"), [(0.7, 0.0), (0.0, 1.9), (1.0, 2.0)])
def test_viscosity_of_a_pair(alpha, beta):
    """dv/dt = -m (-alpha c w + beta w^2) / rho dW/dr, eq. (5), of two that approach at w = -1.2, c = 0.5."""
    h, distance, speed = 0.1, 0.08, 1.2
    vel = np.array([[0.5 * speed], [-0.5 * speed]])
    viscosity = {"alpha": alpha, "beta": beta, "pairs": "approaching"}
    pos = np.array([[0.5], [0.5 + distance]])
    sim = simulation(pos, 1, "periodic", vel=vel, cs=0.5, smoothing_length=h, viscosity=viscosity)
    value, slope = w("cubic", 1, np.array([0.0, distance / h]))
    rho = 0.5 * 2 / (3 * h) * value.sum()
    push = 0.5 * (alpha * 0.5 * speed + beta * speed**2) / rho * 2 / (3 * h**2) * slope[1]
    found = sim.effects["gas"].viscous_acceleration(sim.state)
    np.testing.assert_allclose(found[:, 0], [push, -push], rtol=1e-12)  # a sum of one


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
            sim = simulation(pos, 2, "periodic", vel=vel, viscosity={"switch": switch, "pairs": "approaching"}, cs=0.01)
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
    sums = sim.effects["gas"].sph.found
    for found, expected in ((sums.div, abs(a + d)), (sums.curl, abs(c - b))):
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


RECONSTRUCTED = {"alpha": 0.7, "beta": 1.3, "pairs": "reconstructed"}


def scattered(dim, count=300, seed=4):
    """Particles at random places in a box of .5, of masses between .3 and 1 of the largest."""
    rng = np.random.default_rng(seed)
    return 0.2 + 0.5 * rng.random((count, dim)), rng.uniform(0.3, 1.0, count) / count, rng


@pytest.mark.parametrize(
    "kernel, dim, precision",
    [
        ("wendland-c2", 2, "double"), ("quintic", 2, "double"), ("cubic", 1, "double"), ("wendland-c2", 2, "single"),
        pytest.param("quintic", 2, "single", marks=pytest.mark.slow),  # each compiles the sums once more
        pytest.param("cubic", 1, "single", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_a_linear_flow_feels_no_reconstructed_viscosity(kernel, dim, precision):
    """Shear, rotation and compression at once, of uneven masses, up to the free edge: the gradient is exact there."""
    pos, mass, _ = scattered(dim)
    flow = np.array([[0.3, -0.9], [1.7, -0.4]])[:dim, :dim]
    push = {}
    for pairs in ("all", "reconstructed"):
        viscosity = RECONSTRUCTED | {"pairs": pairs}
        vel = pos @ flow.T + [0.4, -0.2][:dim]
        sim = simulation(pos, dim, "open", kernel, mass, vel=vel, viscosity=viscosity, precision=precision)
        push[pairs] = np.abs(sim.effects["gas"].viscous_acceleration(sim.state)).max()
    # Rounding of velocities over the distance of particles that are nearly at one place.
    assert push["reconstructed"] < {"double": 1e-9, "single": 1e-3}[precision] * push["all"]


def test_reconstructed_jumps_are_those_of_limited_slopes():
    """Eqs. (6, 7) by sums over all pairs, and the viscosity (5) and its heat from them."""
    pos, _, rng = scattered(2, 60)
    vel = rng.normal(size=pos.shape)
    sim = simulation(
        pos, 2, "open", "wendland-c4", vel=vel, u=rng.uniform(0.5, 2.0, 60), viscosity=RECONSTRUCTED,
        eos={"kind": "adiabatic", "gamma": 1.4},
    )  # fmt: skip
    gas = sim.gas
    # Slopes have the weights of the h from which its search took the last step: with the h found that is next to none.
    accelerate(sim.effects["gas"], sim.state)
    d, dv = gas.pos[:, None] - gas.pos[None], gas.vel[:, None] - gas.vel[None]
    r = np.sqrt((d**2).sum(axis=2)) + np.eye(60)
    weight = gas.mass[None] * w("wendland-c4", 2, r / gas.h[:, None])[0] * (1 - np.eye(60))
    moments = np.einsum("ij,ija,ijb->iab", weight, d, d)
    slopes = np.einsum("ij,ija,ijb->iab", weight, dv, d) @ np.linalg.inv(moments)
    of_i = np.einsum("ija,iab,ijb->ij", d, slopes, d) / r
    of_j = np.einsum("ija,jab,ijb->ij", d, slopes, d) / r
    whole = (dv * d).sum(axis=2) / r
    jump = whole - np.where(of_i * of_j > 0, 2 * of_i * of_j / (of_i + of_j + np.eye(60)), 0.0)
    sound, density = (0.5 * (x[:, None] + x[None]) for x in (gas.sound_speed, 1 / gas.density))
    pi = (-0.7 * sound * jump + 1.3 * np.minimum(jump, 0.0) ** 2) * density
    slope = 9 / (4 * np.pi) / gas.h[:, None] ** 3 * w("wendland-c4", 2, r / gas.h[:, None])[1]
    slope = 0.5 * (slope + slope.T)
    force = -(gas.mass[None] * pi * slope)[..., None] * d / r[..., None]
    found = sim.effects["gas"].viscous_acceleration(sim.state)
    np.testing.assert_allclose(found, force.sum(axis=1), atol=1e-7 * np.abs(found).max())
    heat = 0.5 * (gas.mass[None] * pi * whole * slope).sum(axis=1)
    compression = gas.pressure / (gas.gradh * gas.density**2)
    own = 9 / (4 * np.pi) / gas.h[:, None] ** 3 * w("wendland-c4", 2, r / gas.h[:, None])[1]
    heat += compression * (gas.mass[None] * whole * own).sum(axis=1)
    np.testing.assert_allclose(gas.heating_rate, heat, atol=1e-7 * np.abs(heat).max())


@pytest.mark.parametrize("dim", [1, 2])
def test_noise_between_neighbours_is_damped_whole(dim):
    """Velocities of alternating signs have no slope: reconstruction leaves their jump, and the push, of all pairs."""
    count = 16
    pos = lattice(count) if dim == 2 else (np.arange(count)[:, None] + 0.5) / count
    vel = np.zeros_like(pos)
    vel[:, 0] = 0.1 * (-1.0) ** np.round(pos[:, 0] * count - 0.5)
    push = []
    for pairs in ("all", "reconstructed"):
        sim = simulation(pos, dim, "periodic", "cubic", vel=vel, viscosity=RECONSTRUCTED | {"pairs": pairs})
        push.append(sim.effects["gas"].viscous_acceleration(sim.state)[np.argsort(sim.gas.ids)])
    assert np.abs(push[0]).max() > 0.1
    np.testing.assert_allclose(push[1], push[0], atol=1e-12)


# Conduction


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


def test_viscosity_of_all_pairs_heats_by_what_it_brakes():
    """Pairs that recede are braked too, and both get half of what that takes, beside the work of the pressure."""
    rng = np.random.default_rng(5)
    gas = simulation(
        lattice(16) + 0.01 * rng.normal(size=(256, 2)), 2, "periodic", "wendland-c4", vel=rng.normal(size=(256, 2)),
        u=rng.uniform(0.5, 2.0, 256), eos={"kind": "adiabatic", "gamma": 1.4}, conductivity={"alpha": 1.0},
        viscosity={"alpha": 0.7, "beta": 1.3, "pairs": "all"},
    ).gas  # fmt: skip
    work, heat = gas.mass * (gas.acc * gas.vel).sum(axis=1), gas.mass * gas.heating_rate
    assert abs(work.sum() + heat.sum()) < 1e-13 * (np.abs(work) + np.abs(heat)).sum()  # rounding of sums over pairs


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
    np.testing.assert_allclose(u + limits_of(sim, "gas")["gas"].step * sim.gas.heating_rate, u[::-1], rtol=1e-12)
