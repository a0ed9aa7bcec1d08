"""The setups that come with discsim, by name: listed, run, copied; also from a wheel, where there is no clone."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from checkout import copy_of_tree
from typer.testing import CliRunner

from discsim import __version__, cli, load_scene, shipped
from discsim.cli import app
from discsim.cli.analyse import SCRIPTS
from setups import SETUPS

HOME = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def work(tmp_path, monkeypatch):
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def loaded(monkeypatch):
    """The scenes that a command would load, which end it."""
    seen = []

    def note(path, overrides, without):
        seen.append(path)
        raise SystemExit(7)

    for module in (cli.runs, cli.scenes, cli.costs):
        monkeypatch.setattr(module, "load", note)
    return seen


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refused(*arguments, status=2):
    """The message of a command that must end with `status`, without a trace."""
    before = sorted(Path.cwd().rglob("*"))
    done = command(*arguments)
    assert done.exit_code == status and done.stdout == "" and "Traceback" not in done.stderr
    assert sorted(Path.cwd().rglob("*")) == before
    return done.stderr.strip()


def test_every_setup_is_listed_with_its_title_and_a_line():
    lines = command("setups").stdout.splitlines()
    assert len(lines) == 2 * len(SETUPS)
    for path, first, second in zip(SETUPS, lines[::2], lines[1::2], strict=True):
        name, title = first.split(maxsplit=1)
        assert name == path.stem and title.startswith(load_scene(path).title + " (")
        assert f"# {second.strip()}\n" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_every_setup_says_what_one_sees_and_how_long_it_takes(path):
    each = shipped.setup(path.stem)
    assert each.about.endswith(".") and len(each.about) < 140
    assert each.notes["What you will see"] and each.notes["How long"]
    for line in each.text[: each.text.index("title = ")].splitlines():
        assert line.startswith("#")  # one comment, which ends where the scene begins


def test_notes_go_on_over_lines_and_end_at_an_empty_one(work):
    path = work / "a.toml"
    path.write_text(
        "# First: a line.\n# Its second.\n#\n# How long: some\n# time.\n#\n# More.\n# Paper: one\ntitle = ''\n"
    )
    each = shipped.Setup(path)
    assert each.about == "First: a line." and each.notes == {"How long": "some time.", "Paper": "one"}


def test_scenes_that_somebody_left_among_them_are_listed_too(work, monkeypatch):
    (work / "mine.toml").write_text("title = 'Mine'\n")
    (work / "wrong.toml").write_text("# Half-made.\ntitle = \n")
    monkeypatch.setattr(shipped, "SETUP_DIRECTORIES", (work,))
    assert command("setups").stdout.split() == ["mine", "Mine", "wrong", "Half-made."]


@pytest.mark.parametrize("name", ["dusty_box", "disc"])
def test_a_copy_has_the_setup_word_for_word(work, name):
    done = command("new", name, "my.toml")
    assert done.exit_code == 0 and "discsim run my.toml" in done.stdout
    assert (work / "my.toml").read_bytes() == (HOME / "setups" / f"{name}.toml").read_bytes()
    assert command("new", name).exit_code == 0
    assert (work / f"{name}.toml").read_bytes() == (work / "my.toml").read_bytes()


def test_a_copy_replaces_nothing(work):
    (work / "my.toml").write_text("mine")
    (work / "folder").mkdir()
    (work / "link.toml").symlink_to(work / "nowhere")
    for name in ("my.toml", "folder", "link.toml"):
        assert refused("new", "disc", name) == f"{name}: already exists; give the name of a new file"
    assert (work / "my.toml").read_text() == "mine"


def test_a_copy_that_cannot_be_written_leaves_nothing():
    told = refused("new", "disc", "absent/my.toml", status=1)
    assert told == "absent/my.toml: cannot be written: No such file or directory"
    if os.path.exists("/dev/full"):

        class Full(type(Path())):
            def open(self, mode):
                Path(self).touch()
                return open("/dev/full", "wb")

        with pytest.raises(OSError, match="No space"):
            shipped.copy_setup("disc", Full("my.toml"))
        assert not os.path.exists("my.toml")


def test_a_copy_of_an_unknown_setup():
    assert refused("new", "dusty-bx") == ('dusty-bx: unknown setup; did you mean "dusty_box"?')
    assert refused("new", "xyz") == "xyz: unknown setup; `discsim setups` lists them"


@pytest.mark.parametrize(
    "arguments", [["run"], ["check"], ["cost", "--vary", "drag.K=1,2", "-o", "out"]], ids=lambda words: words[0]
)
def test_a_bare_name_is_a_shipped_setup(loaded, arguments):
    assert command(arguments[0], "dusty_box", *arguments[1:]).exit_code == 7
    assert [path.resolve() for path in loaded] == [HOME / "setups" / "dusty_box.toml"]


def test_a_file_always_wins(work, loaded):
    (work / "dusty_box").mkdir()  # a directory is no scene
    command("check", "dusty_box")
    (work / "dusty_box.toml").write_text("")  # what `discsim new dusty_box` leaves
    command("check", "dusty_box")
    (work / "dusty_box").rmdir()
    (work / "dusty_box").write_text("")
    command("check", "dusty_box")
    command("check", "./dusty_box")
    assert [str(path) for path in loaded[1:]] == ["dusty_box.toml", "dusty_box", "dusty_box"]
    assert loaded[0].resolve() == HOME / "setups" / "dusty_box.toml"


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_scene_that_is_not_there(verb, work):
    expected = "file not found; give a scene file (TOML)"
    assert refused(verb, "dusty_bix") == f'dusty_bix: {expected}, or the name of a setup; did you mean "dusty_box"?'
    assert refused(verb, "xyz") == f"xyz: {expected}, or the name of a setup; `discsim setups` lists them"
    of_clone = refused(verb, "setups/dusty_box.toml")
    assert of_clone == f"setups/dusty_box.toml: {expected}; for the setup of this name give: dusty_box"
    assert refused(verb, "no.toml") == f"no.toml: {expected}"
    assert "give a scene" in refused(verb, "x" * 300)
    (work / "folder").mkdir()
    assert refused(verb, "folder") == "folder: is a directory; give a scene file (TOML)"


def test_a_setup_runs_by_its_name_and_what_it_leaves_says_which_version_wrote_it(work):
    import h5py
    from PIL import Image

    assert command("run", "dusty_box", "--until", "0.01", "--quiet").exit_code == 0
    out = work / "runs/dusty_box"
    for name in ("snapshots/0000.h5", "checkpoint.h5"):
        with h5py.File(out / name) as file:
            assert file.attrs["version"].decode() == __version__
    assert (out / "run.log").read_text(encoding="utf-8").startswith(f"discsim {__version__}: ")
    with Image.open(out / "last_state.png") as image:
        assert image.info["Software"] == f"discsim {__version__}"


def test_the_version_is_told_once():
    """pyproject.toml takes it from the package, and what people cite says the same."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in project["project"]["dynamic"]
    assert project["tool"]["hatch"]["version"]["path"] == "discsim/version.py"
    assert f'\nversion: "{__version__}"\n' in (HOME / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## [{__version__}]" in (HOME / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_wheel_needs_no_clone(work):
    """Built from a copy of the tree, installed with what it depends on in an environment of its own."""
    copy, environment = work / "copy", work / "venv"
    copy_of_tree(copy)
    outside = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

    def made(*words):
        done = subprocess.run(list(map(str, words)), cwd=work, env=outside, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    made(sys.executable, "-m", "venv", environment)
    made(environment / "bin/pip", "wheel", "--no-deps", "-w", work / "dist", copy)
    shutil.rmtree(copy)
    (wheel,) = (work / "dist").glob(f"discsim2d-{__version__}-*.whl")
    made(environment / "bin/pip", "install", wheel)
    discsim = environment / "bin/discsim"
    assert made(discsim, "--version") == f"discsim {__version__}\n"
    assert len(made(discsim, "setups").splitlines()) == 2 * len(SETUPS)
    made(discsim, "run", "dusty_box")
    assert (work / "runs/dusty_box/last_state.png").is_file()
    made(discsim, "new", "disc", "my.toml")
    assert (work / "my.toml").read_bytes() == (HOME / "setups/disc.toml").read_bytes()
    assert "A first disc" in made(discsim, "check", "my.toml")
    for name in SCRIPTS:
        assert made(discsim, "analyse", name, "--help").startswith(f"usage: discsim analyse {name} ")
    scripts = {file.name for file in environment.glob("lib/*/site-packages/discsim/analysis/*") if file.is_file()}
    assert scripts == {f"{script}.py" for script, _ in SCRIPTS.values()}
