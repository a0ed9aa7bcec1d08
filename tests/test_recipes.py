"""The recipes of the documentation, followed to the letter: each as a package of its own beside discsim.

The commands of each page run as they stand there, in a fresh environment, among the files of the page and no others.
Beside that each part is taken through a resume in a process that knows of no parts before, nor of other recipes.
"""

import os
import re
import site
import subprocess
import sys
import tomllib
import venv
from pathlib import Path

import fresh
import pytest
from recipes import PAGES, commands_of, files_of, write_package

HOME = Path(__file__).parents[1]
IN_DISCSIM = ("gas_model",)  # parts that packages cannot add
NAMES = sorted(path.stem for path in PAGES.glob("*.md") if path.stem not in ("index", *IN_DISCSIM))
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

# A part in discsim itself is registered by lines of parts.py, before other modules read its lists.
REGISTER = """
import sys
sys.path.insert(0, ".")
from discsim import parts
parts.MODELS = ("steady:MODEL", *parts.MODELS)
parts.EFFECTS._own["steady"] = "steady:Effect"
"""


@pytest.fixture
def environment(tmp_path):
    """Variables of a shell in a fresh environment that has discsim: it finds the packages of this one."""
    home = tmp_path / "environment"
    venv.create(home, with_pip=True)
    (packages,) = home.glob("lib/python*/site-packages")
    lines = [f"import site; site.addsitedir({folder!r})\n" for folder in (*site.getsitepackages(), str(HOME))]
    (packages / "beside.pth").write_text("".join(lines))
    for name in ("discsim", "pytest"):  # scripts of packages that are beside
        module = {"discsim": "discsim.cli", "pytest": "pytest"}[name]
        script = home / "bin" / name
        script.write_text(f"#!{home / 'bin/python'}\nfrom {module} import main\nmain()\n")
        script.chmod(0o755)
    return os.environ | {"PATH": f"{home / 'bin'}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.slow  # pip fetches what builds the package
@pytest.mark.parametrize("recipe", NAMES)
def test_the_commands_of_a_page_work(environment, tmp_path, recipe):
    page = (PAGES / f"{recipe}.md").read_text(encoding="utf-8")
    folder = tmp_path / "copied"
    folder.mkdir()
    for name, text in files_of(page).items():
        (folder / name).write_text(text, encoding="utf-8")
    for command in commands_of(page):
        done = subprocess.run(
            ["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, (command, done.stdout[-3000:], done.stderr[-3000:])
    assert "1 passed" in done.stdout and (folder / "out/last_state.png").is_file()


@pytest.mark.parametrize("recipe", NAMES)
def test_a_page_has_a_whole_package_and_its_commands(recipe):
    """All that pip needs, and the files that the commands name."""
    page = (PAGES / f"{recipe}.md").read_text(encoding="utf-8")
    files, commands = files_of(page), commands_of(page)
    project = tomllib.loads(files["pyproject.toml"])
    (points,) = project["project"]["entry-points"].values()
    modules = [home.partition(":")[0] for home in points.values()]
    assert project["project"]["name"] and project["project"]["version"]
    assert project["build-system"]["build-backend"] == "setuptools.build_meta"
    assert project["tool"]["setuptools"]["py-modules"] == modules and f"{modules[0]}.py" in files
    assert commands[0] == "pip install -e ." and commands[-1] == f"python -m pytest test_{modules[0]}.py"
    named = {word for command in commands for word in command.split() if re.search(r"[.](py|toml)$", word)}
    assert named == files.keys() - {"pyproject.toml", f"{modules[0]}.py"}


@pytest.fixture(scope="module")
def following():
    imports = (
        "import astropy.units, discsim.cli, discsim.kernels.drag.cells, discsim.kernels.sph.forces, discsim.run.runner"
    )
    with fresh.after(imports) as run:
        yield run


@pytest.mark.parametrize("recipe", NAMES)
def test_the_part_of_a_recipe_resumes_to_the_same_bits(following, tmp_path, recipe):
    files = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))
    name = write_package(tmp_path, files)
    (scene,) = (file for file in files if file.endswith(".toml") and file != "pyproject.toml")
    (code,) = (text for file, text in files.items() if file == f"{Path(scene).stem}.py")
    keys = re.findall(r"^    (\w+): .* = Field", code, re.M)
    figure = "drawn" if recipe in IN_FIGURES else "undrawn"
    printed = following(tmp_path, FOLLOW, scene, name, ",".join(keys), figure)
    assert printed.splitlines()[-1] == "done 1"


@pytest.mark.parametrize("recipe", IN_DISCSIM)
def test_a_part_of_discsim_itself_resumes_to_the_same_bits(tmp_path, recipe):
    files = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (scene,) = (name for name in files if name.endswith(".toml"))
    script = REGISTER + FOLLOW
    done = subprocess.run(
        [sys.executable, "-c", script, scene, "steady", "step", "undrawn"], cwd=tmp_path, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.splitlines()[-1] == "done 1"


def test_there_is_a_recipe_for_each_kind_of_part():
    from discsim import parts

    groups = {value.group for value in vars(parts).values() if isinstance(value, parts.Registry)}
    named = set()
    for recipe in NAMES:
        text = files_of((PAGES / f"{recipe}.md").read_text(encoding="utf-8"))["pyproject.toml"]
        named |= set(tomllib.loads(text)["project"]["entry-points"])
    assert named == groups
