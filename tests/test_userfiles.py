"""Files that a user names: FIFOs, devices, directories and endless files are one message, and never waited for."""

import errno
import os
import socket

import pytest

from discsim.scene import SceneError, load_scene
from discsim.userfiles import open_plain, read_plain, read_text, system_message

SCENE = {
    "units": {"system": "code"}, "run": {"until": 1.3}, "space": {"size": 9.0}, "star": {"mass": 1.2},
    "initial": {"kind": "table", "file": ""},
    "gas": {"particles": 90, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07}},
}  # fmt: skip


@pytest.fixture
def fifo(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    return tmp_path / "fifo"


def test_a_fifo_is_never_waited_for(fifo):
    for read in (open_plain, read_plain, read_text):
        with pytest.raises(OSError, match="is a FIFO, not a plain file"):
            read(fifo)


def test_a_socket_and_a_directory_are_no_plain_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as made:
        made.bind("socket")
        with pytest.raises(OSError, match="is a socket, not a plain file"):
            read_plain("socket")
    with pytest.raises(IsADirectoryError, match="is a directory"):
        read_plain(tmp_path)


def test_a_larger_file_than_expected_is_not_read(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"")
    os.truncate(path, 1 << 40)  # sparse
    with pytest.raises(OSError, match="is larger than 64 MiB"):
        read_plain(path)


def test_too_few_file_handles_are_not_blamed_on_a_file():
    for number in (errno.EMFILE, errno.ENFILE):
        words = system_message(OSError(number, os.strerror(number), "a.csv"), "written", "b")
        assert words.startswith("too many open files") and "a.csv" not in words
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert system_message(full, "written", "b") == "b: cannot be written: No space left on device"


def problem_of(name, folder):
    scene = {**SCENE, "initial": {"kind": "table", "file": name}}
    with pytest.raises(SceneError) as fault:
        load_scene(scene, folder=folder)
    (problem,) = fault.value.problems
    return problem


@pytest.mark.parametrize("kind", ["table", "snapshot"])
def test_a_start_from_a_fifo_is_one_message(fifo, kind):
    scene = {**SCENE, "initial": {"kind": kind, "file": "fifo"}}
    with pytest.raises(SceneError, match=r'initial\.file: "fifo": .*/fifo: is a FIFO, not a plain file'):
        load_scene(scene, folder=fifo.parent)


def test_a_scene_in_a_fifo_is_one_message(fifo):
    with pytest.raises(SceneError, match="fifo: cannot be read: is a FIFO, not a plain file"):
        load_scene(fifo)


def test_a_larger_scene_or_table_is_one_message(tmp_path):
    for name, most in (("scene.toml", "1 MiB"), ("table.txt", "16 MiB")):
        (tmp_path / name).touch()
        os.truncate(tmp_path / name, 1 << 40)
        if name == "scene.toml":
            with pytest.raises(SceneError, match=f"is larger than {most}"):
                load_scene(tmp_path / name)
        else:
            assert f"is larger than {most}" in problem_of(name, tmp_path)


def test_nothing_is_shown_of_a_file_that_is_no_table(tmp_path):
    """Somebody else's scene may name a file that only its reader can see."""
    for text in ("secret words of a diary\n1 2\n", "user:x:0:0:secret\n", "secret\n", "1.5 secret"):
        (tmp_path / "a.txt").write_text(text)
        problem = problem_of("a.txt", tmp_path)
        assert "secret" not in problem and "a.txt:1: not a table header; expected a header" in problem


@pytest.mark.parametrize("name", ["~no-such-user-of-this-machine/a.txt", "a\0b", "x" * 5000])
def test_a_name_that_no_file_can_have(tmp_path, name):
    assert "expected the path of a readable file, relative to the folder of the scene file" in problem_of(
        name, tmp_path
    )
