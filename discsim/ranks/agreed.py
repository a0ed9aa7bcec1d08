"""Collective handling of errors: an exception on one rank is raised on all ranks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from discsim.ranks.comm import Comm


def led(comm: Comm, do: Callable[[], Any]) -> Any:
    """Call `do` on the leading rank alone; return its result on all ranks, or raise its exception on all."""
    value, raised = comm.mpi.bcast(_tried(do) if comm.rank == 0 else None)
    if raised is not None:
        raise raised
    return value


def raise_together(comm: Comm, do: Callable[[], Any]) -> Any:
    """Call `do` on each rank and return its own result, or raise the exception of the first rank that has one on all.

    `do` must not wait for other ranks.
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
