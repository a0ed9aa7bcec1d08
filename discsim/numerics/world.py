"""Interface of the communication between the processes of a run.

In serial runs every method is a no-op (`Alone`); `discsim/ranks` installs an implementation for several MPI ranks.
Local particles are those that this process owns; ghosts are copies of particles of other processes. Minima, maxima and
sums of integers are exact, so they do not depend on the division of particles among processes. Sums of floats use
`numerics/totals.py`. All methods are collective: every process has to call them in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from discsim.numerics.state import Particles, State

Array = np.ndarray


class Needed(NamedTuple):
    """Cells near a process, with a mask of those whose particles it needs; arrays are (cells,).

    mask: whether the particles in a cell are needed. begin, end: range of cell numbers on the whole grids that a cell
    covers; both ascend.
    """

    mask: Array
    begin: Array
    end: Array


class Joined(Protocol):
    """Protocol of the local particles of a species combined with ghosts.

    own: index (slice or rows) of the local particles in combined arrays. global_index (n,): keys of the order of
    summation; None: the order of the arrays.
    """

    @property
    def own(self) -> Any: ...

    @property
    def global_index(self) -> Array | None: ...

    def of(self, array: Array) -> Array:
        """Return a combined array: `array` (n, ...) of local particles with the entries of ghosts."""
        ...

    def keep(self, array: Array, both: Array) -> None:
        """Copy the local entries of a combined array, `both`, to `array` (n, ...)."""
        ...


class Fetched(Joined, Protocol):
    """Protocol of local particles combined with ghosts, whose entries can be fetched again from their owners."""

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """Return combined arrays of several `arrays`, as `of`, in one exchange."""
        ...

    def beside(self, array: Array) -> Array:
        """Return a combined array with the local entries of `array` and uninitialised ghost entries."""
        ...

    def refresh(self, array: Array) -> None:
        """Fetch the ghost entries of a combined array from their owners, in place."""
        ...


class Whole:
    """`Fetched` without ghosts, for one process."""

    own: Any = slice(None)
    global_index: Array | None = None

    def of(self, array: Array) -> Array:
        return array

    def of_all(self, arrays: list[Array]) -> list[Array]:
        return arrays

    def beside(self, array: Array) -> Array:
        return array

    def refresh(self, array: Array) -> None:
        pass

    def keep(self, array: Array, both: Array) -> None:
        pass


class Alone:
    """Communication of a single process, with no-ops; its methods define the interface for several processes."""

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
        """Return `do()`. If it raises an exception on one process, the exception is raised on all.

        `do` must not communicate.
        """
        return do()

    def forget(self) -> None:
        """Drop caches that depend on positions, order or owners of particles, before these change."""

    def forget_positions(self) -> None:
        """Drop caches that depend on positions alone, after these change."""

    def settle(self, state: State) -> None:
        """Send particles that have moved to the processes that now own them."""

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates, (2,) each, of local positions `pos` (n, d).

        find: function that computes them, called as `find(pos)` if they are not cached.
        """
        return find(pos)

    def reuse_removed_keys(self, global_index: Array, gone: Array, unsorted_rows: Array) -> Array:
        """Give the keys of removed particles to the last particles of all processes, which fill the gaps.

        The global order is then as after `Particles.remove` on one process. global_index (n,): keys of local particles,
        changed in place; they ascend except in the rows `unsorted_rows`. gone: local rows to be removed. Return the
        local rows that got a new key.
        """
        raise NotImplementedError("one process has no places")

    def everyone(self, particles: Particles) -> Joined:
        """Return the particles of all processes combined, on every process; arrays are in the global order."""
        return Whole()

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Needed]) -> Fetched:
        """Return local particles combined with ghosts: all particles of other processes in the cells `needed()`.

        key (n,): cell number of each local particle.
        """
        return Whole()

    def sph(self, kind: Any, scene: Any) -> Any:
        """Return an object for SPH sums over the particles of all processes; kind: its class for one process."""
        return kind(scene)

    def sample(self, columns: Array, global_index: Array | None, some: Array) -> Array:
        """Return the values (m, columns) of a subset of the particles of all processes, in the global order.

        columns: values of the local particles in the subset, a row for each. global_index (n,): keys of all local
        particles. some: rows of the local particles in the subset.
        """
        return columns


processes: Any = Alone()


def set_processes(world: Any) -> None:
    """Set `world` as the communication of this process, `processes`."""
    global processes
    processes = world


@contextmanager
def without_communication() -> Iterator[None]:
    """Disable communication within the context, for work that every process does in full."""
    joined = processes
    set_processes(Alone())
    try:
        yield
    finally:
        set_processes(joined)
