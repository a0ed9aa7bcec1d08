"""The command line: what is wrong is told in one message with exit status 2, and nothing is written."""

import os
import subprocess
import sys
from types import ModuleType

import pytest
from scenes import DISC, write
from typer.testing import CliRunner

import discsim
from discsim.cli import app
from discsim.parts import EFFECTS
from discsim.run.directory import directory_fault


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """The calls of run_scene, which a stand-in answers with status 3; the working directory is empty."""
    seen = []
    runner = ModuleType("discsim.run.runner")
    runner.run_scene = lambda scene, directory, **options: seen.append((scene, directory, options)) or 3
    monkeypatch.setitem(sys.modules, "discsim.run.runner", runner)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return seen


def discsim_command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refused(calls, *arguments):
    """The message of a command that must end with status 2, without a trace."""
    done = discsim_command(*arguments)
    assert done.exit_code == 2
    assert calls == [] and os.listdir() == []
    assert done.stdout == "" and "Traceback" not in done.stderr
    return done.stderr.strip()


def test_run_hands_the_scene_over(tmp_path, calls):
    done = discsim_command(
        "run", write(tmp_path, DISC), "--until", "3 yr", "--threads", 2, "--without", "dust",
        "--without", "drag", "--set", "gas.kernel=quintic", "--quiet",
    )  # fmt: skip
    assert done.exit_code == 3, done.stderr
    ((scene, directory, options),) = calls
    assert scene.units.show(scene.run.until, "time") == "3 yr"
    assert scene.run.threads == 2 and scene.gas.kernel == "quintic" and scene.dust is None
    assert str(directory) == "runs/scene" and options == {"resume": False, "quiet": True}
    assert os.listdir() == []  # writing is the runner's


BAD_SCENES = [
    # (old, new, line, words): the kinds of bad input, each once through the whole command
    ("[self_gravity]", "[self_gravty]", 29, 'did you mean "self_gravity"?'),
    ("ratio = 0.01", "ratoi = 0.01", 24, 'did you mean "ratio"?'),
    ("ratio = 0.01", "", 22, "dust.ratio: missing"),
    ('"100 au"', '"100 yr"', 14, "is a time; expected a length"),
    ('"100 au"', "100", 14, "a length needs a unit"),
    ('"0.1 Msun"', '"-1 Msun"', 12, "is not positive"),
    ("0.01", "-1", 24, "is not positive"),
    ('"260 au"', '"-260 au"', 8, "is not positive"),
    ("100_000", "0", 16, "is too small"),
    ("100_000", "10_000_000_001", 16, "is too large"),
    ("0.05", "nan", 19, "is not a finite number"),
    ('"epstein"', '"epstein"\nscheme = "idic-lineal"', 33, 'did you mean "idic-linear"?'),
    ("particles = 100_000", 'particles = 1\nkernel = "wendland"', 17, 'did you mean "wendland-c4"?'),
    ('grain_size = "1 cm"\n', "", 22, 'dust.grain_size: missing, but required by drag.law = "epstein"; add this key'),
    ('"260 au"', '"199 au"', 8, "space is smaller than the disc"),
]


@pytest.mark.parametrize("old, new, line, words", BAD_SCENES)
@pytest.mark.parametrize("command", ["run", "check"])
def test_bad_scene(tmp_path, calls, command, old, new, line, words):
    path = write(tmp_path, DISC.replace(old, new, 1))
    first = refused(calls, command, path).splitlines()[0]
    assert first.startswith(f"{path}:{line}: ") and words in first


def test_drag_without_dust(tmp_path, calls):
    path = write(tmp_path, DISC)
    assert refused(calls, "run", path, "--without", "dust") == (
        f"{path}:31: drag: drag needs dust; add a table [dust], or remove [drag]"
    )


@pytest.mark.parametrize("text", ["", "[run", b"\xff\xfe[\x00r\x00"])
def test_broken_file(tmp_path, calls, text):
    path = write(tmp_path, text)
    assert refused(calls, "run", path).startswith(f"{path}:1: ")


def test_missing_file(tmp_path, calls):
    assert "file not found" in refused(calls, "run", "no.toml")


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["run"], "Missing argument"),
        (["run", "SCENE", "--speed"], "No such option"),
        (["run", "SCENE", "--threads", "0"], "--threads"),
        (["run", "SCENE", "--threads", "two"], "--threads"),
        (["run", "SCENE", "--until", "3 au"], '"3 au" is a length; expected a time'),
        (["run", "SCENE", "--set", "gas.kernel"], "expected table.key=value"),
        (["run", "SCENE", "--without", "drga"], 'did you mean "drag"?'),
        (["go"], "No such command"),
    ],
)
def test_wrong_command_line(tmp_path, calls, arguments, words):
    path = write(tmp_path, DISC)
    assert words in refused(calls, *[path if part == "SCENE" else part for part in arguments])


