"""Drag on a polar grid: conservation and exactness of emsi, drift in a disc against theory, and DustyWaves."""

import numpy as np
import pytest
from polar_cells import MASS, disc_scene, polar, set_polar
from runs import assert_resumes, on_threads, state_bits
from scenes import changed, problems
from scipy.linalg import expm

from discsim import Simulation, load_scene
from discsim.exact import dustywave, nsh
from discsim.numerics.polar import PolarCells

H = 0.07
# With p + q = 3/2 the drift of gas and dust carries the same mass through all radii, so that it is steady.
DISC = disc_scene(0.5, 2.0, 3000, index=0.5, aspect=H) | {
    "dust": {"particles": 2500, "ratio": 0.3},
    "drag": {"law": "stokes-number", "stokes": 0.03, "scheme": "emsi"},
}
EPICYCLE = 2.0 * np.pi / np.sqrt(MASS)  # at r = 1


def stirred(scene=DISC, seed=5, even=0):
    """A disc with random velocities of gas and dust, grains of unequal masses at random places, and no forces.

    even: number of grains that are placed evenly instead.
    """
    if isinstance(scene["dust"], dict):
        scene = changed(scene, dust={"particles": even} if even else {"placement": "random"})
    sim = Simulation(scene)
    rng = np.random.default_rng(seed)
    sim.dust.mass *= rng.uniform(0.2, 3.0, sim.dust.count)
    for p in (sim.gas, sim.dust):
        p.vel += 0.1 * rng.standard_normal(p.vel.shape)
        p.acc[:] = 0.0
    sim.state.acc_unshared = {"gas": np.empty((0, 2)), "dust": np.empty((0, 2))}
    return sim, rng


def kick(sim, dt, heat=None):
    """A kick of gas and dust by the engine of the drag; the velocities change in place."""
    sim.effects["drag"].engine.kick(sim.state, dt, sim.gas.vel, np.empty(0) if heat is None else heat)


def sums(sim):
    """Radial momentum, angular momentum and energy of gas and dust, and the sum of absolute angular momenta."""
    out = np.zeros(4)
    for p in (sim.gas, sim.dust):
        r, radial, around = polar(p)
        energy = 0.5 * p.mass * (p.vel**2).sum(axis=1)
        out += [(p.mass * v).sum() for v in (radial, r * around)] + [energy.sum(), (p.mass * r * abs(around)).sum()]
    return out


TWO_SIZES = [
    {"particles": 900, "ratio": 0.4, "t_stop": 0.02, "placement": "random"},
    {"particles": 1300, "ratio": 1.1, "t_stop": 0.7, "placement": "random"},
]


@pytest.mark.parametrize("dt", [1e-3, 0.1, 1e4])
def test_emsi_conserves_radial_and_angular_momentum(dt):
    sim, _ = stirred()
    before = sums(sim)
    kick(sim, dt)
    after = sums(sim)
    assert after[2] < before[2] * (1.0 - 1e-4)  # drag has acted
    assert np.abs(after[:2] - before[:2]).max() < 1e-14 * before[3]


def test_emsi_conserves_momentum_of_several_populations():
    scene = {**DISC, "dust": TWO_SIZES, "drag": {"law": "stopping-time", "scheme": "emsi"}}
    sim, _ = stirred(scene)
    before = sums(sim)
    kick(sim, 0.1)
    assert np.abs(sums(sim)[:2] - before[:2]).max() < 1e-14 * before[3]


def test_emsi_keeps_the_energy_with_its_heat():
    """The heat of the cells is the kinetic energy that drag removes, also under accelerations."""
    sim, rng = stirred(changed(DISC, gas=DISC["gas"] | {"eos": {"kind": "adiabatic", "gamma": 1.3, "sound_speed": H}}))
    for p in (sim.gas, sim.dust):
        p.acc[:] = rng.standard_normal(p.acc.shape)
    dt, heat = 0.05, np.zeros(sim.gas.count)
    old = [p.vel.copy() for p in (sim.gas, sim.dust)]
    before = sums(sim)[2]
    kick(sim, dt, heat)
    work = sum(
        (p.mass * dt * (p.acc * 0.5 * (p.vel + v)).sum(axis=1)).sum()
        for p, v in zip((sim.gas, sim.dust), old, strict=True)
    )
    lost = before + work - sums(sim)[2]
    assert lost > 0.005 * before
    assert np.isclose((sim.gas.mass * heat).sum(), lost, rtol=1e-11)


