"""Starts: one of another package is as good as one of our own, and none is known beside its own file."""

import csv
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from installed import install, looked_up_anew
from scipy.special import erf
from typer.testing import CliRunner

import discsim
from discsim import Simulation
from discsim.cli import app
from discsim.parts import STARTS
from discsim.preview.derived import gas_at_start, gas_mass
from discsim.run.runner import run_scene
from discsim.scene import SceneError, load_scene
from discsim.study.errors import measure_of

PART = '''
"""A stream: uniform gas that moves along x."""

from typing import Literal

import numpy as np

from discsim.initial.base import Start
from discsim.initial.lattice import sample_uniform_gas, uniform_particles
from discsim.initial.measure import ErrorMeasure, velocity_errors
from discsim.scene.fields import Table, Velocity


class Stream(Table):
    """Gas that moves."""

    kind: Literal["stream"] = "stream"
    speed: Velocity = 1.0


def particles(scene):
    out = uniform_particles(scene, 2.0)
    out["gas"]["vel"] += scene.initial.speed
    return out


def measure(scene):
    # Against twice its speed: the error is a half.
    exact = velocity_errors(lambda sim, kind: (np.array([[2.0 * scene.initial.speed]]), 0.0))
    return ErrorMeasure("velocities against those of another stream", exact)


def warnings(scene):
    if scene.initial.speed > 1.0:
        yield f"initial.speed = {scene.initial.speed:g} is fast: lower it to 1"


def is_slow(draft):
    if draft.initial.speed > 10.0:
        yield ("initial", "speed"), "too fast; expected 10 at most"


START = Start(
    Stream,
    particles,
    lambda scene: sample_uniform_gas(2.0),
    dimensions=(1,),
    eos=("isothermal",),
    rules=(is_slow,),
    kernel="quintic",
    warnings=warnings,
    measure=measure,
    exact_effects=("external",),
)
'''

SCENE = """\
units.system = "code"
run = {until = 0.1, snapshots = 2}
space = {dimensions = 1, size = 1, boundary = "periodic"}
initial = {kind = "stream", speed = 2}
gas = {particles = 30, eos = {kind = "isothermal", sound_speed = 1}}
"""


@pytest.fixture
def stream(tmp_path, monkeypatch):
    """The file of a scene that starts with a stream, from an installed package."""
    site = tmp_path / "site"
    install(site, {"streams": PART}, {"discsim.starts": {"stream": "streams:START"}})
    monkeypatch.syspath_prepend(site)
    path = tmp_path / "stream.toml"
    path.write_text(SCENE)
    with looked_up_anew():
        yield path


def test_a_start_of_another_package_is_checked(stream):
    done = CliRunner().invoke(app, ["check", str(stream)])
    assert done.exit_code == 0, done.output
    assert re.search(r"mass of gas +2\n", done.output) and "at   " in done.output and "everywhere" in done.output
    assert "initial.speed = 2 is fast" in done.output
    done = CliRunner().invoke(app, ["effects"])
    assert 'initial.kind = "stream": Gas that moves.' in done.output and "speed " in done.output
    scene = load_scene(stream)
    assert scene.gas.kernel == "quintic" and gas_mass(scene) == 2.0 and gas_at_start(scene).density == [2.0]


def test_its_rules_hold(stream):
    wrong = ["initial.speed=11", 'space.boundary="open"', 'gas.eos={kind="polytropic", gamma=2, constant=1}']
    with pytest.raises(SceneError) as found:
        load_scene(stream, wrong)
    told = "\n".join(found.value.problems)
    for words in (
        "initial.speed: too fast; expected 10 at most",
        '"open" is not possible with initial.kind = "stream"; expected "periodic"',
        '"polytropic" is not possible with initial.kind = "stream"; expected "isothermal"',
    ):
        assert words in told


def test_it_runs_and_resumes_to_the_same_bits(stream, tmp_path):
    scene = load_scene(stream)
    straight, other = Simulation(scene), Simulation(scene)
    for _ in range(3):
        straight.step()
    other.step()
    other.save(tmp_path / "checkpoint.h5")
    resumed = Simulation(scene)
    resumed.restore(tmp_path / "checkpoint.h5")
    for _ in range(2):
        resumed.step()
    assert straight.gas.pos.tobytes() == resumed.gas.pos.tobytes() and straight.time == resumed.time
    # Rounding of forces that cancel, over some steps.
    np.testing.assert_allclose(straight.gas.vel, 2.0, rtol=1e-12)
    out = tmp_path / "run"
    assert run_scene(scene, out, quiet=True) == 0 and (out / "last_state.png").stat().st_size > 5000
    assert run_scene(scene, out, resume=True, quiet=True) == 0


