"""Forces that a caller adds to a simulation as functions: orbits, momentum, steps, checkpoints and messages."""

import h5py
import numpy as np
import pytest
from astropy import units as u
from runs import SHOCK, assert_same_arrays, contents, on_threads, scene_of, state_bits
from stepping import disc

from discsim import Simulation
from discsim.output.checkpoint import CheckpointError, read_checkpoint
from discsim.output.history import history_columns, history_row
from discsim.run.runner import run_scene
from discsim.run.simulation import PhysicsError

OMEGA, NU, G = 1.7, 0.6, np.array([0.3, -0.5])  # frequencies of a spring and of a push, and amplitude of the push
START = {"pos": [[1.3, 0.2], [0.4, -0.7]], "vel": [[0.1, 0.6], [0.3, 0.2]], "mass": [1e-6, 2.5e-6]}
TWO_SPECIES = disc(
    run={"until": 1.0, "courant": 0.015},
    gas={"particles": 300, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1}, "viscosity": {}},
    dust={"particles": 200, "ratio": 0.3}, drag={"law": "stopping-time", "t_stop": 0.3},
)  # fmt: skip


def grains(timestep=None, **run):
    """Two grains in empty space."""
    run = {"until": 3.0} | ({} if timestep is None else {"timestep": timestep}) | run
    scene = {"units": {"system": "code"}, "run": run, "space": {"size": 8.0}, "dust": {"ratio": 1.0}}
    return Simulation(scene, particles={"dust": START})


def spring(particles, time):
    return -(OMEGA**2) * particles.pos


def shaken_spring(particles, time):
    return G * np.cos(NU * time) - OMEGA**2 * particles.pos


def breeze(particles, time):
    """Differs between particles, and from step to step."""
    return 0.02 * np.sin(3.0 * particles.pos[:, ::-1] + 5.0 * time)


def exact_orbit(time):
    """Positions of the two grains on a shaken spring."""
    pos, vel = (np.array(START[name]) for name in ("pos", "vel"))
    forced = G / (OMEGA**2 - NU**2)
    own = (pos - forced) * np.cos(OMEGA * time) + vel / OMEGA * np.sin(OMEGA * time)
    return own + forced * np.cos(NU * time)


def by_id(particles, array):
    return array[np.argsort(particles.ids)]


def test_added_forces_are_listed_with_their_species():
    sim = grains()
    assert "forces" not in repr(sim)
    sim.add_force(spring, on="dust", name="spring")
    assert 'forces   "spring" on dust' in repr(sim)


def test_grains_on_a_shaken_spring_are_on_the_exact_orbit_to_second_order():
    """Errors fall by four with half the step. A force at another time than that of the positions is first order."""
    errors = []
    for timestep in (0.05, 0.025):
        sim = grains(timestep)
        sim.add_force(shaken_spring, on="dust", name="spring")
        sim.run()
        errors.append(np.abs(by_id(sim.dust, sim.dust.pos) - exact_orbit(3.0)).max())
    assert errors[0] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)


def test_a_limit_sets_the_step():
    sim = grains(courant=0.13)
    sim.add_force(spring, on=("dust",), name="spring", limit=1.0 / OMEGA)
    with sim.synchronised():
        assert sim.limited_by == "spring" and sim.limit == 1.0 / OMEGA
    assert sim.step() == pytest.approx(0.13 / OMEGA, rel=1e-12)


def test_a_limit_with_a_unit_is_converted():
    scene = {"units": {"length": "3 au"}, "run": {"until": "9 yr"}, "space": {"size": "20 au"}, "dust": {"ratio": 1.0}}
    sim = Simulation(scene, particles={"dust": START})
    sim.add_force(spring, on="dust", limit=0.7 * u.yr)
    with sim.synchronised():
        assert (sim.limit * sim.units.time).to_value("yr") == pytest.approx(0.7, rel=1e-12)


def test_the_potential_closes_the_energy():
    """The energy of leapfrog is that of a spring to (Omega dt)^2 / 8 = 1e-3 at most."""
    sim = grains(timestep=0.05)
    sim.add_force(spring, "dust", potential=lambda p, time: 0.5 * OMEGA**2 * (p.pos**2).sum(axis=1))

    def energies():
        with sim.synchronised() as state:
            row = dict(zip(history_columns(sim.scene), history_row(state, sim.effects, 0.0, ""), strict=True))
        return row["kinetic_dust"], row["potential"]

    first = energies()
    pos, mass = (np.array(START[name]) for name in ("pos", "mass"))
    assert first[1] == pytest.approx(0.5 * OMEGA**2 * (mass * (pos**2).sum(axis=1)).sum(), rel=1e-14)
    sim.run(1.1)
    last = energies()
    assert sum(last) == pytest.approx(sum(first), rel=2e-3)
    assert abs(last[1] / first[1] - 1.0) > 0.1  # energy has moved from one to the other