@pytest.mark.parametrize("dt", [1e-6, 0.03, 2.0, 1e6])
def test_one_way_slips_relax_exactly(dt):
    """Grains at random positions in gas on circular orbits that is accelerated as r^-2: exact for any dt / t_stop."""
    t_stop, push = 0.03, 0.02
    drag = {"law": "stopping-time", "t_stop": t_stop, "scheme": "emsi", "direction": "one-way"}
    sim, rng = stirred(changed(DISC, drag=None, dust=None) | {"dust": DISC["dust"], "drag": drag})
    r, _, _ = polar(sim.gas)
    set_polar(sim.gas, 0.01 / r**2, np.sqrt(MASS / r))
    sim.state.acc_unshared["gas"] = push * sim.gas.pos / r[:, None] ** 3
    r, _, _ = polar(sim.dust)
    slip = 0.1 * rng.standard_normal((2, sim.dust.count))
    set_polar(sim.dust, 0.01 / r**2 + slip[0], np.sqrt(MASS / r) + slip[1])
    kick(sim, dt)
    _, radial, around = polar(sim.dust)
    gone = np.expm1(-dt / t_stop)
    expected = np.exp(-dt / t_stop) * slip
    expected[0] += (dt + t_stop * gone) * push / r**2
    found = np.stack([radial - 0.01 / r**2, around - np.sqrt(MASS / r)])
    # With one-way drag the kick does not add the source to the velocity of the gas; the grains follow gas that has it.
    assert np.abs(found - expected).max() < 1e-12 * (1.0 + dt)


def test_two_sizes_relax_as_by_the_exponential():
    """Cells of equal masses and uniform slips: gas and both populations of a cell far from the edges."""
    scene = changed(
        DISC, initial=DISC["initial"] | {"surface_density_index": 2.0}, gas=DISC["gas"] | {"particles": 12_000}
    )
    cells = Simulation(changed(scene, dust=None, drag=None)).effects["gas"].cells
    mass = np.full(len(cells.pos), 1e-7)
    masses, times, dt = np.array([1.0, 0.4, 1.1]), np.array([0.02, 0.7]), 0.05
    shift = [np.exp(0.3 * np.log(4.0) / cells.rings), np.exp(-0.1 * np.log(4.0) / cells.rings)]
    dust = {
        "pos": np.concatenate([factor * cells.pos for factor in shift]),
        "vel": np.zeros((2 * len(mass), 2)), "mass": np.concatenate([masses[1] * mass, masses[2] * mass]),
        "species": np.repeat([0, 1], len(mass)),
    }  # fmt: skip
    populations = [{"particles": len(mass), "ratio": m, "t_stop": t} for m, t in zip(masses[1:], times, strict=True)]
    scene = changed(scene, initial=None, star=None, gas=scene["gas"] | {
        "grid": {"inner": 0.5, "outer": 2.0}, "eos": {"kind": "isothermal", "sound_speed": 0.1},
    })  # fmt: skip
    scene |= {"dust": populations, "drag": {"law": "stopping-time", "scheme": "emsi"}}
    gas = {"pos": cells.pos, "vel": np.zeros((len(mass), 2)), "mass": mass}
    sim = Simulation(scene, particles={"gas": gas, "dust": dust})
    sim.gas.acc[:] = sim.dust.acc[:] = 0.0
    sim.state.acc_unshared = {"gas": np.empty((0, 2)), "dust": np.empty((0, 2))}
    start = np.array([[0.0, 0.3, -0.2], [0.1, -0.2, 0.4]])
    for p, which in ((sim.gas, np.zeros(len(mass), int)), (sim.dust, 1 + sim.dust.species)):
        r = np.hypot(*p.pos.T)
        set_polar(p, start[0, which] / r**2, start[1, which] / np.sqrt(r))
    kick(sim, dt)
    eps = masses[1:]
    matrix = np.array(
        [[-(eps / times).sum(), *(eps / times)], [1 / times[0], -1 / times[0], 0], [1 / times[1], 0, -1 / times[1]]]
    )
    exact = start @ expm(dt * matrix).T
    for p, which in ((sim.gas, np.zeros(len(mass), int)), (sim.dust, 1 + sim.dust.species)):
        r, radial, around = polar(p)
        inside = np.abs(np.log(r)) < 0.4
        found = np.stack([radial * r**2, around * np.sqrt(r)])[:, inside]
        assert np.abs(found - exact[:, which[inside]]).max() < 1e-3  # slips vary over a cell: (3 d ln r)^2 / 4 = 0.002


