"""`discsim.simulate`: the files of `discsim run`, from Python."""

import signal
import threading

import numpy as np
import pytest
from runs import WAVE

import discsim
from discsim.printable import UserError
from discsim.run.simulation import PhysicsError

SCENE = {
    "units": {"system": "code"}, "run": {"until": 0.7, "snapshots": 3, "timestep": 0.05, "seed": 3},
    "space": {"size": 8.0}, "star": {"mass": 1.3},
    "initial": {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0},
    "dust": {"particles": 70, "ratio": 0.1, "placement": "random"},
}  # fmt: skip


def longer(until):
    return SCENE | {"run": SCENE["run"] | {"until": until}}


def test_a_run_from_a_dict_has_the_files_of_the_command_and_prints_nothing(tmp_path, capfd):
    run = discsim.simulate(SCENE, tmp_path / "my")
    assert len(run) == 4 and run[-1].time == 0.7 and [*run.history["step"]] == [*range(16)]
    assert {"scene.toml", "history.csv", "run.log", "checkpoint.h5"} <= {path.name for path in run.directory.iterdir()}
    assert "done at t = 0.7" in (run.directory / "run.log").read_text()
    assert capfd.readouterr() == ("", "")


def test_a_scene_and_its_file_do_as_well_and_progress_is_shown(tmp_path, capfd):
    path = tmp_path / "wave.toml"
    path.write_text(WAVE)
    first = discsim.simulate(path, tmp_path / "a", progress=True)
    assert "done at t = 0.1" in capfd.readouterr().out
    second = discsim.simulate(discsim.load_scene(path), str(tmp_path / "b"))
    np.testing.assert_array_equal(first[-1].gas.pos, second[-1].gas.pos)


def test_resume_opens_a_finished_run_and_continues_to_a_later_end(tmp_path):
    whole = discsim.simulate(longer(0.7), tmp_path / "whole")
    with pytest.raises(UserError, match="already contains a run"):
        discsim.simulate(SCENE, tmp_path / "whole")
    before = (tmp_path / "whole/history.csv").stat().st_mtime_ns
    assert len(discsim.simulate(SCENE, tmp_path / "whole", resume=True)) == len(whole)
    assert (tmp_path / "whole/history.csv").stat().st_mtime_ns == before
    assert discsim.simulate(longer(0.9), tmp_path / "whole", resume=True)[-1].time == 0.9
    with pytest.raises(discsim.SceneError, match=r"star[.]mass"):
        discsim.simulate(SCENE | {"star": {"mass": 1.4}}, tmp_path / "whole", resume=True)


def test_after_an_interrupt_it_resumes_to_the_same_bits(tmp_path, monkeypatch, capfd):
    from discsim.run.runner import Run

    after_step = Run._after_step

    def interrupted(self):
        if self.sim.state.step == 6:
            signal.raise_signal(signal.SIGINT)
        return after_step(self)

    monkeypatch.setattr(Run, "_after_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        discsim.simulate(SCENE, tmp_path / "stopped")
    assert "interrupted by SIGINT at t = 0.2833, step 6" in capfd.readouterr().err
    monkeypatch.undo()
    again = discsim.simulate(SCENE, tmp_path / "stopped", resume=True)
    straight = discsim.simulate(SCENE, tmp_path / "straight")
    np.testing.assert_array_equal(again[-1].dust.pos, straight[-1].dust.pos)
    np.testing.assert_array_equal(again[-1].dust.vel, straight[-1].dust.vel)


def test_in_another_thread_it_runs_without_signals(tmp_path):
    found = []
    thread = threading.Thread(target=lambda: found.append(discsim.simulate(SCENE, tmp_path / "my")))
    thread.start()
    thread.join()
    assert found[0][-1].time == 0.7


def test_a_failure_is_raised_and_logged(tmp_path, monkeypatch):
    from discsim.run.runner import Run

    def fail(self):
        raise PhysicsError("the step has collapsed")

    monkeypatch.setattr(Run, "_after_step", fail)
    with pytest.raises(PhysicsError, match="collapsed"):
        discsim.simulate(SCENE, tmp_path / "my")
    assert "the step has collapsed" in (tmp_path / "my/run.log").read_text()
    faulty = SCENE | {"star": {"mass": -1.3}}
    with pytest.raises(discsim.SceneError, match=r"star[.]mass"):
        discsim.simulate(faulty, tmp_path / "other")
    assert not (tmp_path / "other").exists()
