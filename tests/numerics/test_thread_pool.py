"""Jobs beside each other: all at once, each with whoever has nothing to do in its loops, and what they cost."""

import gc
import os
import signal
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
from loops import meet_in_a_loop

from discsim.numerics.thread_pool import cpu_time, number_of_threads, run_concurrently
from discsim.numerics.threads import parallel_for, set_threads


def burn(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_jobs_run_at_the_same_time_with_the_threads_and_settings_of_their_caller(four_cores):
    met, found = threading.Barrier(4), {}

    def job():
        met.wait(30.0)
        found[threading.get_ident()] = number_of_threads()

    set_threads(4)
    run_concurrently(job, job, job, job)
    assert [*found.values()] == [4] * 4


def test_who_has_nothing_to_do_takes_part_in_the_loops_of_others(four_cores):
    """All four of the pool, as one job ends at once; and two jobs at once share theirs."""
    for _ in range(20):
        found = []
        run_concurrently(lambda: None, lambda found=found: found.append(meet_in_a_loop(4)))
        run_concurrently(*[lambda found=found: found.append(meet_in_a_loop(2))] * 2)
        assert [len(threads) >= least for threads, least in zip(found, (4, 2, 2), strict=True)] == [True] * 3


def run_nine_jobs():
    """All of them, whatever was before, though there are fewer threads."""
    set_threads(2)
    found = []
    run_concurrently(*[lambda k=k: found.append(k) for k in range(9)])
    assert sorted(found) == [*range(9)]


def test_more_jobs_than_threads_all_run(four_cores):
    run_nine_jobs()


def test_on_one_thread_jobs_run_one_after_another(four_cores):
    set_threads(1)
    found = []
    run_concurrently(*[lambda k=k: found.append((k, threading.get_ident())) for k in range(3)])
    assert found == [(k, threading.get_ident()) for k in range(3)]


def test_the_first_fault_is_raised_once_all_jobs_have_ended(four_cores):
    ended = []

    def late():
        time.sleep(0.1)
        ended.append(True)
        raise ValueError("late")

    def fail(text):
        raise ValueError(text)

    with pytest.raises(ValueError, match="one"):
        run_concurrently(lambda: fail("one"), late, lambda: fail("three"))
    with pytest.raises(ValueError, match="late"):
        run_concurrently(lambda: None, late)
    assert ended == [True] * 2
    run_nine_jobs()


@pytest.mark.parametrize("where", ["early", "late"])
def test_ctrl_c_waits_for_the_jobs_that_have_begun(four_cores, where):
    """Then all goes on."""
    ended, begun = [], threading.Event()

    def interrupt(here):
        if here == where:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)

    def interrupt_early():
        begun.wait()
        time.sleep(0.1)  # until the caller waits for both jobs; before, it would not begin the second
        interrupt("early")

    def job():
        begun.set()
        try:
            parallel_for(lambda first, last: time.sleep(0.001), 64, least=1)
            time.sleep(0.3)
            interrupt("late")
        finally:
            ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        run_concurrently(interrupt_early, job)
        time.sleep(1.0)
    assert ended == [True]
    run_nine_jobs()


@pytest.mark.parametrize("work", ["jobs", "loop"])
def test_ctrl_c_while_work_is_handed_over_loses_none_of_it(four_cores, monkeypatch, work):
    """It comes once the pool has the work and before the caller knows: no thread goes on with arrays afterwards."""
    begun, ended = threading.Event(), []

    def job(*piece):
        begun.set()
        time.sleep(0.2)
        ended.append(True)

    class InterruptedPool(ThreadPoolExecutor):
        def submit(self, *given, **more):
            super().submit(*given, **more)
            begun.wait()
            raise KeyboardInterrupt

    pool = InterruptedPool(2)
    monkeypatch.setattr("discsim.numerics.thread_pool._pool_of_threads", lambda threads: pool)
    with pytest.raises(KeyboardInterrupt):
        run_concurrently(job, job) if work == "jobs" else parallel_for(job, 64, least=1)
    assert ended == [True]
    pool.shutdown()
    assert ended == [True]  # what had not begun is cancelled


class Held:
    """Of which it is known whether it is still there."""


@pytest.mark.parametrize("thread", ["caller", "helper"])
@pytest.mark.parametrize("within", ["job", "loop"])
def test_a_fault_keeps_nothing(four_cores, thread, within):
    """No circle of it and the frames that it came through: arrays would stay until somebody looks for garbage."""
    kept = []

    def fail(*piece):
        held = Held()
        kept.append(weakref.ref(held))
        raise ValueError("of a job")

    work = fail if within == "job" else lambda: parallel_for(fail, 64, least=1)
    gc.disable()
    try:
        for _ in range(3):
            with suppress(ValueError):
                run_concurrently(*[work, lambda: None][:: 1 if thread == "caller" else -1])
        run_nine_jobs()  # helpers have let go of what they had
        assert len(kept) >= 3 and not any(ref() for ref in kept)
    finally:
        gc.enable()


def test_cpu_time_of_a_job_is_that_of_all_in_its_loops_and_of_no_other_job(four_cores):
    found = {}

    def job(name, seconds):
        begun = cpu_time()
        parallel_for(lambda first, last: burn(seconds * (last - first)), 8, least=1)
        found[name] = cpu_time() - begun

    run_concurrently(lambda: job("long", 0.04), lambda: job("short", 0.01))
    # Pieces end after what they are to burn, and calls of some microseconds; a machine that is busy does not count.
    assert found["long"] == pytest.approx(0.32, rel=0.1)
    assert found["short"] == pytest.approx(0.08, rel=0.1)
