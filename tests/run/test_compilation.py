"""What a run shows while kernels compile."""

import pytest
from numba import njit
from runs import WAVE, at_step, scene_of

from discsim.run.progress import LINE_EVERY, CompilationListener, Progress
from discsim.run.runner import run_scene


class Kernel:
    """An event of numba's about a kernel of this name."""

    def __init__(self, name):
        def function():
            pass

        function.__name__ = name
        self.data = {"dispatcher": self}
        self.py_func = function


@pytest.fixture
def clock(monkeypatch):
    """Seconds that tests set."""
    now = [100.0]
    monkeypatch.setattr("discsim.run.progress.time.monotonic", lambda: now[0])
    return now


def test_a_run_says_once_that_kernels_compile(tmp_path, monkeypatch, capsys):
    at_step(monkeypatch, 2, lambda sim: [njit(lambda x, k=k: x + k)(1) for k in range(3)])
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out") == 0
    said = "compiling kernels for the first time: up to a minute for a scene with drag\n"
    assert capsys.readouterr().out.count(said) == 1
    assert (tmp_path / "out/run.log").read_text().count(said) == 1


def test_a_long_compilation_counts_kernels_every_few_seconds(tmp_path, clock, capsys):
    told = CompilationListener(Progress(scene_of(tmp_path, WAVE), quiet=False))
    for name, seconds in (("density", 0.0), ("forces", 0.4 * LINE_EVERY), ("pull", 1.1 * LINE_EVERY), ("kick", 0.1)):
        clock[0] += seconds
        told.on_start(Kernel(name))
        told.on_end(Kernel(name))
    assert capsys.readouterr().out.splitlines()[1:] == ["compiling kernel 3: pull"]


def test_a_terminal_shows_each_kernel_in_one_place(tmp_path, clock, monkeypatch):
    progress, frames = Progress(scene_of(tmp_path, WAVE), quiet=False), []
    progress.screen.has_frames = True
    monkeypatch.setattr(progress.screen, "frame", frames.append)
    told = CompilationListener(progress)
    for name in ("density", "forces"):
        clock[0] += 5.0
        told.on_start(Kernel(name))
    assert frames == ["compiling kernel 1: density", "compiling kernel 2: forces"]
