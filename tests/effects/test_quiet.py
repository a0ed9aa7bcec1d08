"""Quiet gas: density that follows the flow, the push of rings, and what the two leave of the noise of forces."""

import numpy as np
import pytest
from runs import on_threads, state_bits
from scenes import problems

from discsim import SceneError, Simulation
from discsim.effects.quiet import QuietDisc
from discsim.kernels.sph.quiet import follow_density
from discsim.numerics.operators import accelerate
from discsim.run.forces import acceleration_of
from discsim.scene import load_scene

GAS = {
    "particles": 3000,
    "kernel": "wendland-c4",
    "eta": 1.9,
    "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.11, "temperature_index": 0.7, "reference_radius": 2.0},
    "quiet": {"share": 0.8, "time": 4.0, "guard": 0.6},
}

MANY = 8000  # some 300 in a ring, so that n^2 / (n^2 + 30^2) is .99


def disc(quiet=GAS["quiet"], **more):
    gas = {key: value for key, value in GAS.items() if key != "quiet"} | {"quiet": quiet}
    if quiet is None:
        del gas["quiet"]
        gas["viscosity"] = {"alpha": 0.3, "beta": 0.5, "pairs": "reconstructed"}
    tables = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 14.0},
        "initial": {"kind": "disc", "mass": 0.02, "inner": 1.2, "outer": 4.0, "surface_density_index": 1.3},
        "gas": gas,
        "star": {"mass": 1.4},
    }
    for name, table in more.items():
        merges = isinstance(table, dict) and name in tables
        tables[name] = {**tables[name], **table} if merges else table
    return tables


def shaken(sim, by=0.3):
    """The particles of a simulation moved at random by a share of their spacing."""
    gas = sim.gas
    rng = np.random.default_rng(5)
    gas.pos += by * gas.h[:, None] / 1.9 * rng.uniform(-1.0, 1.0, gas.pos.shape)
    return sim


def forces(sim):
    return acceleration_of(sim.effects["gas"], sim.state)["gas"]


def within(gas, near=2.0, far=3.2):
    r = np.hypot(*gas.pos.T)
    return (r > near) & (r < far)


def followed(div, dt, steps, start=0.7, summed=0.7, memory=1e9, omega=1.3, sound=0.4, size=0.2):
    """Density after steps of `follow` in a flow of one divergence, where sums find another density."""
    one = [np.array([value]) for value in (start, div, 0.0, 0.0)]
    slopes = np.array([[0.4 * div, 0.3, 0.6 * div]])
    for k in range(1, steps + 1):
        pressure = np.array([sound**2 * summed])
        given = np.array([omega]), slopes, np.array([summed]), pressure, np.array([sound]), np.array([1.0 / size])
        follow_density(0, 1, k * dt, memory, *given, *one)
    return float(one[0][0]), float(pressure[0]), float(one[2][0])


def test_density_follows_the_divergence_of_the_flow():
    """rho = rho_0 exp(-div v t), and pressure is c_s^2 of it."""
    density, pressure, shock = followed(div=0.35, dt=0.02, steps=40)
    assert density == pytest.approx(0.7 * np.exp(-0.35 * 0.8), rel=1e-9)  # by 1 / memory
    assert pressure == pytest.approx(0.16 * density, rel=1e-14) and shock == 0.0


def test_density_becomes_the_summed_one_in_the_time_asked_for():
    """The ratio of the two falls as exp(-t Omega / time)."""
    density, _, _ = followed(div=0.0, dt=0.05, steps=30, start=0.9, summed=0.6, memory=2.5)
    assert np.log(density / 0.6) == pytest.approx(np.log(1.5) * np.exp(-1.5 * 1.3 / 2.5), rel=1e-12)


def test_density_stays_within_a_factor_of_three_of_the_summed_one():
    """However long a flow diverges, or converges too slowly for a shock: of few particles such slopes are noise."""
    density, pressure, _ = followed(div=0.35, dt=0.5, steps=40)
    assert density == pytest.approx(0.7 / 3.0, rel=1e-12) and pressure == pytest.approx(0.16 * density, rel=1e-12)
    density, _, shock = followed(div=-0.25, dt=0.5, steps=40)
    assert shock == 0.0 and density == pytest.approx(0.7 * 3.0, rel=1e-12)


