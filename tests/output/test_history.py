"""Rows of a table are in the file whole, or not at all."""

import pytest
from deaths import in_pieces
from disks import Limited

from discsim.output.history import History


@pytest.mark.parametrize("room", [0, 1, 3, 4])
def test_a_row_that_finds_no_room_is_taken_back(tmp_path, monkeypatch, room):
    """Here there is room for so many bytes of its six."""
    path = tmp_path / "a.csv"
    head = b"step,time\r\n0,0.5\r\n"
    in_pieces(monkeypatch, lambda file: Limited(file, tmp_path, len(head) + room))
    history = History(path, columns=("step", "time"))
    history.add([0, 0.5])
    digest = history.digest
    with pytest.raises(OSError, match="No space left on device"):
        history.add([1, 1.5])
    history.close()
    monkeypatch.undo()
    assert path.read_bytes() == head and history.digest == digest and history.count == 1
    same = History(tmp_path / "b.csv", [["0", "0.5"]], ("step", "time"))
    same.close()
    assert same.digest == digest
