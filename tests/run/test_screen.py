"""What a run shows: on a terminal lines that stay over a frame that does not, plain lines elsewhere, or nothing."""

import io
import os
import re
import signal
import sys

import pytest
from deaths import forked, status_of
from rich.console import ConsoleDimensions
from runs import SHOCK, WAVE, assert_same_run, at_step, scene_of
from terminal import Terminal, resized, written_to_a_terminal

from discsim import Simulation
from discsim.output.checkpoint import read_checkpoint
from discsim.run.runner import run_scene
from discsim.run.screen import HIDE_CURSOR, SHOW_CURSOR

FRAME = ("t = ", "dt = ")  # how rows begin that only a frame has


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """A frame for each step, in no time; drawing the figure takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    monkeypatch.setattr("discsim.run.progress.FRAME_EVERY", 0.0)
    for name, value in {"TERM": "xterm-256color", "FORCE_COLOR": None, "COLUMNS": None, "LINES": None}.items():
        if value is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, value)


def log_of(out):
    return (out / "run.log").read_text(encoding="utf-8").splitlines()


SIZES = [(100, 24), (38, 24), (120, 9), (61, 5), (23, 30), (200, 50), (7, 3), (90, 24)]


@pytest.mark.parametrize("reflow, late", [(True, False), (False, False), (True, True)])
def test_snapshot_lines_stay_and_no_frame_is_left(tmp_path, monkeypatch, reflow, late):
    """The screen has another size after each step, and is looked at before; `late`: the run does not know it yet."""
    advance = Simulation._advance
    if late:
        monkeypatch.setattr("rich.console.Console.size", ConsoleDimensions(100, 24))

    def advance_and_resize(sim, *arguments):
        advance(sim, *arguments)
        width, height = SIZES[sim.state.step % len(SIZES)]
        resized(width, max(height, 9) if late else height)

    monkeypatch.setattr(Simulation, "_advance", advance_and_resize)
    out = tmp_path / "out"
    status, text = written_to_a_terminal(lambda: run_scene(scene_of(tmp_path, WAVE, "run.snapshots=8"), out))
    assert status == 0 and text.rindex(SHOW_CURSOR) > text.rindex(HIDE_CURSOR)
    terminal, frames, said = Terminal(100, 24, reflow), [], log_of(out)

    def look():
        frames.append(terminal.lines())
        for beginning in FRAME:
            assert sum(line.startswith(beginning) for line in frames[-1]) <= 1

    terminal.feed(text, look)
    assert sum(any(line.startswith("t = ") for line in lines) for lines in frames) > 5  # the least have no room for it
    lines = terminal.lines()
    assert lines[-1] == "" and terminal.column == 0
    assert not any(line.startswith(FRAME) or "\N{BOX DRAWINGS HEAVY HORIZONTAL}" in line for line in lines)
    assert sum("snapshot 00" in line for line in said) == 9
    if reflow:  # another terminal has cut what was too long when it became narrower
        assert lines[:-1] == said


def test_a_terminal_that_knows_no_frames_gets_plain_lines(tmp_path, monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    out = tmp_path / "out"
    status, text = written_to_a_terminal(lambda: run_scene(scene_of(tmp_path, WAVE), out))
    assert status == 0 and "\x1b" not in text
    assert text.splitlines() == log_of(out)


def test_a_pipe_gets_plain_lines(tmp_path, monkeypatch, capfd):
    """Also where colours are asked for."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out") == 0
    text = capfd.readouterr().out
    assert "\x1b" not in text and text.splitlines() == log_of(tmp_path / "out")


def test_quiet_prints_errors_alone(tmp_path, monkeypatch):
    out, errors = tmp_path / "out", tmp_path / "errors"
    scene = scene_of(tmp_path, WAVE)
    assert written_to_a_terminal(lambda: run_scene(scene, out, quiet=True)) == (0, "")
    assert written_to_a_terminal(lambda: run_scene(scene, out, resume=True, quiet=True)) == (0, "")
    status, text = written_to_a_terminal(lambda: run_scene(scene, out, quiet=True), errors=errors)
    assert (status, text) == (2, "") and "already contains a run" in errors.read_text()


def test_an_encoding_without_the_letters(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    assert run_scene(scene_of(tmp_path, WAVE, "title=Wirbelstraße"), tmp_path / "out") == 0
    sys.stdout.flush()
    assert "Wirbelstra?e" in sys.stdout.buffer.getvalue().decode("ascii")
    assert "Wirbelstraße" in log_of(tmp_path / "out")[0]


def test_a_reader_that_leaves_does_not_end_the_run(tmp_path):
    """As `discsim run ... | head -3` does."""
    scene, out = scene_of(tmp_path, WAVE), tmp_path / "out"

    def run():
        read, write = os.pipe()
        os.close(read)
        os.dup2(write, 1)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        return run_scene(scene, out)

    assert status_of(forked(run)) == 0
    assert "done at t = 0.1" in (out / "run.log").read_text()


@pytest.mark.parametrize("name", ["SIGHUP", "SIGXCPU"])
def test_a_terminal_or_job_that_ends_leaves_a_checkpoint(tmp_path, monkeypatch, capsys, name):
    number = signal.Signals[name]
    scene, out = scene_of(tmp_path, SHOCK), tmp_path / "out"
    before = signal.signal(number, lambda *given: pytest.fail("nobody took it"))
    try:
        with monkeypatch.context() as patch:
            at_step(patch, 3, lambda sim: signal.raise_signal(number))
            assert run_scene(scene, out, quiet=True) == 128 + number
        assert f"interrupted by {name}" in capsys.readouterr().err
        assert read_checkpoint(out / "checkpoint.h5")[1]["step"] == 3
        signal.signal(number, signal.SIG_IGN)  # as nohup has it
        with monkeypatch.context() as patch:
            at_step(patch, 5, lambda sim: signal.raise_signal(number))
            assert run_scene(scene, out, resume=True, quiet=True) == 0
    finally:
        signal.signal(number, before)
    assert run_scene(scene, tmp_path / "straight", quiet=True) == 0
    assert_same_run(tmp_path / "straight", out)


@pytest.mark.parametrize("until, words", [("0.5", "of all CPU time"), ("1e-6", "of the effects' CPU time")])
def test_shares_at_the_end_have_one_whole(tmp_path, until, words):
    """A run of one step has only compiled beside its effects."""
    scene = scene_of(tmp_path, WAVE, f"run.until={until}", "run.snapshots=1")
    assert run_scene(scene, tmp_path / "out", quiet=True) == 0
    line = log_of(tmp_path / "out")[-1]
    shares = [int(share) for share in re.findall(r" (\d+)%", line)]
    assert line.startswith("cost    gas ") and line.endswith(words) and len(shares) == (4 if "all" in words else 3)
    assert abs(sum(shares) - 100) <= len(shares) / 2  # each is rounded