def test_gas_and_dust_on_circular_orbits_have_no_slip():
    """For stiff drag, grains anywhere in their cells, and both senses of rotation."""
    for sense in (1.0, -1.0):
        sim, _ = stirred(changed(DISC, drag={"stokes": 1e-9}))
        before = []
        for p in (sim.gas, sim.dust):
            r = np.hypot(*p.pos.T)
            set_polar(p, 0.0, sense * np.sqrt(MASS / r))
            before.append(p.vel.copy())
        kick(sim, 1.0)
        for p, old in zip((sim.gas, sim.dust), before, strict=True):
            assert np.abs(p.vel - old).max() < 1e-14


def test_a_common_velocity_field_is_hardly_damped():
    """Stiff drag changes a swirl of both, with 40 and 80 cells a wavelength, only at second order in the cells."""
    errors = []
    for cells in (3000, 12_000):
        sim, _ = stirred(changed(DISC, gas=DISC["gas"] | {"particles": cells}, drag={"stokes": 1e-9}), even=12 * cells)
        for p in (sim.gas, sim.dust):
            r, phi = np.hypot(*p.pos.T), np.arctan2(p.pos[:, 1], p.pos[:, 0])
            set_polar(p, 0.1 * np.sin(3.0 * phi + 4.0 * r), np.sqrt(MASS / r) + 0.1 * np.cos(2.0 * phi - 5.0 * r))
        inside = np.abs(np.hypot(*sim.gas.pos.T) - 1.0) < 0.3
        kick(sim, 1.0)  # leaves velocities of the dust that are consistent with those of the gas
        old = sim.gas.vel.copy()
        kick(sim, 1.0)
        errors.append(np.sqrt(np.mean((sim.gas.vel - old)[inside] ** 2)))
    assert errors[1] < 1e-5
    assert errors[0] > 4.0 * errors[1]  # second order: the grains in a cell are not quite even


def drifts(sim, samples=22):
    """Mean radial velocities of dust and gas near r = 1 over the Keplerian one, without epicycles.

    At each radius, the constant of a least-squares fit of a constant and an epicycle over one period.
    """
    sides = sim.effects["gas"].cells.geometry.sides
    start, ring = [], []
    for p in (sim.dust, sim.gas):
        r = np.hypot(*p.pos[np.argsort(p.ids)].T)
        start.append(np.flatnonzero(np.abs(r - 1.0) < 0.15))
        ring.append(np.unique(np.digitize(r[start[-1]], sides), return_inverse=True)[1])
    times, found = [], ([], [])
    for k in range(samples + 1):
        sim.run(EPICYCLE * k / samples)
        times.append(sim.time)
        for p, rows, of, out in zip((sim.dust, sim.gas), start, ring, found, strict=True):
            r, radial, _ = (values[np.argsort(p.ids)][rows] for values in polar(p))
            count = np.bincount(of)
            out.append([np.bincount(of, values) / count for values in (radial * np.sqrt(r / MASS), r)])
    result = []
    for series in map(np.array, found):
        constants = []
        for values, r in zip(series[:, 0].T, series[:, 1].mean(axis=0), strict=True):
            angle = np.sqrt(MASS / r**3) * np.array(times)
            terms = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
            constants.append(np.linalg.lstsq(terms, values, rcond=None)[0][0])
        result.append(np.mean(constants))
    return result


def drift_errors(scheme, stokes, ratio, cells=12_000, at_centroids=False):
    """Relative errors of the drift of dust, of gas, and of dust relative to gas, with as many grains as cells.

    at_centroids: each grain starts at the centroid of a cell, so that all cells have the same dust-to-gas ratio.
    """
    scene = changed(
        DISC, gas=DISC["gas"] | {"particles": cells}, dust={"particles": cells, "ratio": ratio},
        drag={"stokes": stokes, "scheme": scheme},
    )  # fmt: skip
    dust, gas = drifts(with_grains_at_centroids(scene, ratio) if at_centroids else Simulation(closed(scene)))
    exact = nsh.drift_about_circular_orbits([[stokes]], [[ratio]], [0.75 * H**2], [1.0])
    expected = exact.dust_radial[0, 0], exact.gas_radial[0]
    return dust / expected[0] - 1.0, gas / expected[1] - 1.0, (dust - gas) / (expected[0] - expected[1]) - 1.0


def with_grains_at_centroids(scene, ratio):
    """The simulation of a scene with a grain in each cell, which moves as the grains of the scene at its radius."""
    cells = Simulation(closed(scene)).gas.count
    sim = Simulation(closed(changed(scene, dust={"particles": cells, "placement": "random"})))
    r, radial, around = polar(sim.dust)
    order, at = np.argsort(r), np.hypot(*sim.gas.pos.T)
    sim.dust.pos[:], sim.dust.mass[:] = sim.gas.pos, ratio * sim.gas.mass
    set_polar(sim.dust, *(np.interp(at, r[order], (v * np.sqrt(r))[order]) / np.sqrt(at) for v in (radial, around)))
    return sim


