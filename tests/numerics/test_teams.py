"""Jobs beside each other: all at once, each with whoever has nothing to do in its loops, and what they cost."""

import signal
import threading
import time

import numba
import pytest
from loops import meet_in_a_loop

from discsim.numerics.teams import beside, cpu_time
from discsim.numerics.threads import share


def burn(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_jobs_run_at_the_same_time_with_the_threads_and_settings_of_their_caller(four_cores):
    met, found = threading.Barrier(4), {}

    def job():
        met.wait(30.0)
        found[threading.get_ident()] = numba.get_num_threads()

    numba.set_num_threads(4)
    beside(job, job, job, job)
    assert threading.get_ident() in found and [*found.values()] == [4] * 4


def test_who_has_nothing_to_do_takes_part_in_the_loops_of_others(four_cores):
    """The caller too, whose own job has ended; and two jobs at once share theirs."""
    caller = threading.get_ident()
    for _ in range(20):
        found = []
        beside(lambda: None, lambda found=found: found.append(meet_in_a_loop(4)))
        assert caller in found[0]
        beside(*[lambda found=found: found.append(meet_in_a_loop(2))] * 2)
        assert [len(threads) >= 2 for threads in found] == [True] * 3


def test_more_jobs_than_threads_all_run(four_cores):
    numba.set_num_threads(2)
    found = []
    beside(*[lambda k=k: found.append(k) for k in range(9)])
    assert sorted(found) == [*range(9)]


def test_on_one_thread_jobs_run_one_after_another(four_cores):
    numba.set_num_threads(1)
    found = []
    beside(*[lambda k=k: found.append((k, threading.get_ident())) for k in range(3)])
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
        beside(lambda: fail("one"), late, lambda: fail("three"))
    with pytest.raises(ValueError, match="late"):
        beside(lambda: None, late)
    assert ended == [True] * 2
    test_more_jobs_than_threads_all_run(None)


@pytest.mark.parametrize("where", ["own job", "waiting", "another's loop"])
def test_ctrl_c_waits_for_the_jobs_of_others(four_cores, where):
    """Then all goes on. In a loop that it helps with, the caller ends that loop, and with it the job."""
    caller, ended = threading.get_ident(), []

    def interrupt(here):
        if here == where:
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.1)

    def piece(first, last):
        time.sleep(0.001)
        interrupt("another's loop" if threading.get_ident() == caller else "")

    def job():
        try:
            share(piece, 64, least=1)
            time.sleep(0.1)
            interrupt("waiting")
        finally:
            ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        beside(lambda: interrupt("own job"), job)
    assert ended == [True]
    test_more_jobs_than_threads_all_run(None)


def test_cpu_time_of_a_job_is_that_of_all_in_its_loops_and_of_no_other_job(four_cores):
    found = {}

    def job(name, seconds):
        begun = cpu_time()
        share(lambda first, last: burn(seconds * (last - first)), 8, least=1)
        time.sleep(0.01)  # who has ended the last piece says what it took a moment after that
        found[name] = cpu_time() - begun

    beside(lambda: job("long", 0.04), lambda: job("short", 0.01))
    # Pieces end after what they are to burn, and calls of some microseconds; a machine that is busy does not count.
    assert found["long"] == pytest.approx(0.32, rel=0.1)
    assert found["short"] == pytest.approx(0.08, rel=0.1)