@pytest.mark.parametrize("step_limit", [0.04, 3.0])
def test_pushed_dust_takes_gas_along_and_keeps_the_momentum(step_limit):
    """Uniform gas and dust of ratio 0.7: slip g tau (1 - exp(-t / tau)), tau = t_stop / (1 + ratio), in steps of 0.16
    and of 12 tau; drag includes the force in its relaxation. Momentum grows by g times the mass of the dust.
    """
    ratio, t_stop, until = 0.7, 0.42, 0.9
    scene = {
        "units": {"system": "code"}, "run": {"until": until, "timestep": min(step_limit, until)},
        "space": {"size": 1.0, "boundary": "periodic"}, "initial": {"kind": "box"},
        "gas": {"particles": 256, "eos": {"kind": "isothermal", "sound_speed": 0.01}},
        "dust": {"particles": 256, "ratio": ratio}, "drag": {"law": "stopping-time", "t_stop": t_stop},
    }  # fmt: skip
    sim = Simulation(scene)
    gas, dust = (p.vel.mean(axis=0) for p in (sim.gas, sim.dust))
    sim.add_force(lambda particles, time: np.tile(0.01 * G, (len(particles.mass), 1)), on=["dust"])
    sim.run()
    tau = t_stop / (1.0 + ratio)
    slip = 0.01 * G * tau * (1.0 - np.exp(-until / tau))
    gained = [p.vel.mean(axis=0) - before for p, before in ((sim.gas, gas), (sim.dust, dust))]
    np.testing.assert_allclose(gained[1] - gained[0], slip, rtol=1e-9)
    np.testing.assert_allclose(gained[0] + ratio * gained[1], ratio * until * 0.01 * G, rtol=1e-12)


def test_the_same_formula_as_a_table_is_the_same_run_to_rounding():
    """[external]: constant accelerations, and an attraction to y = 0, of gas and dust with drag."""
    table = {"gas": [0.011, 0.02], "dust": [-0.03, 0.013], "vertical_frequency": 0.7}

    def push(species):
        return lambda p, time: np.array(table[species]) - [0.0, 0.7**2] * p.pos

    with_table, added = Simulation(TWO_SPECIES | {"external": table}), Simulation(TWO_SPECIES)
    for species in ("gas", "dust"):
        added.add_force(push(species), on=species, name=f"push_{species}", limit=1.0 / 0.7)
    for sim in (with_table, added):
        sim.run(0.2)
    assert with_table.state.step == added.state.step > 10
    for name, p in added.state.species.items():
        other = with_table.state.species[name]
        assert np.array_equal(p.ids, other.ids)
        for key in ("pos", "vel"):  # rounding of a dozen steps, of numbers of 1
            np.testing.assert_allclose(getattr(p, key), getattr(other, key), rtol=0.0, atol=1e-12)


def test_a_force_acts_from_the_moment_at_which_it_is_added():
    """A constant acceleration from t = 0.35, after a step whose closing kick is due: exact for leapfrog."""
    sim = grains(timestep=0.05)
    sim.evolve(0.35)
    assert sim.state.velocity_lag == 0.0 or sim.state.velocity_lag == pytest.approx(0.025)
    sim.add_force(lambda p, time: np.tile(G, (len(p.mass), 1)), on="dust", name="push")
    np.testing.assert_allclose(sim.dust.acc, np.tile(G, (2, 1)), rtol=1e-15)
    sim.run(1.0)
    pos, vel = (np.array(START[name]) for name in ("pos", "vel"))
    np.testing.assert_allclose(by_id(sim.dust, sim.dust.pos), pos + vel + 0.5 * G * 0.65**2, rtol=1e-13)
    np.testing.assert_allclose(by_id(sim.dust, sim.dust.vel), vel + G * 0.65, rtol=1e-13)


