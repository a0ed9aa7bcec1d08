"""Interface of the communication between the processes of a run.

In serial runs every method is a no-op (`SerialComm`); `discsim/ranks` installs an implementation for several MPI ranks.
Local particles are owned by this process; ghosts are copies of particles of other processes. Minima, maxima and sums of
integers are exact, so they do not depend on the division of particles among processes. Sums of floats use
`numerics/totals.py`. All methods are collective: every process has to call them in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray


class Needed(NamedTuple):
    """Cells near the particles of this process, and which of them have particles that it needs; arrays are (cells,).

    mask: whether the process needs the particles in a cell. begin, end: range of cell numbers that a cell covers on the
    grids of all processes; `begin` and `end` ascend.
    """

    mask: Array
    begin: Array
    end: Array


class NoGhosts:
    """Local particles of a species combined with ghosts, on a single process, which has none.

    The methods define the interface for several processes (`discsim/ranks/exchange.py`). Combined arrays have the
    entries of local particles and of ghosts; here they are the arrays of the particles themselves. own: index of the
    local particles in combined arrays, a slice or rows. global_index (n,): keys that give the order of summation; None:
    the order of the arrays.
    """

    own: Any = slice(None)
    global_index: Array | None = None

    def of(self, array: Array) -> Array:
        """Return the combined array of `array` (n, ...), which has the local particles."""
        return array

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """Return the combined arrays of several `arrays`, as `of`, with a single exchange."""
        return arrays

    def beside(self, array: Array) -> Array:
        """Return a combined array with the local entries of `array` (n, ...) and uninitialised ghost entries."""
        return array

    def refresh(self, array: Array) -> None:
        """Set the ghost entries of the combined array `array` to the present values of their owners."""

    def keep(self, array: Array, both: Array) -> None:
        """Copy the local entries of the combined array `both` to `array` (n, ...)."""


class SerialComm:
    """Communication of a single process: no-ops. Its methods define the interface for several processes."""

    many = False  # whether there are several processes
    balance = 1.0  # load of the most loaded process over the mean

    def least(self, values: Any) -> Any:
        """Return the element-wise minimum over all processes of `values`, a number or an array."""
        return values

    def most(self, values: Any) -> Any:
        """Return the element-wise maximum over all processes of `values`, a number or an array."""
        return values

    def sum(self, values: Any) -> Any:
        """Return the element-wise sum over all processes of `values`, an integer or an array of integers."""
        return values

    def raise_together(self, do: Callable[[], Any]) -> Any:
        """Return `do()`, or raise its exception; an exception on one process is raised on all processes.

        `do` must not communicate.
        """
        return do()

    def forget(self) -> None:
        """Drop caches that depend on positions, order or owners of particles; call it before these change."""

    def forget_positions(self) -> None:
        """Drop caches that depend on positions alone; call it after positions have changed."""

    def migrate(self, state: State) -> None:
        """Send particles that have moved to the processes that now own them."""

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates, (2,) each, of local positions `pos` (n, d).

        find: function that computes the two from `pos`, for processes without a cached result.
        """
        return find(pos)

    def reuse_removed_keys(self, global_index: Array, gone: Array, unsorted_rows: Array) -> Array:
        """Give the keys of removed particles, in `global_index`, to the last particles in the global order.

        The global order is then as after `Particles.remove` on one process. global_index (n,): keys of local particles,
        changed in place; they ascend, except in the rows `unsorted_rows`. gone: local rows that will be removed. Return
        the local rows with a new key.
        """
        raise NotImplementedError("a single process has no global_index")

    def everyone(self, particles: Particles) -> NoGhosts:
        """Return the particles of all processes combined, on every process; arrays are in the global order.

        The result has only the methods `of`, `of_all` and `keep`.
        """
        return NoGhosts()

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Needed]) -> NoGhosts:
        """Return local particles combined with ghosts, which are all particles of other processes in the needed cells.

        key (n,): cell number of each local particle. needed: function that returns the needed cells.
        """
        return NoGhosts()

    def sph(self, kind: Any, scene: Any) -> Any:
        """Return an object for SPH sums over the particles of all processes; kind: its class in serial runs."""
        return kind(scene)

    def sample(self, columns: Array, global_index: Array | None, some: Array) -> Array:
        """Return values (m, columns) of a subset of the particles of all processes, in the global order.

        columns: values of the local particles in the subset, a row for each. global_index (n,): keys of all local
        particles. some: rows of the local particles in the subset.
        """
        return columns


processes: Any = SerialComm()


def set_processes(comm: Any) -> None:
    """Set the communication of this process, `processes`, to `comm`."""
    global processes
    processes = comm


@contextmanager
def without_communication() -> Iterator[None]:
    """Disable communication within the context, for functions whose arrays already contain all ghosts they need."""
    before = processes
    set_processes(SerialComm())
    try:
        yield
    finally:
        set_processes(before)