def test_a_cost_study_measures_its_error(stream, tmp_path):
    out = tmp_path / "study"
    done = CliRunner().invoke(app, ["cost", str(stream), "--vary", "gas.particles=20,30", "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "velocities against those of another stream" in done.output
    with (out / "cost.csv").open(newline="") as file:
        assert [float(row["error"]) for row in csv.DictReader(file)] == pytest.approx([0.5, 0.5], rel=1e-9)
    # The exact solution knows external accelerations, but no self-gravity.
    measure = measure_of(load_scene(stream, ["external.gas=0.1"]))
    assert measure is not None and measure.words == "velocities against those of another stream"
    assert measure_of(load_scene(stream, ["self_gravity.softening=0.1"])) is None


def test_without_its_package_the_kind_is_unknown(tmp_path):
    path = tmp_path / "stream.toml"
    path.write_text(SCENE)
    with pytest.raises(SceneError, match='"stream"'):
        load_scene(path)


def own_file(kind):
    return Path(discsim.__file__).parent.parent / (STARTS.module(kind).replace(".", "/") + ".py")


def test_no_other_file_names_a_start():
    home = Path(discsim.__file__).parent
    own = {own_file(kind) for kind in STARTS}
    quoted = re.compile(r"[\"'](" + "|".join(STARTS) + r")[\"']")
    named = [
        f"{file.relative_to(home)}:{number}: {line.strip()}"
        for file in sorted(home.rglob("*.py"))
        if file.parent.name != "initial" and file not in own and file != home / "parts.py"
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if quoted.search(line) and "hdf5." not in line  # which are told kinds of files
    ]
    assert named == []


def test_a_start_is_named_in_its_own_file_alone():
    files = {*(Path(discsim.__file__).parent / "initial").glob("*.py"), *map(own_file, STARTS)}
    for kind in STARTS:
        naming = {file for file in files if re.search(rf"[\"']{kind}[\"']", file.read_text())}
        assert naming == {own_file(kind)}


@pytest.mark.parametrize(("grains", "offset"), [(60, 0.5), (240, 0.3)])
def test_grains_of_a_layer_are_offset_by_shares_of_a_gas_particle(grains, offset):
    """Below each grain is more of the layer's gas by that share of the mass of one, whatever the number of grains."""
    tables = {
        "units": {"system": "code"},
        "run": {"until": 0.1},
        "space": {"dimensions": 1, "size": 5.0},
        "external": {"vertical_frequency": 0.8},
        "initial": {"kind": "settling", "density": 1.3},
        "gas": {"particles": 120, "eos": {"kind": "isothermal", "sound_speed": 1.1}},
        "dust": {"particles": grains, "ratio": 0.01, "offset": 0.0},
    }
    height, below = 1.1 / 0.8, []
    for shift in (0.0, offset):
        scene = load_scene(tables | {"dust": tables["dust"] | {"offset": shift}})
        z = STARTS["settling"].particles(scene)["dust"]["pos"][:, 0]
        below.append(0.5 * erf(z / height / np.sqrt(2.0)))
    between = erf(2.5 / height / np.sqrt(2.0))
    np.testing.assert_allclose((below[1] - below[0])[:-1], offset / 120 * between, rtol=1e-9)  # of erf's inverse


def test_error_of_a_blast_is_the_same_in_open_and_periodic_boxes():
    """The middle of a periodic box is not the origin."""
    errors = []
    for boundary in ("open", "periodic"):
        scene = load_scene({
            "units": {"system": "code"}, "run": {"until": 0.1}, "space": {"size": 1.0, "boundary": boundary},
            "initial": {"kind": "blast", "radius": 0.05},
            "gas": {"particles": 10_000, "eos": {"kind": "adiabatic", "gamma": 1.4}},
        })  # fmt: skip
        arrays = STARTS["blast"].particles(scene)["gas"]
        r = np.sqrt(((arrays["pos"] - arrays["pos"].mean(axis=0)) ** 2).sum(axis=1))
        gas = SimpleNamespace(pos=arrays["pos"], mass=1e-4 * np.where(np.abs(r - 0.3) < 0.02, 4.0, 1.0), count=10_000)
        sim = SimpleNamespace(time=0.1, gas=gas, state=SimpleNamespace(species={"gas": gas}))
        errors.append(measure_of(scene).errors(sim)["gas"])
    assert errors[0] == pytest.approx(errors[1], abs=0.02) and errors[0] < 0.2


@pytest.mark.parametrize("kind", list(STARTS))
def test_what_a_start_says_is_consistent(kind):
    start = STARTS[kind]
    assert start.keys.model_fields["kind"].default == kind and start.keys.__doc__
    assert start.min_half_side is None or start.min_half_side[0] in start.keys.model_fields
    # Only a scene in one dimension is on cells, and only what is exact can be drawn over the middle of space.
    assert start.cell_values is None or 1 in start.dimensions
    assert start.figure_velocity is None or (start.exact_curves is not None and start.dimensions == (2,))
    assert not start.exact_effects or start.measure is not None
