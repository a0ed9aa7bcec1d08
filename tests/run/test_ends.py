"""A run that must not go on, ends early, or goes wrong; and what it shows meanwhile."""

import errno
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from operating import replace_operator
from runs import DISC, WAVE, assert_same_run, at_step, contents, errors_of, rows, scene_of

from discsim import Simulation
from discsim.numerics.operators import ALL, Limit
from discsim.output.checkpoint import read_checkpoint
from discsim.run.outputs import output_times
from discsim.run.progress import Progress
from discsim.run.runner import run_scene
from discsim.scene import SceneError
from discsim.scene.units import clock


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


# Going on is refused


@pytest.mark.parametrize(
    "overrides, without, keys",
    [
        (["gas.particles=1001"], (), "gas.particles"),
        (["drag.scheme=idic", "run.courant=0.2"], (), "run.courant, drag.scheme"),
        ([], ("drag",), "drag"),
        ([], ("gas.viscosity",), "gas.viscosity"),
        (["dust.ratio=0.2"], (), "dust.0.ratio"),
        (["run.seed=2", "run.until=2"], (), "run.seed"),
    ],
)
def test_another_scene_is_refused(finished, tmp_path, overrides, without, keys, capsys):
    before = contents(finished)
    scene = scene_of(tmp_path, DISC, *overrides, without=without)
    assert run_scene(scene, finished, resume=True) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1
    assert f"{finished}/checkpoint.h5: " in said.err
    assert f"differs from the scene of the run in {keys}; change only" in said.err
    assert contents(finished) == before


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The directory of a finished run of the disc."""
    folder = tmp_path_factory.mktemp("finished")
    assert run_scene(scene_of(folder, DISC, "run.until=0.5"), folder / "out", quiet=True) == 0
    return folder / "out"


def test_a_finished_run_says_so(finished, tmp_path, capsys):
    before = contents(finished)
    for until in (0.5, 0.2):
        scene = scene_of(tmp_path, DISC, f"run.until={until}", "run.threads=1", "run.walltime=1 h")
        assert run_scene(scene, finished, resume=True) == 0
        assert "already finished, at t = 0.5" in capsys.readouterr().out
    assert contents(finished) == before


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "text"])
def test_a_damaged_checkpoint_is_one_message(finished, tmp_path, damage, capsys):
    whole = (finished / "checkpoint.h5").read_bytes()
    middle = whole.find(read_checkpoint(finished / "checkpoint.h5")[0]["gas"]["pos"].tobytes()[:64])
    assert middle > 0
    flipped = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    bad = {"flipped": flipped, "cut": whole[: len(whole) // 2], "empty": b"", "text": b"step 4\n"}[damage]
    out = tmp_path / "out"
    out.mkdir()
    (out / "checkpoint.h5").write_bytes(bad)
    assert run_scene(scene_of(tmp_path, DISC), out, resume=True) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1 and "damaged" in said.err
    assert contents(out) == {out / "checkpoint.h5": bad}


def test_a_scene_that_cannot_be_set_up_writes_nothing(tmp_path, monkeypatch, capsys):
    def refuse(scene, **_):
        raise SceneError(["space.size: no"])

    monkeypatch.setattr("discsim.run.runner.Simulation", refuse)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 2
    assert capsys.readouterr().err == "space.size: no\n" and not (tmp_path / "out").exists()


# Ends


def poison(sim):
    def spoil(view):
        limit = accelerate(view)
        view.gas.acc_unshared[7] = np.nan
        return limit

    gas = sim.effects["gas"]
    accelerate, gas.accelerate = gas.accelerate, spoil
    replace_operator(sim, "gas.forces", spoil)


def test_not_finite_is_told_with_effect_particle_time_and_checkpoint(tmp_path, monkeypatch, capsys):
    scene, out = (
        scene_of(tmp_path, DISC, "run.until=0.5", "run.courant=0.2", "run.checkpoint_every=1e-9 s"),
        tmp_path / "out",
    )
    at_step(monkeypatch, 4, poison)
    assert run_scene(scene, out) == 3
    message = capsys.readouterr().err
    number = re.search(r"gas particle (\d+) is not finite", message)
    assert number and 0 <= int(number[1]) < 1000
    assert "first effect with an acceleration that is not finite is gas" in message
    assert re.search(r"at t = 0\.\d+, step 5", message) and f"{out}/checkpoint.h5 is a checkpoint at t = 0." in message
    assert message in (out / "run.log").read_text()
    assert int(read_checkpoint(out / "checkpoint.h5")[1]["step"]) == 4  # the last good state
    monkeypatch.undo()
    assert run_scene(scene, out, resume=True, quiet=True) == 0


def test_the_start_is_there_to_go_back_to(tmp_path, monkeypatch, capsys):
    at_step(monkeypatch, 1, poison)
    assert run_scene(scene_of(tmp_path, DISC), tmp_path / "out", quiet=True) == 3
    assert "checkpoint.h5 is a checkpoint at t = 0; resume with: discsim run" in capsys.readouterr().err


def test_a_collapsed_step_names_its_effect(tmp_path, monkeypatch, capsys):
    at_step(monkeypatch, 2, lambda sim: replace_operator(sim, "star.limit", lambda view: {ALL: Limit(1e-300)}))
    assert run_scene(scene_of(tmp_path, DISC), tmp_path / "out", quiet=True) == 3
    assert re.search(r"time step became too small, 6e-301, by the limit of star", capsys.readouterr().err)


def test_out_of_memory(tmp_path, monkeypatch, capsys):
    def run_out(sim):
        raise MemoryError("Unable to allocate 7 TiB")

    at_step(monkeypatch, 2, run_out)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 3
    message = capsys.readouterr().err
    assert "out of memory at t = " in message and "7 TiB" in message and "--resume" in message


def test_a_full_disk_is_one_line(tmp_path, monkeypatch, capsys):
    def full(path, *arguments):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("discsim.run.outputs.write_snapshot", full)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 1
    message = capsys.readouterr().err
    assert len(message.splitlines()) == 1 and "0000.h5: cannot be written: No space left" in message


def test_walltime_is_a_clean_stop(finished, tmp_path, capsys):
    scene, out = scene_of(tmp_path, DISC, "run.until=0.5", "run.walltime=1e-6 s"), tmp_path / "out"
    assert run_scene(scene, out) == 0
    said = capsys.readouterr()
    assert "stopped by run.walltime at t = 0, step 0" in said.out and "--resume" in said.out
    assert run_scene(scene_of(tmp_path, DISC, "run.until=0.5"), out, resume=True, quiet=True) == 0
    assert_same_run(finished, out)


def test_a_second_interrupt_leaves_at_once(tmp_path, monkeypatch, capsys):
    def twice(sim):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        pytest.fail("still here")

    at_step(monkeypatch, 2, twice)
    before = signal.getsignal(signal.SIGINT)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 130
    assert "stopped immediately" in capsys.readouterr().err
    assert read_checkpoint(tmp_path / "out" / "checkpoint.h5")[1]["step"] == 0
    assert signal.getsignal(signal.SIGINT) is before


def command(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "discsim", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def test_ctrl_c_on_the_command_line(tmp_path):
    # Outputs are many, so that the signal surely arrives between the first and the last.
    scene = scene_of(tmp_path, DISC, "run.every=0.004", "run.until=4")
    (tmp_path / "a.toml").write_text(scene.text)
    out = tmp_path / "out"
    child = command("run", tmp_path / "a.toml", "-o", out)
    try:
        deadline = time.monotonic() + 300  # kernels may have to compile first
        while not (out / "snapshots" / "0003.h5").exists():
            assert child.poll() is None and time.monotonic() < deadline, child.stderr.read()
            time.sleep(0.02)
        child.send_signal(signal.SIGINT)
        text, message = child.communicate(timeout=60)
    finally:
        child.kill()
    assert child.returncode == 130, message
    assert len(message.splitlines()) == 1 and "--resume" in message and "Traceback" not in text + message
    reached = float(read_checkpoint(out / "checkpoint.h5")[1]["time"])
    done = next(t for t in output_times(scene.run) if t > reached)
    child = command("run", out / "scene.toml", "-o", out, "--resume", "--until", repr(done), "--quiet")
    text, message = child.communicate(timeout=300)
    assert (text, errors_of(message), child.returncode) == ("", [], 0)
    straight = tmp_path / "straight"
    assert run_scene(scene_of(tmp_path, scene.text, f"run.until={done!r}"), straight, quiet=True) == 0
    assert_same_run(straight, out)


# Progress


def test_plain_lines_come_at_intervals(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("discsim.run.progress.LINE_EVERY", 0.0)
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out") == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("step ")]
    found = rows(tmp_path / "out")
    assert len(lines) >= len(found)  # every step, and the outputs
    assert re.fullmatch(
        r"step 5  t = [\d.]+ of 0\.1  dt = [\d.]+, set by gas  [\d.e+]+ steps/s  [\d.]+ s left",
        lines[5].strip(),
    )


def test_time_left_leaves_the_first_step_out(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("discsim.run.progress.time.monotonic", lambda: now[0])
    sim = Simulation(scene_of(tmp_path, WAVE))
    progress = Progress(sim.scene, quiet=True)
    for wall, t in ((100.0, 0.01), (101.0, 0.02), (102.0, 0.03)):  # 100 s of compiling
        now[0], sim.state.time, sim.state.step = wall, t, sim.state.step + 1
        progress.step(sim.state, 0.01, "gas")
    facts = progress._facts(sim.state, 0.01, "gas")
    assert facts["speed"] == "1 steps/s" and facts["left"] == "7.0 s left"


def test_clock():
    assert [clock(s) for s in (0.04, 9.94, 12.3, 59.7, 245, 7504)] == [
        "0.0 s", "9.9 s", "12 s", "1 min 0 s", "4 min 5 s", "2 h 5 min",
    ]  # fmt: skip
