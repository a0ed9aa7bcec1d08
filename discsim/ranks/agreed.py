"""What ranks do so that all come to the same end: where one of them fails, all do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from discsim.ranks.comm import Comm


def led(comm: Comm, do: Callable[[], Any]) -> Any:
    """What `do` returns on the rank that leads, where alone it is called; raises everywhere what it raises."""
    value, raised = comm.mpi.bcast(_tried(do) if comm.rank == 0 else None)
    if raised is not None:
        raise raised
    return value


def alike(comm: Comm, do: Callable[[], Any]) -> Any:
    """What `do` returns here; raises everywhere what it raises on the first rank where it does.

    It must not wait for other ranks.
    """
    value, fault = _tried(do)
    if comm.reduced(fault is not None, MPI.MAX):
        raise next(raised for raised in comm.mpi.allgather(fault) if raised is not None)
    return value


def _tried(do: Callable[[], Any]) -> tuple[Any, BaseException | None]:
    try:
        return do(), None
    except Exception as fault:
        return None, fault
