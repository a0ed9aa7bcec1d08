"""Instructions of the pages for installing: three commands of the README, extras, the name of the distribution."""

import ast
import os
import re
import subprocess
import sys

import environment
import pytest
from checkout import EXTRAS, HOME, PROJECT, copy_of_tree, packages_of

from discsim.parts import install_command

README = (HOME / "README.md").read_text(encoding="utf-8")
COMMANDS = [line for line in README.splitlines() if ".venv/bin/pip install -e " in line]
OURS = {"discsim", *(path.stem for path in HOME.glob("docs/*.py"))}
WITH_SPHINX = {"docutils"}  # what sphinx itself is made of


def texts():
    """Every text of the tree in which a user may find a command."""
    for folder in ("discsim", "docs", "setups", "analysis", "tests"):
        yield from (path for path in (HOME / folder).rglob("*.*") if path.suffix in (".py", ".md", ".toml", ".ipynb"))
    yield from (HOME / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "pyproject.toml"))


def test_no_page_and_no_message_installs_another_project():
    """The name discsim on the package index is not ours: everything is installed from a clone."""
    assert PROJECT["name"] == "discsim2d" and PROJECT["scripts"]["discsim"]
    for path in texts():
        packages = re.findall(r"pip install ['\"]?([\w-]+)", path.read_text(encoding="utf-8"))
        assert "discsim" not in packages or path.name == "install.md", path
    assert install_command("mpi") == "pip install -e '.[mpi]' in a clone of discsim"


def test_the_page_has_every_extra():
    page = (HOME / "docs/install.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.M)) == set(EXTRAS)
    named = {
        extra for path in texts() for extra in re.findall(r"install_command\(\W(\w+)\W\)", path.read_text("utf-8"))
    }
    assert named and named <= set(EXTRAS)


def test_the_site_is_installed_with_what_builds_it():
    """Modules that docs/*.py import, and the extensions and the theme that docs/conf.py names."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in HOME.glob("docs/*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    modules = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    modules |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    settings = {
        node.targets[0].id: node.value
        for node in nodes
        if isinstance(node, ast.Assign) and hasattr(node.targets[0], "id")
    }
    modules |= set(ast.literal_eval(settings["extensions"])) | {ast.literal_eval(settings["html_theme"])}
    packages = {name.split(".")[0] for name in modules} - set(sys.stdlib_module_names) - OURS - WITH_SPHINX
    packages = {name.replace("_", "-") for name in packages}
    assert {"sphinx", "myst-nb", "furo"} <= packages <= packages_of("docs")


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """A function that runs a command of the README in a copy of the tree, with a shell that has set nothing."""
    clone = tmp_path_factory.mktemp("fresh") / "clone"
    copy_of_tree(clone)
    variables = dict(os.environ)
    environment.settle(variables)
    variables = {
        key: value for key, value in variables.items() if key not in (*environment.SET, "PYTHONPATH", "NUMBA_CACHE_DIR")
    }

    def run(command, **changes):
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=clone,
            env=variables | changes,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]
        return done.stdout

    run.clone = clone
    return run


@pytest.mark.slow
def test_the_first_command_runs_the_main_job(fresh):
    fresh(COMMANDS[0])
    assert (fresh.clone / "runs/dusty_disc/last_state.png").is_file()


@pytest.mark.slow
def test_the_second_command_runs_the_tests(fresh):
    """All of them are collected, with all that their files import; those that need packages of the extra run."""
    some = "test_notebook or test_layers or test_exact or test_watch"
    assert " passed" in fresh(COMMANDS[1], PYTEST_ADDOPTS=f"-k '{some}'").splitlines()[-1]


@pytest.mark.slow
def test_the_third_command_builds_the_site(fresh):
    """Whole, with the runs of the gallery and of the notebook, in an environment that has this extra alone."""
    fresh("rm -rf .venv && python3 -m venv .venv && " + COMMANDS[2])
    assert (fresh.clone / "docs/_build/html/index.html").is_file()
    assert "to_pandas" in (fresh.clone / "docs/_build/html/notebook.html").read_text(encoding="utf-8")


def test_the_readme_has_three_commands():
    endings = ("bin/discsim run setups/dusty_disc.toml -o runs/dusty_disc", "-m pytest", "-W docs docs/_build/html")
    assert len(COMMANDS) == 3 and all(map(str.endswith, COMMANDS, endings))
