"""Threads: pools of their own process, and a number of their own for each Simulation."""

import signal
import threading
import time

import numba
import numpy as np
import pytest
from deaths import forked, status_of
from runs import WAVE, scene_of

from discsim import Simulation
from discsim.numerics.threads import fill


@pytest.fixture
def four_cores(monkeypatch):
    """numba as it is on four cores: a number for each Python thread."""
    own = threading.local()
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)
    monkeypatch.setattr(numba, "set_num_threads", lambda number: setattr(own, "number", number))
    monkeypatch.setattr(numba, "get_num_threads", lambda: getattr(own, "number", 4))


def test_a_fork_after_a_shared_loop_has_threads_of_its_own(four_cores):
    # What multiprocessing does on Linux: threads are not forked, and work that is given to them waits for ever.
    def in_threads():
        out = np.zeros(20_000)
        fill(out, lambda piece: time.sleep(0.02) or 1.0)  # long enough for every thread to begin
        return out.sum()

    def child():
        signal.alarm(5)  # ends a child that waits
        return 0 if in_threads() == 20_000 else 1

    assert in_threads() == 20_000
    assert status_of(forked(child)) == 0


def test_threads_of_a_simulation_are_its_own(tmp_path, four_cores):
    two = Simulation(scene_of(tmp_path, WAVE, "run.threads=2"))
    Simulation(scene_of(tmp_path, WAVE, "run.threads=1"))
    found = set()
    for name in ("accelerate", "move", "event", "limit"):
        real = getattr(two.effects["gas"], name)
        setattr(two.effects["gas"], name, lambda *given, real=real: found.add(numba.get_num_threads()) or real(*given))

    def look():
        with two.synchronised():
            pass
        two.acceleration("gas")
        two.save(tmp_path / "a.h5")

    for use in (two.step, lambda: two.run(0.02), lambda: two.evolve(0.03), look):
        Simulation(scene_of(tmp_path, WAVE, "run.threads=3"))
        use()
        thread = threading.Thread(target=use)  # of another number: numba's default
        thread.start()
        thread.join()
    assert found == {2}
