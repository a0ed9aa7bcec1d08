"""Cores that this machine may not have."""

import threading

import numba
import pytest


@pytest.fixture
def four_cores(monkeypatch):
    """numba as it is on four cores: a number for each Python thread."""
    own = threading.local()
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)
    monkeypatch.setattr(numba, "set_num_threads", lambda number: setattr(own, "number", number))
    monkeypatch.setattr(numba, "get_num_threads", lambda: getattr(own, "number", 4))