def test_grains_move_straight_on_after_their_force_is_removed(tmp_path):
    """From the position and velocity at this moment, to rounding; the limit of the force and its cost are gone too."""
    sim = grains(courant=0.13)
    sim.add_force(spring, "dust", name="spring", limit=1.0 / OMEGA)
    sim.add_force(lambda particles, time: 0.0 * particles.pos, "dust", name="calm", limit=0.9)
    sim.run(0.7)
    with sim.synchronised() as state:
        pos, vel = by_id(state.dust, state.dust.pos).copy(), by_id(state.dust, state.dust.vel).copy()
    sim.remove_force("spring")
    assert "spring" not in {*sim.effects, *sim.costs.seconds} and sim.limited_by == "calm" and sim.limit == 0.9
    sim.run(1.9)
    np.testing.assert_allclose(by_id(sim.dust, sim.dust.pos), pos + 1.2 * vel, rtol=0, atol=1e-14)
    sim.save(tmp_path / "half.h5")
    sim.run(2.5)
    other = grains(courant=0.13)
    other.add_force(lambda particles, time: 0.0 * particles.pos, "dust", name="calm", limit=0.9)
    other.restore(tmp_path / "half.h5")
    other.run(2.5)
    assert state_bits(other) == state_bits(sim)


def test_a_force_that_is_removed_before_the_first_step_changes_no_bit():
    runs = Simulation(TWO_SPECIES), Simulation(TWO_SPECIES)
    runs[1].add_force(breeze, ("gas", "dust"))
    runs[1].remove_force("force")
    for sim in runs:
        sim.run(0.05)
    assert state_bits(runs[0]) == state_bits(runs[1])


def test_only_an_added_force_can_be_removed_and_not_in_a_callback():
    sim = grains(timestep=0.1)
    sim.add_force(spring, "dust", name="spring")
    for name in ("dust", "wind"):
        with pytest.raises(KeyError, match=f"{name} is no added force; expected one of spring"):
            sim.remove_force(name)
    with pytest.raises(RuntimeError, match="the state is being read"):
        sim.run(0.3, callback=lambda sim: sim.remove_force("spring"))
    assert "spring" in sim.effects


def test_two_forces_add_and_are_effects_of_their_own():
    gas = {key: value for key, value in TWO_SPECIES["gas"].items() if key != "viscosity"}
    sim = Simulation(TWO_SPECIES | {"gas": gas})
    sim.step()
    before = sim.gas.acc.copy()
    sim.add_force(breeze, on=("dust", "gas"), name="breeze")
    sim.add_force(lambda p, time: -0.1 * p.pos, on="gas", name="hold")
    found, other = sim.acceleration("breeze"), sim.acceleration("hold")
    np.testing.assert_allclose(found[1], 0.02 * np.sin(3.0 * sim.dust.pos[:, ::-1] + 5.0 * sim.time), rtol=1e-14)
    np.testing.assert_allclose(other[0], -0.1 * sim.gas.pos, rtol=1e-14)
    assert not other[1].any()
    # Forces of the gas are found again from smoothing lengths that agree to 1e-6.
    np.testing.assert_allclose(sim.gas.acc, before + found[0] + other[0], rtol=0.0, atol=1e-5 * np.abs(before).max())
    assert [*sim.effects][-2:] == [*sim.costs.calls][-2:] == ["breeze", "hold"]
    sim.step()
    assert sim.costs.calls["hold"] >= 2 and sim.costs.seconds["hold"] > 0.0


def test_grains_keep_their_own_force_when_arrays_are_sorted():
    """A charge of each grain, found by its id."""
    sim = Simulation(TWO_SPECIES)
    charge = np.linspace(-0.4, 0.7, sim.dust.count)
    first = sim.dust.ids.min()
    sim.add_force(lambda p, time: charge[p.ids - first, None] * [0.0, 0.1], on="dust", name="field")
    order = sim.dust.ids.copy()
    sim.step()
    assert not np.array_equal(sim.dust.ids, order)
    found = by_id(sim.dust, sim.acceleration("field")[1])
    np.testing.assert_allclose(found, charge[:, None] * [0.0, 0.1], rtol=1e-14)


def test_populations_and_sizes_are_known_to_a_force():
    dust = [{"particles": 30, "ratio": 0.01}, {"particles": 20, "ratio": 0.01}]
    sim = Simulation(disc(gas=None, dust=dust) | {"gas": TWO_SPECIES["gas"]})
    sim.add_force(lambda p, time: np.array([0.3, -0.8])[p.species][:, None] * p.pos, on="dust")
    expected = np.array([0.3, -0.8])[sim.dust.species][:, None] * sim.dust.pos
    np.testing.assert_allclose(sim.acceleration("force")[1], expected, rtol=1e-14)


