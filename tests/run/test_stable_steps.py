"""How long steps may be: the bound of leapfrog on sound between particles and on orbits, and gas that is torn apart."""

from types import SimpleNamespace

import numpy as np
import pytest
from runs import state_bits

from discsim import Simulation
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.operators import accelerate
from discsim.run import guards
from discsim.run.forces import PhysicsError
from discsim.scene import SceneError, load_scene, rules

COUNT, SPEED = 12, 1.3  # particles along a side, and of sound


def box(kernel, alpha=0.3, count=COUNT, shaken=0.0, pairs="all", **run):
    """Gas on a lattice in a periodic square, each particle shaken by a part of the spacing."""
    place = (np.arange(count) + 0.5) / count
    pos = np.stack(np.meshgrid(place, place, indexing="ij"), axis=-1).reshape(-1, 2)
    pos = (pos + shaken / count * np.random.default_rng(3).uniform(-1, 1, pos.shape)) % 1.0
    tables = {
        "units": {"system": "code"},
        "run": {"until": 1e9, "threads": 1} | run,
        "space": {"size": 1.0, "boundary": "periodic"},
        "gas": {
            "particles": count**2,
            "kernel": kernel,
            "eos": {"kind": "isothermal", "sound_speed": SPEED},
            "viscosity": {"alpha": alpha, "beta": 2 * alpha, "pairs": pairs},
        },
    }
    gas = {"pos": pos, "vel": np.zeros_like(pos), "mass": np.full(count**2, 1.0 / count**2)}
    return Simulation(tables, particles={"gas": gas})


def fixed(kernel, courant, alpha=0.3, count=COUNT):
    """The step of so many times sound's limit in even gas."""
    h = SMOOTHING[kernel].eta[1] / count / SMOOTHING[kernel].squeezed
    return courant * h / (SPEED * (1 + 1.2 * alpha))


@pytest.mark.parametrize("kernel", SMOOTHING)
def test_fastest_sound_of_a_lattice(kernel):
    """The largest frequency of small motions, from the forces on a lattice with each particle moved a little."""
    sim = box(kernel)
    sim.step(1e-9)
    gas, effect = sim.gas, sim.effects["gas"]
    start, small = gas.pos.copy(), 1e-6 / COUNT

    def forces():
        gas.acc[:] = 0.0
        gas.vel[:] = 0.0
        accelerate(effect, sim.state)
        return gas.acc.ravel().copy()

    matrix = np.empty((start.size, start.size))
    for column in range(start.size):
        found = []
        for sign in (1.0, -1.0):
            gas.pos[:] = start
            gas.pos[divmod(column, 2)] += sign * small
            found.append(forces())
        matrix[:, column] = (found[0] - found[1]) / (2 * small)
    fastest = np.sqrt(-np.linalg.eigvals(matrix).real.min()) / SPEED * gas.h.mean() / SMOOTHING[kernel].squeezed
    assert fastest == pytest.approx(SMOOTHING[kernel].fastest[1], rel=0.03)  # 12 a side have not each wavelength


@pytest.mark.parametrize("kernel, alpha", [("cubic", 0.0), ("quintic", 0.3), ("wendland-c4", 0.3)])
def test_noise_dies_below_the_bound_and_grows_beyond_it(kernel, alpha):
    """Shaken particles after 60 steps of 2/3 and of 4/3 of the bound, with the damping of alpha."""
    bound = 2.0 / SMOOTHING[kernel].fastest[1] * (1.0 + 0.5 * min(1.0, alpha / 0.3))
    speeds = []
    for share in (0.67, 1.33):
        sim = box(kernel, alpha, shaken=0.1, timestep=fixed(kernel, share * bound, alpha))
        try:
            sim.evolve(1e9, lambda sim=sim: sim.state.step >= 60)
            speeds.append(np.sqrt((sim.gas.vel**2).sum(axis=1).mean()) / SPEED)
        except PhysicsError:
            speeds.append(np.inf)  # by one of the guards
    assert speeds[0] < 0.1 and speeds[1] > 2.0 * speeds[0] + 0.02


@pytest.mark.parametrize("alpha", [0.4, 2.0])
def test_reconstructed_viscosity_is_stable_up_to_the_bound(alpha):
    """It brakes the shortest waves as the others do, so that its limit falls with alpha as theirs: 1 + 1.2 alpha."""
    bound = 2.0 / SMOOTHING["wendland-c4"].fastest[1]
    speeds = []
    for share in (0.97, 1.4):
        step = fixed("wendland-c4", share * bound, alpha)
        sim = box("wendland-c4", alpha, shaken=0.1, pairs="reconstructed", timestep=step)
        try:
            sim.evolve(1e9, lambda sim=sim: sim.state.step >= 60)
            speeds.append(np.sqrt((sim.gas.vel**2).sum(axis=1).mean()) / SPEED)
        except PhysicsError:
            speeds.append(np.inf)
    assert speeds[0] < 0.01 < speeds[1]