def test_a_particle_at_an_edge_whose_density_has_run_down_is_not_torn_away():
    """The push is inversely proportional to the density. Without a bound it was 600 times the force here."""
    sims = [Simulation(disc()) for _ in range(2)]
    for sim, share in zip(sims, (1.0, 1e-3), strict=True):
        sim.step(1e-9)
        first = np.hypot(*sim.gas.pos.T).argmin()
        sim.gas.followed[first] *= share
        for _ in range(2):  # a step begins with the forces of the last one
            sim.step(1e-9)
    pulls = [np.hypot(*sim.gas.acc[np.hypot(*sim.gas.pos.T).argmin()]) for sim in sims]
    assert pulls[1] < 4.0 * pulls[0]


def test_in_a_shock_the_density_is_soon_the_summed_one():
    """Compressed by .8 c_s/h it is in 10 c_s/h; by .1 c_s/h it is no shock."""
    density, _, shock = followed(div=-1.6, dt=0.05, steps=8, start=0.3, summed=0.9)
    assert shock == 1.0 and density == pytest.approx(0.9, rel=0.1)
    density, _, shock = followed(div=-0.2, dt=0.05, steps=8, start=0.3, summed=0.9)
    assert shock == 0.0 and density == pytest.approx(0.3 * np.exp(0.08), rel=1e-6)


def test_a_shock_is_remembered_for_five_crossings():
    state = [np.array([value]) for value in (0.5, 0.0, 1.0, 0.0)]
    given = np.array([1.3]), np.zeros((1, 3)), np.array([0.5]), np.array([0.08]), np.array([0.4]), np.array([5.0])
    follow_density(0, 1, 2.0, 1e9, *given, *state)
    assert state[2][0] == pytest.approx(np.exp(-2.0 / (5.0 * 0.2 / 0.4)), rel=1e-12)


def test_the_first_density_is_the_summed_one():
    sims = [Simulation(disc(quiet)) for quiet in (GAS["quiet"], None)]
    for sim in sims:
        sim.step(1e-9)
    np.testing.assert_allclose(sims[0].gas.followed, sims[1].gas.density, rtol=1e-7)  # of so short a step
    inside = within(sims[0].gas)  # edges are no rings
    np.testing.assert_allclose(sims[0].gas.density[inside], sims[0].gas.followed[inside], rtol=0.02)


def test_with_no_share_and_no_memory_forces_are_those_of_plain_gas():
    """Density relaxes within 1e-12 / Omega, and no pressure is taken out of the pairs."""
    sims = [shaken(Simulation(disc(quiet))) for quiet in ({"share": 0.0, "time": 1e-12}, None)]
    for sim in sims:
        sim.step(0.01)
        sim.step(0.01)
    np.testing.assert_allclose(sims[0].gas.pos, sims[1].gas.pos, rtol=1e-13)
    np.testing.assert_allclose(sims[0].gas.vel, sims[1].gas.vel, rtol=1e-11, atol=1e-12)


def test_the_push_is_the_share_of_the_pull_of_a_smooth_disc():
    """-(1/Sigma) d(f Sigma c_s^2)/dr = f (p + q) c_s^2 / r away from the edges, where rings are even: sigma is of the
    lattice. Pairs feel the rest.
    """
    sim = Simulation(disc({"share": 0.4, "guard": 0.6}, gas={"particles": MANY}))
    sim.step(1e-6)
    gas, effect = sim.gas, sim.effects["gas"]
    pressure, push, _ = effect.quiet.pair_pressure(sim.state)
    inside = within(gas)
    r = np.hypot(*gas.pos.T)
    radial = (push * gas.pos).sum(axis=1) / r
    wanted = 0.4 * 2.0 * gas.sound_speed**2 / r
    # Particles of the lattice are nearer to one ring or the other: some per cent, and more from ring to ring.
    assert radial[inside].mean() == pytest.approx(wanted[inside].mean(), rel=0.05)
    assert np.std((radial / wanted)[inside]) < 0.35
    across = push[:, 0] * gas.pos[:, 1] - push[:, 1] * gas.pos[:, 0]
    assert np.abs(across).max() < 1e-16 and np.all(pressure[inside] > 0.0)
    np.testing.assert_allclose((pressure / gas.pressure)[inside], 0.6, atol=0.06)


