"""Files that are whole or absent: all that is replaced is written by one function."""

import os
from pathlib import Path

import numpy as np
import pytest

from discsim.output.checkpoint import read_checkpoint, write_checkpoint
from discsim.output.files import replace_atomically


def test_what_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.txt"
    for text in ("one", "two"):
        with replace_atomically(path, ".txt") as temporary:
            temporary.write_text(text)
            assert temporary.suffix == ".txt"
    with pytest.raises(KeyboardInterrupt), replace_atomically(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "two" and [*tmp_path.iterdir()] == [path]


def test_what_is_replaced_may_stay(tmp_path):
    path, before = tmp_path / "a.h5", tmp_path / "before.h5"
    for number in range(3):
        write_checkpoint(path, {}, {"number": number}, before)
        assert before.exists() == (number > 0)
    assert [read_checkpoint(file)[1]["number"] for file in (before, path)] == [1, 2]


def test_a_disk_that_holds_something_else_is_noticed(tmp_path, monkeypatch):
    """It is read back once it is written: here a bit turns on the way to the disk."""
    path, before = tmp_path / "a.h5", tmp_path / "before.h5"
    write_checkpoint(path, {}, {"number": 0})

    def turn(file, *arguments):
        with open(f"/proc/self/fd/{file}", "rb") as there:
            content = bytearray(there.read())
        content[-1] ^= 1
        Path(f"/proc/self/fd/{file}").write_bytes(content)

    with monkeypatch.context() as patch:
        patch.setattr(os, "posix_fadvise", turn)
        with pytest.raises(OSError, match="the file on disk differs from the data written") as caught:
            write_checkpoint(path, {"gas": {"pos": np.ones(5)}}, {"number": 1}, before)
    assert caught.value.filename == str(path)
    assert read_checkpoint(path)[1]["number"] == 0 and [*tmp_path.iterdir()] == [path]
