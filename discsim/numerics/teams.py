"""Who works on what: a thread that calls, and helpers that sleep until there is something to do.

There are two kinds of work: loops that have pieces left (`numerics/threads.py`), and jobs that nobody has begun. A loop
is one task: the thread that calls takes pieces too, and its helpers, each asleep behind a lock, are woken once. A step
of 80 loops is as many tasks, and one that a pool hands out piece by piece takes a tenth of its time for that.

Jobs that do not need each other run `beside` each other: where one of them works by itself, as all do between two
loops, others go on meanwhile, and each shares its loops with whoever has nothing to do.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from contextvars import copy_context
from itertools import accumulate, chain
from threading import Lock, Thread
from typing import Any

from discsim.parts import Lazy

numba = Lazy("numba")

# Seconds after which the interpreter goes from one job to another that waits for it; else it does when a kernel begins.
# With Python's own 5 ms jobs waited a thirtieth of a step of 3e5 particles for it (2026-11).
TURN = 5e-4


class Here(threading.local):
    """Of this Python thread: the team of the job that it runs, its number there, CPU seconds of others in its loops;
    and how many threads these may take, 0 where nobody has said it.
    """

    team: Team | None = None
    number = threads = 0
    others = 0.0

    def __init__(self) -> None:
        self.heard: list[float] = []  # of these, that are not added yet

    def add_up(self) -> float:
        while self.heard:
            self.others += self.heard.pop()
        return self.others


here = Here()


def number_of_threads() -> int:
    """How many threads loops of this Python thread may take. numba's own number of them takes 4 us to ask for."""
    return here.threads or int(numba.config.NUMBA_NUM_THREADS)


class Turns:
    """Short turns of the interpreter, of the whole process, while any thread has jobs."""

    def __init__(self) -> None:
        self.lock, self.users, self.before = Lock(), 0, 0.0

    def __enter__(self) -> None:
        with self.lock:
            if self.users == 0:
                self.before = sys.getswitchinterval()
                sys.setswitchinterval(min(self.before, TURN))
            self.users += 1

    def __exit__(self, *fault: object) -> None:
        with self.lock:
            self.users -= 1
            if self.users == 0:
                sys.setswitchinterval(self.before)


turns = Turns()


def cpu_time() -> float:
    """CPU seconds of this thread until now, with those of others in its loops."""
    return time.thread_time() + here.add_up()


class Loop:
    """A kernel and the pieces of its range; what they returned, and what they raised, by number.

    runs: how many of the pieces each thread begins with.
    """

    def __init__(
        self, kernel: Callable[..., Any], parts: list[tuple[Any, ...]], arguments: tuple[Any, ...], runs: list[int]
    ) -> None:
        self.kernel, self.parts, self.arguments = kernel, parts, arguments
        self.returned: list[Any] = [None] * len(parts)
        self.raised: dict[int, BaseException] = {}
        # Numbers of the pieces of each thread's own. The interpreter gives each number to one thread.
        self.left = [iter(range(end - run, end)) for run, end in zip(runs, accumulate(runs), strict=True)]
        self.ended: set[int] = set()
        self.done = Lock()
        self.done.acquire()
        self.heard = here.heard
        self.context = copy_context()  # settings of numpy's errors are the caller's

    def take(self, thread: int, helping: bool = False) -> None:
        """Run pieces until none is left, a thread's own ones first: it has their data at hand from the loops before.

        Whoever ends the last one says so. What Ctrl-C raises between two pieces ends the loop, as what one raises does;
        it is raised here where all pieces have ended. helping: for another thread, which hears of the CPU time.
        """
        own, number, begun = thread % len(self.left), -1, time.thread_time()
        try:
            for number in chain(*self.left[own:], *self.left[:own]):
                if not self.raised or number < min(self.raised):  # the first to raise is the same on any threads
                    try:
                        self.returned[number] = self.kernel(*self.parts[number], *self.arguments)
                    except BaseException as fault:  # for who called, Ctrl-C too
                        self.raised[number] = fault
                if helping:
                    now = time.thread_time()
                    self.heard.append(now - begun)
                    begun = now
                self._end(number)
        except BaseException as fault:
            late = len(self.ended) == len(self.parts)
            self.raised[-1] = fault
            if number >= 0:
                self._end(number)
            if late:
                raise

    def _end(self, number: int) -> None:
        self.ended.add(number)
        if len(self.ended) == len(self.parts):
            wake(self.done)

    def help(self, thread: int) -> None:
        """The same by another thread than that which called."""
        self.context.copy().run(self.take, thread, True)

    def complete(self, thread: int) -> list[Any]:
        """Take pieces, and wait for those of others; what all returned, or raises what the first raised."""
        while True:
            try:
                if len(self.ended) == len(self.parts):
                    break
                self.take(thread)
                self.done.acquire()
            except BaseException as fault:  # Ctrl-C while others end their pieces
                self.raised[-1] = fault
        here.add_up()
        try:
            if self.raised:
                raise self.raised[min(self.raised)]
        finally:
            self.raised = {}  # no circle of a fault and the frames that it came through
        return self.returned


