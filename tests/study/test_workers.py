"""Processes that make runs for another one end with it."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future

from discsim.study.workers import results

PARENT = """
import os, sys, time
from concurrent.futures import ProcessPoolExecutor
from discsim.study.workers import end_with_parent
with ProcessPoolExecutor(2, initializer=end_with_parent) as pool:
    print(*{pool.submit(os.getpid).result() for _ in range(20)}, flush=True)
    time.sleep(60)
"""
SOON = 20.0  # seconds; what waits for ever is still there then


def test_workers_end_where_their_parent_is_killed():
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        parent.send_signal(signal.SIGKILL)
    assert workers
    late = time.monotonic() + SOON
    while left := [pid for pid in workers if alive(pid)]:
        if time.monotonic() > late:
            for pid in left:
                os.kill(pid, signal.SIGKILL)
            raise AssertionError(f"{len(left)} workers are still there")
        time.sleep(0.05)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"


def test_jobs_that_are_waited_for_are_told_of(monkeypatch):
    monkeypatch.setattr("discsim.study.workers.LINE_EVERY", 0.01)
    jobs, said = [Future(), Future()], []
    jobs[1].set_result("second")

    def say(text):
        said.append(text)
        if len(said) == 3:
            jobs[0].set_result("first")

    assert list(results(jobs, say)) == ["first", "second"]
    assert said == 3 * ["    1 of 2 runs are complete, others continue"]
