"""Kernels that a second process compiles are those that a run of the same scene asks for."""

import sys

import pytest
from drags import OF_PARTICLES
from numba.core.registry import CPUDispatcher
from runs import DISC, SHOCK, WAVE

from discsim import Simulation
from discsim.run import ahead
from discsim.scene import load_scene

DRAG = ("blocks", "drag", "relax", "nodes", "levels", "nonlinear", "laws", "pairs", "interpolation", "slopes")


def compiled():
    """Signatures of the kernels that serve nothing but drag, as far as they are loaded."""
    names = [name for name in (f"discsim.kernels.{last}" for last in DRAG) if name in sys.modules]
    found = [entry for name in names for entry in vars(sys.modules[name]).values() if isinstance(entry, CPUDispatcher)]
    return {(kernel.py_func.__qualname__, str(signature)) for kernel in found for signature in kernel.signatures}


def scene_of(text, changes, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_scene(path, changes)


@pytest.mark.parametrize(
    ("text", "changes"),
    [(WAVE, [f"drag.scheme={scheme}"]) for scheme in OF_PARTICLES]
    + [(DISC, [f"drag.scheme={scheme}"]) for scheme in ("tsc", "idic-linear")]
    + [(DISC, ["drag.direction=one-way"]), (DISC, ["gas.eos.kind=adiabatic", "gas.eos.gamma=1.4"])],
)
def test_what_is_compiled_ahead_is_what_a_run_asks_for(text, changes, tmp_path):
    scene = scene_of(text, changes, tmp_path)
    ahead.kick_once(scene)
    before = compiled()
    sim = Simulation(scene)
    for _ in range(2):
        sim.step()
    extra = {name for name, _ in compiled() - before}
    assert before and extra <= {"stopping_times"}  # for the start of a disc, before anything is dragged


def test_the_second_process_drags_and_ends(tmp_path):
    second = ahead.begin(scene_of(WAVE, [], tmp_path))
    assert second.wait(300) == 0


def test_a_second_process_that_cannot_start_is_no_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no python"))
    assert ahead.begin(scene_of(WAVE, [], tmp_path)) is None


@pytest.mark.parametrize(
    ("text", "changes"), [(SHOCK, []), (WAVE.replace("smoothing_length = 0.025\n", ""), ["drag.scheme=emsi-ppm"])]
)
def test_no_second_process_without_drag_between_particles(text, changes, tmp_path):
    assert ahead.begin(scene_of(text, changes, tmp_path)) is None