def test_the_guard_lowers_the_share_by_the_scatter_of_the_density():
    """Particles have 1.4 or 1 / 1.4 of the mean density, so that sigma = ln 1.4 and rings take 1 - 2 ln 1.4 of P."""
    sim = Simulation(disc({"share": 0.9, "guard": 2.0}))
    sim.step(1e-6)
    gas = sim.gas
    factor = np.where(gas.ids % 2 == 0, 1.4, 1.0 / 1.4)
    smooth = gas.pressure / gas.sound_speed**2
    gas.pressure *= factor
    gas.followed *= factor
    pressure, _, _ = sim.effects["gas"].quiet.pair_pressure(sim.state)
    inside = within(gas)
    taken = (gas.pressure - pressure)[inside] / (smooth * gas.sound_speed**2)[inside]
    assert taken.mean() == pytest.approx(1.0 - 2.0 * np.log(1.4), rel=0.12)  # edges and what rings have by themselves


def test_others_take_densities_that_have_the_mass_of_their_ring():
    """Densities that are .85 of it are corrected; in rings with a scatter of .3 they stay as they are."""
    found = []
    for scatter in (0.0, 0.3):
        sim = Simulation(disc(gas={"particles": MANY}))
        sim.step(1e-6)
        gas = sim.gas
        smooth = gas.density.copy()
        factor = 0.85 * np.exp(np.where(gas.ids % 2 == 0, scatter, -scatter))
        gas.followed *= factor
        accelerate(sim.effects["gas"], sim.state)
        inside = within(gas)
        found.append(np.exp(np.log(gas.density / smooth)[inside].mean()))
        np.testing.assert_allclose(gas.pressure, gas.density * gas.sound_speed**2, rtol=1e-12)
    assert found[0] == pytest.approx(1.0, abs=0.02) and found[1] == pytest.approx(0.85, rel=3e-3)  # rings of 300


@pytest.mark.parametrize("gravitates", [True, False])
def test_density_takes_the_eccentric_pattern_of_the_mass(gravitates):
    """In self-gravity. Azimuths are changed by .08 sin(phi - .7), so that there is .08 less mass at .7.

    Only forces are found, there is no step. m = 2 of the mass, .08^2 / 2 of it, is not taken.
    """
    gravity = {"self_gravity": {"softening": 0.3}} if gravitates else {}
    sim = Simulation(disc(gas={"particles": 24_000}, **gravity))  # some 900 in a ring
    sim.step(1e-6)
    gas, quiet = sim.gas, sim.effects["gas"].quiet
    r, phi = np.hypot(*gas.pos.T), np.arctan2(gas.pos[:, 1], gas.pos[:, 0])
    moved = phi + 0.08 * np.sin(phi - 0.7)
    gas.pos[:] = r[:, None] * np.column_stack([np.cos(moved), np.sin(moved)])
    before, pressure = gas.followed.copy(), gas.pressure.copy()
    for _ in range(5):
        quiet.pair_pressure(sim.state)
    inside = within(gas)
    if not gravitates:
        np.testing.assert_array_equal(gas.followed, before)
        return
    change = np.log(gas.followed / before)[inside]
    found = 2.0 * np.mean(change * np.exp(1j * moved[inside]))
    assert found == pytest.approx(-0.08 * np.exp(0.7j), abs=0.006)  # rings of the lattice
    assert abs(2.0 * np.mean(change * np.exp(2j * moved[inside]))) < 0.004
    np.testing.assert_allclose(gas.pressure / pressure, gas.followed / before, rtol=1e-12)


def test_quiet_gas_feels_what_the_share_leaves_of_the_noise_of_disorder():
    """Forces of shaken particles whose followed density is still the smooth one, less the mean pull."""
    noise = {}
    for name, quiet in (("quiet", {"share": 0.9, "time": 1e9, "guard": 0.0}), ("plain", None)):
        sim = Simulation(disc(quiet, gas={"particles": MANY}))
        sim.step(1e-6)
        before = forces(sim)
        inside = within(sim.gas)
        after = forces(shaken(sim))
        noise[name] = np.sqrt(((after - before)[inside] ** 2).mean())
    assert noise["quiet"] < 0.15 * noise["plain"]


COMPANION = {"mass": 0.2, "semi_major_axis": 0.6, "eccentricity": 0.3, "orbit": "live", "softening": 0.1}


