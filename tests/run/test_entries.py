"""Arrays that a caller sets between two steps: what kernels cannot take is one ValueError before any of them has it."""

import dataclasses

import numpy as np
import pytest
from runs import DISC, assert_resumes, at_step, errors_of, scene_of, state_bits

from discsim import Simulation
from discsim.numerics.bodies import Bodies
from discsim.numerics.entries import TYPES, VECTORS
from discsim.numerics.state import Dust, Gas
from discsim.output.checkpoint import CheckpointError, read_checkpoint, write_checkpoint
from discsim.physics.companions import ramp_fraction
from discsim.run.runner import run_scene

SMALL = ["gas.particles=300", "run.until=0.05", "run.every=0.02"]
TWO = "[[dust]]\nparticles = 90\nratio = 0.07\n[[dust]]\nparticles = 70\nratio = 0.05\n"


def disc(tmp_path, *more):
    """A disc with two populations of dust, drag, gravity and a star that accretes."""
    start, end = DISC.index("[dust]"), DISC.index("[star]")
    return scene_of(tmp_path, DISC[:start] + TWO + DISC[end:], *SMALL, *more)


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A simulation after two steps, and the arrays that it had then."""
    sim = Simulation(disc(tmp_path_factory.mktemp("scene")))
    sim.step()
    sim.step()
    return sim, {name: p.copy() for name, p in sim.state.species.items()}


@pytest.fixture
def sim(begun):
    sim, kept = begun
    sim.state.gas, sim.state.dust = kept["gas"].copy(), kept["dust"].copy()
    return sim


def entry(species, name, value):
    def act(sim):
        getattr(getattr(sim, species), name)[5] = value

    return act


def other(species, name, make):
    def act(sim):
        setattr(getattr(sim, species), name, make(getattr(getattr(sim, species), name)))

    return act


SET = {
    "a species above the last": (
        entry("dust", "species", 2),
        r"dust\.species\[5\] is 2; expected a pop.* 0 to 1",
    ),
    "a species far away": (entry("dust", "species", 10**8), r"dust\.species\[5\] is 1e\+08; expected a population"),
    "a species below 0": (entry("dust", "species", -1), r"dust\.species\[5\] is -1; expected a population"),
    "h below 0": (entry("gas", "h", -0.3), r"gas\.h\[5\] is -0\.3; expected a positive number"),
    "h of 0": (entry("gas", "h", 0.0), r"gas\.h\[5\] is 0; expected a positive number"),
    "a negative mass of gas": (entry("gas", "mass", -1e-5), r"gas\.mass\[5\] is -1e-05; expected a positive number"),
    "no mass of gas": (entry("gas", "mass", 0.0), r"gas\.mass\[5\] is 0; expected a positive number"),
    "a negative mass of dust": (entry("dust", "mass", -1e-5), r"dust\.mass\[5\] is -1e-05; expected 0 or a positive"),
    "single precision": (other("gas", "pos", lambda a: a.astype("f4")), r"gas\.pos is of type <f4; expected .* <f8"),
    "another byte order": (
        other("gas", "mass", lambda a: a.astype(">f8")),
        r"gas\.mass is of type >f8; expected",
    ),
    "whole numbers": (other("dust", "vel", lambda a: a.astype(int)), r"dust\.vel is of type <i8; expected .* <f8"),
    "species as floats": (other("dust", "species", lambda a: a.astype(float)), r"dust\.species is of type <f8"),
    "ids of 4 bytes": (other("gas", "ids", lambda a: a.astype("i4")), r"gas\.ids is of type <i4; expected .* <i8"),
    "columns in a row": (other("gas", "pos", np.asfortranarray), r"gas\.pos is not C-contiguous"),
    "every other row": (other("gas", "mass", lambda a: np.repeat(a, 2)[::2]), r"gas\.mass is not C-contiguous"),
    "read-only": (other("gas", "h", lambda a: np.broadcast_to(a[:1], a.shape)), r"gas\.h is not C-contiguous"),
    "fewer masses": (other("gas", "mass", lambda a: a[:-5].copy()), r"has shape \(\d+,\); expected the shape \(\d+,\)"),
    "one column": (
        other("gas", "vel", lambda a: a[:, :1].copy()),
        r"gas\.vel has shape \(\d+, 1\); expected",
    ),
    "three columns": (other("dust", "pos", lambda a: np.pad(a, ((0, 0), (0, 1)))), r"dust\.pos has shape \(\d+, 3\)"),
    "a list": (other("gas", "mass", list), r"gas\.mass is of type a list; expected a numpy array"),
    "nothing": (other("gas", "acc", lambda a: None), r"gas\.acc is None; expected an array"),
    "a particle less": (
        lambda sim: sim.gas.take(np.arange(sim.gas.count - 1)),
        r"but had \d+ particles before; keep the number",
    ),
}
WAYS = {
    "step": lambda sim: sim.step(), "run": lambda sim: sim.run(0.05), "evolve": lambda sim: sim.evolve(0.05),
    "save": lambda sim: sim.save("nowhere.h5"), "acceleration": lambda sim: sim.acceleration("gas"),
}  # fmt: skip


@pytest.mark.parametrize("case", SET)
def test_what_kernels_cannot_take_is_one_error(sim, case):
    act, words = SET[case]
    act(sim)
    with pytest.raises(ValueError, match=words) as caught:
        sim.step()
    assert "\n" not in str(caught.value) and sim.state.step == 2


@pytest.mark.parametrize("way", WAYS)
def test_each_way_in_is_guarded(sim, way, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sim.dust.species[7] = 12345
    with pytest.raises(ValueError, match=r"dust\.species\[7\] is 12345; expected a population of the scene, 0 to 1"):
        WAYS[way](sim)
    with pytest.raises(ValueError, match=r"dust\.species\[7\] is 12345"), sim.synchronised():
        pass
    assert sim.state.step == 2 and not [*tmp_path.iterdir()]


def test_what_is_set_after_a_step_of_a_run_is_checked_too(tmp_path):
    sim = Simulation(disc(tmp_path))

    def act():
        sim.dust.species[3] = -4

    with pytest.raises(ValueError, match=r"dust\.species\[3\] is -4"):
        sim.evolve(sim.time + 1.0, act)
    assert sim.state.step == 1


def test_bodies_are_checked(sim):
    bodies = sim.state.bodies
    sim.state.bodies = Bodies(**{**bodies.arrays(), "vel": bodies.vel[:, :1]})
    with pytest.raises(ValueError, match=r"bodies\.vel has type and shape float64 \(1, 1\); expected float64 \(1, 2\)"):
        sim.step()
    sim.state.bodies = Bodies(**{**bodies.arrays(), "mass": -bodies.mass})
    with pytest.raises(ValueError, match=r"bodies\.mass\[0\] is -1; expected 0 or a positive number"):
        sim.step()
    sim.state.bodies = bodies


def test_all_arrays_of_a_state_have_a_type_and_a_shape(sim):
    for particles in (sim.gas, sim.dust):
        for name, array in particles.arrays().items():
            assert array.dtype == TYPES.get(name, np.float64) and array.ndim == 1 + (name in VECTORS), name
    known = {field.name for kind in (Gas, Dust) for field in dataclasses.fields(kind)}
    assert {*VECTORS, *TYPES} <= known


# Checkpoints


def changed(path, change):
    """Write a checkpoint again, with something in it changed."""
    groups, values = read_checkpoint(path)
    groups, values = {name: dict(arrays) for name, arrays in groups.items()}, dict(values)
    change(groups, values)
    write_checkpoint(path, groups, values)


@pytest.mark.parametrize("number", [-1, 0, 1, 10**7])
def test_a_wrong_count_of_snapshots_removes_none(tmp_path, number, monkeypatch, capsys):
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    out = tmp_path / "out"
    assert run_scene(disc(tmp_path), out, quiet=True) == 0
    kept = sorted(path.name for path in (out / "snapshots").iterdir())
    assert len(kept) == 4
    changed(out / "checkpoint.h5", lambda groups, values: values.update(snapshots=number))
    capsys.readouterr()
    assert run_scene(disc(tmp_path, "run.until=0.06"), out, resume=True, quiet=True) == 2
    said = capsys.readouterr()
    assert len(errors_of(said.err)) == 1 and "snapshots" in said.err and f"{out}/checkpoint.h5" in said.err
    assert sorted(path.name for path in (out / "snapshots").iterdir()) == kept


def test_what_is_refused_leaves_the_simulation_as_it_was(sim, tmp_path):
    path = tmp_path / "a.h5"
    sim.save(path)
    before = state_bits(sim)

    def change(groups, values):
        groups["dust"]["species"][9] = 10**8

    changed(path, change)
    with pytest.raises(CheckpointError, match=r"damaged checkpoint, .*: dust\.species\[9\] is 1e\+08; expected"):
        sim.restore(path)
    assert state_bits(sim) == before


COMPANION = '[[companion]]\nmass = 0.02\nsemi_major_axis = 3\nsoftening = "0.2"\n'
RAMP = f"{COMPANION}ramp = 0.7\n"


def body(name, *place, value):
    return lambda groups, values: groups["bodies"][name].__setitem__(place, value)


def single(name, value):
    return lambda groups, values: values.__setitem__(name, value)


DAMAGED = {
    "mass that was lost": (body("gained", 1, value=-1e-9), r"bodies\.gained\[1\] is -1e-09; expected 0 or a positive"),
    "a loss of the star": (body("gained", 0, value=-1.0), r"bodies\.gained\[0\] is -1; expected 0 or a positive"),
    "dust that was given": (body("accreted", 1, 1, value=-0.3), r"bodies\.accreted\[1, 1\] is -0\.3; expected 0"),
    "a push": (body("felt", 0, value=-1e-300), r"bodies\.felt\[0\] is -1e-300; expected 0 or a positive number"),
    "one yet to begin": (body("begun", 1, value=1e300), r"bodies\.begun\[1\] is 1e\+300; expected at most the time"),
    "one that soon begins": (
        lambda groups, values: groups["bodies"]["begun"].__setitem__(0, np.nextafter(values["time"], 1.0)),
        r"bodies\.begun\[0\] is 0\.\d+; expected at most the time of the state, 0\.\d+",
    ),
    "a time before the start": (single("time", -1.0), r"time is -1\.0; expected a finite number, 0 or more"),
    "no step": (single("limit", 0.0), r"limit is 0\.0; expected a number above 0"),
    "a limit of no effect": (single("dust_limit", 0.1), r"dust_limited_by is ''; expected one of gas, "),
}


@pytest.fixture(scope="module", params=[COMPANION, RAMP], ids=["no ramp", "ramp"])
def with_companion(request, tmp_path_factory):
    """A simulation after a step, and its checkpoint."""
    folder = tmp_path_factory.mktemp("companion")
    sim = Simulation(scene_of(folder, DISC + request.param, *SMALL, "dust.particles=200", "star.frame=inertial"))
    sim.step()
    sim.save(folder / "whole.h5")
    return sim, folder / "whole.h5"


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_values_are_one_message(with_companion, tmp_path, case):
    (sim, whole), (change, words) = with_companion, DAMAGED[case]
    path = tmp_path / "a.h5"
    path.write_bytes(whole.read_bytes())
    changed(path, change)
    before = state_bits(sim)
    with pytest.raises(CheckpointError, match=words) as caught:
        sim.restore(path)
    assert str(path) in str(caught.value) and state_bits(sim) == before


def test_a_companion_that_has_yet_to_begin_has_no_mass(with_companion):
    (companion,) = with_companion[0].scene.companion
    # Under a ramp of 0 the whole mass is felt from the beginning on.
    assert [ramp_fraction(companion, time) for time in (-1e300, -5e-324, 1e300)] == [0.0, 0.0, 1.0]
    assert ramp_fraction(companion, 0.0) == (companion.ramp == 0.0)


def test_what_an_effect_spoils_is_one_message_of_a_run(tmp_path, monkeypatch, capsys):
    at_step(monkeypatch, 3, lambda sim: sim.dust.species.__setitem__(3, 2))
    assert run_scene(disc(tmp_path, "run.checkpoint_every=1e-9 s"), tmp_path / "out", quiet=True) == 2
    (said,) = errors_of(capsys.readouterr().err)
    assert said == "dust.species[3] is 2; expected a population of the scene, 0 to 1"


def test_checks_change_no_bit_of_what_goes_on(tmp_path):
    assert_resumes(disc(tmp_path), tmp_path / "half.h5", 0.02, 0.04)
