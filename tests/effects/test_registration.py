"""Effects that a script registers: the recipe of the documentation without a package."""

import re
import tomllib

import numpy as np
import pytest
from installed import looked_up_anew
from recipes import PAGES, files_of
from runs import assert_resumes

import discsim
from discsim.effects import base
from discsim.parts import EFFECTS, PartError
from discsim.scene.fields import Table

SCENE = {
    "units": {"system": "code"}, "run": {"until": 1.0, "courant": 0.05}, "space": {"size": 6.0},
    "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0},
    "dust": {"particles": 90, "ratio": 0.1}, "star": {"mass": 1.3}, "lamp": {"beta": 0.2},
}  # fmt: skip


@pytest.fixture(autouse=True)
def none_registered(monkeypatch):
    """Without effects that others have registered, before and after."""
    monkeypatch.setattr(EFFECTS, "added", {})
    with looked_up_anew():
        yield


@pytest.fixture
def lamp():
    """The class of the recipe, as a cell of a notebook defines it."""
    names = {"__name__": "__main__"}
    exec(files_of((PAGES / "effect.md").read_text(encoding="utf-8"))["lamp.py"], names)
    return names["Effect"]


def test_a_registered_effect_acts_in_scenes_from_a_dict_and_a_file(lamp, tmp_path):
    with pytest.raises(discsim.SceneError, match="lamp: unknown table"):
        discsim.load_scene(SCENE)
    discsim.register(lamp=lamp)
    discsim.register(lamp=lamp)  # a cell that is run again
    path = tmp_path / "lamp.toml"
    path.write_text(discsim.load_scene(SCENE).text)
    for scene in (SCENE, path):
        sim = discsim.Simulation(scene)
        away, r = sim.dust.pos, np.linalg.norm(sim.dust.pos, axis=1)
        expected = 0.2 * 1.3 * away / r[:, None] ** 3
        np.testing.assert_allclose(sim.acceleration("lamp")[1], expected, rtol=1e-13)
        assert list(sim.effects) == ["dust", "star", "lamp"]
    with pytest.raises(discsim.SceneError, match=r"lamp[.]beta: -0[.]3 is not positive"):
        discsim.load_scene(SCENE | {"lamp": {"beta": -0.3}})


def test_a_registered_effect_resumes_to_the_same_bits(lamp, tmp_path):
    discsim.register(lamp=lamp)
    assert assert_resumes(SCENE, tmp_path / "checkpoint.h5", 0.2, 0.4).costs.calls["lamp"] > 0


def test_the_friction_of_the_recipe_is_second_order():
    """x = v t_stop (1 - exp(-t / t_stop)): half steps around the drift have the error (dt / t_stop)^2 / 24."""
    page = (PAGES / "effect.md").read_text(encoding="utf-8")
    (text,) = (block for block in re.findall(r"^```python\n(.*?)^```$", page, re.S | re.M) if "register(" in block)
    names = {"__name__": "__main__"}
    exec(text, names)
    vel, left = np.array([[1.0, 0.5]]), np.exp(-1.0 / 2.0)
    for timestep, sim in ((0.02, names["sim"]), (0.5, coarse(names["sim"]))):
        np.testing.assert_allclose(sim.dust.vel, vel * left, rtol=1e-13)
        error = 1.0 - sim.dust.pos / (2.0 * vel * (1.0 - left))
        np.testing.assert_allclose(error, (timestep / 2.0) ** 2 / 24.0, rtol=0.01)


def coarse(sim):
    """The same run with a step of 0.5."""
    given = {"pos": [[0.0, 0.0]], "vel": [[1.0, 0.5]], "mass": [1e-6]}
    scene = tomllib.loads(sim.scene.text)
    again = discsim.Simulation(scene | {"run": scene["run"] | {"timestep": 0.5}}, particles={"dust": given})
    again.run()
    return again


class NoKeys(base.Effect):
    """Effect without a table."""


class Other(base.Effect):
    """Effect with an empty table."""

    keys = type("Keys", (Table,), {})


WRONG = {
    "star is a name of discsim or of a package; expected another name": {"star": Other},
    "units is a name of discsim": {"units": Other},
    "others is a name of discsim": {"others": Other},
    '"a lamp" is no name of a table; expected letters': {"a lamp": Other},
    "lens is of type int; expected a subclass of discsim.effects.base.Effect": {"lens": 3},
    f"lens is {Table.__module__}.Table; expected a subclass": {"lens": Table},
    "NoKeys has no keys for [lens]; expected keys = a subclass of discsim.scene.fields.Table": {"lens": NoKeys},
    "lamp is registered as __main__.Effect; expected another name, or a new process": {"lamp": Other},
}


@pytest.mark.parametrize("words", WRONG)
def test_a_name_or_class_that_cannot_be_used_is_one_message_and_adds_nothing(lamp, words):
    discsim.register(lamp=lamp)
    with pytest.raises(PartError, match=re.escape(words)):
        discsim.register(mirror=Other, **WRONG[words])
    assert list(EFFECTS.added) == ["lamp"] and EFFECTS["lamp"] is lamp
