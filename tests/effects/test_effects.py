"""Effects: one of another package is as good as one of our own, and the loop knows none by name."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from installed import install, looked_up_anew
from runs import DISC, assert_same_run, scene_of
from typer.testing import CliRunner

import discsim
from discsim import Simulation
from discsim.cli import app, main
from discsim.parts import EFFECTS, PartError
from discsim.run.runner import run_scene
from discsim.scene import SceneError, load_scene
from discsim.scene.differences import differences

PART = '''
"""A spring: a = -Omega^2 x, on the gas alone."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from discsim.effects import base
from discsim.scene.fields import Number, Table


class Keys(Table):
    """What holds the gas."""

    strength: Number = Field(gt=0, description="Omega")


def is_open(draft):
    if draft.space and draft.space.boundary == "periodic":
        yield ("spring",), "a periodic space has no middle; expected open boundaries"


class Effect(base.Effect):
    keys = Keys
    rules = (is_open,)

    def __init__(self, scene, state):
        self.strength = scene.table("spring").strength

    def operators(self, state):
        pos, acc = base.arrays("gas", "pos"), base.arrays("gas", "acc_unshared")
        return [
            base.Operator("spring.pull", base.Slot.FORCE, self.pull, pos, acc),
            base.Operator("spring.limit", base.Slot.LIMIT, self.limit),
        ]

    def pull(self, view):
        acc = view.gas.acc_unshared
        acc -= self.strength**2 * view.gas.pos

    def limit(self, view):
        return {base.ALL: base.Limit(1.0 / self.strength)}