def closed(scene):
    return changed(scene, gas=scene["gas"] | {"grid": {"edges": "closed"}})


@pytest.mark.parametrize("stokes, ratio", [(0.03, 0.01), (0.03, 3.0), (1.0, 0.3)])
def test_drift_by_emsi(stokes, ratio):
    """Within 0.5%; (d ln r)^2 is 7e-4, and waves of the grains make the rest."""
    assert np.abs(drift_errors("emsi", stokes, ratio)).max() < 0.005


@pytest.mark.parametrize("stokes, ratio, bound", [(0.03, 0.3, 0.01), (1.0, 3.0, 0.004)])
def test_drift_by_tsc(stokes, ratio, bound):
    """The drag cells are squares that shift, so that the rings of cells have uneven dust-to-gas ratios."""
    assert np.abs(drift_errors("tsc", stokes, ratio)).max() < bound


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.01, 0.3, 3.0])
def test_drift_of_small_grains_by_emsi(ratio):
    """Waves are 1e-8 of the Keplerian velocity, and move gas and dust; the drift of dust is 5e-7 to 7e-6 of it."""
    dust, gas, slip = drift_errors("emsi", 0.001, ratio, 48_000)
    assert abs(slip) < 0.003
    assert max(abs(dust), abs(gas)) < 0.02


def test_drift_of_small_grains_at_centroids():
    """Without noise in the dust-to-gas ratio: second order in the cells, 0.3% with 12,000."""
    assert np.abs(drift_errors("emsi", 0.001, 0.3, at_centroids=True)).max() < 0.004


@pytest.mark.slow
@pytest.mark.parametrize("ratio, cells", [(0.01, 24_000), (0.3, 24_000), (3.0, 64_000)])
def test_drift_of_small_grains_at_centroids_of_small_cells(ratio, cells):
    assert np.abs(drift_errors("emsi", 0.001, ratio, cells, at_centroids=True)).max() < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.01, 0.3, 3.0])
@pytest.mark.parametrize("stokes", [0.03, 1.0])
def test_drift_by_emsi_in_all_mixtures(stokes, ratio):
    assert np.abs(drift_errors("emsi", stokes, ratio)).max() < 0.005


