"""What the processes of a run know together. A run is one process, for which all this is nothing at all, unless
`discsim/ranks` has joined several.

Least, largest and sums of whole numbers are exact, and so the same however particles are divided among the processes;
sums of other numbers go through `numerics/totals.py`. Each process has to ask, in the same order.
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
    """Which cells (cells,) of a process's own part are needed there, and what numbers each has among all: from `begin`
    up to `end` (cells,), both rising.
    """

    mask: Array
    begin: Array
    end: Array


class Joined(Protocol):
    """Particles of a species, own ones and those of other processes that are needed here.

    own: where in arrays of both its own are. place (n,): the order in which sums go through them; None: that of arrays.
    """

    @property
    def own(self) -> Any: ...

    @property
    def place(self) -> Array | None: ...

    def of(self, array: Array) -> Array:
        """An array (n, ...) of own particles, with the same of the others."""
        ...

    def keep(self, array: Array, both: Array) -> None:
        """Let own entries be those of an array of both."""
        ...


class Fetched(Joined, Protocol):
    """The same, where what becomes of the particles goes on from one to the other."""

    def of_all(self, arrays: list[Array]) -> list[Array]:
        """As `of`, of several arrays at once."""
        ...

    def beside(self, array: Array) -> Array:
        """An array of both with own entries, and others' that mean nothing yet."""
        ...

    def refresh(self, array: Array) -> None:
        """Take the others' entries of an array of both, in place, from where they are own."""
        ...


class Whole:
    """`Fetched` of one process: its own."""

    own: Any = slice(None)
    place: Array | None = None

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
    """One process."""

    many = False
    balance = 1.0  # how much the most loaded process has to do, over the mean

    def least(self, values: Any) -> Any:
        """The least of each of `values`, a number or an array."""
        return values

    def most(self, values: Any) -> Any:
        """The largest of each."""
        return values

    def sum(self, values: Any) -> Any:
        """The sum of each, of whole numbers."""
        return values

    def alike(self, do: Callable[[], Any]) -> Any:
        """What `do` returns, which asks no other process; raises what it raises on any of them."""
        return do()

    def forget(self) -> None:
        """Let go of what was made of particles where they were, before they are put in another order or place."""

    def settle(self, state: State) -> None:
        """Bring particles to the processes that they belong to, once they have moved."""

    def corners(self, pos: Array, find: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array]:
        """What `find` finds of this process's places (n, d): least and largest coordinates (2,)."""
        return find(pos)

    def close_up(self, place: Array, gone: Array, loose: Array) -> Array:
        """Before the rows `gone` are removed, give their places to the last ones of all processes, as
        `Particles.remove` does: `place` (n,), which rises but for the rows `loose`, becomes what it is then. Returns
        the rows that got another one.
        """
        raise NotImplementedError("one process has no places")

    def everyone(self, particles: Particles) -> Joined:
        """All particles of a species, with arrays in the order of all."""
        return Whole()

    def in_cells(self, particles: Any, key: Array, needed: Callable[[], Needed]) -> Fetched:
        """Own particles, whose cells are `key` (n,), and all in the cells that are `needed()`."""
        return Whole()

    def sph(self, kind: Any, scene: Any) -> Any:
        """SPH sums over the particles of all processes; `kind` makes those of one."""
        return kind(scene)

    def sample(self, columns: Array, place: Array | None, some: Array) -> Array:
        """Rows (m, columns) of the particles `some` of `place`, of all processes, in the order of all."""
        return columns


together: Any = Alone()


def join(world: Any) -> None:
    """Let `world` answer from now on."""
    global together
    together = world


@contextmanager
def apart() -> Iterator[None]:
    """Within it this process asks no others: of what it has the whole of, as the others have."""
    joined = together
    join(Alone())
    try:
        yield
    finally:
        join(joined)
