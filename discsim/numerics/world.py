"""Interface of the communication between the processes of a run.

In serial runs every method is a no-op (`Alone`); `discsim/ranks` installs an implementation for several MPI ranks.
Minima, maxima and sums of integers are exact, and so independent of the division of particles among processes; sums of
floats go through `numerics/totals.py`. All methods are collective: every process has to call them in the same order.
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
    """Cells (cells,) of the part of the grids about a process, and those whose particles it needs.

    mask: whether the particles of a cell are needed. begin, end: range of numbers of the cell on the whole grids, both
    rising.
    """

    mask: Array
    begin: Array
    end: Array


class Joined(Protocol):
    """Local particles of a species and ghosts, the particles of other processes that are needed here.

    own: index of local particles in arrays with ghosts. place (n,): keys of the order of summation; None: the order of
    the arrays.
    """

    @property
    def own(self) -> Any: ...

    @property
    def global_index(self) -> Array | None: ...

    def of(self, array: Array) -> Array:
        """Return an array (n, ...) of local particles extended by the entries of ghosts."""
        ...

    def keep(self, array: Array, both: Array) -> None:
        """Copy the local entries of an array with ghosts, `both`, to `array` (n, ...)."""
        ...


class Fetched(Joined, Protocol):
    """Local particles and ghosts whose entries can be updated from their owners."""

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """Extend several arrays by ghosts in one exchange, as `of` does for one."""
        ...

    def beside(self, array: Array) -> Array:
        """Return an array with ghosts: local entries are those of `array`, ghost entries uninitialised."""
        ...

    def refresh(self, array: Array) -> None:
        """Update the ghost entries of an array from their owners, in place."""
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
    """Communication of a single process: no-ops, and the interface of the one for several."""

    many = False  # whether there are several processes
    balance = 1.0  # load of the most loaded process over the mean

    def least(self, values: Any) -> Any:
        """Return the minimum over processes of each of `values`, a number or an array."""
        return values

    def most(self, values: Any) -> Any:
        """Return the maximum over processes of each of `values`."""
        return values

    def sum(self, values: Any) -> Any:
        """Return the sum over processes of each of `values`, integers."""
        return values

    def raise_together(self, do: Callable[[], Any]) -> Any:
        """Call `do`, which must not communicate, and return its result; raise on all processes if it raises on one."""
        return do()

    def forget(self) -> None:
        """Drop caches that depend on the order or the owners of particles, before these change."""

    def forget_positions(self) -> None:
        """Drop caches that depend on positions alone, after these change."""

    def settle(self, state: State) -> None:
        """Migrate particles to their owners after a move."""

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return `find(pos)`, the least and largest coordinates (2,) of local positions (n, d), or a cached result."""
        return find(pos)

    def close_up(self, global_index: Array, gone: Array, unsorted_rows: Array) -> Array:
        """Assign the keys of removed particles to the last ones of all processes, as `Particles.remove` moves these.

        gone: local rows to be removed. place (n,): keys of the global order, changed in place; they rise except in the
        rows `unsorted_rows`. Return the rows with a new key.
        """
        raise NotImplementedError("one process has no places")

    def everyone(self, particles: Particles) -> Joined:
        """Return all particles of a species on every process, with arrays in the global order."""
        return Whole()

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Needed]) -> Fetched:
        """Return local particles, in cells `key` (n,), and as ghosts all particles in the cells of `needed()`."""
        return Whole()

    def sph(self, kind: Any, scene: Any) -> Any:
        """Return the SPH sums over particles of all processes; kind: class of the sums of one process."""
        return kind(scene)

    def sample(self, columns: Array, global_index: Array | None, some: Array) -> Array:
        """Return the rows (m, columns) of a subset of the particles of all processes, in the global order.

        columns (n, columns): local rows of this subset. place (n,): keys of local particles; some: the local subset.
        """
        return columns


processes: Any = Alone()


def join(world: Any) -> None:
    """Install `world` as the communication of this process."""
    global processes
    processes = world


@contextmanager
def apart() -> Iterator[None]:
    """Communicate with no other process within the context, for work that every process does in full."""
    joined = processes
    join(Alone())
    try:
        yield
    finally:
        join(joined)