@pytest.mark.parametrize("centre", ["star", "barycentre"])
def test_quiet_gas_keeps_momentum_and_angular_momentum_beside_live_stars(centre):
    """Also where it is lopsided, and shaken: all forces within it sum to nothing, and have no torque."""
    star = {"mass": 1.4, "frame": "inertial", "centre": centre, "indirect": ["companions", "gas"]}
    sim = shaken(Simulation(disc(star=star, companion=COMPANION)))
    gas = sim.gas
    gas.pos[gas.pos[:, 0] > 1.0] *= 1.05
    gas.mass *= np.where(gas.ids % 3 == 0, 1.6, 0.7)
    acc = forces(sim)
    size = (gas.mass[:, None] * np.abs(acc)).sum()
    assert np.abs((gas.mass[:, None] * acc).sum(axis=0)).max() < 1e-14 * size
    torque = gas.mass * (gas.pos[:, 0] * acc[:, 1] - gas.pos[:, 1] * acc[:, 0])
    assert abs(torque.sum()) < 1e-14 * np.abs(torque).sum()


def test_quiet_gas_keeps_its_angular_momentum_about_a_star():
    sim = shaken(Simulation(disc()))
    gas = sim.gas
    sim.step()

    def spin():
        return (gas.mass * (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0])).sum()

    before = spin()
    for _ in range(12):
        sim.step()
    gas = sim.gas
    assert spin() == pytest.approx(before, rel=3e-15)  # rounding of 12 steps


def test_a_particle_beyond_all_rings_is_left_alone():
    """Rings of a flared disc end at infinity. One far beyond is in none, and the others feel the same."""
    sims = [Simulation(disc()) for _ in range(2)]
    far = sims[1].gas
    far.pos[np.argmax(np.hypot(*far.pos.T))] = 1e12, 0.0
    for sim in sims:
        sim.step(1e-9)
    pushes = [sim.effects["gas"].quiet.pair_pressure(sim.state)[1][np.argsort(sim.gas.ids)] for sim in sims]
    inside = within(sims[0].gas)[np.argsort(sims[0].gas.ids)]
    np.testing.assert_allclose(pushes[1][inside], pushes[0][inside], rtol=1e-3, atol=1e-9)
    assert np.isfinite(pushes[1]).all()


def test_asking_for_forces_leaves_what_is_followed_alone():
    sim = Simulation(disc())
    sim.step()
    before = state_bits(sim)
    forces(sim)
    assert state_bits(sim) == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gas": {"viscosity": {"alpha": 0.4, "pairs": "all"}}}, "velocity gradients of the reconstruction"),
        ({"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4, "aspect_ratio": 0.1}}}, "has no energy"),
        ({"gas": {"eos": {"kind": "polytropic", "gamma": 1.4, "constant": 0.1}}}, "has no energy"),
    ],
)
def test_quiet_gas_is_refused_where_it_has_no_meaning(changes, words):
    (found,) = problems(disc(**changes))
    assert words in found


