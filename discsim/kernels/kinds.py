"""What kernels of the drag are given: gas and dust sorted into blocks, and the law."""

from typing import NamedTuple

import numpy as np


class Species(NamedTuple):
    """The particles of the gas, or of the dust of all its populations, as they are in the state; `own` sources and
    `density` may have no entries; of dust whose grains have sizes of their own `density` is the stopping time over that
    of the class. `order` and `start` have them by block and, within it, by population (`number` of
    these, from the `first` species on, of which the gas is species 0).
    """

    pos: np.ndarray
    vel: np.ndarray
    acc: np.ndarray
    own: np.ndarray
    mass: np.ndarray
    density: np.ndarray
    sound: np.ndarray
    order: np.ndarray
    start: np.ndarray
    number: int
    first: int


class Law(NamedTuple):
    """The drag over a step: the law's `code` and `grains`, one way or both, the step and how it is integrated."""

    code: int
    grains: np.ndarray
    two_way: bool
    dt: float
    exponential: bool
