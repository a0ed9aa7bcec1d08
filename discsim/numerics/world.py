"""Interface of the communication between the processes of a run.

This module implements it for a single process: most methods return their argument or do nothing. `discsim/ranks`
installs an implementation for several MPI ranks as `processes`. Local particles are those that this process owns;
ghosts are copies of particles of other processes. Minima, maxima and sums of integers are exact, so they do not depend
on the division of particles among processes. Sums of floats use `numerics/totals.py`. All methods are collective unless
their docstring says otherwise: every process has to call them in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray


class NeededCells(NamedTuple):
    """Cells near a process, and whether it needs the particles in each of them; arrays are (cells,).

    mask: True for needed cells. begin, end: a cell consists of the smallest cells `begin` to `end` - 1, in a numbering
    that all processes share; both arrays ascend.
    """

    mask: Array
    begin: Array
    end: Array


class CombinedParticles:
    """Particles of a species: the local ones combined with those of other processes.

    This class is for a single process, where combined arrays are the local arrays themselves; `ranks/exchange.py` has
    subclasses for several. local_rows: index of the local particles in combined arrays, a slice or an array of rows.
    """

    local_rows: Any = slice(None)

    @property
    def global_index(self) -> Array | None:
        """Keys of all particles in combined arrays, in whose order sums are added; None: in the order of the arrays."""
        return None

    def with_ghosts(self, array: Array) -> Array:
        """Return a combined array: the local entries `array` (n, ...), and the same data of other processes."""
        return array

    def set_local(self, array: Array, combined: Array) -> None:
        """Set `array` (n, ...) to the local entries of the array `combined`. Not collective."""


class ParticlesWithGhosts(CombinedParticles):
    """Local particles of a species combined with ghosts, whose data can be fetched repeatedly."""

    def all_with_ghosts(self, arrays: list[Array]) -> list[Array]:
        """Return `with_ghosts` of each array, in one exchange."""
        return arrays

    def with_empty_ghosts(self, array: Array) -> Array:
        """Return a combined array with the local entries `array` and uninitialised ghost entries. Not collective."""
        return array

    def update_ghosts(self, combined: Array) -> None:
        """Fetch the ghost entries of the array `combined` from their owners, in place."""


class SerialComm:
    """Communication of a single process."""

    is_parallel = False  # whether there are several processes
    balance = 1.0  # load of the most loaded process over the mean

    def min(self, values: Any) -> Any:
        """Return the element-wise minimum of `values`, a number or an array, over all processes."""
        return values

    def max(self, values: Any) -> Any:
        """Return the element-wise maximum of `values`, a number or an array, over all processes."""
        return values

    def sum(self, values: Any) -> Any:
        """Return the element-wise sum of `values`, an integer or an array of integers, over all processes."""
        return values

    def raise_on_all(self, do: Callable[[], Any]) -> Any:
        """Return `do()`. If it raises an exception on one process, the exception is raised on all.

        `do` must not communicate.
        """
        return do()

    def drop_caches(self) -> None:
        """Drop all caches that depend on positions, order or owners of particles. Not collective."""

    def drop_position_caches(self) -> None:
        """Drop caches that depend on positions alone; results of the last kick are kept. Not collective."""

    def migrate(self, state: State) -> None:
        """Send particles that have left the space of their process to the processes that now own them."""

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates, (2,) each, of local positions `pos` (n, d). Not collective.

        find: function that computes the coordinates, called as `find(pos)` if they are not cached.
        """
        return find(pos)

    def reuse_removed_keys(self, global_index: Array, gone: Array, unsorted_rows: Array) -> Array:
        """Give the keys of removed particles to the last particles of all processes, which fill the gaps.

        The global order is then as after `Particles.remove` on one process. global_index (n,): keys of local
        particles, changed in place; the keys ascend except in the rows `unsorted_rows`. gone: local rows to be
        removed. Return the local rows that got a new key.
        """
        raise NotImplementedError("particles of a single process have no keys")

    def allgather(self, particles: Particles) -> CombinedParticles:
        """Return the particles of all processes combined, on every process; arrays are in the global order."""
        return CombinedParticles()

    def fetch_ghosts(self, particles: Any, key: Array, needed: Callable[[], NeededCells]) -> ParticlesWithGhosts:
        """Return local particles combined with ghosts: all particles of other processes in the cells `needed()`.

        key (n,): cell of each local particle, an index of the arrays of `needed()`.
        """
        return ParticlesWithGhosts()

    def make_sph(self, kind: Any, scene: Any) -> Any:
        """Return an object for SPH sums over the particles of all processes. Not collective.

        kind: class of the object for a single process.
        """
        return kind(scene)

    def gather_sample(self, columns: Array, global_index: Array | None, rows: Array) -> Array:
        """Return values (m, k) of a sample of the particles of all processes, in the global order.

        columns (n, k): values of the local particles in the sample. global_index: keys of all local particles. rows
        (n,): rows of the local particles in the sample.
        """
        return columns


processes: Any = SerialComm()


def set_processes(comm: Any) -> None:
    """Set `comm` as the communication of this process, `processes`."""
    global processes
    processes = comm


@contextmanager
def without_communication() -> Iterator[None]:
    """Use the communication of a single process within the context, for work that every process does in full."""
    parallel = processes
    set_processes(SerialComm())
    try:
        yield
    finally:
        set_processes(parallel)
