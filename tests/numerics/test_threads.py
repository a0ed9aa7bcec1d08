"""Threads: pools of their own process, and a number of their own for each Simulation."""

import signal
import threading
import time

import numpy as np
import pytest
from deaths import forked, status_of
from loops import meet_in_a_loop
from runs import WAVE, scene_of

from discsim import Simulation
from discsim.numerics import thread_pool
from discsim.numerics.threads import chunks, fill, parallel_for, parallel_for_fused, parallel_for_ranges, set_threads
from discsim.run.forces import Plan


def test_a_fork_after_a_shared_loop_has_threads_of_its_own(four_cores):
    # What multiprocessing does on Linux: threads are not forked, and work that is given to them waits for ever.
    def child():
        signal.alarm(20)  # ends a child that waits
        return 0 if len(meet_in_a_loop(4)) == 4 else 1

    assert len(meet_in_a_loop(4)) == 4
    assert status_of(forked(child)) == 0


def test_threads_of_a_simulation_are_its_own(tmp_path, four_cores):
    two = Simulation(scene_of(tmp_path, WAVE, "run.threads=2"))
    Simulation(scene_of(tmp_path, WAVE, "run.threads=1"))
    found = set()
    for name in ("accelerate", "drift", "sort", "limit"):
        real = getattr(two.effects["gas"], name)
        setattr(
            two.effects["gas"],
            name,
            lambda *given, real=real: found.add(thread_pool.number_of_threads()) or real(*given),
        )
    two.operators.plan = Plan(two.effects, two.state)

    def look():
        with two.synchronised():
            pass
        two.acceleration("gas")
        two.save(tmp_path / "a.h5")

    for use in (two.step, lambda: two.run(0.02), lambda: two.evolve(0.03), look):
        Simulation(scene_of(tmp_path, WAVE, "run.threads=3"))
        use()
        thread = threading.Thread(target=use)  # of another number: as many as there may be
        thread.start()
        thread.join()
    assert found == {2}


def cover(first, last, seen):
    seen[first:last] += 1
    return first, last