class Job:
    """Work that does not need that of other jobs."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self.work, self.context = work, copy_context()
        self.fault: BaseException | None = None
        self.ended = False

    def run(self, team: Team, thread: int) -> None:
        """Do the work; what it raises is for who called, Ctrl-C too."""
        try:
            here.team, here.number = team, thread
            here.threads = len(team.locks)
            self.context.run(self.work)
        except BaseException as fault:
            self.fault = fault
        self.end(team)

    def end(self, team: Team, fault: BaseException | None = None) -> None:
        here.team = None
        self.fault = self.fault or fault
        self.ended = True
        wake(team.locks[0])


class Team:
    """A caller and its helpers, each asleep until its lock is opened; the first is the caller's."""

    def __init__(self, helpers: int) -> None:
        self.jobs: Iterator[Job] = iter(())  # that nobody has begun; the interpreter gives each to one thread
        self.loops: list[Loop] = []  # with pieces that nobody has begun
        self.locks = [Lock() for _ in range(helpers + 1)]
        for lock in self.locks:
            lock.acquire()
        for number in range(1, helpers + 1):
            Thread(target=self._serve, args=(number,), name="discsim", daemon=True).start()

    def share(self, loop: Loop, thread: int) -> list[Any]:
        """Run a loop of this thread on all that have nothing else to do."""
        try:
            self.loops.append(loop)
            # Of a caller alone, as many as there are pieces for; beside other jobs nobody knows who has nothing to do.
            for lock in self.locks[1 : len(loop.parts)] if here.team is None else self.locks:
                wake(lock)
        except BaseException as fault:  # Ctrl-C
            loop.raised[-1] = fault
        try:
            return loop.complete(thread)
        finally:
            with suppress(ValueError):
                self.loops.remove(loop)

    def beside(self, jobs: list[Job]) -> None:
        """Run jobs at the same time, the first on this thread, and wait for all."""
        self.jobs = iter(jobs[1:])
        begun = False
        while True:
            try:
                if all(job.ended for job in jobs):
                    break
                if begun:
                    self._help(0)
                    self.locks[0].acquire()
                else:
                    begun = True
                    for lock in self.locks[1:]:
                        wake(lock)
                    jobs[0].run(self, 0)
            except BaseException as fault:  # Ctrl-C: nothing goes on while a job still changes things
                for job in (jobs[0], *self.jobs):  # which nobody has begun
                    job.end(self, fault)

    def _serve(self, thread: int) -> None:
        while True:
            self.locks[thread].acquire()
            self._help(thread)

    def _help(self, thread: int) -> None:
        """Do what there is to do. What comes meanwhile opens the lock again."""
        job = None
        try:
            for job in self.jobs:
                job.run(self, thread)
        except BaseException as fault:  # Ctrl-C before or after the work
            if job is None:
                raise
            job.end(self, fault)
        for loop in [*self.loops]:
            loop.help(thread)


def wake(lock: Any) -> None:
    """Open a lock, unless it is open."""
    if lock.locked():
        with suppress(RuntimeError):  # somebody else has opened it meanwhile
            lock.release()


_idle: dict[int, list[Team]] = {}  # by the number of helpers
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a fork has none of the threads: work given to them would wait


def share(loop: Loop, helpers: int) -> list[Any]:
    """Run a loop on this thread and helpers; what its pieces returned, or raises what the first raised."""
    if here.team is not None:
        return here.team.share(loop, here.number)
    team = _team(helpers)
    try:
        return team.share(loop, 0)
    finally:
        _idle[helpers].append(team)


def several_threads() -> bool:
    """Whether jobs of this thread run at the same time."""
    return number_of_threads() > 1 and here.team is None


def beside(*jobs: Callable[[], object]) -> None:
    """Run jobs that do not need each other at the same time, and wait for all; raises what the first of them raised.

    Each may share loops. On one thread, and within a job, they run one after another, until one raises.
    """
    if len(jobs) < 2 or not several_threads():
        for work in jobs:
            work()
        return
    helpers = number_of_threads() - 1
    team, held = _team(helpers), [Job(work) for work in jobs]
    try:
        with turns:
            team.beside(held)
    finally:
        _idle[helpers].append(team)
    faults = [job.fault for job in held if job.fault is not None]
    for job in held:
        job.fault = None  # no circle of a fault and the frames that it came through
    if faults:
        try:
            raise faults[0]
        finally:
            faults.clear()


def _team(helpers: int) -> Team:
    """One of which nobody is at work."""
    try:
        return _idle.setdefault(helpers, []).pop()
    except IndexError:
        return Team(helpers)
