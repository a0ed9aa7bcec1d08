"""Files that are whole or absent: all that is replaced is written by one function."""

from pathlib import Path

import pytest

import discsim
from discsim.output.files import written


def test_what_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.txt"
    for text in ("one", "two"):
        with written(path, ".txt") as temporary:
            temporary.write_text(text)
            assert temporary.suffix == ".txt"
    with pytest.raises(KeyboardInterrupt), written(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "two" and [*tmp_path.iterdir()] == [path]


def test_nothing_else_replaces_files():
    home = Path(discsim.__file__).parent
    assert [file.name for file in home.rglob("*.py") if "os.replace" in file.read_text()] == ["files.py"]
