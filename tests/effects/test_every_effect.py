"""Every effect: in a scene that has them all it acts on whom it says, and each can be left out."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from operating import accelerated, replace_operator
from runs import on_threads
from stepping import assert_sane, disc

from discsim import Simulation, load_scene
from discsim.numerics import threads
from discsim.numerics.operators import accelerate
from discsim.parts import EFFECTS
from discsim.scene.tables import removable_tables

SETUPS = Path(__file__).parents[2] / "setups"

# Of the kernel that setups with most effects have, and of masses that are unequal from the start, as growth makes them:
# so sums that compile for one of these tests serve the others.
EVERYTHING = disc(
    gas={
        "particles": 400,
        "kernel": "wendland-c4",
        "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.1},
        "viscosity": {},
        "conductivity": {},
    },
    alpha_viscosity={"alpha": 0.01},
    companion=[{"mass": 1e-3, "semi_major_axis": 1.5, "softening": "0.1"}],
    dust={"particles": 300, "ratio": 0.1, "grain_size": 1e-3, "grain_density": 1.0},
    self_gravity={"softening": 0.2},
    external={"gas": [0.01, 0.0], "dust": [0.0, 0.01]},
    drag={"law": "epstein"},
    radiation_pressure={"beta": 0.1},
    cooling={"kind": "constant", "t_cool": 0.5, "aspect_ratio": 0.05},
    dust_diffusion={},
    damping={"inner": [1.0, 1.2]},
    growth={"fragmentation_speed": 0.1, "alpha": 1e-3, "small_size": 1e-6, "small_ratio": 0},
)
STEPPED = (
    "gas", "gas.viscosity", "gas.conductivity", "alpha_viscosity", "dust", "star", "companion", "self_gravity",
    "radiation_pressure", "external", "cooling", "drag", "dust_diffusion", "damping", "growth",
)  # fmt: skip
# What cannot stay without it.
NEEDS = {
    "gas": ("alpha_viscosity", "drag", "dust_diffusion", "cooling", "growth"), "alpha_viscosity": ("dust_diffusion",),
    "dust": ("drag", "dust_diffusion", "radiation_pressure", "growth"), "drag": ("dust_diffusion", "growth"),
    "star": (
        "alpha_viscosity", "dust_diffusion", "companion", "radiation_pressure", "cooling", "damping", "drag", "growth",
    ),
}  # fmt: skip


def test_every_effect_is_stepped_here():
    given = {"background", "background.bump", "background.gap"}  # no partner of gas: test_background.py
    boxed = {"shearing_box"}  # no partner of a star: test_shearing_box.py
    polar = {"gas.grid"}  # no partner of SPH: tests/polar
    isothermal = {"gas.quiet"}  # no partner of gas with an energy: test_quiet.py
    assert {*STEPPED, *given, *isothermal, *boxed, *polar} == set(removable_tables())
    assert set(load_scene(EVERYTHING).effects) == set(STEPPED)


@pytest.fixture(scope="module")
def start():
    """Positions, velocities and masses of a disc in balance, one of whose gas particles is a little heavier."""
    species = Simulation(EVERYTHING).state.species
    found = {name: {key: getattr(p, key).copy() for key in ("pos", "vel", "mass")} for name, p in species.items()}
    found["gas"]["mass"][0] *= 1.01
    return found


def test_the_same_bits_on_any_number_of_threads(monkeypatch, start):
    """Of effects at once, particles and what is added up over them, in pieces of 50 and of all particles, in whatever
    order they come; the field of self-gravity has threads of its own (numerics/test_poisson.py).
    """
    scene = {name: table for name, table in EVERYTHING.items() if name != "self_gravity"}
    ends = []
    for number in on_threads(monkeypatch, (1, 3, 4)):
        if number == 4:
            monkeypatch.setattr(threads, "_run_chunks", last_piece_first)
        sim = Simulation(scene, start)
        for _ in range(3):
            sim.step()
        held = [*sim.state.species.values(), sim.bodies]
        arrays = [array for group in held for array in group.arrays().values()]
        arrays += [np.atleast_1d(value) for value in asdict(sim.state.ledger).values()]
        ends.append([array.tobytes() for array in arrays])
    assert ends[0] == ends[1] == ends[2]


def last_piece_first(calls, lengths):
    return [call() for call in calls[::-1]][::-1]


def test_effects_act_on_whom_they_say(start):
    """And give gas and dust at one place the same where they say that they do."""
    sim = Simulation(EVERYTHING, start)
    sim.dust.pos[:] = sim.gas.pos[: sim.dust.count]
    sim.step()
    sim.dust.pos[:] = sim.gas.pos[: sim.dust.count]
    for name, effect in sim.effects.items():
        given = dict(zip(("gas", "dust"), sim.acceleration(name), strict=True))
        felt = {species for species, acc in given.items() if np.any(acc)}
        written = accelerated(effect, sim.state)
        assert felt == {name.partition(".")[0] for name in written}, name
        alike = bool(felt) and np.allclose(given["gas"][: sim.dust.count], given["dust"], rtol=1e-9)
        assert alike == any(name.endswith(".acc") for name in written), name


def two_steps(start, without=()):
    """The scene without some effects after two steps from one and the same start."""
    whole = load_scene(EVERYTHING, ["run.timestep=0.01"], without)
    sim = Simulation(whole, {name: arrays for name, arrays in start.items() if name not in without})
    sim.step()
    sim.step()
    assert_sane(sim)
    return sim


@pytest.fixture(scope="module")
def with_everything(start):
    return two_steps(start)


@pytest.mark.parametrize("effect", STEPPED)
def test_effect_matters_and_can_be_left_out(effect, start, with_everything):
    gone = (effect, *NEEDS.get(effect, ()))
    sim = two_steps(start, gone)
    assert set(sim.effects) == set(EFFECTS) - {"background", "shearing_box"} - set(gone)
    kept = "dust" if effect == "gas" else "gas"
    ours, theirs = getattr(sim, kept), getattr(with_everything, kept)
    fields = ("vel", "u") if kept == "gas" else ("vel",)
    changes = [getattr(ours, f)[np.argsort(ours.ids)] - getattr(theirs, f)[np.argsort(theirs.ids)] for f in fields]
    assert max(np.abs(change).max() for change in changes) > 1e-9


@pytest.mark.parametrize("effect", [name for name in EFFECTS if name not in ("background", "shearing_box")])
def test_acceleration_of_each_effect(effect, with_everything):
    gas, dust = with_everything.acceleration(effect)
    assert gas.shape == (400, 2) and dust.shape == (300, 2)
    # SPH pushes gas alone, by its viscosity too; dust alone gives nothing; drag is the kick itself, damping one more.
    nothing = dict.fromkeys(
        ("alpha_viscosity", "dust", "drag", "dust_diffusion", "cooling", "damping", "growth"), (False, False)
    )
    acts = (nothing | {"gas": (True, False), "radiation_pressure": (False, True)}).get(effect, (True, True))
    assert (np.abs(gas).max() > 0, np.abs(dust).max() > 0) == acts


@pytest.mark.parametrize("threads_there", [1, 3])
def test_forces_that_end_half_way_leave_nothing_to_those_after_them(monkeypatch, start, threads_there):
    """The star writes to what nobody has written: not any more, once that has come to nothing."""
    sim = Simulation(EVERYTHING, start)
    sim.step()
    expected = sim.acceleration("star")

    def fail(view):
        raise RuntimeError("half-way")

    with monkeypatch.context() as patched:
        replace_operator(sim, "star.pull", fail)
        for _ in on_threads(patched, (threads_there,)):
            with pytest.raises(RuntimeError, match="half-way"):
                sim.operators.forces()
    for p in (sim.gas, sim.dust):
        p.acc[:] = 1.0
    accelerate(sim.effects["star"], sim.state)
    for one, p in zip(expected, (sim.gas, sim.dust), strict=True):
        np.testing.assert_allclose(p.acc - 1.0, one, rtol=1e-12, atol=1e-13)  # rounding of what is beside 1


@pytest.mark.parametrize("scene", [EVERYTHING, "dusty_wave.toml"])
@pytest.mark.parametrize("threads_there", [1, 3])
def test_drag_knows_what_each_species_feels_alone(monkeypatch, start, scene, threads_there):
    """Of all that it feels, whatever comes first; in a box, where nothing is felt alike, it is all. As exactly as
    a search for smoothing lengths finds again what it has found.
    """
    sim = Simulation(scene, start) if scene is EVERYTHING else Simulation(SETUPS / scene)
    for _ in on_threads(monkeypatch, (threads_there,)):
        sim.operators.forces()
    each = {name: sim.acceleration(name) for name in sim.effects}
    for k, (name, p) in enumerate(sim.state.species.items()):
        unshared = f"{name}.acc_unshared"
        own = sum(acc[k] for effect, acc in each.items() if unshared in accelerated(sim.effects[effect], sim.state))
        whole = sum(acc[k] for acc in each.values())
        near = {"rtol": 0.0, "atol": 1e-6 * max(np.abs(acc[k]).max() for acc in each.values())}
        np.testing.assert_allclose(p.acc, whole, **near)
        np.testing.assert_allclose(sim.state.acc_unshared[name] if np.any(own) else 0.0 * own, own, **near)
