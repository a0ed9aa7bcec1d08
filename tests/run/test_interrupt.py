"""Ctrl-C in Python ends between steps, and what was stopped runs on to the same bits; steps past the end."""

import math
import signal
import threading

import pytest
from operating import replace_operator
from runs import DISC, SHOCK, WAVE, scene_of, state_bits

from discsim import SceneError, Simulation


@pytest.fixture
def sim(tmp_path):
    return Simulation(scene_of(tmp_path, WAVE))


def interrupt(sim, step, times=1):
    """Ctrl-C between the kick and the drift of the given step."""
    move = sim.operators.move

    def interrupted(dt):
        if sim.state.step == step - 1:
            sim.operators.move = move
            for _ in range(times):
                signal.raise_signal(signal.SIGINT)
        move(dt)

    sim.operators.move = interrupted


def all_bits(sim):
    state = sim.state
    return state_bits(sim), state.time, state.step, state.velocity_lag, state.ledger.accreted_gas, sim.limit


WAYS = {
    "step": lambda sim: [sim.step() for _ in range(8 - sim.state.step)],
    "run": lambda sim: sim.run(0.05),
    "evolve": lambda sim: sim.evolve(0.05),
}


@pytest.mark.parametrize("way", WAYS)
def test_ctrl_c_waits_for_the_end_of_the_step(tmp_path, sim, way):
    straight = Simulation(sim.scene)
    WAYS[way](straight)
    assert straight.state.step > 5
    interrupt(sim, 4)
    with pytest.raises(KeyboardInterrupt):
        WAYS[way](sim)
    assert sim.state.step == 4 and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    WAYS[way](sim)
    assert all_bits(sim) == all_bits(straight)


@pytest.mark.parametrize("text", [DISC, SHOCK])
def test_ctrl_c_in_the_first_forces(tmp_path, text):
    scene = scene_of(tmp_path, text)
    straight, sim = Simulation(scene), Simulation(scene)

    def interrupted(view):
        replace_operator(sim, "gas.forces", accelerate)
        signal.raise_signal(signal.SIGINT)
        return accelerate(view)

    accelerate = replace_operator(sim, "gas.forces", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sim.step()
    assert sim.state.step == 0
    assert sim.step() == straight.step() and all_bits(sim) == all_bits(straight)


def test_a_second_ctrl_c_ends_at_once_and_nothing_goes_on_from_there(tmp_path, sim):
    sim.step()
    sim.save(tmp_path / "a.h5")
    straight = sim.step()
    interrupt(sim, 4, times=2)
    sim.step()
    with pytest.raises(KeyboardInterrupt):
        sim.run()
    assert sim.state.step == 3 and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    for use in (sim.step, sim.run, lambda: sim.evolve(1.0), lambda: sim.save(tmp_path / "b.h5")):
        with pytest.raises(RuntimeError, match="the last step was interrupted; make a new Simulation, or call restore"):
            use()
    assert not (tmp_path / "b.h5").exists()
    sim.restore(tmp_path / "a.h5")
    assert sim.step() == straight


def test_ctrl_c_while_somebody_looks_leaves_what_was_there(sim):
    sim.evolve(0.02)
    assert sim.state.velocity_lag > 0.0
    before, kick = all_bits(sim), sim.operators.kick

    def interrupted(dt):
        kick(dt)
        signal.raise_signal(signal.SIGINT)

    sim.operators.kick = interrupted
    with pytest.raises(KeyboardInterrupt), sim.synchronised():
        pass
    assert all_bits(sim) == before


def test_a_handler_of_the_caller_is_left_alone(sim):
    calls = []
    before = signal.signal(signal.SIGINT, lambda *given: calls.append(sim.state.step))
    try:
        interrupt(sim, 2)
        sim.run(0.02)
    finally:
        signal.signal(signal.SIGINT, before)
    assert calls == [1] and sim.time == 0.02


def test_another_thread_may_step(sim):
    found = []
    thread = threading.Thread(target=lambda: found.append(sim.step()))
    thread.start()
    thread.join()
    assert found == [sim.time]


# Steps past the end


def grains(tmp_path):
    """Dust alone at rest: no effect limits the time step."""
    text = WAVE.replace('kind = "wave"', 'kind = "box"')
    return Simulation(scene_of(tmp_path, text, "run.until=1", without=("gas", "drag")))


def test_a_step_past_the_end_has_the_length_that_is_asked_for(tmp_path):
    sim = grains(tmp_path)
    assert sim.step() == 1.0  # to the end
    with pytest.raises(ValueError, match=r"no effect limits the step after run.until; call step\(most="):
        sim.step()
    assert sim.time == 1.0 and sim.step(most=0.25) == 0.25 and sim.time == 1.25
    with pytest.raises(ValueError, match="no effect limits the step"):
        sim.step()
    sim.run(3.0)
    assert sim.time == 3.0


@pytest.mark.parametrize("most", [0.0, -1.0, math.nan])
def test_time_does_not_run_back(tmp_path, sim, most):
    before = all_bits(sim)
    with pytest.raises(ValueError, match="is not a time step; expected a positive time in code units"):
        sim.step(most=most)
    assert all_bits(sim) == before


# Checkpoints of others


def test_the_checkpoint_of_another_scene_is_refused(tmp_path, sim):
    sim.step()
    sim.save(tmp_path / "a.h5")
    other = Simulation(scene_of(tmp_path, WAVE, "drag.t_stop=0.1", "run.threads=1"))
    before = all_bits(other)
    with pytest.raises(
        SceneError, match=r"a\.h5: the scene differs from the scene of the run in " r"drag\.t_stop; change only"
    ):
        other.restore(tmp_path / "a.h5")
    assert all_bits(other) == before
    longer = Simulation(scene_of(tmp_path, WAVE, "run.until=7", "run.snapshots=3", "title=longer"))
    longer.restore(tmp_path / "a.h5")
    assert all_bits(longer) == all_bits(sim)


def test_own_particles_are_restored(tmp_path):
    scene = {"units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 8.0}, "star": {"mass": 1.0}}
    scene["dust"] = {"particles": 1, "ratio": 1.0}
    orbit = {"dust": {"pos": [[1.0, 0.0]], "vel": [[0.0, 1.0]], "mass": [1e-6]}}
    one, other = Simulation(scene, particles=orbit), Simulation(scene, particles=orbit)
    one.step()
    one.save(tmp_path / "a.h5")
    other.restore(tmp_path / "a.h5")
    assert one.step() == other.step() and all_bits(one) == all_bits(other)
