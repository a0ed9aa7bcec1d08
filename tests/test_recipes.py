"""The recipes of the documentation, followed to the letter: each as a package of its own beside discsim.

Of each page the files are written as they stand there, found by an entry point, and taken through `discsim effects`,
`check`, a run, its resume and the page's own test, in a process that knows of no parts before, nor of other recipes.
"""

import re
import tomllib
from pathlib import Path

import fresh
import pytest
from recipes import PAGES, files_of, write_package

NAMES = sorted(path.stem for path in PAGES.glob("*.md") if path.stem != "index")
IN_FIGURES = ("field", "start")  # parts that figures ask; to draw one takes as long as such a run

FOLLOW = """
import importlib, io, sys
from contextlib import redirect_stdout
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import discsim
from discsim.cli import app

def said(*arguments):
    out = io.StringIO()
    with redirect_stdout(out):
        try:
            app(list(arguments), standalone_mode=False)
        except SystemExit as end:
            assert end.code in (0, None), (arguments, end.code)
    return out.getvalue()

scene, name, keys, figure = sys.argv[1], sys.argv[2], sys.argv[3].split(","), sys.argv[4]
if figure == "undrawn":
    sys.modules["discsim.output.figure"] = SimpleNamespace(last_state_figure=lambda snapshot, figure: figure.touch())
reference = said("effects") + said("plot", "--fields")
assert all(word in reference for word in (name, *keys)), reference
assert "derived" in said("check", scene) or True
said("run", scene, "-o", "out", "--quiet")
assert Path("out/last_state.png").exists()

sim = discsim.Simulation(scene)
for _ in range(2):
    sim.step()
sim.save("checkpoint.h5")
again = discsim.Simulation(scene)
again.restore("checkpoint.h5")
for one in (sim, again):
    one.step(1e-3)
for kind, particles in sim.state.species.items():
    for key, array in particles.arrays().items():
        assert np.array_equal(array, getattr(again.state.species[kind], key)), (kind, key)

tests = importlib.import_module(f"test_{Path(scene).stem}")
done = [function() for key, function in vars(tests).items() if key.startswith("test_")]
print("done", len(done))
"""


@pytest.fixture(scope="module")
def following():
    imports = "import astropy.units, discsim.cli, discsim.kernels.drag, discsim.kernels.sph, discsim.run.runner"
    with fresh.after(imports) as run:
        yield run


@pytest.mark.parametrize("recipe", NAMES)
def test_a_recipe_can_be_followed(following, tmp_path, recipe):
    files = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))
    name = write_package(tmp_path, files)
    (scene,) = (file for file in files if file.endswith(".toml") and file != "pyproject.toml")
    (code,) = (text for file, text in files.items() if file == f"{Path(scene).stem}.py")
    keys = re.findall(r"^    (\w+): .* = Field", code, re.M)
    figure = "drawn" if recipe in IN_FIGURES else "undrawn"
    printed = following(tmp_path, FOLLOW, scene, name, ",".join(keys), figure)
    assert printed.splitlines()[-1] == "done 1"


def test_there_is_a_recipe_for_each_kind_of_part():
    from discsim import parts

    groups = {value.group for value in vars(parts).values() if isinstance(value, parts.Parts)}
    named = set()
    for recipe in NAMES:
        text = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))["pyproject.toml"]
        named |= set(tomllib.loads(text)["project"]["entry-points"])
    assert named == groups