@pytest.mark.parametrize("times, kept", [(1.1, True), (1.35, False)])
def test_orbits_are_kept_up_to_the_bound(times, kept):
    """A ring of grains, steps in 1/Omega of its inner edge: energies stay of one sign, or grains leave."""
    n = 60
    r, phi = np.linspace(2.0, 2.4, n), np.random.default_rng(5).uniform(0, 2 * np.pi, n)
    out = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    vel = np.sqrt(0.7 / r)[:, None] * np.stack([-out[:, 1], out[:, 0]], axis=1)
    tables = {
        "units": {"system": "code"},
        "run": {"until": 1e9, "timestep": times * (2.0**3 / 0.7) ** 0.5},
        "space": {"size": 16.0},
        "star": {"mass": 0.7, "softening": 1e-9},  # whose pull is in the kick
        "dust": {"particles": n, "ratio": 0.1},
    }
    dust = {"pos": r[:, None] * out, "vel": vel, "mass": np.full(n, 1e-9)}
    sim = Simulation(tables, particles={"dust": dust})
    sim.run(until=400.0)
    energy = 0.5 * (sim.dust.vel**2).sum(axis=1) - 0.7 / np.hypot(*sim.dust.pos.T)
    assert (energy.max() < 0.0) == kept


def message(overrides, path="setups/gas_disc.toml"):
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    (line,) = str(caught.value).splitlines()
    return line


def test_a_courant_factor_beyond_the_bound_is_one_message():
    assert (
        "run.courant: the value 2.3 gives time steps so long that orbits about the star are unstable; "
        "expected at most 2.2" in message(["run.courant=2.3"], "setups/star_dust.toml")
    )
    undamped = ["run.courant=0.9", "gas.kernel=wendland-c4", "gas.viscosity.alpha=0.0"]
    assert 'sound waves are unstable with kernel "wendland-c4"; expected at most 0.7' in message(undamped)
    assert "expected at most 0.76" in message(["run.courant=0.8"], "setups/dusty_wave.toml")
    warm = "run.courant: the value 0.61 gives time steps so long that cold gas gets a negative energy; expected at most"
    assert f"{warm} 0.6" in message(["run.courant=0.61"], "setups/gravitoturbulent.toml")
    load_scene("setups/gravitoturbulent.toml", ["run.courant=0.69", "gas.viscosity.pairs=all"])
    load_scene("setups/gas_disc.toml", ["run.courant=0.8"])
    load_scene("setups/dusty_box.toml", ["run.courant=50"])  # nothing moves but by drag, which is exact


@pytest.mark.parametrize(
    "kernel, alpha, courant, integrator",
    [("wendland-c4", 0.3, 1.3, "kdk"), ("cubic", 0.0, 1.6, "kdk"), ("cubic", 0.0, 1.2, "euler")],
)
def test_gas_that_is_torn_apart_stops_the_run(kernel, alpha, courant, integrator, monkeypatch):
    """Steps beyond the bound, which a scene is otherwise refused for: by one mode that grows, and by noise."""
    monkeypatch.setattr(rules, "longest_courant", lambda draft: (np.inf, ""))
    sim = box(kernel, alpha, shaken=0.2, count=24, courant=courant, integrator=integrator)
    with pytest.raises(PhysicsError, match=r"the gas is numerically unstable: .* the sound speed; .*lower run.courant"):
        sim.run(until=10.0)


@pytest.mark.parametrize("swings", [False, True])
def test_gas_is_watched_in_whatever_order_it_is(swings):
    """Rows are sorted, and particles leave, between three steps about a star of mass 1.7 that is not at the origin."""
    rng, count, dt, centre = np.random.default_rng(5), 3000, 0.02, np.array([0.3, -0.2])
    start, kick = rng.normal(size=(count, 2)), rng.normal(size=(count, 2)) * 0.4 * SPEED / dt
    pos = centre + rng.uniform(0.5, 2.0, (count, 1)) * np.array([0.6, 0.8])
    watch, scene = guards.ReversalGuard(), box("quintic", timestep=dt).state.scene
    for step in (17, 18, 19):
        ids = rng.permutation(count)[: count - 40 * step]
        away = pos[ids] - centre
        acc = start[ids] + kick[ids] * ((step % 2) if swings else step)
        acc -= 1.7 * away / ((away**2).sum(axis=1)[:, None] + 0.1**2) ** 1.5
        gas = SimpleNamespace(
            ids=ids, pos=pos[ids], acc=acc, count=len(ids), global_count=len(ids), sound_speed=np.full(len(ids), SPEED)
        )
        state = SimpleNamespace(
            gas=gas, step=step, time=dt * step, central=(1.7, 0.1), from_centre=lambda x: x - centre,
            scene=scene,
        )  # fmt: skip
        if swings and step == 19:
            with pytest.raises(PhysicsError, match=r"the gas is numerically unstable: .* lower run\.timestep"):
                watch.check(state, {})
        else:
            watch.check(state, {})
    assert len(watch.samples) == 3


def test_shaken_gas_in_steps_below_the_bound_goes_on():
    sim = box("wendland-c4", 0.05, shaken=0.3, courant=0.7)
    sim.evolve(1e9, lambda: sim.state.step >= 200)
    assert sim.state.step == 200


@pytest.mark.parametrize("step", [1, 2])
def test_gas_that_goes_back_to_a_checkpoint_is_not_judged_by_steps_after_it(tmp_path, step):
    """Accelerations are compared in the first three steps; those from before `restore` are of another path."""
    sim = box("cubic", shaken=0.3)
    sim.evolve(1e9, lambda: sim.state.step >= step)
    sim.save(tmp_path / "a.h5")
    found = []
    for _ in range(2):
        sim.restore(tmp_path / "a.h5")
        sim.evolve(1e9, lambda: sim.state.step >= 5)
        found.append(state_bits(sim))
        sim.restore(tmp_path / "a.h5")
        sim.evolve(1e9, lambda: sim.state.step >= 3)
    assert found[0] == found[1]