# Checkpoints


def test_a_run_with_forces_resumes_to_the_same_bits_on_any_number_of_threads(tmp_path, monkeypatch):
    """Saved while a closing kick is due."""

    def begun():
        sim = Simulation(TWO_SPECIES)
        sim.add_force(breeze, on=("gas", "dust"), name="breeze", limit=0.9)
        sim.add_force(lambda p, time: -0.1 * time * p.pos, on="dust", name="hold")
        return sim

    ends = []
    for number in on_threads(monkeypatch, (1, 2)):
        straight, resumed, path = begun(), begun(), tmp_path / f"{number}.h5"
        straight.evolve(0.1)
        straight.save(path)
        assert straight.state.velocity_lag > 0.0
        straight.run(0.2)
        resumed.restore(path)
        resumed.run(0.2)
        assert straight.state.step > 5
        assert state_bits(straight) == state_bits(resumed)
        ends.append(straight)
    for name, p in ends[0].state.species.items():
        assert_same_arrays(p.arrays(), ends[1].state.species[name].arrays())


def push(particles, time):
    return np.tile(G, (len(particles.mass), 1))


@pytest.mark.parametrize(
    ("saved", "present", "words"),
    [
        (["wind"], [], 'the added force "wind" on dust; expected sim[.]add_force[(][.]{3}, name="wind"[)] in Python'),
        (["wind", "rain"], ["wind"], 'the added force "rain" on dust; expected sim[.]add_force[(][.]{3}, name="rain"'),
        ([], ["wind"], 'no added force "wind" on dust; expected a Simulation without this force: restore the check'),
        (["wind"], ["wind", "rain"], 'no added force "rain" on dust'),
        (["wind", "rain"], ["rain", "wind"], 'in the order "wind" on dust; "rain" on dust; expected add_force in this'),
    ],
)
def test_a_checkpoint_of_other_forces_is_one_message_and_changes_nothing(tmp_path, saved, present, words):
    path = tmp_path / "checkpoint.h5"
    one, other = grains(timestep=0.05), grains(timestep=0.05)
    for sim, names in ((one, saved), (other, present)):
        for name in names:
            sim.add_force(push, on="dust", name=name)
        sim.step()
    one.step()
    one.save(path)
    before = state_bits(other)
    with pytest.raises(CheckpointError, match=words) as found:
        other.restore(path)
    assert str(path) in str(found.value) and "\n" not in str(found.value)
    assert state_bits(other) == before


def test_a_force_may_follow_the_checkpoint_of_a_run_without_it(tmp_path):
    sim, again = grains(timestep=0.05), grains(timestep=0.05)
    sim.evolve(0.35)
    sim.save(tmp_path / "checkpoint.h5")
    again.restore(tmp_path / "checkpoint.h5")
    for each in (sim, again):
        each.add_force(spring, on="dust")
        each.run(0.8)
    assert state_bits(sim) == state_bits(again)


def test_a_checkpoint_without_forces_does_not_mention_any(tmp_path):
    sim = grains(timestep=0.05)
    sim.save(tmp_path / "checkpoint.h5")
    assert "added_forces" not in read_checkpoint(tmp_path / "checkpoint.h5")[1]


@pytest.mark.parametrize("stored", [b'"wind" on gas', b"\x1b[31m" + b"w" * 5000, 7])
def test_resume_by_the_command_refuses_a_checkpoint_with_forces(tmp_path, capsys, stored):
    """A scene file cannot have the function. Text in the file is clipped, and printable. `sim.save` into the directory
    of a run leaves no number of snapshots, which is not the fault to report.
    """
    scene, out = scene_of(tmp_path, SHOCK, "run.walltime=1e-6 s"), tmp_path / "out"
    assert run_scene(scene, out, quiet=True) == 0
    with h5py.File(out / "checkpoint.h5", "a") as file:
        del file["values"].attrs["snapshots"]
        file["values"].attrs["added_forces"] = np.bytes_(stored) if isinstance(stored, bytes) else stored
    before = contents(out)
    capsys.readouterr()
    assert run_scene(scene, out, resume=True, quiet=True) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "\x1b" not in said and len(said) < 600 and contents(out) == before
    wanted = 'name="wind") in Python, then sim.restore(path)' if stored == b'"wind" on gas' else "added"
    assert wanted in said


