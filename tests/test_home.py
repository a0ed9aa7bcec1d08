"""Commands where the user's home directory is absent, unreadable, unwritable or unknown, as in containers."""

import json
import os
import subprocess
import sys

import pytest
from runs import WAVE

# root reads and writes everything: these processes give up that right.
LESS = """
import ctypes, os, sys
for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP
os.execv(sys.executable, [sys.executable, "-c", *sys.argv[1:]])
"""

COMMANDS = """
import json, os, pwd, sys
if "HOME" not in os.environ:
    def unknown(user): raise KeyError(user)
    pwd.getpwuid = unknown
from discsim.cli import app
for command in json.loads(sys.argv[1]):
    try:
        app(command)
    except SystemExit as end:
        assert not end.code, command
assert "XDG_CONFIG_HOME" not in os.environ
from discsim.preview import stored_runs
stored_runs.write_list("speed", [])
"""

SCENE = """
run = {until = "3 day", snapshots = 1, threads = 1, timestep = "3 day"}
space = {size = "160 au"}
star = {mass = "1.3 Msun"}
initial = {kind = "disc", mass = "0.001 Msun", inner = "15 au", outer = "60 au"}
gas = {particles = 60, eos = {kind = "locally-isothermal", aspect_ratio = 0.07, reference_radius = "20 au"}}
"""


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("absent", "unwritable", "a file")]


@pytest.fixture(params=["unreadable", "unknown", *SLOW])
def home(request, tmp_path):
    path = tmp_path / "home"
    if request.param == "a file":
        path.touch()
    elif request.param != "absent":
        path.mkdir()
    mode = {"unreadable": 0o000, "unwritable": 0o555}.get(request.param)
    if mode is not None:
        path.chmod(mode)
    yield None if request.param == "unknown" else path
    if mode is not None:
        path.chmod(0o755)


def ended(commands, home, folder):
    """The process of some commands, with this home."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("XDG_") and key != "HOME"}
    environment |= {} if home is None else {"HOME": str(home)}
    command = [sys.executable, "-c", LESS, COMMANDS, json.dumps(commands)]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done


def test_every_command_works_without_a_home(home, tmp_path):
    (tmp_path / "a.toml").write_text(SCENE)
    commands = [["setups"], ["effects"], ["check", "a.toml"], ["new", "disc", "b.toml"], ["plot", "--fields"]]
    done = ended(commands, home, tmp_path)
    assert done.stderr == "" and "forecast" in done.stdout and (tmp_path / "b.toml").exists()
    assert sorted({*os.listdir(tmp_path)} - {"home"}) == ["a.toml", "b.toml"]
    assert home is None or home.is_file() or not home.exists() or not os.listdir(home)


def test_a_run_without_a_readable_home(tmp_path):
    """With units: astropy, matplotlib and compiled kernels have all to find a place."""
    (tmp_path / "a.toml").write_text(WAVE)
    (tmp_path / "b.toml").write_text(SCENE)
    (tmp_path / "home").mkdir(mode=0o000)
    run = [["run", "a.toml", "-o", "out", "--quiet"], ["plot", "out"], ["report", "out"]]
    done = ended([["check", "b.toml"], *run], tmp_path / "home", tmp_path)
    assert "Traceback" not in done.stderr and (tmp_path / "out/report.html").exists()