@pytest.mark.parametrize("least", [1, 7, 64])
@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_pieces_cover_a_range_once_and_none_is_too_small(threads, least):
    for count in [*range(200), 511, 512, 513, 4096]:
        runs = chunks(count, least, threads)
        spans = [span for run in runs for span in run]
        assert spans[0][0] == 0 and spans[-1][1] == count
        assert [a for a, _ in spans[1:]] == [b for _, b in spans[:-1]]
        sizes = np.diff(spans)[:, 0]
        if len(sizes) > 1:
            assert sizes.min() >= least
            # What the last piece leaves the others to wait for: a sixteenth of a thread's share, twice where it ends.
            assert sizes[-1] < 2 * max(least, np.ceil(count / (8 * threads)))
            # Parts are equal, and fewer than threads only where they would be too small.
            assert len(runs) == min(threads, count // least)
            assert np.ptp([run[-1][1] - run[0][0] for run in runs]) <= 1
        assert len(sizes) == 1 or count >= 2 * least


def test_what_pieces_return_comes_in_their_order_and_goes_to_the_same_pieces(four_cores):
    seen = np.zeros(5000, int)
    found = parallel_for(cover, len(seen), seen, least=10)
    assert len(found) > 4 and (seen == 1).all()
    assert [a for a, _ in found[1:]] == [b for _, b in found[:-1]]

    def again(first, last, own):
        assert own == (first, last)
        return own

    assert parallel_for(again, len(seen), least=10, each=found) == found


@pytest.mark.parametrize("counts", [(), (0,), (0, 0), (3, 4), (3000,), (700, 0, 1900, 1), (0, 5000)])
def test_several_ranges_are_one_loop(counts, four_cores, monkeypatch):
    """Each is covered once, and tells what its own pieces returned, in their order; no more loops than one."""
    loops, run = [], thread_pool.run_loop
    monkeypatch.setattr(thread_pool, "run_loop", lambda loop, helpers: loops.append(loop) or run(loop, helpers))
    all_seen = [np.zeros(count, int) for count in counts]
    found = parallel_for_ranges(cover, [(len(seen), seen) for seen in all_seen], least=10)
    assert len(found) == len(counts) and len(loops) == (sum(counts) > 100)  # few rows wake nobody
    for seen, returned in zip(all_seen, found, strict=True):
        assert (seen == 1).all() and returned[0][0] == 0 and returned[-1][1] == len(seen)
        assert [a for a, _ in returned[1:]] == [b for _, b in returned[:-1]]


@pytest.mark.parametrize("count", [0, 7, 3000])
def test_pieces_go_through_several_kernels_in_turn(count, four_cores, monkeypatch):
    """As one loop; each kernel finds what those before it made of the piece, and has arguments of its own."""
    loops, run = [], thread_pool.run_loop
    monkeypatch.setattr(thread_pool, "run_loop", lambda loop, helpers: loops.append(loop) or run(loop, helpers))
    seen, twice = np.zeros(count), np.zeros(count)

    def double(first, last, source, out):
        out[first:last] = 2 * source[first:last]

    parallel_for_fused([(cover, seen), (double, seen, twice)], count, least=10)
    assert (seen == 1).all() and (twice == 2).all() and len(loops) == (count > 100)


def test_loops_are_shared_among_the_caller_and_the_same_helpers(four_cores):
    found = meet_in_a_loop(4)
    assert threading.get_ident() in found and len(found) == 4
    assert all(meet_in_a_loop(4) == found for _ in range(20))


def test_a_thread_begins_with_its_own_part_of_a_range(four_cores):
    """The same in each loop, so what it needs is in its cache; and then it takes what others have not begun."""
    # Who is late finds its own part taken, so each waits in its first piece until all have begun; and helpers wait
    # there until the caller has taken a piece of theirs, or it would find none.
    caller, took = threading.get_ident(), []
    runs = chunks(64, 1, 4)
    firsts = [run[0][0] for run in runs]

    def note(first, last):
        mine = threading.get_ident()
        begins = all(thread != mine for thread, _ in took)
        took.append((mine, first))
        if begins:
            begun.wait(30.0)
        if mine != caller:
            assert helped.wait(30.0)
        elif first >= firsts[1]:
            helped.set()

    for _ in range(3):
        took.clear()
        begun, helped = threading.Barrier(4), threading.Event()
        parallel_for(note, 64, least=1)
        began = dict(reversed(took))
        assert began[caller] == 0 and sorted(began.values()) == firsts == [0, 16, 32, 48]
        assert len(took) == sum(map(len, runs))


def test_loops_of_few_pieces_take_helpers_that_are_there(four_cores):
    parallel_for(lambda first, last: None, 64, least=1)
    before = threading.active_count()
    for count in (2, 3, 64):
        parallel_for(lambda first, last: None, count, least=1)
    assert threading.active_count() == before


def test_a_loop_too_small_to_be_shared_is_the_callers(four_cores):
    assert parallel_for(lambda first, last: threading.get_ident(), 7, least=4) == [threading.get_ident()]


def test_a_loop_within_a_piece_has_helpers_of_its_own(four_cores):
    def inner(first, last):
        time.sleep(0.001)
        return last - first

    def outer(first, last):
        return [sum(parallel_for(inner, 16, least=1)) for _ in range(first, last)]

    assert [number for piece in parallel_for(outer, 8, least=1) for number in piece] == [16] * 8


@pytest.mark.parametrize("threads", [1, 4])
def test_the_first_fault_of_a_loop_reaches_its_caller(four_cores, threads):
    set_threads(threads)

    def fail(first, last):
        time.sleep(0.02 if first == 0 else 0.0)  # the first to fail is not the first in the range
        raise ValueError(f"at {first}")

    for _ in range(5):
        with pytest.raises(ValueError, match=r"at 0$"):
            parallel_for(fail, 1000, least=10)
    seen = np.zeros(1000, int)
    parallel_for(cover, len(seen), seen, least=10)
    assert (seen == 1).all()


def test_settings_of_numpys_errors_are_those_of_the_caller(four_cores):
    out = np.zeros(40_000)

    def overflow(piece):
        time.sleep(0.01)  # every thread takes part
        return np.array([1e300]) * (1.0 if piece.start == 0 else 1e300)

    with np.errstate(over="raise"), pytest.raises(FloatingPointError):
        fill(out, overflow)
    with np.errstate(over="ignore"):
        fill(out, overflow)
    assert np.isinf(out[-1])


@pytest.mark.parametrize("late", [False, True])
def test_ctrl_c_reaches_who_shares_a_loop_and_the_next_one_runs(four_cores, late):
    """In a piece of the caller's own, and while it waits for those of its helpers."""
    caller = threading.get_ident()

    def act(first, last):
        if (threading.get_ident() == caller) != late:
            time.sleep(0.1)
            signal.raise_signal(signal.SIGINT)
        time.sleep(0.1 if late else 0.0)

    with pytest.raises(KeyboardInterrupt):
        parallel_for(act, 8, least=1)
        time.sleep(1.0)
    seen = np.zeros(1000, int)
    parallel_for(cover, len(seen), seen, least=10)
    assert (seen == 1).all()


def test_many_callers_at_once(four_cores):
    wrong = []

    def use():
        for _ in range(50):
            seen = np.zeros(1000, int)
            parallel_for(cover, len(seen), seen, least=10)
            if not (seen == 1).all():
                wrong.append(seen)

    callers = [threading.Thread(target=use) for _ in range(6)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert not wrong
