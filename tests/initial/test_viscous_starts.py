"""The starts of viscous discs: their profiles, their flow, and what becomes of them."""

import numpy as np
import pytest
from scenes import problems

from discsim import Simulation, load_scene
from discsim.exact import spreading_ring
from discsim.initial import steady, viscous_ring
from discsim.physics import profile, viscosity
from discsim.preview.check import report
from discsim.preview.warnings import warnings
from discsim.study.errors import measure_of

EVEN = {"kind": "locally-isothermal", "aspect_ratio": 0.05, "temperature_index": 1.0}


def ring(particles=2000, until=1.0, **tables):
    """A ring with nu = .05 H^2 Omega, which index -1/2 makes the same everywhere."""
    return {
        "units": {"system": "code"},
        "run": {"until": until, "courant": 0.5},
        "space": {"size": 5.0},
        "initial": {"kind": "viscous-ring", "radius": 1.0, "mass": 1e-6},
        "gas": {"particles": particles, "kernel": "cubic", "eos": EVEN},
        "star": {"mass": 1.0, "accretion_radius": 0.2},
        "alpha_viscosity": {"alpha": 0.05, "index": -0.5},
    } | tables


def disc(particles=2000, **tables):
    start = {"kind": "steady", "accretion_rate": 1e-9, "inner": 0.5, "outer": 2.0}
    start |= {"inner_taper": 0.2, "outer_taper": 0.3}
    return ring(particles) | {"initial": start, "alpha_viscosity": {"alpha": 0.02}} | tables


def polar(gas):
    r = np.sqrt((gas.pos**2).sum(axis=1))
    return r, (gas.pos * gas.vel).sum(axis=1) / r, (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]) / r


def test_the_ring_is_that_of_lynden_bell_and_pringle():
    sim = Simulation(ring(20_000))
    r, radial, turning = polar(sim.gas)
    x = np.linspace(0.4, 1.6, 20_001)
    within = np.cumsum(2.0 * np.pi * x * spreading_ring.surface_density(x, 0.016)) * (x[1] - x[0])
    places = np.linspace(0.75, 1.3, 12)
    found = np.searchsorted(np.sort(r), places) / sim.gas.count
    # Particles come in rings, of which the largest has 2.2% of them.
    np.testing.assert_allclose(found, np.interp(places, x, within), atol=0.025)
    nu = 0.05 * 0.05**2
    assert viscous_ring.uniform_viscosity(sim.scene) == pytest.approx(nu, rel=1e-12)
    np.testing.assert_allclose(radial, spreading_ring.radial_velocity(r, 0.016, nu), rtol=1e-9)
    # v^2 / r = 1 / r^2 + (1 / Sigma) dP/dr, H / r = .05.
    step = 1e-4
    rise = np.log(spreading_ring.surface_density(r + step, 0.016) / spreading_ring.surface_density(r - step, 0.016))
    core = np.abs(r - 1.0) < 0.1  # where the pressure falls over more than H
    balance = 1.0 / r + 0.05**2 * (rise / (2 * step) - 1.0 / r)
    np.testing.assert_allclose(turning[core] ** 2, balance[core], rtol=1e-6)


def test_a_small_ring_spreads_as_the_exact_one():
    """To tau = .05 with 3000 particles, h/H = .7, where noise adds to the viscosity; at full size see test_slow.

    A tenth of the mass in other bins than the exact ring's; without viscosity it is four tenths.
    """
    sim = Simulation(ring(3000))
    sim.run((0.05 - 0.016) / 12.0 / (0.05 * 0.05**2))
    assert measure_of(sim.scene).errors(sim)["gas"] < 0.15
    start = Simulation(ring(3000))
    start.state.time = sim.time
    assert measure_of(sim.scene).errors(start)["gas"] > 0.3


def test_a_steady_disc_carries_one_rate_everywhere():
    sim = Simulation(disc(10_000))
    scene, (r, radial, _) = sim.scene, polar(sim.gas)
    nu = viscosity.diffusivity(scene, r)
    inside = (r > 0.7) & (r < 1.7)
    surface_density = profile.radial(scene).surface_density
    sigma = surface_density(r)
    np.testing.assert_allclose((-2.0 * np.pi * r * sigma * radial)[inside], 1e-9, rtol=1e-10)
    np.testing.assert_allclose((3.0 * np.pi * nu * sigma)[inside], 1e-9, rtol=1e-10)
    edges = np.linspace(0.7, 1.7, 6)
    mass = np.histogram(r, edges, weights=sim.gas.mass)[0]
    fine = np.linspace(0.7, 1.7, 5001)
    within = np.cumsum(2.0 * np.pi * fine * surface_density(fine)) * (fine[1] - fine[0])
    wanted = np.diff(np.interp(edges, fine, within))
    np.testing.assert_allclose(mass, wanted, rtol=0.1)  # rings of particles, an eighth of a bin each
    given = disc() | {"initial": {"kind": "steady", "surface_density": 2e-5, "inner": 0.5, "outer": 2.0}}
    assert steady.accretion_rate(load_scene(given)) == pytest.approx(3 * np.pi * 0.02 * 0.05**2 * 2e-5, rel=1e-12)


def test_wrong_starts_are_one_message():
    both = {"kind": "steady", "accretion_rate": 1e-9, "surface_density": 1.0, "inner": 0.5, "outer": 2.0}
    assert any("are both given; give exactly one of" in line for line in problems(disc(initial=both)))
    dead = {"alpha": 0.1, "dead_alpha": 0.0, "dead_inner": 0.8, "dead_outer": 1.2, "dead_width": 0.1}
    assert any("Sigma of a steady disc is infinite" in line for line in problems(disc(alpha_viscosity=dead)))
    bare = {name: table for name, table in ring().items() if name != "alpha_viscosity"}
    assert any("a viscous-ring needs viscosity" in line for line in problems(bare))


def test_a_ring_without_one_viscosity_is_told():
    assert any(
        "no known exact solution" in line for line in warnings(load_scene(ring(alpha_viscosity={"alpha": 0.05})))
    )
    assert not any("no known exact solution" in line for line in warnings(load_scene(ring())))
    assert "alpha of the scene" in report(load_scene(ring()))