# Messages

GOOD = {"function": spring, "on": "dust", "name": "wind"}
WRONG = {
    "function is of type float; expected a function of (particles, time)": {"function": 0.1},
    "potential is of type float; expected a function": {"potential": 0.1},
    'on has no species; expected one or more of dust, like on=("dust",)': {"on": ()},
    'on has "gas"; this scene has dust': {"on": ("dust", "gas")},
    'on has "None"; this scene has dust': {"on": None},
    'name = "radiation_pressure" is the name of a table of scenes; expected another': {"name": "radiation_pressure"},
    'name = "spring" is the name of another force': {"name": "spring"},
    'name = "a wind"; expected letters, digits and _': {"name": "a wind"},
    "limit = -0.1; expected a positive time": {"limit": -0.1},
    "limit = nan; expected a positive time": {"limit": np.nan},
    "function of force wind returns ndarray with numbers of type float64 and shape (2,) for dust; "
    "expected an array of real numbers of shape (2, 2), in code units": {"function": lambda p, t: p.pos[:, 0]},
    "returns NoneType with numbers of type object": {"function": lambda p, t: None},
    "returns ndarray with numbers of type complex128": {"function": lambda p, t: 1j * p.pos},
    "returns list with numbers of type object": {"function": lambda p, t: [[1.0, 2.0], [3.0]]},
    "returns a Quantity in m / s2 for dust": {"function": lambda p, t: p.pos * u.m / u.s**2},
    "potential of force wind returns float with numbers of type float64 and shape () for dust; expected an array of "
    "real numbers of shape (2,)": {"potential": lambda p, t: 0.1},
}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_argument_is_one_message_and_adds_nothing(words):
    sim, straight = grains(timestep=0.05), grains(timestep=0.05)
    for each in (sim, straight):
        each.add_force(spring, on="dust", name="spring")
        each.evolve(0.2)
    with pytest.raises(ValueError) as found:
        sim.add_force(**GOOD | WRONG[words])
    assert words in str(found.value) and "\n" not in str(found.value)
    assert list(sim.effects) == list(sim.costs.calls) == ["dust", "spring"]
    for each in (sim, straight):
        each.run(0.5)
    assert state_bits(sim) == state_bits(straight)


def test_an_acceleration_that_is_not_finite_is_one_message_and_adds_nothing():
    sim = grains(timestep=0.05)
    with pytest.raises(PhysicsError, match=r"dust particle 1 is not finite .*\(nan, nan; step 0\).* is wind$"):
        sim.add_force(lambda p, time: np.where(p.ids[:, None] == 1, np.nan, 0.3 * p.pos), on="dust", name="wind")
    assert "wind" not in sim.effects
    sim.step()


def test_a_force_that_fails_later_ends_the_run_with_its_name():
    for fails, error, words in (
        (lambda p, time: p.pos[:, 0], ValueError, r"function of force wind returns .* shape \(2,\) for dust"),
        (lambda p, time: p.pos / 0.0, PhysicsError, "first effect with an acceleration that is not finite is wind"),
    ):
        sim = grains(timestep=0.05)
        sim.add_force(lambda p, t, fails=fails: fails(p, t) if t > 0.12 else spring(p, t), on="dust", name="wind")
        with np.errstate(all="ignore"), pytest.raises(error, match=words):
            sim.run(1.0)


def test_velocities_are_not_given_and_arrays_are_read_only():
    sim = grains(timestep=0.05)
    with pytest.raises(AttributeError, match=r"no vel here; expected .* mass, ids, species; .* use discsim\.register"):
        sim.add_force(lambda p, time: -p.vel, on="dust")
    with pytest.raises(AttributeError, match=r"no u here; expected one of pos, mass, ids, species$"):
        sim.add_force(lambda p, time: -p.u, on="dust")

    def writes(particles, time):
        particles.pos[:] = 0.0
        return particles.pos

    with pytest.raises(ValueError, match="read-only"):
        sim.add_force(writes, on="dust")
    np.testing.assert_array_equal(by_id(sim.dust, sim.dust.pos), START["pos"])


def test_a_callback_cannot_add_a_force():
    sim = grains(timestep=0.05)
    with pytest.raises(RuntimeError, match="being read"):
        sim.run(0.2, callback=lambda sim: sim.add_force(spring, on="dust"))
