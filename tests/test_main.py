"""The command as a shell starts it: faults of its surroundings are one message, and never a traceback."""

import errno
import os
import resource
import subprocess
import sys
from functools import partial

import pytest
from installed import install

from discsim.launch import LaunchError, size_and_rank

BOX = "title = 'a box'\nunits.system = 'code'\nrun.until = 1.3\nspace.size = 2\nspace.boundary = 'periodic'\n"
BOX += "initial.kind = 'box'\n[gas]\nparticles = 90\neos = {kind = 'isothermal', sound_speed = 0.7}\n"


def ended(*arguments, environment=None):
    command = [sys.executable, "-m", "discsim", *map(str, arguments)]
    return subprocess.run(command, env={**os.environ, **(environment or {})}, capture_output=True, text=True)


@pytest.fixture
def box(tmp_path):
    (tmp_path / "box.toml").write_text(BOX)
    return tmp_path / "box.toml"


def test_a_full_standard_output_is_one_message(box):
    """Here one that may have no byte, which stands for a disk without room."""
    with (box.parent / "out.txt").open("w") as out:
        command = [sys.executable, "-m", "discsim", "check", str(box)]
        least = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (0, 0))
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, preexec_fn=least)
    assert done.returncode == 1
    assert done.stderr == f"standard output: cannot be written: {os.strerror(errno.EFBIG)}\n"


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_reader_that_has_left_is_no_message(box, command):
    """As after `| head -1`; a run goes on without it."""
    read, write = os.pipe()
    os.close(read)
    arguments = [
        sys.executable,
        "-m",
        "discsim",
        command,
        str(box),
        *(["-o", str(box.parent / "out")] * (command == "run")),
    ]
    with os.fdopen(write, "w") as pipe:
        done = subprocess.run(arguments, stdout=pipe, stderr=subprocess.PIPE, text=True)
    assert done.stderr == ""
    assert (command == "check") or (done.returncode == 0 and (box.parent / "out/last_state.png").exists())


@pytest.mark.parametrize("size, rank", [("x", "0"), ("2", ""), ("-1", "0"), ("2", "2"), ("0", "0"), ("1.5", "0")])
def test_numbers_of_a_launcher_that_are_none(monkeypatch, size, rank):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", size)
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", rank)
    with pytest.raises(LaunchError, match=f'OMPI_COMM_WORLD_SIZE="{size}" and OMPI_COMM_WORLD_RANK="{rank}" in the'):
        size_and_rank()


def test_commands_beside_a_broken_launcher_end_in_one_message(box):
    environment = {"PMI_SIZE": "1\n2", "PMI_RANK": "\x1b"}
    done = ended("run", box, "-o", box.parent / "out", environment=environment)
    assert done.returncode == 2 and done.stdout == "" and not (box.parent / "out").exists()
    assert done.stderr.startswith('PMI_SIZE="') and done.stderr.count("\n") == 1 and done.stderr.strip().isprintable()
    assert ended("check", box.parent / "absent.toml", environment=environment).stderr.count("\n") == 1


@pytest.mark.parametrize(
    "module, value, wrong",
    [
        ("raise RuntimeError('out\\nof order')", "toy:Effect", "RuntimeError: out\\nof order"),
        ("Effect = 3", "toy:Effect", "toy:Effect, has no keys"),
        pytest.param("", "toy:Effect", "has no attribute 'Effect'", marks=pytest.mark.slow),
        pytest.param("", "toy", "cannot be imported from toy", marks=pytest.mark.slow),
        (None, "toy:Effect", "No module named 'toy'"),
    ],
)
def test_a_broken_effect_of_another_package_is_one_message(tmp_path, box, module, value, wrong):
    install(tmp_path / "site", {} if module is None else {"toy": module}, {"discsim.effects": {"toy": value}})
    environment = {"PYTHONPATH": str(tmp_path / "site")}
    done = ended("effects", environment=environment)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith('discsim.effects: "toy" of another package') and wrong in done.stderr
    assert done.stderr.count("\n") == 1
    assert ended("check", box, environment=environment).returncode == 0  # which names no such effect