@pytest.mark.parametrize(
    "left, way_on",
    [
        (
            "scene.toml",
            ", without a checkpoint; choose another directory, or add --resume to restart the run from the beginning",
        ),
        ("checkpoint.h5", "; choose another directory, or add --resume"),
        ("snapshots", "; choose another directory"),  # --resume would find nothing there
    ],
)
def test_directory_that_holds_a_run(tmp_path, calls, left, way_on):
    path, out = write(tmp_path, DISC), tmp_path / "out"
    out.mkdir()
    (out / left).touch()
    assert refused(calls, "run", path, "-o", out) == f"{out}: already contains a run ({left}){way_on}"
    assert os.listdir(out) == [left]
    assert (directory_fault(out, resume=True) is None) == ("--resume" in way_on)


def test_directory_that_is_there_but_empty_is_taken(tmp_path, calls):
    (tmp_path / "out").mkdir()
    assert discsim_command("run", write(tmp_path, DISC), "-o", tmp_path / "out").exit_code == 3


def test_directory_under_a_file(tmp_path, calls):
    path = write(tmp_path, DISC)
    assert f"{path} is a file" in refused(calls, "run", path, "-o", path)
    assert f"{path} is a file" in refused(calls, "run", path, "-o", path / "a" / "b")


def test_directory_that_is_not_writable(tmp_path, calls, monkeypatch):
    # By a stand-in for the file system's answer: the superuser may write anywhere.
    monkeypatch.setattr("os.access", lambda path, mode: False)
    message = refused(calls, "run", write(tmp_path, DISC), "-o", tmp_path / "out")
    assert f"{tmp_path} is not writable" in message and not (tmp_path / "out").exists()


def test_directory_name_too_long(calls, tmp_path):
    assert "expected a writable directory" in refused(calls, "run", write(tmp_path, DISC), "-o", "x" * 5000)


def test_resume(tmp_path, calls):
    path, out = write(tmp_path, DISC), tmp_path / "out"
    assert "no checkpoint.h5" in refused(calls, "run", path, "-o", out, "--resume")
    out.mkdir()
    assert "no checkpoint.h5" in refused(calls, "run", path, "-o", out, "--resume")
    (out / "checkpoint.h5").touch()
    assert directory_fault(out, resume=True) is None
    assert discsim_command("run", path, "-o", out, "--resume").exit_code == 3
    assert calls[0][2]["resume"] is True


def test_module_is_the_command(tmp_path):
    path = write(tmp_path, DISC.replace("ratio = 0.01", "ratoi = 0.01"))
    command = [sys.executable, "-m", "discsim"]
    done = subprocess.run([*command, "run", path], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.startswith(f"{path}:24: dust.ratoi:")
    assert os.listdir(tmp_path) == ["scene.toml"]
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout == f"discsim {discsim.__version__}\n"


# discsim effects


def test_effects_lists_equations_keys_units_and_defaults():
    done = discsim_command("effects")
    assert done.exit_code == 0
    for name in EFFECTS:
        assert f"[{name}]" in done.stdout.splitlines()
    row = next(line for line in done.stdout.splitlines() if line.split()[:1] == ["outer_taper"])
    assert row.split()[:3] == ["outer_taper", "length", "0"]


def test_effects_lists_a_key_that_is_a_value_or_a_table_as_both():
    lines = discsim_command("effects").stdout.splitlines()
    row = next(line for line in lines if line.split()[:1] == ["grain_size"])
    assert row.split(maxsplit=1)[1].startswith("length, or a table ")
    assert any(line.strip().startswith("[dust.grain_size] Grains of many sizes") for line in lines)


@pytest.mark.parametrize("name, key", [("drag", "scheme"), ("run", "courant")])
def test_effects_prints_one_table(name, key):
    done = discsim_command("effects", name)
    lines = done.stdout.splitlines()
    assert done.exit_code == 0 and lines[0] == f"[{name}]" and any(line.split()[:1] == [key] for line in lines)
    assert done.stdout in discsim_command("effects").stdout
    assert not any(line.startswith("[") for line in lines[1:])


def test_effects_names_the_nearest_table(calls):
    assert refused(calls, "effects", "dust_difusion").endswith('did you mean "dust_diffusion"?')


# Texts of the command line


def test_summaries_fit_a_terminal(monkeypatch):
    """In 80 columns no command is described by half a sentence."""
    monkeypatch.setenv("COLUMNS", "80")
    text = discsim_command("--help").stdout
    assert len(text.splitlines()) > 15 and "..." not in text.split("Commands:")[1]


@pytest.mark.parametrize(
    "option, words",
    [
        (("--until", "5"), '--until 5: run.until: 5 has no unit; a time needs a unit, like "100 yr"'),
        (("--until", "5 pc"), '--until 5 pc: run.until: "5 pc" is a length; expected a time, like "100 yr"'),
        (("--set", "run.until=5"), "--set run.until=5: run.until: 5 has no unit"),
    ],
)
def test_an_option_is_named_as_it_was_typed(tmp_path, calls, option, words):
    assert refused(calls, "run", write(tmp_path, DISC), *option).startswith(words)