def plane(quiet, boundary="periodic", along=1):
    """A square lattice of particles whose columns are displaced by a sine, along themselves or (0) across."""
    rows = 20
    spacing = 1.6 / rows
    x, y = (a.ravel() for a in np.meshgrid(*[(np.arange(n) + 0.5) * spacing for n in (rows, rows // 2)], indexing="ij"))
    wave = np.sin(2.0 * np.pi * x / 1.6)
    tables = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": [1.6, 0.8], "boundary": boundary},
        "gas": {"kernel": "wendland-c4", "eta": 1.9, "eos": {"kind": "isothermal", "sound_speed": 0.3}, "quiet": quiet},
    }
    if boundary == "periodic":
        tables["space"]["cells"] = 20
    pos = np.stack([x, y], axis=1)
    pos[:, along] += 1e-5 * wave
    particles = {"gas": {"pos": pos, "vel": np.zeros_like(pos), "mass": np.full(len(x), 0.7 * spacing**2)}}
    return tables, particles, wave


def stiffness(quiet, along=1):
    """Mean of the acceleration along the displacement times the sine."""
    tables, particles, wave = plane(quiet, along=along)
    sim = Simulation(tables, particles=particles)
    acc = forces(sim)
    assert np.abs(acc.sum(axis=0)).max() < 1e-13  # of c_s^2 over the spacing; masses are equal
    return (acc[np.argsort(sim.gas.ids), along] * wave).mean()


def test_a_quiet_lattice_resists_shear_by_what_its_share_leaves():
    """As a crystal does by the mean pressure: 1 - .8 of it, to the .2% by which summed densities are off the mean."""
    plain, quiet = stiffness(False), stiffness({"share": 0.8, "guard": 0.0})
    assert abs(plain) > 1e-9 and quiet / plain == pytest.approx(0.2, rel=0.02)


def test_sound_of_a_quiet_plane_is_as_slow_as_it_is_fast_without():
    """On a lattice with kh = .6; the error of both falls with (kh)^2."""
    wave = 2.0 * np.pi / 1.6
    speeds = [np.sqrt(-2.0 * stiffness(quiet, along=0) / 1e-5) / (0.3 * wave) for quiet in (False, {"guard": 0.0})]
    assert 1.01 < speeds[0] < 1.06 and 0.94 < speeds[1] < 0.99


def test_a_guard_leaves_a_box_its_pressure():
    """1 - guard sigma of it is taken; densities of every second column are 1.3 and 1 / 1.3 of the mean."""
    tables, particles, _ = plane({"share": 0.9, "guard": 2.5})
    sim = Simulation(tables, particles=particles)
    forces(sim)
    gas, effect = sim.gas, sim.effects["gas"]
    gas.density[:] = 0.7 * np.where(gas.ids // 10 % 2 == 0, 1.3, 1.0 / 1.3)
    gas.pressure[:], gas.sound_speed[:] = 0.09 * gas.density, 0.3
    with effect.quiet.split_pressure(sim.state, effect.sph) as pressure:
        taken = gas.pressure - pressure
    np.testing.assert_allclose(taken, 0.09 * 0.7 * (1.0 - 2.5 * np.log(1.3)), rtol=1e-12)


def test_quiet_gas_wants_a_star_or_a_periodic_plane():
    tables, particles, _ = plane(True, boundary="open")
    with pytest.raises(SceneError, match=r"gas.quiet: quiet gas needs a disc about a star, or a periodic 2D space"):
        Simulation(tables, particles=particles)


def test_quiet_gas_has_a_kernel_and_a_viscosity_of_its_own_unless_they_are_named():
    scene = load_scene(disc(quiet=True))
    assert (scene.gas.viscosity.alpha, scene.gas.viscosity.pairs) == (0.3, "reconstructed")
    assert (scene.gas.quiet.share, scene.gas.quiet.time, scene.gas.quiet.guard) == (0.9, 10.0, 0.75)
    bare = disc(quiet=True)
    del bare["gas"]["kernel"], bare["gas"]["eta"]
    assert (load_scene(bare).gas.kernel, load_scene(bare).gas.eta) == ("wendland-c4", 1.7)
    plain = disc(quiet=False)
    assert load_scene(plain).gas.quiet is None and load_scene(plain).gas.viscosity is None


@pytest.mark.parametrize("index", [0.0, 0.7, 1.0, 1.6])
def test_rings_are_four_tenths_of_a_scale_height_wide(index):
    """In discs of any flaring; places and radii are each other's inverse."""
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.11, "temperature_index": index, "reference_radius": 2.0}
    rings = QuietDisc(load_scene(disc(gas={**GAS, "eos": eos})))
    r = np.array([1.3, 2.0, 3.7])
    places = rings._ring_coordinates(r)
    np.testing.assert_allclose(rings._ring_radii(places), r, rtol=1e-12)
    height = 0.11 * r * (r / 2.0) ** (0.5 * (1.0 - index))
    width = (rings._ring_radii(places + 1e-4) - rings._ring_radii(places - 1e-4)) / 2e-4
    np.testing.assert_allclose(width, 0.4 * height, rtol=1e-6)


def test_a_quiet_disc_goes_on_with_the_same_bits(tmp_path, monkeypatch):
    """From a checkpoint, and on two threads."""
    sims = [shaken(Simulation(disc(companion=COMPANION))) for _ in range(2)]
    for _ in range(3):
        sims[0].step()
    sims[0].save(tmp_path / "a.h5")
    sims[1].restore(tmp_path / "a.h5")
    for _ in range(3):
        sims[0].step()
    for _ in on_threads(monkeypatch, (2,), least=8):
        for _ in range(3):
            sims[1].step()
    assert state_bits(sims[0]) == state_bits(sims[1])
