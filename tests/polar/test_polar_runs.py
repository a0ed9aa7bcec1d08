"""Runs with gas on a polar grid: balance, drag, viscosity, companions, damping, bits, and messages."""

import re

import numpy as np
import pytest
from operating import longest_step_of
from polar_cells import MASS, disc_scene, polar
from runs import assert_resumes, on_threads, state_bits
from scenes import changed, problems

from discsim import SceneError, Simulation, load_scene
from discsim.effects.polar import MAX_PUSH
from discsim.exact import nsh, spreading_ring
from discsim.formulas.polar import FLOOR
from discsim.initial.rings import perturb_angles
from discsim.physics.polar import polar_shape
from discsim.preview.check import report
from discsim.preview.forecast import expected_steps
from discsim.preview.warnings import warnings
from discsim.run.forces import PhysicsError

DISC = disc_scene(0.6, 1.5, 4000)
ADIABATIC = {"eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.07}}
DUSTY = {
    "dust": {"particles": 3000, "ratio": 0.3},
    "drag": {"law": "stokes-number", "stokes": 0.03, "scheme": "tsc"},
}
PLANET = {"mass": 3e-4, "semi_major_axis": 1.0, "softening": 0.6}
# All that acts on the gas of a polar grid at once.
MANY = changed(
    DISC,
    gas=DISC["gas"] | ADIABATIC,
    companion=PLANET,
    alpha_viscosity={"alpha": 0.01},
    damping={"inner": [0.6, 0.7], "outer": [1.3, 1.5], "surface_density": True},
    cooling={"kind": "beta", "beta": 10.0},
    self_gravity={"softening": 0.05},
    **DUSTY,
)


def closed(scene, **more):
    return changed(scene, gas=scene["gas"] | {"grid": {"edges": "closed"}} | more)


@pytest.mark.parametrize("eos", [{}, ADIABATIC], ids=["locally-isothermal", "adiabatic"])
def test_a_disc_stays_in_balance(eos):
    """The rotation balances the discrete pressure force, so that only rounding moves the gas."""
    sim = Simulation(changed(DISC, gas=DISC["gas"] | eos))
    mass = sim.gas.mass.copy()
    sim.run(6.0)
    _, radial, _ = polar(sim.gas)
    assert np.abs(radial / sim.gas.sound_speed).max() < 1e-10
    assert np.abs(sim.gas.mass / mass - 1.0).max() < 1e-10


@pytest.mark.parametrize("eos", [{}, ADIABATIC], ids=["locally-isothermal", "adiabatic"])
def test_cells_beyond_the_disc_start_in_balance(eos):
    """On a grid wider than a tapered disc: v^2 / r = g - a in all rings, with the pressure force a of the cells."""
    initial = DISC["initial"] | {"inner_taper": 0.1, "outer_taper": 0.2}
    sim = Simulation(closed(changed(DISC, initial=initial), particles=6000, grid={"inner": 0.5, "outer": 2.0}, **eos))
    r, radial, around = polar(sim.gas)
    pull = MASS / r**2
    push = (sim.acceleration("gas")[0] * sim.gas.pos).sum(axis=1) / r
    assert 0.1 < np.abs(push / pull).max() < MAX_PUSH
    np.testing.assert_allclose(around, np.sqrt(r * (pull - push)), rtol=1e-12)
    assert np.abs(radial).max() < 1e-14


@pytest.mark.parametrize("tables", [{}, DUSTY])
def test_own_velocities_are_kept_with_a_table_initial(tables):
    """[initial] then describes the disc, for damping zones and previews."""
    scene = changed(DISC, gas={"particles": 800}, **tables)
    sim = Simulation(scene)
    given = {
        name: {"pos": p.pos, "vel": 1.02 * p.vel, "mass": p.mass}
        for name, p in (("gas", sim.gas), ("dust", sim.dust)) if p is not None
    }  # fmt: skip
    again = Simulation(scene, particles=given)
    for name, arrays in given.items():
        assert np.array_equal(getattr(again, name).vel, arrays["vel"])


def test_the_cells_of_a_scene_are_nearly_square_and_as_many_as_asked_for():
    for number in (4000, 12345, 100_000):
        shape = polar_shape(load_scene(changed(DISC, gas=DISC["gas"] | {"particles": number})))
        assert abs(shape.cells - number) <= shape.rings
        wide = np.log(1.5 / 0.6) / shape.rings
        assert np.isclose(wide, 2.0 * np.pi / shape.angles, rtol=0.03)
    shape = polar_shape(load_scene(closed(DISC, grid={"rings": 20, "inner": 0.5, "outer": 2.0})))
    assert shape[:4] == (20, 200, 0.5, 2.0)


def test_the_mass_of_cells_is_that_of_the_disc_and_a_floor_beyond_it():
    scene = changed(DISC, initial=DISC["initial"] | {"inner_taper": 0.2})
    sim = Simulation(closed(scene, grid={"inner": 0.5, "outer": 1.8}))
    r = np.hypot(*sim.gas.pos.T)
    density = sim.gas.mass / sim.effects["gas"].cells.area
    inside = (r > 0.85) & (r < 1.45)
    assert np.allclose(density[inside], 1e-4 / r[inside], rtol=1e-3)  # (d ln r)^2 / 24
    assert np.allclose(density[r > 1.55], FLOOR * density.max())
    sim.run(1.0)


@pytest.mark.parametrize("eos", [{}, ADIABATIC], ids=["locally-isothermal", "adiabatic"])
def test_noise_does_not_grow(eos):
    """Noise of 1e-6 c_s for five inner orbits, in steps at the default Courant factor."""
    sim = Simulation(changed(DISC, gas=DISC["gas"] | {"particles": 8000} | eos))
    sim.gas.vel += 1e-7 * np.random.default_rng(0).standard_normal(sim.gas.vel.shape)
    sim.run(15.0)
    _, radial, _ = polar(sim.gas)
    assert np.sqrt(np.mean(radial**2)) < 4e-7  # swing amplification of waves by the shear: 2e-7


def test_amplitudes_of_the_perturbation():
    sim = Simulation(changed(DISC, initial=DISC["initial"] | {"perturbation": 0.05}))
    shape = polar_shape(sim.scene)
    ring = sim.gas.mass.reshape(shape.rings, shape.angles)
    power = np.abs(np.fft.rfft(ring / ring.mean(axis=1, keepdims=True), axis=1)).mean(axis=0) / shape.angles
    assert np.allclose(power[2:7], 0.025, rtol=0.05)  # half of each amplitude, to first order in it
    assert power[8:].max() < 0.003
    sim.run(0.5)


def test_the_perturbation_of_cells_is_that_of_particles():
    """Amplitude and phase of each mode in each ring of cells are those of displaced particles on a ring."""
    sim = Simulation(changed(DISC, initial=DISC["initial"] | {"perturbation": 0.02}))
    cells, even = sim.effects["gas"].cells, 2.0 * np.pi * np.arange(500) / 500
    radius, mass = cells.geometry.radius, sim.gas.mass.reshape(cells.shape)
    angle = perturb_angles(sim.scene, np.repeat(radius, 500), np.tile(even, len(radius))).reshape(-1, 500)
    for m in range(2, 7):
        particles = np.exp(1j * m * angle).mean(axis=1)
        found = mass @ np.exp(1j * m * cells.azimuth) / mass.sum(axis=1)
        assert np.allclose(np.abs(particles), 0.01, rtol=0.1)
        # Terms of second order in the amplitude, and (m dphi)^2 / 24.
        assert np.allclose(found, particles, atol=1e-3)


def test_what_a_cell_has_radiated_stays_in_the_cell():
    """m times the radiated energy per mass, while gas moves from cell to cell and through the edges."""
    sim = Simulation(changed(DISC, gas=ADIABATIC, cooling={"kind": "beta", "beta": 5.0}))
    sim.step()
    gas, rng = sim.gas, np.random.default_rng(2)
    gas.radiated[:] = rng.uniform(0.5, 2.0, gas.count)
    gas.vel += 0.1 * rng.standard_normal(gas.vel.shape)
    mass, radiated = gas.mass.copy(), gas.mass * gas.radiated
    sim.effects["gas"].drift(sim.state, 0.02)
    assert np.abs(gas.mass / mass - 1.0).max() > 0.01
    assert np.allclose(gas.mass * gas.radiated, radiated, rtol=1e-14)


@pytest.mark.parametrize("ratio, stokes", [(0.3, 0.03), (0.01, 0.03), (0.3, 0.3)])
def test_dust_drifts_as_by_nakagawa(ratio, stokes):
    """Two-way drag: radial drift of gas and dust within 1.5%, and rotation within 1%, of Nakagawa et al. (1986)."""
    scene = changed(DISC, gas=DISC["gas"] | {"particles": 8000}, **DUSTY)
    scene["dust"] = {"particles": 8000, "ratio": ratio}
    scene["drag"] = DUSTY["drag"] | {"stokes": stokes}
    sim = Simulation(scene)
    sim.run(3.0)
    headwind = 0.07**2  # (p + q) h^2 / 2 at p = q = 1
    exact = nsh.velocities(stokes, ratio, headwind)
    for p, in_radius, around in (
        (sim.dust, exact.dust_radial, exact.dust_azimuthal), (sim.gas, exact.gas_radial, exact.gas_azimuthal),
    ):  # fmt: skip
        r, radial, azimuthal = polar(p)
        near = np.abs(r - 1.0) < 0.15
        scale = np.sqrt(r[near] / MASS)
        assert np.isclose((radial[near] * scale).mean(), in_radius, rtol=0.015, atol=0.015 * abs(exact.dust_radial))
        assert np.isclose((azimuthal[near] * scale).mean() - 1.0, around, rtol=0.01)


def test_one_way_dust_leaves_the_bits_of_the_gas():
    scene = changed(DISC, companion=PLANET)
    alone = Simulation(scene)
    dusty = Simulation(changed(scene, dust=DUSTY["dust"], drag=DUSTY["drag"] | {"direction": "one-way"}))
    for sim in (alone, dusty):
        sim.run(0.7)
    for name in ("pos", "vel", "mass"):
        assert np.array_equal(getattr(alone.gas, name), getattr(dusty.gas, name))


def test_a_viscous_ring_spreads():
    """Within 0.5% of the exact solution, as means over cells; waves of the start make 0.2%."""
    nu, begin, end = 1e-4, 0.016, 0.024
    scene = changed(
        DISC | {"initial": {}},
        initial={"kind": "viscous-ring", "radius": 1.0, "mass": 1e-6, "tau": begin},
        gas={
            "method": "grid", "particles": 24_000, "grid": {"inner": 0.5, "outer": 1.7, "edges": "closed"},
            "eos": {"kind": "isothermal", "sound_speed": 0.01},
        },
        alpha_viscosity={"nu": nu},
    )  # fmt: skip
    sim = Simulation(scene)
    spin = (sim.gas.mass * np.multiply(*polar(sim.gas)[::2])).sum()
    sim.run((end - begin) / (12.0 * nu))
    assert np.isclose((sim.gas.mass * np.multiply(*polar(sim.gas)[::2])).sum(), spin, rtol=1e-12)
    cells = sim.effects["gas"].cells
    r = np.exp(
        np.interp((np.arange(8 * cells.rings) + 0.5) / 8, np.arange(cells.rings + 1), np.log(cells.geometry.sides))
    )
    exact = np.average((spreading_ring.surface_density(r, end, 1e-6)).reshape(-1, 8), 1, (r * r).reshape(-1, 8))
    found = sim.gas.density.reshape(cells.shape).mean(axis=1)
    assert np.abs(found - exact) @ cells.geometry.volume < 5e-3 * exact @ cells.geometry.volume


def test_viscous_heat():
    """The energy that a shear loses becomes heat."""
    scene = changed(DISC, initial=DISC["initial"] | {"surface_density_index": 0.0}, alpha_viscosity={"nu": 1e-3})
    scene = closed(scene, eos={"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.07})
    sim = Simulation(scene)

    def energy():
        return (sim.gas.mass * (sim.gas.u + 0.5 * (sim.gas.vel**2).sum(axis=1) - MASS / np.hypot(*sim.gas.pos.T))).sum()

    whole = energy()
    sim.step(1e-6)
    r = np.hypot(*sim.gas.pos.T)
    expected = 2.25e-3 * MASS / r**3  # nu (3 Omega / 2)^2, less (d ln r)^2 and the pressure's headwind
    inside = (r > 0.7) & (r < 1.35)
    assert np.allclose(sim.gas.heating_rate[inside], expected[inside], rtol=0.01)
    sim.run(0.9)
    assert abs(energy() - whole) < 0.02 * (sim.gas.mass * expected).sum()  # of the leapfrog, over the heat


def test_a_planet_makes_a_wake_in_cells_at_rest():
    """In the frame of the star, whose whole acceleration is in the kick."""
    sim = Simulation(changed(DISC, companion=PLANET | {"orbit": "fixed"}, gas=DISC["gas"] | {"particles": 10_000}))
    sim.run(6.0)
    assert np.array_equal(sim.gas.pos, sim.effects["gas"].cells.pos)
    shape = polar_shape(sim.scene)
    ring = sim.gas.density.reshape(shape.rings, shape.angles)
    contrast = ring.max(axis=1) / ring.mean(axis=1)
    r = sim.effects["gas"].cells.geometry.radius
    for at in (0.75, 1.3):  # wakes on both sides
        assert 1.05 < contrast[np.argmin(np.abs(r - at))] < 2.0


def test_damping_stops_waves_at_the_edges():
    scene = closed(changed(DISC, damping={"inner": [0.6, 0.75], "outer": [1.25, 1.5], "time": 0.3}))
    found = []
    for without in ((), ("damping",)):
        sim = Simulation(load_scene(scene, without=without))
        r, _, _ = polar(sim.gas)
        sim.gas.vel += 0.01 * np.exp(-(((r - 1.0) / 0.1) ** 2))[:, None] * sim.gas.pos
        sim.run(50.0)
        _, radial, _ = polar(sim.gas)
        found.append(np.sqrt(np.mean(radial**2)))
    assert found[0] < 0.5 * found[1]


def test_damping_leaves_a_disc_in_balance():
    """v* of the zones is rotated as the velocities before and after a drift are."""
    sim = Simulation(changed(DISC, damping={"inner": [0.6, 0.75], "outer": [1.25, 1.5]}))
    sim.run(6.0)
    _, radial, _ = polar(sim.gas)
    assert np.abs(radial / sim.gas.sound_speed).max() < 2e-5  # discrete and exact pressure forces differ by 1e-4


def test_zones_sustain_a_viscous_inflow():
    """A steady disc of alpha = .01 r^.5 between zones that hold Sigma: v_r = -1.5 nu / r, and Sigma as at the start."""
    scene = changed(
        DISC,
        initial={
            **dict.fromkeys(DISC["initial"]),
            "kind": "steady",
            "surface_density": 1e-6,
            "inner": 0.6,
            "outer": 1.5,
        },
        alpha_viscosity={"alpha": 0.01, "index": 0.5},
        damping={"inner": [0.6, 0.7], "outer": [1.3, 1.5], "time": 0.05, "surface_density": True},
    )
    sim = Simulation(closed(scene, particles=9000))
    begun = sim.gas.mass.copy()
    sim.run(20.0)
    r, radial, _ = polar(sim.gas)
    between = (r > 0.75) & (r < 1.25)
    # nu = alpha c_s H with H/r = .07. Where Sigma differs by 2e-4 over three cells, viscosity changes the flow by 10%.
    wanted = -1.5 * 0.01 * r**0.5 * 0.07**2 * np.sqrt(MASS / r)
    np.testing.assert_allclose((radial / wanted)[between], 1.0, atol=0.15)
    assert (radial / wanted)[between].mean() == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose((sim.gas.mass / begun)[between], 1.0, atol=2e-3)


def test_torques_of_the_outer_and_inner_disc_on_a_light_planet():
    """Signs and sizes of linear theory, about 0.4 q^2 (H/r)^-3 Sigma each (Ward 1997); q (H/r)^-3 = 0.58."""
    q, height = 2e-4, 0.07
    planet = {"mass": q * MASS, "semi_major_axis": 1.0, "softening": 0.6}
    start = {"kind": "disc", "surface_density": 1e-6, "inner": 0.4, "outer": 2.2, "surface_density_index": 0.5}
    zones = {"inner": [0.4, 0.5], "outer": [1.9, 2.2]}
    sim = Simulation(closed(changed(DISC, companion=planet, initial=start, damping=zones), particles=9000))
    found = []
    for orbits in (3.0, 3.5, 4.0):
        sim.run(orbits * 2.0 * np.pi / np.sqrt(MASS))
        place, gas = sim.bodies.pos[1], sim.gas
        away = gas.pos - place
        apart = np.sqrt((away**2).sum(axis=1) + (0.6 * height) ** 2)
        turn = MASS * q * gas.mass * (place[0] * away[:, 1] - place[1] * away[:, 0]) / apart**3
        outer = np.hypot(*gas.pos.T) > 1.0
        far = np.hypot(*away.T) > 0.5 * (q / 3.0) ** (1.0 / 3.0)
        found.append([turn[outer & far].sum(), turn[~outer & far].sum()])
    unit = q**2 * height**-3 * 1e-6 * MASS
    outside, inside = np.mean(found, axis=0) / unit
    assert -0.6 < outside < -0.2 and 0.15 < inside < 0.5
    assert outside + inside < -0.03


def test_surface_density_in_a_zone_falls_to_its_initial_value_and_takes_momentum_along():
    """One operator over dt = .7: the excess falls by exp(-R dt), R = x^2 / (.05 orbits at r = 1.5)."""
    zone = {"outer": [1.1, 1.5], "time": 0.05, "surface_density": True}
    sim = Simulation(closed(changed(DISC, damping=zone), **ADIABATIC))
    p = sim.gas
    r, _, around = polar(p)
    begun, more = p.mass.copy(), 1.0 + 0.3 * np.cos(3.0 * np.arctan2(*p.pos.T)) + 0.1 * r
    u = p.u.copy()
    p.mass *= more
    p.vel *= 1.03
    p.u *= 1.4

    def totals():
        x, y = p.pos.T
        return np.array([p.mass.sum(), *(p.mass @ p.vel), p.mass @ (x * p.vel[:, 1] - y * p.vel[:, 0])])

    before = totals()
    sim.effects["damping"].operate(sim.state, 0.7)
    rate = np.clip((r - 1.1) / 0.4, 0.0, 1.0) ** 2 / (0.05 * 2.0 * np.pi * np.sqrt(1.5**3 / MASS))
    left = np.exp(-0.7 * rate)
    mass = 1.0 + (more - 1.0) * left
    # Nodes are 1e-3 apart in ln r, and the means of rings 0.02 apart lie on lines that bend by 0.02 at each.
    np.testing.assert_allclose(p.mass / begun, mass, rtol=0, atol=2e-5)
    # Added gas has the initial energy and the velocity of the zone.
    old = np.minimum(1.0, more / mass)
    assert old.min() < 0.9
    np.testing.assert_allclose(p.u / u, 1.4 * old + 1.0 - old, rtol=0, atol=2e-5)
    # The discrete pressure force balances a rotation that differs from the exact one of the zones by 1e-4.
    np.testing.assert_allclose(polar(p)[2] / around, 1.0 + 0.03 * left * old, rtol=0, atol=2e-4)
    ledger = sim.state.ledger
    taken = [ledger.damped_gas, *ledger.damped_momentum, ledger.damped_angular_momentum]
    np.testing.assert_allclose(before - totals(), taken, rtol=0, atol=1e-14 * before[0])
    assert ledger.damped_gas > 3e-3 * before[0]


def test_cooling_to_the_temperature_of_the_start():
    sim = Simulation(
        changed(MANY, companion=None, self_gravity=None, dust=None, drag=None, damping=None, alpha_viscosity=None)
    )
    begun = sim.gas.u.copy()
    sim.gas.u *= 1.3
    sim.run(0.4)
    left = (sim.gas.u / begun - 1.0) / 0.3
    rate = np.sqrt(MASS) * np.hypot(*sim.gas.pos.T) ** -1.5 / 10.0
    inside = np.abs(np.hypot(*sim.gas.pos.T) - 1.0) < 0.2
    assert np.allclose(left[inside], np.exp(-0.4 * rate[inside]), rtol=0.01)


def test_the_gas_feels_its_own_gravity():
    """A massive ring of gas: the cells rotate faster outside it by its gravity."""
    scene = changed(DISC, initial=DISC["initial"] | {"surface_density": 0.02}, self_gravity={"softening": 0.05})
    sim = Simulation(closed(scene))
    mass = sim.gas.mass.copy()
    sim.run(2.0)
    r, _, around = polar(sim.gas)
    inside = (r > 0.7) & (r < 1.35)
    assert np.abs(sim.gas.mass / mass - 1.0)[inside].max() < 0.05
    outer = np.abs(r - 1.35) < 0.05
    assert (around[outer] * np.sqrt(r[outer] / MASS)).mean() > 1.005


def test_bits_after_a_resume(tmp_path):
    sim = assert_resumes(load_scene(MANY), tmp_path / "checkpoint", 0.11, 0.25)
    assert sim.state.ledger.accreted_gas != 0.0


def test_bits_on_several_threads(monkeypatch):
    monkeypatch.setattr("discsim.numerics.polar.CHUNK", 200)
    found = []
    for _ in on_threads(monkeypatch):
        sim = Simulation(MANY)
        sim.run(0.15)
        found.append(state_bits(sim))
    assert found[0] == found[1]


def test_open_edges_lose_mass_to_the_ledger():
    sim = Simulation(DISC)
    before = sim.gas.mass.sum(), (sim.gas.mass * np.multiply(*polar(sim.gas)[::2])).sum()
    r, _, _ = polar(sim.gas)
    sim.gas.vel += 0.1 * (r - 1.0)[:, None] * sim.gas.pos / r[:, None]
    sim.run(2.0)
    ledger = sim.state.ledger
    assert ledger.accreted_gas > 0.01 * before[0]
    assert np.isclose(sim.gas.mass.sum() + ledger.accreted_gas, before[0], rtol=1e-12)
    spin = (sim.gas.mass * np.multiply(*polar(sim.gas)[::2])).sum()
    assert np.isclose(spin + ledger.accreted_angular_momentum, before[1], rtol=1e-12)


def test_too_long_a_step_is_refused():
    assert problems(changed(DISC, run={"until": 1.0, "courant": 1.5}))
    sim = Simulation(changed(DISC, run={"until": 30.0, "timestep": 0.5}))
    rng = np.random.default_rng(1)
    sim.gas.vel += 1e-3 * rng.standard_normal(sim.gas.vel.shape)
    with pytest.raises((PhysicsError, ValueError)):
        sim.run()


WRONG = {
    "quiet": ({"gas": {"quiet": True}}, 'gas.quiet: used only by SPH, but gas.method is "grid"; remove this key'),
    "kernel": ({"gas": {"kernel": "cubic"}}, "gas.kernel: used only by SPH"),
    "viscosity": ({"gas": {"viscosity": {}}}, "gas.viscosity: used only by SPH"),
    "edges": ({"gas": {"grid": {"inner": 2.0, "outer": 1.0}}}, "gas.grid.outer: the outer edge is not larger"),
    "space": ({"gas": {"grid": {"outer": 3.0}}}, "space.size: the space is smaller than the polar grid"),
    "method": ({"gas": {"method": "sph", "grid": {}}}, "gas.grid: the table is used only with gas.method"),
    "relax": ({"initial": {"relax": 3}}, "initial.relax: gas on a polar grid starts in balance"),
    "euler": ({"run": {"integrator": "euler"}}, "run.integrator: the integrator does not support gas.method"),
    "frame": ({"star": {"frame": "inertial"}}, "star.frame: the polar grid is centred on the star"),
    "accretion": ({"star": {"accretion_radius": 0.7}}, "star.accretion_radius: the star would accrete cells"),
    "scheme": (
        {"dust": DUSTY["dust"], "drag": {"law": "stokes-number", "stokes": 0.1, "scheme": "lab14"}},
        'drag.scheme: drag.scheme "lab14" needs pairs of particles',
    ),
    "background": ({"background": {"surface_density": 1e-4}}, "background: [gas] is also given; keep [gas] (gas that"),
    "damping": (
        {"gas": {"method": "sph"}, "damping": {"inner": [0.6, 0.7], "surface_density": True}},
        "damping.surface_density: only gas on a polar grid relaxes its surface density; remove this key",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_messages(name):
    tables, message = WRONG[name]
    scene = changed(DISC, **{key: {**DISC.get(key, {}), **table} for key, table in tables.items()})
    found = problems(scene)
    assert any(f"scene: {message}" in one for one in found), found


def test_messages_of_other_starts():
    scene = DISC | {"initial": {"kind": "box"}, "space": {"size": 1.0, "boundary": "periodic"}}
    scene = changed(scene, star=None, gas={"eos": {"kind": "isothermal", "sound_speed": 1.0}})
    found = problems(scene)
    assert any("a polar grid needs an open plane" in one for one in found), found


def test_own_arrays_have_to_be_at_the_cells():
    scene = closed(changed(DISC, initial=None), grid={"inner": 0.6, "outer": 1.5, "rings": 10, "edges": "closed"})
    sim = Simulation(DISC)
    given = {"pos": sim.gas.pos[:500], "vel": sim.gas.vel[:500], "mass": sim.gas.mass[:500]}
    with pytest.raises(SceneError, match="centroids"):
        Simulation(scene, particles={"gas": given})
    cells = type(sim.effects["gas"].cells)(10, 50, 0.6, 1.5, True)
    own = {"pos": cells.pos, "vel": cells.pos[:, ::-1] * [-1.0, 1.0], "mass": cells.area}
    sim = Simulation(scene, particles={"gas": own})
    sim.run(0.1)


def test_check_prints_the_grid():
    text = report(load_scene(changed(DISC, **DUSTY)))
    assert "polar grid" in text
    assert "gas cells in a drag cell" in text and "gas particles" not in text
    assert "rings of" in text


@pytest.mark.parametrize("cells, count", [(1000, 2), (12_000, 0)])
def test_cells_resolve_the_hill_radius_and_the_softening(cells, count):
    """At r = 1 with q = 3e-4 / 1.3, softening 0.6 H = 0.042; rings of 12 and 42 between 0.6 and 1.5, square cells."""
    scene = load_scene(changed(DISC, gas=DISC["gas"] | {"particles": cells}, companion=PLANET))
    side = float(polar_shape(scene).side(np.array(1.0)))
    lengths = (PLANET["mass"] / MASS / 3.0) ** (1.0 / 3.0), 0.042
    said = [line for line in warnings(scene) if "companion 1" in line]
    expected = [f"is {length / side:.2g} times the side of a cell" for length in lengths if length < 1.5 * side]
    assert len(said) == len(expected) == count
    assert all(words in line for words, line in zip(expected, said, strict=True))


@pytest.mark.parametrize("rings", [5, 40])
def test_the_step_of_long_cells(rings):
    """Viscosity is stable in cells with sides of ratio 6 and 11, and the forecast counts their steps."""
    gas = DISC["gas"] | {"particles": 1000, "grid": {"rings": rings, "edges": "closed"}}
    scene = changed(DISC, run={"until": 0.5 if rings < 10 else 0.12}, gas=gas, alpha_viscosity={"nu": 0.05})
    sim = Simulation(scene)
    expected = expected_steps(sim.scene).number
    sim.gas.vel += 1e-4 * np.random.default_rng(5).standard_normal(sim.gas.vel.shape)
    sim.run()
    radial = polar(sim.gas)[1].reshape(rings, -1)
    assert sim.limited_by == "alpha_viscosity"
    assert sim.state.step > 80
    # Viscosity damps the noise. With the step of square cells of this area it grows by 1.5 and more in a step.
    assert np.abs(radial - radial.mean(axis=1, keepdims=True)).max() < 1e-4
    assert expected == pytest.approx(sim.state.step, rel=0.25)  # the forecast has the edge, the run the first centroid
    assert any("times longer" in text for text in warnings(sim.scene))


@pytest.mark.parametrize(
    "gas, more, name",
    [
        ({"particles": 3100, "grid": {"rings": 7}}, {}, "gas"),  # cells long in radius
        ({"particles": 3100, "grid": {"rings": 90, "edges": "closed"}}, {}, "gas"),  # and in azimuth
        ({"particles": 900, **ADIABATIC}, {}, "gas"),
        ({"particles": 700, "grid": {"rings": 8}}, {"alpha_viscosity": {"nu": 0.013}}, "alpha_viscosity"),
    ],
    ids=["long in radius", "long in azimuth", "adiabatic", "viscous"],
)
def test_a_fixed_step_beyond_the_limit_of_the_cells(gas, more, name):
    """`check` takes the limit at the inner edge, a run at the first centroid, where it is up to 16% longer."""
    scene = changed(DISC, gas=DISC["gas"] | gas, **more)
    sim = Simulation(scene)
    sim.step(1e-6)
    limit = longest_step_of(sim, name)
    for factor, count in ((1.37, 1), (0.81, 0)):
        fixed = load_scene(changed(scene, run=scene["run"] | {"timestep": factor * limit}))
        found = [line for line in warnings(fixed) if "run.timestep" in line]
        assert len(found) == count, found
        if count:
            times = float(re.search(r"is ([\d.]+) times the sound limit at 0.6: lower run.timestep", found[0])[1])
            assert factor * 0.95 < times < factor * 1.2


@pytest.mark.parametrize(
    "key, more",
    [
        ("gas.grid.rings", {"grid": {"rings": 501}}),
        ("gas.grid.inner", {"grid": {"inner": 1.5}}),
        ("gas.grid.outer", {"grid": {"outer": 0.6}}),
        ("gas.grid.outer", {"grid": {"inner": 1.6, "outer": 2.1}}),
        ("gas.grid.inner", {"grid": {"inner": 1.7}}),
    ],
)
def test_grids_without_cells_or_gas_are_refused(key, more):
    (found,) = problems(changed(DISC, gas=DISC["gas"] | more))
    assert key in found


def test_damping_zones_without_cells_and_over_all_cells():
    for zone, word in (([0.2, 0.6], "damps nothing"), ([0.4, 1.6], "all gas is damped")):
        found = [text for text in warnings(load_scene(changed(DISC, damping={"inner": zone}))) if word in text]
        assert len(found) == 1 and "damping.inner" in found[0]
    assert not [t for t in warnings(load_scene(changed(DISC, damping={"outer": [1.4, 1.5]}))) if "damping" in t]


def test_the_number_of_cells_that_resolve_the_scale_height():
    """A grid has at least 40 cells, so fewer gas.particles do not lower the number that is needed."""
    few, more = (
        [t for t in warnings(load_scene(changed(DISC, gas=DISC["gas"] | {"particles": n}))) if "H wide" in t]
        for n in (1, 40)
    )
    assert few == more != []
