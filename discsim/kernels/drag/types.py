"""Arguments of the drag kernels: gas and dust sorted into blocks, and the law."""

from typing import NamedTuple

import numpy as np


class Species(NamedTuple):
    """Particles of the gas, or of all populations of dust, as arrays of the state.

    own (n, d): accelerations of this species alone, or empty. density (n,): may be empty; if grains have individual
    sizes, it is the stopping time of each over that of its class. order, start: particles sorted by block and, within
    a block, by population. number: populations. first: species of the first population; the gas is species 0.
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
    """Drag over a step dt: `code` and `grains` of the law (`formulas/laws.py`), direction and integrator.

    exponential: exact exponential, else implicit Euler.
    """

    code: int
    grains: np.ndarray
    two_way: bool
    dt: float
    exponential: bool