'''

KINDS = """
class Long(Table):
    kind: Literal["long"] = "long"


class Short(Table):
    kind: Literal["short"] = "short"


class Keys(Table):
    form: Annotated[Long | Short, Field(discriminator="kind")] = Long()
"""

SCENE = """\
units.system = "code"
run = {until = 0.02, snapshots = 2}
space = {dimensions = 1, size = 1, boundary = "open"}
initial = {kind = "shock"}
gas = {particles = 40, eos = {kind = "adiabatic", gamma = 1.4}}
spring.strength = 60
"""


@pytest.fixture
def spring(tmp_path, monkeypatch):
    """The file of a scene with a spring, from an installed package."""
    site = tmp_path / "site"
    install(site, {"springs": PART}, {"discsim.effects": {"spring": "springs:Effect"}})
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "springs", raising=False)
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    path = tmp_path / "spring.toml"
    path.write_text(SCENE)
    with looked_up_anew():
        yield path


def test_it_is_told_and_checked(spring):
    told = CliRunner().invoke(app, ["effects"]).output
    assert "[spring]\n  A spring: a = -Omega^2 x, on the gas alone." in told and re.search(r"strength +number", told)
    done = CliRunner().invoke(app, ["check", str(spring)])
    assert done.exit_code == 0, done.output
    assert re.search(r"\n  spring +strength 60\n", done.output)
    assert load_scene(spring, without=["spring"]).named == ("gas",)


def test_it_acts_and_limits_the_step(spring):
    """Steps are the Courant number over its frequency, which sound alone would allow to be longer."""
    sim = Simulation(load_scene(spring))
    with sim.synchronised():
        assert sim.limited_by == "spring"
    assert sim.step() == pytest.approx(0.3 / 60, rel=1e-12)
    free = ~sim.gas.immobile
    np.testing.assert_allclose(sim.acceleration("spring")[0][free], -3600 * sim.gas.pos[free], rtol=1e-12)
    assert list(sim.costs.calls) == ["gas", "spring"] and sim.costs.calls["spring"] > 0


def test_it_resumes_to_the_same_bits(spring, tmp_path):
    scene = load_scene(spring)
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    stopped = load_scene(spring, ["run.walltime=1e-6 s"])
    assert run_scene(stopped, tmp_path / "resumed", quiet=True) == 0
    assert run_scene(scene, tmp_path / "resumed", resume=True, quiet=True) == 0
    assert_same_run(tmp_path / "straight", tmp_path / "resumed")
    assert "spring" in (tmp_path / "resumed" / "costs.csv").read_text()
    other = load_scene(spring, ["spring.strength=999"])
    assert list(differences(scene, other)) == ["spring.strength"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("spring.strenght=2", 'spring.strenght: unknown key; expected one of strength; did you mean "strength"?'),
        ("spring.strength=-2", "spring.strength: -2 is not positive; expected more than 0"),
        ("sprong.strength=2", 'unknown table; expected one of *spring; did you mean "spring"?'),
        ('space.boundary="periodic"', "spring: a periodic space has no middle; expected open boundaries"),
    ],
)
def test_its_faults_are_told(spring, change, words):
    with pytest.raises(SceneError) as found:
        load_scene(spring, [change])
    assert re.search(re.escape(words).replace(r"\*", ".*"), "\n".join(found.value.problems))


def test_a_table_in_it_may_be_of_several_kinds(spring):
    package = spring.parent / "site" / "springs.py"
    package.write_text(PART.replace("\nclass Keys(Table):\n", KINDS))
    with pytest.raises(SceneError, match=r'spring\.form\.kind: missing; expected one of "long", "short"'):
        load_scene(spring, ["spring.form={}"])


def test_a_part_that_cannot_be_imported_is_one_message(spring, monkeypatch, capsys):
    (spring.parent / "site" / "springs.py").write_text("import absent_module")
    monkeypatch.setattr(sys, "argv", ["discsim", "check", str(spring)])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    assert ended.value.code == 2 and told.count("\n") == 1
    assert told.startswith(
        'discsim.effects: "spring" of another package cannot be imported from springs:Effect: Module'
    )


def test_two_parts_of_one_name_are_one_message(tmp_path, monkeypatch):
    install(tmp_path, {"stars": "Effect = None"}, {"discsim.effects": {"star": "stars:Effect"}})
    monkeypatch.syspath_prepend(tmp_path)
    with (
        looked_up_anew(),
        pytest.raises(PartError, match=r'"star" belongs to discsim[.]effects[.]star:Effect, and to stars'),
    ):
        list(EFFECTS)


def test_a_second_owner_of_the_kick_is_refused(spring):
    package = spring.parent / "site" / "springs.py"
    package.write_text(PART.replace("keys = Keys", "keys, role = Keys, base.Role(kicks=True)"))
    extra = ["dust={particles=40, ratio=1}", 'drag={law="stopping-time", t_stop=1}']
    with pytest.raises(SceneError, match=r"spring: \[drag\] already couples gas and dust"):
        load_scene(spring, extra)


def test_the_loop_names_no_effect():
    """Only the species, gas and dust, have names there that are those of tables too."""
    named = re.compile("|".join(rf"[\"'.]{name}\b" for name in EFFECTS if name not in ("gas", "dust")))
    home = Path(discsim.__file__).parent / "run"
    found = [
        f"{file.name}: {line.strip()}" for file in home.glob("*.py") for line in code_of(file) if named.search(line)
    ]
    assert found == []


def code_of(file):
    """The lines of a module without docstrings and comments."""
    text = re.sub(r'"""(.*?)"""', "", file.read_text(), flags=re.DOTALL)
    return [line.partition("#")[0] for line in text.splitlines()]


def test_the_first_step_puts_particles_in_order(tmp_path):
    """A start is on rings, along which neighbours in memory are near in one direction alone."""
    sim = Simulation(scene_of(tmp_path, DISC, "star.accretion_radius=0.1"))  # nothing leaves
    assert np.array_equal(sim.dust.ids, 1000 + np.arange(1100))
    sim.step()
    place = sim.state.grid.sort_keys(sim.dust.pos)[0]
    assert np.array_equal(np.lexsort((sim.dust.ids, place)), np.arange(sim.dust.count))
    assert not np.array_equal(sim.gas.ids, np.sort(sim.gas.ids))