def dusty_wave(rings, t_stop, ratio, time=0.6, scheme="emsi"):
    """Errors (gas, dust) of a standing DustyWave between walls at a large radius, over its amplitude.

    The walls are one wavelength apart, c_s = 1. The wave is the difference of two mirrored ones: at the start the
    velocities are 2 A sin(2 pi x) in uniform gas and dust.
    """
    far, angles, amplitude = 2e4, 8, 1e-5
    cells = PolarCells(rings, angles, far, far + 1.0, True)
    side = np.diff(cells.geometry.sides)
    line = np.concatenate([cells.geometry.sides[:-1] + part * side for part in (0.17, 0.67)])
    phi = np.append(cells.azimuth, cells.azimuth + 0.1)[:angles]
    r, phi = np.repeat(line, angles), np.tile(phi, len(line))
    pos = r[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    particles = {
        "gas": {"pos": cells.pos, "vel": np.zeros_like(cells.pos), "mass": cells.area},
        "dust": {
            "pos": pos, "vel": np.zeros_like(pos), "mass": np.full(len(r), ratio * cells.area.sum() / len(r)),
        },
    }  # fmt: skip
    scene = {
        "units": {"system": "code"},
        "run": {"until": time},
        "space": {"size": 2.1 * far},
        "gas": {
            "method": "grid", "particles": rings * angles, "eos": {"kind": "isothermal", "sound_speed": 1.0},
            "grid": {"inner": far, "outer": far + 1.0, "rings": rings, "edges": "closed"},
        },
        "dust": {"particles": len(r), "ratio": ratio},
        "drag": {"law": "stopping-time", "t_stop": t_stop, "scheme": scheme},
    }  # fmt: skip
    sim = Simulation(scene, particles=particles)
    for p in (sim.gas, sim.dust):
        set_polar(p, 2.0 * amplitude * np.sin(2.0 * np.pi * (np.hypot(*p.pos.T) - far)), 0.0)
    sim.run(time)
    errors = []
    for name, p in (("gas_velocity", sim.gas), ("dust_velocity", sim.dust)):
        x, radial, _ = polar(p)
        x = x - far
        exact = sum(
            sign * getattr(dustywave.solution(sign * x, time, ratio / t_stop, ratio, 1.0, amplitude), name)
            for sign in (1.0, -1.0)
        )
        errors.append(np.sqrt(np.mean((radial - exact) ** 2)) / amplitude)
    return np.array(errors)


@pytest.mark.parametrize("t_stop, ratio, bound", [(1e-4, 1.0, 0.004), (0.1, 0.7, 0.004), (3.0, 2.0, 0.004)])
def test_dusty_wave(t_stop, ratio, bound):
    """From stiff to loose drag: error over the amplitude, and second order from 32 to 64 cells a wavelength."""
    coarse, fine = (dusty_wave(rings, t_stop, ratio).max() for rings in (32, 64))
    assert fine < bound
    assert fine < coarse / 2.8  # 4 but for the grains, which are not quite even


# All that acts on gas and dust of a polar grid at once, with a law that depends on the slip.
MANY = changed(
    DISC,
    gas={"eos": {"kind": "adiabatic", "gamma": 1.3, "aspect_ratio": H}},
    star={"accretion_radius": 0.45},
    companion={"mass": 3e-4, "semi_major_axis": 1.0, "softening": 0.6},
    alpha_viscosity={"alpha": 0.01},
    damping={"inner": [0.5, 0.6], "outer": [1.8, 2.0]},
    cooling={"kind": "beta", "beta": 10.0},
    self_gravity={"softening": 0.05},
) | {
    "dust": [
        {"particles": 700, "ratio": 0.1, "grain_size": 3e-6, "grain_density": 2.0},
        {"particles": 900, "ratio": 0.2, "grain_density": 2.0,
         "grain_size": {"smallest": 1e-6, "largest": 1e-4, "index": 3.2}},
    ],
    "drag": {"law": "epstein", "supersonic": True, "heating": True, "scheme": "emsi"},
}  # fmt: skip


def test_bits_after_a_resume_with_emsi(tmp_path):
    sim = assert_resumes(load_scene(MANY), tmp_path / "checkpoint", 0.11, 0.25)
    times = sim.effects["drag"].stopping_times
    assert np.isfinite(times).mean() > 0.99
    assert times.max() > 10.0 * times.min()


def test_bits_of_emsi_on_several_threads(monkeypatch):
    for module in ("discsim.numerics.polar", "discsim.drag.polar"):
        monkeypatch.setattr(f"{module}.CHUNK", 200)
    found = []
    for _ in on_threads(monkeypatch):
        sim = Simulation(MANY)
        sim.run(0.15)
        found.append(state_bits(sim))
    assert found[0] == found[1]


def test_one_way_emsi_leaves_the_bits_of_the_gas():
    alone = Simulation(changed(DISC, dust=None, drag=None))
    dusty = Simulation(changed(DISC, drag={"direction": "one-way"}))
    for sim in (alone, dusty):
        sim.run(0.5)
    for name in ("pos", "vel", "mass"):
        assert np.array_equal(getattr(alone.gas, name), getattr(dusty.gas, name))


def test_grains_beyond_the_edges_are_free():
    sim, rng = stirred()
    out = sim.dust.pos[:3] * 6.0
    sim.dust.pos[:3] = out
    sim.dust.acc[:] = rng.standard_normal(sim.dust.acc.shape)
    before = sim.dust.vel[:3].copy()
    kick(sim, 0.2)
    assert np.allclose(sim.dust.vel[:3], before + 0.2 * sim.dust.acc[:3], rtol=1e-15)
    assert np.all(np.isinf(sim.effects["drag"].stopping_times[:3]))
    assert np.isclose(sim.effects["drag"].uncoupled, sim.dust.mass[:3].sum() / sim.dust.mass.sum())


@pytest.mark.parametrize("stokes", [1e-3, 0.2])
def test_implicit_integration_has_the_drift_of_the_exponential(stokes):
    """Backward Euler has the same steady slip at any step."""
    found = []
    for integration in ("exponential", "implicit"):
        sim = Simulation(changed(DISC, drag={"stokes": stokes, "integration": integration}))
        sim.run(1.0)
        r, radial, _ = polar(sim.dust)
        found.append(radial[np.abs(r - 1.0) < 0.15].mean())
    assert np.isclose(*found, rtol=0.02)  # epicycles of the start decay at first order in dt / t_stop


def test_messages_of_emsi():
    of_sph = changed(DISC, gas={"method": "sph"})
    assert any('drag.scheme: drag.scheme "emsi" needs gas on a polar grid' in one for one in problems(of_sph))
    found = problems(changed(DISC, drag={"cell": 2.0}))
    assert any('scheme "emsi" has the cells of the gas as drag cells; remove this key' in one for one in found), found
