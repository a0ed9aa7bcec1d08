"""The environment is the same for every test, whatever the user's shell has set (`helpers/environment.py`).

What runs learn of this machine's speed stays among the tests. Examples of property tests are the same every time.
Garbage is looked for as rarely as a command does it. Ctrl-C interrupts tests as well that a shell has started in the
background, where it would be ignored.
"""

import os
import signal
import sys
import tempfile
from collections import Counter

import environment
import pytest
from hypothesis import settings

from discsim.cli.process import collect_garbage_rarely
from discsim.numerics import threads

environment.settle(os.environ)
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="discsim-tests-")
collect_garbage_rarely()
threads.MIN_CHUNK_CHEAP = 64  # where a test has several threads, they share what they share in runs of many particles
signal.signal(signal.SIGINT, signal.default_int_handler)
settings.register_profile("same-every-time", derandomize=True, deadline=None)
settings.load_profile("same-every-time")


SECOND = "test_forces.py"  # of gravity: long, with kernels of its own


def pytest_collection_modifyitems(items):
    """Files with most tests first: processes that each take the next one then end together. The second process begins
    with a file without runs, as else it would compile what all runs need at the same time as the first.
    """
    tests = Counter(item.path for item in items)
    first = max(tests, key=tests.get, default=None)
    items.sort(key=lambda item: (item.path != first, item.path.name != SECOND, -tests[item.path]))


@pytest.fixture(autouse=True)
def close_figures():
    """Close the figures of pyplot that a test has made: matplotlib warns about more than 20 open ones."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def four_cores(monkeypatch):
    """As on four cores, whatever number of threads other tests have left."""
    import numba  # only now: it reads the number above

    from discsim.numerics import thread_pool

    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)
    token = thread_pool.thread_limit.set(0)
    yield
    thread_pool.thread_limit.reset(token)
