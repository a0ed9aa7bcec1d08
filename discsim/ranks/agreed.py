"""Collective handling of errors: an exception on one rank is raised on all ranks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from discsim.ranks.comm import Comm


def on_root(comm: Comm, do: Callable[[], Any]) -> Any:
    """Call `do` on rank 0 only; return its result on all ranks, or raise its exception on all."""
    value, raised = comm.mpi.bcast(_result_or_exception(do) if comm.rank == 0 else None)
    if raised is not None:
        raise raised
    return value


def raise_together(comm: Comm, do: Callable[[], Any]) -> Any:
    """Call `do` on each rank, and return the rank's own result.

    If `do` raises on some ranks, the exception of the first of these is raised on all. `do` must not communicate.
    """
    value, fault = _result_or_exception(do)
    if comm.reduced(fault is not None, MPI.MAX):
        raise next(raised for raised in comm.mpi.allgather(fault) if raised is not None)
    return value


def _result_or_exception(do: Callable[[], Any]) -> tuple[Any, BaseException | None]:
    try:
        return do(), None
    except Exception as fault:
        return None, fault
