"""Every setup, killed by SIGKILL at any moment, goes on to the files of a run that never stopped."""

import signal

import numpy as np
import pytest
from deaths import Pieces, in_pieces, killed_before, watched
from runs import assert_same_files, rows
from short import short

from discsim import read_snapshot
from discsim.run.outputs import output_times
from discsim.run.runner import run_scene
from setups import SETUPS

KILLS = 4  # in the midst of a write, and as many at other times


def go_on(scene, out, capsys):
    """As a person would: with --resume where there is something to resume from, else from the start."""
    if not (out / "scene.toml").exists():  # what --resume is told
        assert run_scene(scene, out, resume=True) == 2
        assert "there is no checkpoint.h5 to resume from" in capsys.readouterr().err
        assert run_scene(scene, out) == 0
        return "nothing there"
    saved = any(out.glob("checkpoint*.h5"))
    assert run_scene(scene, out, resume=True) == 0
    said = capsys.readouterr()
    assert (
        said.err == "" and ("no checkpoint was written yet; the run restarts from the beginning" in said.out) != saved
    )
    return "resumed" if saved else "began anew"


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_kills_of_a_setup(tmp_path, path, monkeypatch, capsys):
    """KILLS in the midst of a file and as many elsewhere, and one more soon after each resumes."""
    scene, straight = short(path), tmp_path / "straight"
    assert run_scene(scene, straight, quiet=True) == 0
    in_pieces(monkeypatch)
    amid, elsewhere = [], []
    assert watched(lambda: run_scene(scene, tmp_path / "watched", quiet=True),
                   lambda number: (amid if Pieces.writing else elsewhere).append(number)) == 0  # fmt: skip
    stream = np.random.default_rng([15, SETUPS.index(path)])
    chosen = [*stream.choice(amid, KILLS, replace=False), *stream.choice(elsewhere, KILLS, replace=False)]
    ends, again = [], 0
    for number in chosen:
        out = tmp_path / str(number)
        assert killed_before(number, lambda: run_scene(scene, out, quiet=True)) == -signal.SIGKILL  # noqa: B023
        if (out / "scene.toml").exists():  # once more; what is still to do is less than that near the end
            second = int(stream.integers(1, 60))
            again += killed_before(second, lambda: run_scene(scene, out, resume=True, quiet=True)) < 0  # noqa: B023
        capsys.readouterr()
        ends.append(go_on(scene, out, capsys))
        assert_same_files(straight, out)
        assert [read_snapshot(file).time for file in sorted((out / "snapshots").iterdir())] == [
            0.0, *output_times(scene.run),
        ]  # fmt: skip
        assert len({row["step"] for row in rows(out)}) == len(rows(out))
    kinds = ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends)))
    print(f"{path.stem}: {len(chosen)} kills, {KILLS} of them among {len(amid)} moments within a write, {KILLS} among "
          f"{len(elsewhere)} others; {again} killed again; {kinds}")  # fmt: skip
